//! Generalised cross-correlation with Eckart's weights: the least chance of a false peak.
//!
//! Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = γ/(√(Guu·Gyy)·(1 − γ)²), γ the coherence.

use super::generalised::{Line, generalised};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::{Basis, Class, Information, Law, Method, ReferenceExperiment, Scope, Start};
use deadtime_signal::registry::entry;

/// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
///
/// Assumes: as [`crosscorr`](super::crosscorr::Crosscorr); equal ratios of signal to noise in both channels.
/// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
/// Fails when: the coherence is near 1 in a few lines (they get nearly all the weight), the channels' noise differs much (no longer the best weights, still without bias),
/// or the plant has dynamics (late).
/// Source: Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830, table I: ψ = α·Gss/(Gn1n1·Gn2n2). The gain α and the two noises are three
/// unknowns for two coherences and cross-spectra; the source takes α as known. Taking the ratios of signal to noise as equal leaves γ = |Guy|/√(Guu·Gyy) and the form above,
/// which no gain of either channel changes.
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Experiment, GccEckart, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs, fractional_delay};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let y = fractional_delay(&u, 7.3);
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let search = Search { default_bias: 0, ..Search::default() }; // two sensors: no hold, no bias
/// let answer = GccEckart::default().estimate(&experiment, &search)?;
/// assert!((answer.delay_s.unwrap() - 0.73).abs() < 2e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GccEckart {
    /// Samples of a segment of the averaged spectra; default 0: the power of two that leaves six or more segments, at most 1024.
    pub segment: usize,
}

const NAME: &str = "gcc_eckart";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "gcc_eckart",
        "largest generalised correlation weighted by signal over noise in both channels (Eckart)",
        GccEckart,
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
    blind_to: "the plant's own lag; noise that the two channels do not share alike",
    exempt: &[(Law::Exact, super::generalised::LATE)],
};

impl DelayEstimator for GccEckart {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        generalised(NAME, self.segment, weight, experiment, search)
    }
}

/// ψ.
fn weight(line: &Line) -> f64 {
    let coherence = line.coherence.sqrt();
    coherence / ((line.uu * line.yy).sqrt() * (1.0 - coherence).powi(2))
}
