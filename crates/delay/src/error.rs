//! Errors that prevent the setup of an estimation.

use deadtime_identify::IdentifyError;
use deadtime_identify::matching::MatchingError;
use deadtime_identify::structured::StructuredError;
use deadtime_log::LogError;
use deadtime_model::DerivedError;
use deadtime_model::ModelError;
use deadtime_model::effect::EffectError;
use deadtime_model::simulate::SimulateError;
use deadtime_signal::SignalError;
use deadtime_signal::file::FileError;
use deadtime_signal::flatten;
use deadtime_signal::registry::RegistryError;
use deadtime_signal::remedied;
use deadtime_signal::remedy::{Message, Remedied, Remedy};
use deadtime_signal::stop::Stopped;
use deadtime_signal::sum;
use deadtime_signal::time::TimeError;

sum!(
    /// Any error of dead-time estimation.
    Error {
        Identify(IdentifyError),
        Structured(StructuredError),
        Matching(MatchingError),
        Model(ModelError),
        Derived(DerivedError),
        Simulate(SimulateError),
        Effect(EffectError),
        Signal(SignalError),
        Log(LogError),
        File(FileError),
        Time(TimeError),
        Registry(RegistryError),
        Stopped(Stopped);
        by hand Delay(DelayError)
    }
);

flatten!(deadtime_log::Error => Error { Log, File, Time });
flatten!(deadtime_model::Error => Error { Model, Derived, Simulate, Effect, Signal, Log, File, Time });
flatten!(deadtime_identify::Error => Error { Identify, Structured, Matching, Model, Derived, Simulate, Effect, Signal, Log, File, Time, Registry, Stopped });

impl From<DelayError> for Error {
    fn from(error: DelayError) -> Self {
        match error {
            DelayError::Stopped => Stopped.into(),
            other => Self::Delay(other),
        }
    }
}

/// The result of an estimation.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// An estimation that cannot be set up.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DelayError {
    /// Fewer samples than the regression needs.
    #[error("{}", self.remedied().unwrap_or_default())]
    TooShort {
        /// The method.
        method: &'static str,
        /// Samples it needs.
        needed: usize,
        /// Samples of the longest record.
        got: usize,
        /// The options that would make the record long enough.
        remedy: LengthRemedy,
    },
    /// A channel that never changes.
    #[error(
        "{role} `{channel}` never changes (it is {value} throughout); a dead time shows only where it moves"
    )]
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
        /// The counted items.
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
        /// The valid range.
        allowed: &'static str,
    },
    /// Linearly dependent regressors, where the coefficients themselves are required.
    #[error(
        "{method}: the lags of the inputs are combinations of each other; use inputs that move more, and not together"
    )]
    Dependent {
        /// The method.
        method: &'static str,
    },
    /// A method that needs a model and measured states got none.
    #[error("{}", self.remedied().unwrap_or_default())]
    NoStates {
        /// The method.
        method: &'static str,
    },
    /// Event times that do not increase.
    #[error(
        "event {event} of `{channel}` is at {time}, not behind the one before it ({before}); event times must increase"
    )]
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
    /// A channel named more than once.
    #[error("`{channel}` is given twice: name every input and every output once")]
    Twice {
        /// The channel.
        channel: String,
    },
    /// An error in a log's channels.
    #[error("{}", self.remedied().unwrap_or_default())]
    In {
        /// The log.
        log: String,
        /// The error.
        error: Box<DelayError>,
    },
    /// A search window of zero length, or longer than the record.
    #[error("{}", self.remedied().unwrap_or_default())]
    MaxDelay {
        /// The requested window, s.
        seconds: f64,
        /// The sample time, s.
        step_s: f64,
        /// Samples of the longest record.
        samples: usize,
    },
    /// A delay of a channel that is no input.
    #[error("a delay is given for `{input}`, which is no input; there are: {}", inputs.join(", "))]
    NoInput {
        /// The name.
        input: String,
        /// The inputs.
        inputs: Vec<String>,
    },
    /// A search window of a frequency response of zero length, or longer than its frequency spacing resolves.
    #[error("{}", self.remedied().unwrap_or_default())]
    Turns {
        /// The requested window, s.
        seconds: f64,
        /// Delays at this distance are aliases, s.
        unambiguous_s: f64,
    },
    /// A search window of zero length, for event times.
    #[error("{}", self.remedied().unwrap_or_default())]
    NoWindow,
    /// A method for another kind of data.
    #[error("{}", self.remedied().unwrap_or_default())]
    WrongScope {
        /// The method.
        method: &'static str,
        /// `true`: the method needs event times, and samples were given; `false`: the other way round.
        events: bool,
    },
    /// A model as equations.
    #[error(
        "model {model} is written as equations; estimation needs a linear one (kind = \"lti\")"
    )]
    Equations {
        /// The model.
        model: String,
    },
    /// A sampled model of another sample time than the log's.
    #[error("model {model} and log: {error}")]
    ModelGrid {
        /// The model.
        model: String,
        /// The two sample times.
        error: TimeError,
    },
    /// A single event has no interval.
    #[error("{log}: `{channel}` holds one event; at least two are needed")]
    OneEvent {
        /// The log.
        log: String,
        /// The channel.
        channel: String,
    },
    /// Events whose typical interval gives no valid sample time.
    #[error("{log}: the intervals between events of `{channel}`: {error}")]
    Intervals {
        /// The log.
        log: String,
        /// The channel.
        channel: String,
        /// The error of 1 % of the typical interval as a sample time.
        error: TimeError,
    },
    /// The work was cancelled.
    #[error("stopped before it was done")]
    Stopped,
}

