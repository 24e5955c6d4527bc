//! Smallest variance of the delay.
//!
//! Equation: k̂ = argmin ⟨Δ²(i + k, i)⟩ − ⟨Δ(i + k, i)⟩².

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
/// Fails when: the intervals are nearly constant (`not_rich_enough`, `flat` or `not_visible`), the sequences are unrelated (`not_visible`), an event is missed or
/// spurious in the middle (every delay behind it is off by an interval, so the smallest variance may be another offset's: `not_visible`), or the delay drifts.
/// Source: Kekäläinen (2019), Acta IMEKO 8(1), 77-86, doi:10.21014/acta_imeko.v8i1.540, sample variance of the delay (eq. 2.1 of
/// the thesis that this program answers).
///
/// # Example
/// ```
/// use deadtime_delay::{Events, DelayEstimator, EventDelayVariance, Experiment, Search};
/// use deadtime_signal::time::SampleTime;
/// let first: Vec<f64> = (0..40).map(|i| f64::from(i) + 0.3 * f64::from(i * i % 7) / 7.0).collect();
/// let second: Vec<f64> = first.iter().map(|t| t + 2.5).collect();
/// // The window is 35 sample times: 35 s here.
/// let experiment = Experiment::of_events(SampleTime::new(1.0)?, ["first", "second"], vec![Events { first, second, ..Events::default() }])?;
/// let answer = EventDelayVariance::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 2.5).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EventDelayVariance {
    /// What to do with sequences in different units; default: refuse them.
    pub units: Units,
}

const NAME: &str = "event_delay_variance";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "event_delay_variance",
        "offset of two event sequences at which the delay varies least",
        EventDelayVariance,
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
    blind_to: "a missed or spurious event in the middle of a record, after which every delay is off by an interval; a delay that drifts",
    exempt: NO_MAGNITUDES,
};

impl DelayEstimator for EventDelayVariance {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        by_offset(NAME, self.units, criterion, experiment, search)
    }
}

fn criterion(paired: &Paired<'_>) -> f64 {
    variance(|| paired.delays())
}
