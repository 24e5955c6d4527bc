//! The weights ψ of the generalised cross-correlation, one method each.
//!
//! Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|.

use super::generalised::{LATE, Line, NEEDS, WITHSTANDS, generalised};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{NoDelay, PairMethod, PairRecords};
use crate::method::{
    Basis, Information, Law, Method, ReferenceExperiment, copy_example, method_line,
};

/// A method: its options, its line in the list, and its weight of one frequency.
macro_rules! weighted {
    (
        $(#[$doc:meta])*
        pub struct $options:ident;
        $line:ident: ($name:literal, $summary:literal, $same:ident),
        blind_to: $blind_to:literal,
        weight: $weight:expr,
    ) => {
        $(#[$doc])*
        #[doc = copy_example!($options)]
        #[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $options {
            /// Samples of a segment of the averaged spectra. Default 0: the power of two that leaves six or more segments, at most 1024.
            pub segment: usize,
        }

        pub(crate) const $line: Method = Method {
            reference: ReferenceExperiment::Copy,
            information: Information::TwoSensors,
            basis: Basis::CrossSpectrum,
            tolerance: 0.05,
            withstands: WITHSTANDS,
            needs: NEEDS,
            blind_to: $blind_to,
            exempt: &[(Law::Exact, LATE)],
            ..method_line!($name, $summary, $options, Correlation)
        };

        impl PairMethod for $options {
            fn check(&self) -> Result<(), DelayError> {
                super::generalised::check($name, self.segment)
            }

            fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
                generalised($name, self.segment, $weight, pair)
            }
        }
    };
}

weighted! {
    /// The lag of the largest cross-correlation.
    ///
    /// Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = 1.
    ///
    /// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
    ///
    /// Assumes: y is a delayed, scaled copy of u plus noise independent of u; a band wide against the reciprocal of the window searched.
    /// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
    /// Fails when: the plant has dynamics: biased late by about its lag. A note reports significant phases, and the interval then holds the delays of all
    /// frequencies. A narrow-band signal has peaks one cycle apart (all in the interval, or `flat`). A coloured input has a broad peak, and a wider interval
    /// than with whitening weights. Feedback from y to u biases the delay.
    /// Source: Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830, section II and eq. 3. The
    /// source treats continuous correlators and leaves the interpolation between samples open; the interval is this program's own (module head).
    pub struct Crosscorr;
    CROSSCORR: ("crosscorr", "lag of the largest cross-correlation, refined below one sample on the exact interpolant", Crosscorr),
    blind_to: "the plant's own lag, which counts as delay; which cycle of a narrow-band signal it is",
    weight: |_| 1.0,
}

weighted! {
    /// Generalised cross-correlation with Eckart's weights: the lowest probability of a false peak.
    ///
    /// Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = γ/(√(Guu·Gyy)·(1 − γ)²), γ the
    /// coherence.
    ///
    /// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
    ///
    /// Assumes: as [`crosscorr`](Crosscorr); equal ratios of signal to noise in both channels.
    /// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
    /// Fails when: the coherence is near 1 in a few lines, which get nearly all the weight. Unequal noise of the channels makes the weights suboptimal, without
    /// bias. Plant dynamics bias the delay late.
    /// Source: Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830, table I: ψ =
    /// α·Gss/(Gn1n1·Gn2n2). The gain α and the two noises are three unknowns for two coherences and cross-spectra; the source takes α as known. Equal
    /// signal-to-noise ratios give γ = |Guy|/√(Guu·Gyy) and the form above, which is invariant to the gain of either channel.
    pub struct GccEckart;
    ECKART: ("gcc_eckart", "largest generalised correlation weighted by signal over noise in both channels (Eckart)", GccEckart),
    blind_to: "the plant's own lag; noise that the two channels do not share alike",
    weight: |line| {
        let coherence = line.coherence.sqrt();
        coherence / ((line.uu * line.yy).sqrt() * (1.0 - coherence).powi(2))
    },
}

