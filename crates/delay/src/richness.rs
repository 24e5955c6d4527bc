//! The predicted accuracy: the standard deviation of a delay estimate, predicted before any method runs.
//!
//! Equation: σ_L = σ/‖P⊥ψ‖, the bound of [`super::bound`] for a method's information, at a rough model of the pair. ψ = ∂ŷ/∂L is computed from the measured
//! input, so an input that hides the delay gives a large value for any model.

use statrs::distribution::{ContinuousCDF, Normal};

use super::error::DelayError;
use super::estimator::Search;
use super::experiment::Experiment;
use super::method::WHOLE;
use super::method::{Information, Method};
use super::{bound, posterior};
use crate::process::family::{Rough, rough};
use crate::threshold::impulse::Threshold;
use deadtime_identify::{Record, fir};

/// The predicted accuracy of each method for one pair. `None` where its kind of information has no prediction, or the fit fails.
///
/// Inputs: the experiment of the methods; `bias` of the search as in [`Search`]. Output: seconds; methods that count samples add their resolution, 1/12
/// samples².
///
/// The rough model has two poles (or the method's own number) and any dead time of the window. A quick fit uses at most 4000 samples of each record; the
/// prediction uses gain, poles and noise of the whole records. For [`Information::TwoSensors`] the bound is that of a known band-limited signal with the
/// model's spectrum: the coherence of the pair represents both noises. For [`Information::Response`] it is the spread of the first coefficient above five
/// standard deviations of a finite impulse response, its bias included.
///
/// Assumes: open loop, and a plant that two poles describe roughly. Coloured noise enters by its correlations (Bartlett). The upper bound is the prior standard
/// deviation, the window's width over √12. The bound also applies where the output does not visibly follow the input.
/// Fails when: the method's own assumptions fail. Errors of too small a model, of feedback and of outliers are not included.
/// Cost: some milliseconds at 500 samples, once for all methods.
///
/// # Errors
/// [`DelayError`] for an unusable experiment or pair.
pub fn richness(
    experiment: &Experiment<'_>,
    search: &Search,
    methods: &[&Method],
) -> Result<Vec<Option<Richness>>, DelayError> {
    let records = experiment.pair(0, 0)?;
    let step = experiment.sample_time().seconds();
    let data = Data { records: &records, max_delay: search.max_delay, bias: search.bias(0, 0) };
    let stds = data.stds(methods);
    Ok(methods
        .iter()
        .map(|m| {
            let std = stds.iter().find(|(information, _)| *information == m.information)?.1?;
            // The spread of a first coefficient is already in samples.
            let counts = m.tolerance <= WHOLE && m.information != Information::Response;
            let with_resolution =
                if counts { (std * std + posterior::RESOLUTION).sqrt() } else { std };
            // d(1) ≈ ‖P⊥ψ‖, ψ per sample.
            Some(Richness {
                std_s: step * with_resolution,
                data_std_s: step * std,
                separation: 0.5 / std,
            })
        })
        .collect())
}

/// The predicted accuracy of a method on given data.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Richness {
    /// Its standard deviation, s, including the resolution of methods that count samples.
    pub std_s: f64,
    /// The part of it from the data alone, s.
    pub data_std_s: f64,
    /// d(1)/2σ: half the distance between the responses at neighbouring whole delays, over the noise. Below 3 neighbouring delays are nearly indistinguishable.
    pub separation: f64,
}

/// The records of a pair.
struct Data<'a> {
    records: &'a [Record<'a>],
    max_delay: usize,
    bias: usize,
}

