//! The lag of the largest cross-correlation.
//!
//! Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = 1.

use super::generalised::{Line, generalised};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::{Basis, Class, Information, Law, Method, ReferenceExperiment, Scope, Start};
use deadtime_signal::registry::entry;

/// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
///
/// Assumes: y is a delayed, scaled copy of u plus noise that knows nothing of u; a band wide against the reciprocal of the window searched.
/// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
/// Fails when: the plant has dynamics (late by about its lag; the note says so where phases show it, and the interval is as wide as the delays of single frequencies differ), the signal is narrow-band (peaks one cycle apart: the interval holds
/// them all, or `flat`), the input is coloured (a broad peak, wider interval than that of the weights that whiten), or y is fed back to u.
/// Source: Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830, section II and eq. 3. It speaks of continuous correlators and leaves the interpolation
/// between samples open; the interval is this program's own (module head).
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Experiment, Crosscorr, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs, fractional_delay};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let y = fractional_delay(&u, 7.3);
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let search = Search { default_bias: 0, ..Search::default() }; // two sensors: no hold, no bias
/// let answer = Crosscorr::default().estimate(&experiment, &search)?;
/// assert!((answer.delay_s.unwrap() - 0.73).abs() < 2e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Crosscorr {
    /// Samples of a segment of the averaged spectra; default 0: the power of two that leaves six or more segments, at most 1024.
    pub segment: usize,
}

const NAME: &str = "crosscorr";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "crosscorr",
        "lag of the largest cross-correlation, refined below one sample on the exact interpolant",
        Crosscorr,
        dyn DelayEstimator
    ),
    class: Class::Correlation,
    scope: Scope::Pair,
    start: Start::Any,
    reference: ReferenceExperiment::Copy,
    information: Information::TwoSensors,
    basis: Basis::CrossSpectrum,
    tolerance: 0.05,
    withstands: super::generalised::WITHSTANDS,
    needs: super::generalised::NEEDS,
    blind_to: "the plant's own lag, which counts as delay; which cycle of a narrow-band signal it is",
    exempt: &[(Law::Exact, super::generalised::LATE)],
};

impl DelayEstimator for Crosscorr {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        generalised(NAME, self.segment, weight, experiment, search)
    }
}

/// ψ.
fn weight(_: &Line) -> f64 {
    1.0
}