weighted! {
    /// Generalised cross-correlation with Hannan and Thomson's weights: maximum likelihood.
    ///
    /// Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = γ²/(|Guy|·(1 − γ²)), γ² the squared
    /// coherence.
    ///
    /// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
    ///
    /// Assumes: as [`crosscorr`](Crosscorr); Gaussian signal and noise; enough segments to estimate the coherence (six or more).
    /// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
    /// Fails when: few segments make the coherence inaccurate: the weights then favour lines that are coherent by chance, although the mean bias is removed.
    /// Plant dynamics bias the delay late.
    /// Source: Hannan and Thomson (1973), Biometrika 60(3), 469-480, doi:10.1093/biomet/60.3.469; Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal
    /// Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830, table I and eq. 24-25: the weights attain the bound when the coherence is known. The source
    /// leaves its estimation open.
    pub struct GccHannanThomson;
    HANNAN_THOMSON: ("gcc_hannan_thomson", "largest generalised correlation with maximum-likelihood weights (Hannan and Thomson): as sharp as two sensors can be", GccHannanThomson),
    blind_to: "the plant's own lag; coherence that too few segments leave to chance",
    weight: maximum_likelihood,
}

weighted! {
    /// Generalised cross-correlation with the phase transform.
    ///
    /// Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = 1/|Guy|.
    ///
    /// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
    ///
    /// Assumes: as [`crosscorr`](Crosscorr); signal at all frequencies.
    /// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
    /// Fails when: part of the band holds no signal: its random phases have full weight (wider interval, or `flat`). Plant dynamics bias the delay late.
    /// Source: Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830, table I and section III. The
    /// source calls the phases of bands without signal erratic, without a remedy. Here the weight uses at least the cross-spectrum magnitude expected by
    /// chance, and the uncertainty includes its phase.
    pub struct GccPhat;
    PHAT: ("gcc_phat", "largest generalised correlation by phase alone (phase transform): a sharp peak whatever the spectrum", GccPhat),
    blind_to: "the plant's own lag; which frequencies hold signal and which noise",
    weight: |line| 1.0 / line.cross.max(line.chance),
}

weighted! {
    /// Generalised cross-correlation with Roth's weights: the impulse response, and its largest
    /// value.
    ///
    /// Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = 1/Guu.
    ///
    /// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
    ///
    /// Assumes: as [`crosscorr`](Crosscorr); an input with power at all frequencies.
    /// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
    /// Fails when: the input leaves bands empty: their noise is divided by nearly zero (wider interval, or `flat`). With plant dynamics the estimate is the
    /// peak of the impulse response, not its beginning.
    /// Source: Roth (1971), IEEE Spectrum 8(4), 62-70, doi:10.1109/MSPEC.1971.5218046; Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process.
    /// 24(4), 320-327, doi:10.1109/TASSP.1976.1162830, table I. Neither source states the length of the averaged segments.
    pub struct GccRoth;
    ROTH: ("gcc_roth", "largest value of the impulse response from averaged spectra (Roth's weights)", GccRoth),
    blind_to: "the plant's own lag; bands that the input does not move, whose noise it raises",
    weight: |line| 1.0 / line.uu,
}

weighted! {
    /// Generalised cross-correlation with the smoothed coherence transform.
    ///
    /// Equation: τ̂ = argmax |Σ ψ(ω)·Ĝuy(ω)·exp(iωτ)|, ψ = 1/√(Guu·Gyy).
    ///
    /// Inputs: u, y on one even grid, any units. Output: seconds, positive = y lags u.
    ///
    /// Assumes: as [`crosscorr`](Crosscorr).
    /// Resolution and cost: sub-sample, by Newton's method on the exact interpolant; O(N·log N).
    /// Fails when: the plant has dynamics (biased late). In a band with mostly noise the peak follows the coherence and is low, so the interval widens.
    /// Source: Carter, Nuttall and Cable (1973), Proc. IEEE 61(10), 1497-1498, doi:10.1109/PROC.1973.9300; Knapp and Carter (1976), IEEE Trans. Acoust. Speech Signal Process. 24(4), 320-327, doi:10.1109/TASSP.1976.1162830,
    /// table I.
    pub struct GccScot;
    SCOT: ("gcc_scot", "largest generalised correlation with both channels whitened (smoothed coherence transform)", GccScot),
    blind_to: "the plant's own lag; bands without signal, which it weighs as the others where both channels are noise",
    weight: |line| 1.0 / (line.uu * line.yy).sqrt(),
}

/// The weight of the maximum-likelihood estimate.
pub(crate) fn maximum_likelihood(line: &Line) -> f64 {
    line.coherence / (line.cross * (1.0 - line.coherence))
}
