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
