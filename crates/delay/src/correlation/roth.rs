//! Generalised cross-correlation with Roth's weights: the impulse response, and its largest value.
//!
//! Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = 1/Guu.

use super::generalised::{Line, generalised};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::{Basis, Class, Information, Law, Method, ReferenceExperiment, Scope, Start};
use deadtime_signal::registry::entry;

/// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
///
/// Assumes: as [`crosscorr`](super::crosscorr::Crosscorr); an input with power at all frequencies.
/// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
/// Fails when: the input leaves bands empty (their noise is divided by next to nothing: the interval widens, or `flat`), or the plant has dynamics (the peak of its
/// impulse response, not its beginning).
/// Source: Roth (1971), IEEE Spectrum 8(4), 62-70, doi:10.1109/MSPEC.1971.5218046; Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830,
/// table I. Neither says how long the averaged segments should be.
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Experiment, GccRoth, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs, fractional_delay};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let y = fractional_delay(&u, 7.3);
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let search = Search { default_bias: 0, ..Search::default() }; // two sensors: no hold, no bias
/// let answer = GccRoth::default().estimate(&experiment, &search)?;
/// assert!((answer.delay_s.unwrap() - 0.73).abs() < 2e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GccRoth {
    /// Samples of a segment of the averaged spectra; default 0: the power of two that leaves six or more segments, at most 1024.
    pub segment: usize,
}

const NAME: &str = "gcc_roth";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "gcc_roth",
        "largest value of the impulse response from averaged spectra (Roth's weights)",
        GccRoth,
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
    blind_to: "the plant's own lag; bands that the input does not move, whose noise it raises",
    exempt: &[(Law::Exact, super::generalised::LATE)],
};

impl DelayEstimator for GccRoth {
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
    1.0 / line.uu
}
