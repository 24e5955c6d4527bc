//! Largest correlation of the intervals.
//!
//! Equation: k̂ = argmax (⟨ΔT·Δt⟩ − ⟨ΔT⟩⟨Δt⟩)/√(var ΔT·var Δt).

use super::offsets::{NO_MAGNITUDES, Paired, Units, by_offset};
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
/// Fails when: the intervals are nearly constant (`not_rich_enough`, `flat` or `not_visible`), the sequences are unrelated (`not_visible`), or a single long interval, as
/// of a pause, dominates the correlation. The drift of a delay does not matter, nor does a factor between the clocks.
/// Source: Kekäläinen (2019), Acta IMEKO 8(1), 77-86, doi:10.21014/acta_imeko.v8i1.540, correlation coefficient (eq. 2.4 of
/// the thesis that this program answers). The thesis prints ⟨ΔT²⟩⟨Δt⟩ where a covariance needs ⟨ΔT⟩⟨Δt⟩; the covariance is used.
///
/// # Example
/// ```
/// use deadtime_delay::{Events, DelayEstimator, EventCorrelation, Experiment, Search};
/// use deadtime_signal::time::SampleTime;
/// let first: Vec<f64> = (0..40).map(|i| f64::from(i) + 0.3 * f64::from(i * i % 7) / 7.0).collect();
/// let second: Vec<f64> = first.iter().map(|t| t + 2.5).collect();
/// // The window is 35 sample times: 35 s here.
/// let experiment = Experiment::of_events(SampleTime::new(1.0)?, ["first", "second"], vec![Events { first, second, ..Events::default() }])?;
/// let answer = EventCorrelation::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 2.5).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EventCorrelation {
    /// What to do with sequences in different units; default: refuse them.
    pub units: Units,
}

const NAME: &str = "event_correlation";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "event_correlation",
        "offset of two event sequences at which their intervals are most correlated",
        EventCorrelation,
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
    blind_to: "intervals that are nearly constant; single long intervals, which dominate it",
    exempt: NO_MAGNITUDES,
};

impl DelayEstimator for EventCorrelation {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        by_offset(NAME, self.units, criterion, experiment, search)
    }
}

pub(super) fn criterion(paired: &Paired<'_>) -> f64 {
    -paired.correlation()
}
