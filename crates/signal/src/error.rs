//! Signals that cannot be made.

/// A signal that cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SignalError {
    /// Noise that a signal cannot get.
    #[error("noise on `{channel}`: {cause}")]
    Noise {
        /// The signal.
        channel: String,
        /// Its fault.
        cause: Box<SignalError>,
    },
    /// A signal has at least one sample.
    #[error("0 samples asked for; ask for at least 1")]
    NoSamples,
    /// More samples than one call makes.
    #[error("{asked} samples asked for; ask for at most {most}")]
    TooManySamples {
        /// The requested number.
        asked: usize,
        /// The largest number there may be.
        most: usize,
    },
    /// The signal with these options does not fit into the requested samples.
    #[error(
        "{signal} with these options needs {needed} samples, {got} asked for; ask for more samples or shorten it by its options"
    )]
    TooFewSamples {
        /// The signal's registry name.
        signal: &'static str,
        /// The least number of samples.
        needed: usize,
        /// The requested number.
        got: usize,
    },
    /// An option's value is outside its range.
    #[error("{signal}: option {option} is {value}; it must be {allowed}")]
    Option {
        /// The signal's registry name.
        signal: &'static str,
        /// The option's name.
        option: &'static str,
        /// The given value.
        value: f64,
        /// Its range.
        allowed: Allowed,
    },
    /// A pair of values (a band, two levels) is not in ascending order.
    #[error("{signal}: option {option} is [{low}, {high}]; the first must be below the second")]
    Order {
        /// The signal's registry name.
        signal: &'static str,
        /// The option's name.
        option: &'static str,
        /// The first value.
        low: f64,
        /// The second value.
        high: f64,
    },
    /// No line of the periodic signal's spectrum lies in its band.
    #[error(
        "multisine: no {harmonics} line of a period of {period} samples lies in the band [{low}, {high}] of Nyquist; \
         widen the band or lengthen the period"
    )]
    NoLines {
        /// Which lines were allowed: `all` or `odd`.
        harmonics: &'static str,
        /// The period, in samples.
        period: usize,
        /// Lower edge of the band, as a fraction of the Nyquist frequency.
        low: f64,
        /// Upper edge of the band, as a fraction of the Nyquist frequency.
        high: f64,
    },
    /// The band holds fewer lines than requested.
    #[error(
        "multisine: {asked} lines asked for and {available} lie in the band; ask for fewer, widen the band or lengthen the period"
    )]
    TooFewLines {
        /// The requested number.
        asked: usize,
        /// The number that the band holds.
        available: usize,
    },
    /// A value of the signal that noise is to be added to is not a number.
    #[error("sample {index} of the signal is {value}; noise can only be added to finite values")]
    NotFinite {
        /// The sample's index, from 0.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// A signal that does not vary has no signal-to-noise ratio.
    #[error(
        "the signal is constant over its {samples} samples, so no noise gives it the ratio {snr}; give a signal that varies, or an infinite ratio for no noise"
    )]
    Constant {
        /// The signal's length.
        samples: usize,
        /// The requested ratio.
        snr: f64,
    },
    /// The signal's variance is no finite number above zero although its values are finite.
    #[error(
        "the noise for a signal of variance {variance} at the ratio {snr} is not representable; rescale the signal"
    )]
    Scale {
        /// The signal's variance.
        variance: f64,
        /// The requested ratio.
        snr: f64,
    },
    /// The noise filter's autoregressive part does not decay.
    #[error(
        "the noise filter has a pole at radius {radius}; its autoregressive coefficients must put every pole inside the unit circle"
    )]
    UnstableNoise {
        /// The largest pole's distance from zero.
        radius: f64,
    },
}

/// The range of an option's value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Allowed {
    /// Any finite number.
    Finite,
    /// A finite number above zero.
    Positive,
    /// Anything above zero, infinity included.
    PositiveOrInfinite,
    /// From the first to the second, both included.
    Between(f64, f64),
    /// At least this.
    AtLeast(f64),
    /// Zero for an automatic choice, or from the first to the second, both included.
    ZeroOrBetween(f64, f64),
}

impl std::fmt::Display for Allowed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Finite => write!(f, "finite"),
            Self::Positive => write!(f, "finite and above 0"),
            Self::PositiveOrInfinite => write!(f, "above 0"),
            Self::Between(low, high) => write!(f, "from {low} to {high}"),
            Self::AtLeast(low) => write!(f, "at least {low}"),
            Self::ZeroOrBetween(low, high) => {
                write!(f, "from {low} to {high}, or 0 for an automatic choice")
            }
        }
    }
}
