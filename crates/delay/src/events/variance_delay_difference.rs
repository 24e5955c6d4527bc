//! Smallest variance of the difference of neighbouring delays.
//!
//! Equation: k̂ = argmin ⟨d²⟩ − ⟨d⟩², d = Δ(i + k, i) − Δ(i + k − 1, i − 1).

use super::offsets::{NO_MAGNITUDES, Paired, Units, by_offset, variance};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::{Basis, Class, Information, Method, ReferenceExperiment, Scope, Start};
use deadtime_signal::registry::entry;

/// Inputs: times of the same events at two places ([`Events`](super::offsets::Events)), on one clock. Output: seconds, positive = the second place later.
///
/// Assumes: both places see the same events, nearly all of them, and the delay varies less than the intervals do.
/// Resolution and cost: that of the times; O(N·offsets), the offsets being those whose mean delay lies in the window.
/// Fails when: the intervals are nearly constant (`not_rich_enough`, `flat` or `not_visible`), the sequences are unrelated (`not_visible`), or events are missed or
/// spurious: each leaves a difference of a whole interval, which counts by its square. The drift of a delay, even a steady one, does not matter.
/// Source: Kekäläinen (2019), Acta IMEKO 8(1), 77-86, doi:10.21014/acta_imeko.v8i1.540, variance of the delay difference (eq. 2.3 of
/// the thesis that this program answers). There |d| stands in both terms, which is the variance of |d| and calls differences of ±1 ms perfect; whether the source has
/// it so is not clear. A variance of the difference needs d itself, which is used.
///
/// # Example
/// ```
/// use deadtime_delay::{Events, DelayEstimator, EventVarianceDifference, Experiment, Search};
/// use deadtime_signal::time::SampleTime;
/// let first: Vec<f64> = (0..40).map(|i| f64::from(i) + 0.3 * f64::from(i * i % 7) / 7.0).collect();
/// let second: Vec<f64> = first.iter().map(|t| t + 2.5).collect();
/// // The window is 35 sample times: 35 s here.
/// let experiment = Experiment::of_events(SampleTime::new(1.0)?, ["first", "second"], vec![Events { first, second, ..Events::default() }])?;
/// let answer = EventVarianceDifference::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 2.5).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EventVarianceDifference {
    /// What to do with sequences in different units; default: refuse them.
    pub units: Units,
}

const NAME: &str = "event_variance_difference";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "event_variance_difference",
        "offset of two event sequences at which the difference of neighbouring delays varies least",
        EventVarianceDifference,
        dyn DelayEstimator
    ),
    class: Class::Events,
    scope: Scope::Events,
    start: Start::Any,
    reference: ReferenceExperiment::Events,
    information: Information::Events,
    basis: Basis::Own,
    tolerance: 0.01,
    withstands: &[],
    needs: "times of the same events at two places, at intervals that vary",
    blind_to: "single large differences, as of missed or spurious events, which count by their squares",
    exempt: NO_MAGNITUDES,
};

impl DelayEstimator for EventVarianceDifference {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        by_offset(NAME, self.units, criterion, experiment, search)
    }
}

fn criterion(paired: &Paired<'_>) -> f64 {
    variance(|| paired.differences())
}
