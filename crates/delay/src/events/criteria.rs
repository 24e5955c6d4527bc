//! The criteria by which an offset pairs two sequences of event times, one method each.
//!
//! Equation: k̂ = argmin of the criterion over the offsets k.

use super::offsets::{NO_MAGNITUDES, Paired, Units, by_offset, mean, variance};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::{Information, Method, ReferenceExperiment, Scope, method_line};

/// A method: its options, its line in the list, and the criterion that the best offset minimises.
macro_rules! least {
    (
        $(#[$doc:meta])*
        pub struct $options:ident;
        $line:ident: ($name:literal, $summary:literal, $same:ident),
        blind_to: $blind_to:literal,
        criterion: $criterion:expr,
    ) => {
        $(#[$doc])*
        #[doc = concat!(
            "
# Example
```
use deadtime_delay::{DelayEstimator, Events, Experiment, Search, ", stringify!($options), "};
use deadtime_signal::time::SampleTime;
let first: Vec<f64> = (0..40).map(|i| f64::from(i) + 0.3 * f64::from(i * i % 7) / 7.0).collect();
let second: Vec<f64> = first.iter().map(|t| t + 2.5).collect();
let events = vec![Events { first, second, ..Events::default() }];
// The window is 35 sample times: 35 s here.
let experiment = Experiment::of_events(SampleTime::new(1.0)?, [\"first\", \"second\"], events)?;
let answer = ", stringify!($options), "::default().estimate(&experiment, &Search::default())?;
assert!((answer.delay_s.unwrap() - 2.5).abs() < 1e-9);
# Ok::<(), Box<dyn std::error::Error>>(())
```"
        )]
        #[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $options {
            /// The treatment of sequences in different units; default: refuse them.
            pub units: Units,
        }

        pub(crate) const $line: Method = Method {
            scope: Scope::Events,
            reference: ReferenceExperiment::Events,
            information: Information::Events,
            tolerance: 0.01,
            needs: "times of the same events at two places, at intervals that vary",
            blind_to: $blind_to,
            exempt: NO_MAGNITUDES,
            ..method_line!($name, $summary, $options, Events)
        };

        impl DelayEstimator for $options {
            fn estimate(
                &self,
                experiment: &Experiment,
                search: &Search,
            ) -> Result<DelayEstimate, DelayError> {
                by_offset($name, self.units, $criterion, experiment, search)
            }
        }
    };
}

least! {
    /// Smallest average difference of neighbouring delays.
    ///
    /// Equation: k̂ = argmin ⟨|Δ(i + k, i) − Δ(i + k − 1, i − 1)|⟩.
    ///
    /// Inputs: times of the same events at two places ([`Events`](super::times::Events)), on one
    /// clock. Output: seconds, positive = the second place later.
    ///
    /// Assumes: both places register the same events, nearly all of them, and the delay varies less than the intervals do.
    /// Resolution and cost: that of the times; O(N·offsets), the offsets being those whose mean delay lies in the window.
    /// Fails when: the intervals are nearly constant (`not_rich_enough`, `flat` or `not_visible`), or the sequences are unrelated (`not_visible`). Too many
    /// missed or spurious events leave no offset that pairs most events. A single missed event costs two differences, and the pairs behind it. The drift of a
    /// delay has no influence. This criterion is the least sensitive of the five to a few large differences.
    /// Source: Kekäläinen (2019), Acta IMEKO 8(1), 77-86, doi:10.21014/acta_imeko.v8i1.540, average delay difference (eq. 2.2 of
    /// the thesis that this program answers).
    pub struct EventAverageDifference;
    AVERAGE_DIFFERENCE: ("event_average_difference", "offset of two event sequences at which neighbouring delays differ least on average", EventAverageDifference),
    blind_to: "missed or spurious events so many that few neighbouring pairs are whole",
    criterion: |paired| mean(paired.differences().map(f64::abs)),
}

least! {
    /// Smallest variance of the delay.
    ///
    /// Equation: k̂ = argmin ⟨Δ²(i + k, i)⟩ − ⟨Δ(i + k, i)⟩².
    ///
    /// Inputs: times of the same events at two places ([`Events`](super::times::Events)), on one
    /// clock. Output: seconds, positive = the second place later.
    ///
    /// Assumes: both places register the same events, nearly all of them, and the delay varies less than the intervals do.
    /// Resolution and cost: that of the times; O(N·offsets), the offsets being those whose mean delay lies in the window.
    /// Fails when: the intervals are nearly constant (`not_rich_enough`, `flat` or `not_visible`), or the sequences are unrelated (`not_visible`). A drifting
    /// delay raises the variance. A missed or spurious event in the middle does, too. Every delay behind that event is off by an interval, so another offset
    /// may have the smallest variance (`not_visible`).
    /// Source: Kekäläinen (2019), Acta IMEKO 8(1), 77-86, doi:10.21014/acta_imeko.v8i1.540, sample variance of the delay (eq. 2.1 of
    /// the thesis that this program answers).
    pub struct EventDelayVariance;
    DELAY_VARIANCE: ("event_delay_variance", "offset of two event sequences at which the delay varies least", EventDelayVariance),
    blind_to: "a missed or spurious event in the middle of a record, after which every delay is off by an interval; a delay that drifts",
    criterion: |paired| variance(|| paired.delays()),
}