/// Remedies for a record that is too short.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthRemedy {
    /// A shorter search window.
    Window,
    /// A shorter search window, or these options of the method.
    WindowOr(&'static str),
    /// More events at both places.
    Events,
}

remedied!(Error { Delay, Identify, Log });

impl Remedied for DelayError {
    fn remedied(&self) -> Option<Message> {
        let said = |text: String| Message::from(text);
        Some(match self {
            Self::TooShort { method, needed, got, remedy } => {
                let short = said(format!(
                    "{method} needs at least {needed} samples for these orders and this search window, the longest record has {got}; "
                ));
                match remedy {
                    LengthRemedy::Window => short.and("search a shorter ").and(Remedy::MaxDelay),
                    LengthRemedy::WindowOr(options) => short.and("search a shorter ").and(Remedy::MaxDelay).and(format!(", or {options}")),
                    LengthRemedy::Events => short.and("record more events at both places"),
                }
            }
            Self::NoStates { method } => said(format!("{method} needs a model and a measured channel for each of its states; give "))
                .and(Remedy::Model)
                .and(" and name the columns as the states are named (")
                .and(Remedy::Rename)
                .and(")"),
            Self::In { log, error } => said(format!("{log}: ")).and(error.message()),
            Self::MaxDelay { seconds, step_s, samples } => Message::from(Remedy::MaxDelay)
                .and(format!(" {seconds} s: give at least one sample ({step_s} s) and less than the log is long ({samples} samples)")),
            Self::Turns { seconds, unambiguous_s } => Message::from(Remedy::MaxDelay).and(format!(
                " {seconds} s: give more than 0 and at most {unambiguous_s:.4} s, as delays that far apart look alike at these frequencies"
            )),
            Self::NoWindow => Message::from("the window holds no delay: give a longer ").and(Remedy::MaxDelay),
            Self::WrongScope { method, events: true } => said(format!("{method} looks at event times: give ")).and(Remedy::Events),
            Self::WrongScope { method, events: false } => said(format!("{method} looks at samples: give ")).and(Remedy::Channels),
            _ => return None,
        })
    }
}
