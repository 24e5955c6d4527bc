//! Errors that prevent the identification of a model from a log.

use crate::matching::error::MatchingError;
use crate::structured::error::StructuredError;
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
    /// Any error of the identification.
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
        Stopped(Stopped),
    }
);

flatten!(deadtime_log::Error => Error { Log, File, Time });
flatten!(deadtime_model::Error => Error { Model, Derived, Simulate, Effect, Signal, Log, File, Time });

/// The result of an identification.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A model that cannot be identified; every variant holds facts, every message gives the remedy.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// No input or no output was named.
    #[error("no {what} channel is named; name at least one")]
    NoChannel {
        /// Input or output.
        what: &'static str,
    },
    /// One channel in two places.
    #[error("`{channel}` is named twice; each channel is one input or one output")]
    Twice {
        /// The channel.
        channel: String,
    },
    /// A constant channel.
    #[error("`{channel}` never changes in the training data: {remedy}")]
    Constant {
        /// The channel.
        channel: String,
        /// The remedy for an input, or for an output.
        remedy: &'static str,
    },
    /// Logs of different sample times.
    #[error("{}", self.remedied().unwrap_or_default())]
    SampleTimes {
        /// The log.
        file: String,
        /// Its sample time, s.
        found_s: f64,
        /// That of the first record, s.
        first_s: f64,
    },
    /// Too few rows for the parameters of the long predictor.
    #[error(
        "a past window of {past} samples needs {needed} samples with all of their past, and there are {got}; \
         {remedy}", remedy = remedy(*longest)
    )]
    TooFewRows {
        /// The past window, samples.
        past: usize,
        /// Rows needed.
        needed: usize,
        /// Rows available.
        got: usize,
        /// The longest past window that these data support; 0: none.
        longest: usize,
    },
    /// Inputs of which one is a linear combination of the others.
    #[error(
        "the input `{channel}` is a combination of the other inputs ({others}) at every sample: their effects are indistinguishable; \
             leave it out or move it on its own"
    )]
    Collinear {
        /// The input.
        channel: String,
        /// The others.
        others: String,
    },
    /// An input with a lower order of persistent excitation than the model needs.
    #[error(
        "the inputs are not rich enough: `{channel}` is distinguishable from its own past at {orders} lags only, and an order of {needed} needs more; \
         use an excitation such as a random binary or multisine signal (deadtime excite)"
    )]
    NotRich {
        /// The input.
        channel: String,
        /// The order of persistent excitation.
        orders: usize,
        /// The order that the model needs.
        needed: usize,
    },
    /// An order that the windows cannot resolve.
    #[error(
        "order {order}: a past window of {past} samples shows at most {most} states; choose a smaller order or a longer past"
    )]
    Order {
        /// The requested order.
        order: usize,
        /// The past window, samples.
        past: usize,
        /// Largest number of states.
        most: usize,
    },
    /// Records too short for a frequency response.
    #[error(
        "{method}: a record of at least {needed} samples is needed, and there are {got}; record longer, or lower what its options ask for"
    )]
    TooShort {
        /// The method.
        method: &'static str,
        /// Samples needed.
        needed: usize,
        /// Samples available.
        got: usize,
    },
    /// Inputs without excitation at any frequency.
    #[error(
        "the input `{inputs}` excites no frequency enough for a response and its noise; \
         use an excitation that fills its band, such as a random binary signal (deadtime excite)"
    )]
    NotExcited {
        /// The inputs.
        inputs: String,
    },
    /// Unequal numbers of references and inputs.
    #[error("{references} references for {inputs} inputs; name one reference for each input")]
    References {
        /// References named.
        references: usize,
        /// Inputs named.
        inputs: usize,
    },
    /// References without a significant effect on the inputs.
    #[error(
        "the references do not move the inputs beyond noise at any frequency; name what is fed into the loop from outside, or excite it more"
    )]
    Unmoved,
    /// An option outside its range.
    #[error("{option} is {value}: {rule}")]
    Option {
        /// Which option.
        option: &'static str,
        /// The value.
        value: f64,
        /// The valid range.
        rule: &'static str,
    },
    /// A method for one output, with several outputs.
    #[error(
        "{method} makes a model of one output, and {outputs} are named; run it once for each of them, or use pbsidopt"
    )]
    Outputs {
        /// The method.
        method: &'static str,
        /// Outputs named.
        outputs: usize,
    },
    /// A method for one input, with several inputs.
    #[error(
        "{method} makes a model of one input, and {inputs} are named; riv takes several (common poles), and so does pbsidopt"
    )]
    Inputs {
        /// The method.
        method: &'static str,
        /// Inputs named.
        inputs: usize,
    },
    /// A delay given to a method that estimates the delays itself.
    #[error("{}", self.remedied().unwrap_or_default())]
    OwnDelays {
        /// The method.
        method: &'static str,
    },
    /// No model of the structure fits.
    #[error("{method}: {reason}")]
    Unfit {
        /// The method.
        method: &'static str,
        /// The reason, and the remedy.
        reason: String,
    },
    /// The inputs explain nothing, or a decomposition failed.
    #[error("{method}: {reason}")]
    Numeric {
        /// The method.
        method: &'static str,
        /// The failure.
        reason: &'static str,
    },
}

remedied!(Error { Identify, Log });

impl Remedied for IdentifyError {
    fn remedied(&self) -> Option<Message> {
        Some(match self {
            Self::SampleTimes { file, found_s, first_s } => Message::from(format!(
                "{file}: its sample time is {found_s} s, that of the first record {first_s} s; resample one of them ("
            ))
            .and(Remedy::Resample)
            .and(")"),
            Self::OwnDelays { method } => {
                Message::from(format!("{method} finds the dead times itself, so none is removed first: leave "))
                    .and(Remedy::Delay)
                    .and(" out; of riv `nk=[LAG,…]` in samples says what is known")
            }
            _ => return None,
        })
    }
}

fn remedy(longest: usize) -> String {
    if longest == 0 {
        "record longer, or name fewer channels".to_owned()
    } else {
        format!("record longer, name fewer channels or take a past window of {longest} or less")
    }
}
