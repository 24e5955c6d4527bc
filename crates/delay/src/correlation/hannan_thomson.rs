//! Generalised cross-correlation with Hannan and Thomson's weights: maximum likelihood.
//!
//! Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = γ²/(|Guy|·(1 − γ²)), γ² the squared coherence.

use super::generalised::{Line, generalised};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::{Basis, Class, Information, Law, Method, ReferenceExperiment, Scope, Start};
use deadtime_signal::registry::entry;

/// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
///
/// Assumes: as [`crosscorr`](super::crosscorr::Crosscorr); Gaussian signal and noise; enough segments to tell the coherence (six or more).
/// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
/// Fails when: the coherence is misjudged (few segments: the weights favour lines that are coherent by chance; what chance adds on average is taken off), or the plant has
/// dynamics (late).
/// Source: Hannan and Thomson (1973), Biometrika 60(3), 469-480, doi:10.1093/biomet/60.3.469; Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830,
/// table I and eq. 24-25: it attains the bound when the coherence is known. How to estimate it the source leaves open.
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Experiment, GccHannanThomson, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs, fractional_delay};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let y = fractional_delay(&u, 7.3);
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let search = Search { default_bias: 0, ..Search::default() }; // two sensors: no hold, no bias
/// let answer = GccHannanThomson::default().estimate(&experiment, &search)?;
/// assert!((answer.delay_s.unwrap() - 0.73).abs() < 2e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GccHannanThomson {
    /// Samples of a segment of the averaged spectra; default 0: the power of two that leaves six or more segments, at most 1024.
    pub segment: usize,
}

const NAME: &str = "gcc_hannan_thomson";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "gcc_hannan_thomson",
        "largest generalised correlation with maximum-likelihood weights (Hannan and Thomson): as sharp as two sensors can be",
        GccHannanThomson,
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
    blind_to: "the plant's own lag; coherence that too few segments leave to chance",
    exempt: &[(Law::Exact, super::generalised::LATE)],
};

impl DelayEstimator for GccHannanThomson {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        generalised(NAME, self.segment, weight, experiment, search)
    }
}

/// ψ.
pub(crate) fn weight(line: &Line) -> f64 {
    line.coherence / (line.cross * (1.0 - line.coherence))
}
