//! What keeps an estimation from being set up at all.

/// An estimation that cannot be set up.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DelayError {
    /// Fewer samples than the regression needs.
    #[error("{method} needs at least {needed} samples for these orders and this search window, the longest record has {got}; {remedy}")]
    TooShort {
        /// The method.
        method: &'static str,
        /// Samples it needs.
        needed: usize,
        /// Samples of the longest record.
        got: usize,
        /// Which options would make it fit.
        remedy: &'static str,
    },
    /// A channel that never changes.
    #[error("{role} `{channel}` never changes (it is {value} throughout); a dead time shows only where it moves")]
    Constant {
        /// Input or output.
        role: &'static str,
        /// The channel.
        channel: String,
        /// Its value.
        value: f64,
    },
    /// A sample that is NaN or infinite.
    #[error("{role} `{channel}` is {value} at sample {sample}; every sample must be finite")]
    NotFinite {
        /// Input, output or state.
        role: &'static str,
        /// The channel.
        channel: String,
        /// Sample, counted from 0.
        sample: usize,
        /// The value.
        value: f64,
    },
    /// Records or channels of lengths that do not fit.
    #[error("{what}: {got} given, {needed} needed")]
    Count {
        /// What is counted.
        what: &'static str,
        /// How many there should be.
        needed: usize,
        /// How many there are.
        got: usize,
    },
    /// An option out of its range.
    #[error("{method}: {option} = {value}; it must be {allowed}")]
    Option {
        /// The method.
        method: &'static str,
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        allowed: &'static str,
    },
    /// Regressors that are combinations of each other, where the coefficients themselves were asked for.
    #[error("{method}: the lags of the inputs are combinations of each other; use inputs that move more, and not together")]
    Dependent {
        /// The method.
        method: &'static str,
    },
    /// A method that needs a model and measured states got none.
    #[error(
        "{method} needs a model and a measured channel for each of its states; give --model and name the columns as the states are named (--map)"
    )]
    NoStates {
        /// The method.
        method: &'static str,
    },
    /// Event times that do not increase.
    #[error("event {event} of `{channel}` is at {time}, not behind the one before it ({before}); event times must increase")]
    EventOrder {
        /// The channel.
        channel: String,
        /// Event, counted from 0.
        event: usize,
        /// Time of the event before it.
        before: f64,
        /// Its time.
        time: f64,
    },
    /// Two sequences of event times in different units.
    #[error(
        "event times in {first} and in {second}: their differences mean nothing; convert one of them, or set units=standardise where both clocks begin at the same instant"
    )]
    Units {
        /// Unit of the first sequence.
        first: String,
        /// Unit of the second.
        second: String,
    },
}
