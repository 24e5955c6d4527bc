//! The slope of the cross-spectrum's phase over frequency.
//!
//! Equation: φ(ω) = arg Ĝuy(ω) = −ωτ (+ π where the gain is negative), τ̂ = −Σ w·ω·φ/Σ w·ω². The weight is w = γ²/(1 − γ²), γ² the squared coherence.
//!
//! The phase is determined modulo 2π only. The search first tests every whole lag: the best one has the largest weighted sum of cosines of the residual phases.
//! With y moved back by that lag, the residual phase stays within half a turn, and the straight line is a weighted least-squares fit.

use nalgebra::Complex;

use crate::correlation::generalised::{
    Alike, Centred, LATE, NEEDS, WITHSTANDS, alike, check, independent_lines, segment_of,
};
use crate::correlation::weights::maximum_likelihood;
use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords};
use crate::method::{
    Basis, Information, Law, Method, ReferenceExperiment, copy_example, method_line,
};
use deadtime_signal::HANN_LINES;

/// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
///
/// Assumes: y is a delayed, scaled copy of u plus noise independent of u (its phase is a straight line through 0 or π).
/// Resolution and cost: sub-sample; O(N·log N).
/// Fails when: the plant has dynamics: their phase adds to the delay. A note reports a phase that is no straight line through 0 or π; the interval then holds
/// the delays of all frequencies. With a narrow-band signal several lags give straight lines (all in the interval, or `flat`). Few segments make the coherence
/// random.
/// Source: Piersol (1981), IEEE Trans. Acoust. Speech Signal Process. 29(3), 471-477, doi:10.1109/TASSP.1981.1163555. The weights are the inverse variances of
/// the phases, Carter (1987), Proc. IEEE 75(2), 236-255, doi:10.1109/PROC.1987.13723. Neither source unwraps a noisy phase; the search over whole lags is this
/// program's.
#[doc = copy_example!(PhaseSlope)]
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PhaseSlope {
    /// Samples of a segment of the averaged spectra. Default 0: the power of two that leaves six or more segments, at most 1024.
    pub segment: usize,
}

const NAME: &str = "phase_slope";
/// Successive straight-line fits, each unwrapped about the previous one; the second already converges.
const FITS: usize = 4;

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    reference: ReferenceExperiment::Copy,
    information: Information::TwoSensors,
    basis: Basis::CrossSpectrum,
    tolerance: 0.05,
    withstands: WITHSTANDS,
    needs: NEEDS,
    blind_to: "the phase of the plant itself, which counts as delay",
    exempt: &[(Law::Exact, LATE)],
    ..method_line!(
        "phase_slope",
        "slope of the cross-spectrum's phase over frequency, weighted by the coherence",
        PhaseSlope,
        Frequency
    )
};

impl PairMethod for PhaseSlope {
    fn check(&self) -> Result<(), DelayError> {
        check(NAME, self.segment)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let segment = segment_of(NAME, self.segment, pair)?;
        let (coarse, seen) =
            alike(&Centred::new(pair.records), segment, maximum_likelihood, pair.max_delay);
        let (Some(seen), Some(start)) = (seen, coarse.fraction) else {
            return coarse.answer(pair);
        };
        // ω, weight and phasor of every line with a defined phase.
        let lines: Vec<(f64, f64, Complex<f64>)> = (seen.lines.iter().zip(&seen.spectra.uy))
            .filter(|(line, _)| line.times > 1.0 && line.coherence > 0.0)
            .map(|(line, s)| (line.omega, line.coherence / (1.0 - line.coherence), s * seen.sign))
            .collect();
        let left = |omega: f64, s: &Complex<f64>, delay: f64| {
            (s * Complex::from_polar(1.0, omega * delay)).arg()
        };
        let sum = |f: &dyn Fn(f64, f64, f64) -> f64, delay: f64| -> f64 {
            lines.iter().map(|(o, w, s)| f(*o, *w, left(*o, s, delay))).sum()
        };
        let stiffness = sum(&|o, w, _| w * o * o, start);
        if stiffness <= 0.0 {
            let note = "no frequency is coherent enough to have a phase";
            return Err(NoDelay::new(Outcome::NotRichEnough, note));
        }
        let mut delay = start;
        for _ in 0..FITS {
            delay -= sum(&|o, w, phase| w * o * phase, delay) / stiffness;
        }
        // The phase variance of a line is (1 − γ²)/(2·looks·γ²).
        let by_coherence = stiffness / (2.0 * seen.spectra.looks);
        let by_scatter = HANN_LINES * sum(&|o, w, phase| (w * o * phase).powi(2), delay);
        let std = by_coherence.max(by_scatter).sqrt() / stiffness;
        let freedom = independent_lines(&seen.spectra);
        Alike { fraction: Some(delay), std, freedom, ..coarse }.answer(pair)
    }
}
