//! Frequencies of a match: logarithmically even, denser at resonances of the identified model.

use super::error::MatchingError;
use super::system::System;

/// Frequencies over a band without those of resonances.
const COUNT: usize = 120;
/// Points about a resonance, in units of its half width.
const ABOUT: [f64; 9] = [-3.0, -1.5, -0.75, -0.3, 0.0, 0.3, 0.75, 1.5, 3.0];
/// The default band of a continuous model reaches this factor beyond its slowest and fastest pole.
const BEYOND: f64 = 10.0;
/// Just below the Nyquist frequency, where responses are real and phases jump.
const BELOW_NYQUIST: f64 = 0.99;
/// The default width of a band without other information, as a ratio.
const WIDE: f64 = 1e3;

/// The requested band, or the range that the model determines.
pub(super) fn band(
    target: &System,
    lowest_rad_s: Option<f64>,
    asked: Option<[f64; 2]>,
) -> Result<[f64; 2], MatchingError> {
    let nyquist = target.sample_time_s().map(|ts| std::f64::consts::PI / ts);
    if let Some([low, high]) = asked {
        let wrong = |value: f64, rule: &str| {
            Err(MatchingError::Option { option: "band", value, rule: rule.to_owned() })
        };
        if !(low.is_finite() && low > 0.0) {
            return wrong(low, "it must begin above 0 rad/s");
        }
        if !(high.is_finite() && high > low) {
            return wrong(high, "it must end above its beginning, in rad/s");
        }
        return match nyquist {
            Some(nyquist) if high > nyquist => wrong(
                high,
                &format!("the identified model ends at its Nyquist frequency, {nyquist} rad/s"),
            ),
            _ => Ok([low, high]),
        };
    }
    let rates: Vec<f64> =
        target.poles_s().iter().map(|p| p.norm()).filter(|r| r.is_finite() && *r > 1e-9).collect();
    let (slowest, fastest) =
        rates.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), r| (low.min(*r), high.max(*r)));
    let high = nyquist.map(|n| BELOW_NYQUIST * n).unwrap_or(if fastest > 0.0 {
        BEYOND * fastest
    } else {
        WIDE.sqrt()
    });
    let low =
        lowest_rad_s.unwrap_or(if slowest.is_finite() { slowest / BEYOND } else { high / WIDE });
    Ok([low.min(high / 10.0), high])
}

/// Increasing frequencies of a band, including its ends.
pub(super) fn frequencies(target: &System, [low, high]: [f64; 2]) -> Vec<f64> {
    let even = (0..COUNT).map(|k| low * (high / low).powf(k as f64 / (COUNT - 1) as f64));
    let resonances = target.poles_s().into_iter().filter(|p| p.im > 0.0);
    let about = resonances.flat_map(|p| ABOUT.map(|t| p.im + t * p.re.abs()));
    let mut all: Vec<f64> = even.chain(about).filter(|w| (low..=high).contains(w)).collect();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|b, a| *b - *a <= 1e-9 * *a);
    all
}

/// Each frequency's share of an interval by the trapezoidal rule on `scale` of the frequency.
pub(super) fn widths(omegas: &[f64], scale: impl Fn(f64) -> f64) -> Vec<f64> {
    let at: Vec<f64> = omegas.iter().map(|w| scale(*w)).collect();
    let last = at.len().saturating_sub(1);
    (0..at.len()).map(|k| 0.5 * (at[(k + 1).min(last)] - at[k.saturating_sub(1)])).collect()
}
