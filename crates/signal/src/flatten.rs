//! Errors of one layer as those of the next.

/// The variants of a lower layer's error, each the variant of the same name of this layer's error: `flatten!(lower::Error => Error { Log, File })`.
#[macro_export]
macro_rules! flatten {
    ($lower:path => $upper:ty { $($variant:ident),+ $(,)? }) => {
        impl From<$lower> for $upper {
            fn from(error: $lower) -> Self {
                use $lower as Lower;
                match error {
                    $(Lower::$variant(inner) => Self::$variant(inner),)+
                }
            }
        }
    };
}

/// The sum of a layer's errors, with the message of each: `sum!(/// … Error { Log(LogError), … })`. Variants after `by hand` get no `From`.
#[macro_export]
macro_rules! sum {
    (
        $(#[$doc:meta])*
        $name:ident { $($variant:ident($inner:ty)),+ $(,)? $(; by hand $own:ident($of:ty))? }
    ) => {
        $(#[$doc])*
        #[derive(Debug, thiserror::Error)]
        pub enum $name {
            $(
                #[doc = $crate::sum!(@words $own)]
                #[error(transparent)]
                $own($of),
            )?
            $(
                #[doc = $crate::sum!(@words $variant)]
                #[error(transparent)]
                $variant(#[from] $inner),
            )+
        }
    };
    (@words Delay) => { "An estimation that cannot be set up." };
    (@words Identify) => { "A model that cannot be identified." };
    (@words Structured) => { "A model file's parameters that cannot be fitted." };
    (@words Matching) => { "Two models that cannot be matched." };
    (@words Model) => { "A model that cannot be built, read or converted." };
    (@words Derived) => { "A channel that cannot be calculated from others." };
    (@words Simulate) => { "A simulation that cannot be run." };
    (@words Effect) => { "An effect that cannot be applied." };
    (@words Signal) => { "A signal that cannot be made." };
    (@words Log) => { "A log that cannot be read or used." };
    (@words File) => { "A file that the operating system refuses, or that is no such file." };
    (@words Time) => { "A sample time or delay that cannot be." };
    (@words Registry) => { "A name or option that a registry does not know." };
    (@words Stopped) => { "Nobody waits for the answer any more." };
}
