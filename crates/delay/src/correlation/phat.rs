//! Generalised cross-correlation with the phase transform.
//!
//! Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = 1/|Guy|.

use super::generalised::{Line, generalised};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::{Basis, Class, Information, Law, Method, ReferenceExperiment, Scope, Start};
use deadtime_signal::registry::entry;

/// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
///
/// Assumes: as [`crosscorr`](super::crosscorr::Crosscorr); signal at all frequencies.
/// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
/// Fails when: part of the band holds no signal (its phases are chance and count in full: the interval widens, or `flat`), or the plant has dynamics (late).
/// Source: Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830, table I and section III. It says that the phases of bands without signal are
/// erratic, and not what to do about them; here a cross-spectrum smaller than chance alone makes it counts as that large, and the uncertainty counts its phase.
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Experiment, GccPhat, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs, fractional_delay};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let y = fractional_delay(&u, 7.3);
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let search = Search { default_bias: 0, ..Search::default() }; // two sensors: no hold, no bias
/// let answer = GccPhat::default().estimate(&experiment, &search)?;
/// assert!((answer.delay_s.unwrap() - 0.73).abs() < 2e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GccPhat {
    /// Samples of a segment of the averaged spectra; default 0: the power of two that leaves six or more segments, at most 1024.
    pub segment: usize,
}

const NAME: &str = "gcc_phat";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "gcc_phat",
        "largest generalised correlation by phase alone (phase transform): a sharp peak whatever the spectrum",
        GccPhat,
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
    blind_to: "the plant's own lag; which frequencies hold signal and which noise",
    exempt: &[(Law::Exact, super::generalised::LATE)],
};

impl DelayEstimator for GccPhat {
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
    1.0 / line.cross.max(line.chance)
}
