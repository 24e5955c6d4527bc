//! Generalised cross-correlation with the smoothed coherence transform.
//!
//! Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = 1/√(Guu·Gyy).

use super::generalised::{Line, generalised};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::{Basis, Class, Information, Law, Method, ReferenceExperiment, Scope, Start};
use deadtime_signal::registry::entry;

/// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
///
/// Assumes: as [`crosscorr`](super::crosscorr::Crosscorr).
/// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
/// Fails when: the plant has dynamics (late), or most of the band holds noise alone (the peak is that of the coherence, so it is low there; the interval widens).
/// Source: Carter, Nuttall and Cable (1973), Proc. IEEE 61(10), 1497-1498, doi:10.1109/PROC.1973.9300; Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830,
/// table I.
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Experiment, GccScot, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs, fractional_delay};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let y = fractional_delay(&u, 7.3);
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let search = Search { default_bias: 0, ..Search::default() }; // two sensors: no hold, no bias
/// let answer = GccScot::default().estimate(&experiment, &search)?;
/// assert!((answer.delay_s.unwrap() - 0.73).abs() < 2e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GccScot {
    /// Samples of a segment of the averaged spectra; default 0: the power of two that leaves six or more segments, at most 1024.
    pub segment: usize,
}

const NAME: &str = "gcc_scot";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "gcc_scot",
        "largest generalised correlation with both channels whitened (smoothed coherence transform)",
        GccScot,
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
    blind_to: "the plant's own lag; bands without signal, which it weighs as the others where both channels are noise",
    exempt: &[(Law::Exact, super::generalised::LATE)],
};

impl DelayEstimator for GccScot {
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
    1.0 / (line.uu * line.yy).sqrt()
}
