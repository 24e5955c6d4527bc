//! Effects that cannot be applied.

use deadtime_signal::text::did_you_mean;

/// The result of work on effects.
pub(crate) type Result<T, E = EffectError> = std::result::Result<T, E>;

/// An effect that cannot be applied.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EffectError {
    /// No effect has this name.
    #[error("there is no effect `{name}`{}; there are: {known}", did_you_mean(name, known.iter().copied()), known = known.join(", "))]
    Unknown {
        /// The name given.
        name: String,
        /// The known names.
        known: Vec<&'static str>,
    },
    /// The effect cannot act on this channel.
    #[error("{effect} cannot act on `{channel}`; its channels in this model are: {known}", known = known.join(", "))]
    Channel {
        /// The effect.
        effect: &'static str,
        /// The channel given.
        channel: String,
        /// The valid channels.
        known: Vec<String>,
    },
    /// A dynamics effect on a sampled model.
    #[error("{effect} acts on the dynamics of a continuous model; this one is sampled")]
    Sampled {
        /// The effect.
        effect: &'static str,
    },
    /// A dynamics effect on a black-box simulator.
    #[error("{effect} acts on the equations of a model; this simulator can only be called")]
    BlackBox {
        /// The effect.
        effect: &'static str,
    },
    /// The effect has no such parameter.
    #[error("{effect} on `{channel}` has no parameter `{parameter}`; it has: {known}", known = known.join(", "))]
    UnknownParameter {
        /// The effect.
        effect: &'static str,
        /// The channel.
        channel: String,
        /// The parameter given.
        parameter: String,
        /// The valid parameters.
        known: Vec<String>,
    },
    /// A parameter without a default is missing.
    #[error(
        "{effect} on `{channel}`: parameter `{parameter}` is missing; only a limit that does not act may be left out"
    )]
    MissingParameter {
        /// The effect.
        effect: &'static str,
        /// The channel.
        channel: String,
        /// The parameter.
        parameter: String,
    },
    /// A value outside its bounds.
    #[error("{effect} on `{channel}`: {parameter} is {value}; it lies between {lower} and {upper}")]
    Bounds {
        /// The effect.
        effect: &'static str,
        /// The channel.
        channel: String,
        /// The parameter.
        parameter: String,
        /// The value given.
        value: f64,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// Limits without a value between them.
    #[error(
        "{effect} on `{channel}`: lower is {lower}, upper is {upper}; lower must be the smaller one"
    )]
    Limits {
        /// The effect.
        effect: &'static str,
        /// The channel.
        channel: String,
        /// The lower limit.
        lower: f64,
        /// The upper limit.
        upper: f64,
    },
}