impl Data<'_> {
    /// The standard deviation, samples, of each kind of information that the methods use. Only one rough model is in memory at a time: each has several times
    /// the record's size.
    fn stds(&self, methods: &[&Method]) -> Vec<(Information, Option<f64>)> {
        let mut stds: Vec<(Information, Option<f64>)> = Vec::new();
        // The output visibly follows the input, by the first rough model.
        let mut seen = None;
        for method in methods {
            let Some(poles) = poles(method.information)
                .filter(|_| stds.iter().all(|(known, _)| *known != method.information))
            else {
                continue;
            };
            let taps = Threshold::default().taps.max(self.max_delay + 1);
            let rough = rough(self.records, poles, self.max_delay, taps);
            for also in methods {
                if self::poles(also.information) == Some(poles)
                    && stds.iter().all(|(known, _)| *known != also.information)
                {
                    let std = rough.as_ref().and_then(|rough| {
                        let seen = *seen.get_or_insert_with(|| visible(rough, self.max_delay + 1));
                        self.std(also.information, rough, seen, taps)
                    });
                    stds.push((also.information, std));
                }
            }
        }
        stds
    }

    /// Standard deviation, samples.
    fn std(&self, information: Information, rough: &Rough, seen: bool, taps: usize) -> Option<f64> {
        let prior = (self.max_delay as f64) * posterior::RESOLUTION.sqrt();
        if !seen {
            return Some(prior);
        }
        let std = match information {
            Information::Poles(_) => rough.bound(&rough.alone),
            Information::KnownModel => rough.bound(&rough.slope),
            Information::TwoSensors => bound::reference(&rough.model, rough.noise(&rough.model)),
            Information::Response => {
                first_coefficient(self.records, rough, taps, self.bias, self.max_delay)
                    .unwrap_or(prior)
            }
            Information::Events => return None,
        };
        let std = (std.powi(-2) + prior.powi(-2)).powf(-0.5);
        std.is_finite().then_some(std)
    }
}

/// The number of poles of the rough model for this information.
fn poles(information: Information) -> Option<usize> {
    match information {
        Information::Poles(n) => Some(n.clamp(1, 3)),
        Information::TwoSensors | Information::Response | Information::KnownModel => Some(2),
        Information::Events => None,
    }
}

impl Rough {
    /// The noise's standard deviation, corrected for its correlation with a signal.
    fn noise(&self, signal: &[f64]) -> f64 {
        let freedom = (self.samples - self.parameters as f64).max(1.0);
        let cost: f64 = self.residual.iter().map(|e| e * e).sum();
        let share = posterior::samples_under(signal, &self.residual) / signal.len().max(1) as f64;
        // On noise-free data the residual is rounding.
        (cost.max(posterior::ROUNDING * self.power) / freedom / share).sqrt()
    }

    fn bound(&self, slope: &[f64]) -> f64 {
        bound::known_model(slope, self.noise(slope))
    }
}

/// The fit is significant over this number of delays.
fn visible(rough: &Rough, delays: usize) -> bool {
    let cost: f64 = rough.residual.iter().map(|e| e * e).sum();
    let counting = rough.samples * posterior::samples_under(&rough.model, &rough.residual)
        / rough.residual.len().max(1) as f64;
    counting
        * (rough.power / cost.max(posterior::ROUNDING * rough.power).max(f64::MIN_POSITIVE)).ln()
        >= posterior::visible_gain(rough.parameters, delays)
}

/// Root mean square of (first coefficient above its threshold − bias − delay), over the records with such a coefficient. `None` where the input does not excite
/// all.
fn first_coefficient(
    records: &[Record],
    rough: &Rough,
    taps: usize,
    bias: usize,
    max_delay: usize,
) -> Option<f64> {
    let limit = Threshold::default().h_std;
    let covariance = fir(records, taps)?.covariance;
    let normal = Normal::standard();
    let (mut none_yet, mut sum) = (1.0, 0.0);
    for i in 0..=max_delay {
        let height = rough.impulse[i] / covariance[(i, i)].max(0.0).sqrt().max(f64::MIN_POSITIVE);
        let crosses = normal.cdf(height - limit) + normal.cdf(-height - limit);
        let late = i as f64 - bias as f64 - rough.delay;
        sum += none_yet * crosses * late * late;
        none_yet *= 1.0 - crosses;
    }
    (none_yet < 0.5).then(|| (sum / (1.0 - none_yet)).sqrt())
}
