//! Checks of options, each answering with the facts.

use crate::MOST_SAMPLES;
use crate::error::{Allowed, SignalError};

/// A number of samples that can be made.
pub(super) fn samples(samples: usize) -> Result<(), SignalError> {
    match samples {
        0 => Err(SignalError::NoSamples),
        1..=MOST_SAMPLES => Ok(()),
        asked => Err(SignalError::TooManySamples { asked, most: MOST_SAMPLES }),
    }
}

/// The requested samples hold the signal's whole shape.
pub(super) fn fits(signal: &'static str, needed: usize, got: usize) -> Result<(), SignalError> {
    if got < needed { Err(SignalError::TooFewSamples { signal, needed, got }) } else { Ok(()) }
}

/// A finite number.
pub(super) fn finite(
    signal: &'static str,
    option: &'static str,
    value: f64,
) -> Result<(), SignalError> {
    allowed(signal, option, value, value.is_finite(), Allowed::Finite)
}

/// A finite number above zero.
pub(super) fn positive(
    signal: &'static str,
    option: &'static str,
    value: f64,
) -> Result<(), SignalError> {
    allowed(signal, option, value, value.is_finite() && value > 0.0, Allowed::Positive)
}

/// A whole number, at least `low`.
pub(super) fn at_least(
    signal: &'static str,
    option: &'static str,
    value: usize,
    low: usize,
) -> Result<(), SignalError> {
    allowed(signal, option, value as f64, value >= low, Allowed::AtLeast(low as f64))
}

/// A frequency, as a fraction of the Nyquist frequency.
pub(super) fn fraction(
    signal: &'static str,
    option: &'static str,
    value: f64,
) -> Result<(), SignalError> {
    allowed(signal, option, value, (0.0..=1.0).contains(&value), Allowed::Between(0.0, 1.0))
}

/// A band of frequencies, as fractions of the Nyquist frequency.
pub(super) fn band(signal: &'static str, [low, high]: [f64; 2]) -> Result<(), SignalError> {
    fraction(signal, "band", low)?;
    fraction(signal, "band", high)?;
    ascending(signal, "band", [low, high])
}

/// Two finite levels, the lower first.
pub(super) fn levels(signal: &'static str, [low, high]: [f64; 2]) -> Result<(), SignalError> {
    finite(signal, "levels", low)?;
    finite(signal, "levels", high)?;
    ascending(signal, "levels", [low, high])
}

/// A condition on an option's value, with its range.
pub(super) fn allowed(
    signal: &'static str,
    option: &'static str,
    value: f64,
    holds: bool,
    allowed: Allowed,
) -> Result<(), SignalError> {
    if holds { Ok(()) } else { Err(SignalError::Option { signal, option, value, allowed }) }
}

fn ascending(
    signal: &'static str,
    option: &'static str,
    [low, high]: [f64; 2],
) -> Result<(), SignalError> {
    if low < high { Ok(()) } else { Err(SignalError::Order { signal, option, low, high }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refusals_say_what_where_and_what_to_do() {
        assert_eq!(
            finite("step", "amplitude", f64::NAN).unwrap_err().to_string(),
            "step: option amplitude is NaN; it must be finite"
        );
        assert_eq!(
            at_least("prbs", "clock", 0, 1).unwrap_err().to_string(),
            "prbs: option clock is 0; it must be at least 1"
        );
        assert_eq!(
            band("rbs", [0.5, 0.2]).unwrap_err().to_string(),
            "rbs: option band is [0.5, 0.2]; the first must be below the second"
        );
        assert!(band("rbs", [0.0, 1.5]).is_err() && band("rbs", [f64::NAN, 1.0]).is_err());
        assert!(levels("rbs", [1.0, 1.0]).is_err() && levels("rbs", [0.0, f64::INFINITY]).is_err());
    }
}