least! {
    /// Largest correlation of the intervals.
    ///
    /// Equation: k̂ = argmax (⟨ΔT·Δt⟩ − ⟨ΔT⟩⟨Δt⟩)/√(var ΔT·var Δt).
    ///
    /// Inputs: times of the same events at two places ([`Events`](super::times::Events)), on one
    /// clock. Output: seconds, positive = the second place later.
    ///
    /// Assumes: both places register the same events, nearly all of them, and the delay varies less than the intervals do.
    /// Resolution and cost: that of the times; O(N·offsets), the offsets being those whose mean delay lies in the window.
    /// Fails when: the intervals are nearly constant (`not_rich_enough`, `flat` or `not_visible`), or the sequences are unrelated (`not_visible`). A single
    /// long interval, as of a pause, may dominate the correlation. Neither the drift of a delay nor a factor between the clocks has an influence.
    /// Source: Kekäläinen (2019), Acta IMEKO 8(1), 77-86, doi:10.21014/acta_imeko.v8i1.540, correlation coefficient (eq. 2.4 of
    /// the thesis that this program answers). The thesis prints ⟨ΔT²⟩⟨Δt⟩ where a covariance needs ⟨ΔT⟩⟨Δt⟩; the covariance is used.
    pub struct EventCorrelation;
    CORRELATION: ("event_correlation", "offset of two event sequences at which their intervals are most correlated", EventCorrelation),
    blind_to: "intervals that are nearly constant; single long intervals, which dominate it",
    criterion: correlation,
}

least! {
    /// Smallest mean square of the difference of neighbouring delays.
    ///
    /// Equation: k̂ = argmin ⟨|ΔT(i + k) − Δt(i)|²⟩.
    ///
    /// Inputs: times of the same events at two places ([`Events`](super::times::Events)), on one
    /// clock. Output: seconds, positive = the second place later.
    ///
    /// Assumes: both places register the same events, nearly all of them, and the delay varies less than the intervals do.
    /// Resolution and cost: that of the times; O(N·offsets), the offsets being those whose mean delay lies in the window.
    /// Fails when: the intervals are nearly constant (`not_rich_enough`, `flat` or `not_visible`), or the sequences are unrelated (`not_visible`). Every missed
    /// or spurious event leaves a difference of a whole interval, weighted by its square.
    /// Source: Kekäläinen (2019), Acta IMEKO 8(1), 77-86, doi:10.21014/acta_imeko.v8i1.540, quadratic delay difference (eq. 2.5 of
    /// the thesis that this program answers): in stationary sequences the same offset as the largest correlation.
    pub struct EventQuadraticDifference;
    QUADRATIC_DIFFERENCE: ("event_quadratic_difference", "offset of two event sequences at which their intervals differ least in the mean square", EventQuadraticDifference),
    blind_to: "single large differences, as of missed or spurious events, which count by their squares",
    criterion: |paired| mean(paired.differences().map(|d| d * d)),
}

least! {
    /// Smallest variance of the difference of neighbouring delays.
    ///
    /// Equation: k̂ = argmin ⟨d²⟩ − ⟨d⟩², d = Δ(i + k, i) − Δ(i + k − 1, i − 1).
    ///
    /// Inputs: times of the same events at two places ([`Events`](super::times::Events)), on one
    /// clock. Output: seconds, positive = the second place later.
    ///
    /// Assumes: both places register the same events, nearly all of them, and the delay varies less than the intervals do.
    /// Resolution and cost: that of the times; O(N·offsets), the offsets being those whose mean delay lies in the window.
    /// Fails when: the intervals are nearly constant (`not_rich_enough`, `flat` or `not_visible`), or the sequences are unrelated (`not_visible`). Every missed
    /// or spurious event leaves a difference of a whole interval, weighted by its square. The drift of a delay, even a steady one, has no influence.
    /// Source: Kekäläinen (2019), Acta IMEKO 8(1), 77-86, doi:10.21014/acta_imeko.v8i1.540, variance of the delay difference (eq. 2.3 of the thesis that this
    /// program answers). The thesis prints |d| in both terms: the variance of |d|, which calls differences of ±1 ms perfect. Whether its source prints the same
    /// is not clear. The variance of the difference needs d itself, which is used here.
    pub struct EventVarianceDifference;
    VARIANCE_DIFFERENCE: ("event_variance_difference", "offset of two event sequences at which the difference of neighbouring delays varies least", EventVarianceDifference),
    blind_to: "single large differences, as of missed or spurious events, which count by their squares",
    criterion: |paired| variance(|| paired.differences()),
}

/// The correlation of the intervals; less is better.
pub(super) fn correlation(paired: &Paired<'_>) -> f64 {
    -paired.correlation()
}
