//! Averaged spectra of two signals.

use std::f64::consts::PI;

use nalgebra::Complex;

use super::fourier::RealFourier;

/// Segments that cover every sample: the squares of Hann windows 25 % apart add up to a constant, so that all samples have equal weight.
const OVERLAP: usize = 4;

/// Spectra of u and y, averaged over overlapping segments of one length M. Line k is at ω = 2πk/M rad per sample, k = 0 … M/2.
///
/// Scaled so that the sum over the whole circle divided by M is the mean square. Source: Welch (1967), IEEE Trans. Audio Electroacoust. 15(2), 70-73,
/// doi:10.1109/TAU.1967.1161901.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossSpectra {
    /// Length of a segment, samples.
    pub segment: usize,
    /// Samples over the length of a segment: the number of independent segments.
    pub looks: f64,
    /// Spectrum of u.
    pub uu: Vec<f64>,
    /// Spectrum of y.
    pub yy: Vec<f64>,
    /// Cross-spectrum conj(U)·Y: its phase is −ωD where y is u later by D.
    pub uy: Vec<Complex<f64>>,
}

/// Variance of a line of an average over `looks` segments of Hann's window, times `looks`: neighbouring lines are correlated, M·Σw⁴/(Σw²)² = 35/18.
///
/// Overlapping segments make a single line as certain as 35/18 independent looks each.
pub const HANN_LINES: f64 = 35.0 / 18.0;

impl CrossSpectra {
    /// Averages over all pairs (u, y); a pair shorter than a segment has one window of its own length.
    #[must_use]
    pub fn welch<'a>(
        pairs: impl IntoIterator<Item = (&'a [f64], &'a [f64])>,
        segment: usize,
    ) -> Self {
        let segment = segment.max(1);
        let fourier = RealFourier::new(segment);
        let lines = segment / 2 + 1;
        let mut spectra = Self {
            segment,
            looks: 0.0,
            uu: vec![0.0; lines],
            yy: vec![0.0; lines],
            uy: vec![Complex::new(0.0, 0.0); lines],
        };
        let long = hann(segment);
        // Σ of squared windows, and of its square, over samples.
        let (mut power, mut squares) = (0.0, 0.0);
        for (u, y) in pairs {
            let n = u.len().min(y.len());
            let own;
            let window = if n < segment {
                own = hann(n);
                &own
            } else {
                &long
            };
            let mut weight = vec![0.0; n];
            for start in
                (0..(n + 1).saturating_sub(window.len().max(1))).step_by((segment / OVERLAP).max(1))
            {
                let part = |x: &[f64]| {
                    fourier.spectrum(window.iter().zip(&x[start..]).map(|(w, x)| w * x))
                };
                for (k, (u, y)) in part(u).into_iter().zip(part(y)).enumerate() {
                    spectra.uu[k] += u.norm_sqr();
                    spectra.yy[k] += y.norm_sqr();
                    spectra.uy[k] += u.conj() * y;
                }
                weight[start..].iter_mut().zip(window).for_each(|(sum, w)| *sum += w * w);
            }
            power += weight.iter().sum::<f64>();
            squares += weight.iter().map(|w| w * w).sum::<f64>();
        }
        if power > 0.0 {
            spectra.uu.iter_mut().chain(&mut spectra.yy).for_each(|v| *v /= power);
            spectra.uy.iter_mut().for_each(|v| *v /= power);
            let length = segment as f64;
            spectra.looks = power * power / squares / length;
        }
        spectra
    }

    /// |conj(U)·Y|²/(UU·YY) of every line, from 0 to 1; 0 where nothing was seen.
    #[must_use]
    pub fn coherence(&self) -> Vec<f64> {
        let of = |((uy, uu), yy): ((&Complex<f64>, &f64), &f64)| {
            let powers = uu * yy;
            if powers > 0.0 { (uy.norm_sqr() / powers).min(1.0) } else { 0.0 }
        };
        self.uy.iter().zip(&self.uu).zip(&self.yy).map(of).collect()
    }

    /// The frequency of a line, rad per sample.
    #[must_use]
    pub fn omega(&self, line: usize) -> f64 {
        2.0 * PI * line as f64 / self.segment as f64
    }
}

fn hann(n: usize) -> Vec<f64> {
    (0..n).map(|t| (PI * (t as f64 + 0.5) / n as f64).sin().powi(2)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize, mut state: u64) -> Vec<f64> {
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        (0..n).map(|_| 12.0_f64.sqrt() * draw()).collect()
    }

    #[test]
    fn white_noise_has_a_flat_spectrum_of_its_variance_and_no_coherence() {
        let (u, y) = (noise(64_000, 1), noise(64_000, 2));
        let s = CrossSpectra::welch([(&u[..], &y[..])], 64);
        assert!((s.looks / 1000.0 - 1.0).abs() < 0.01, "{}", s.looks);
        assert!(s.uu[1..32].iter().all(|v| (v - 1.0).abs() < 0.15), "{:?}", s.uu);
        // The coherence of independent signals is exponential of mean 1/(looks of a line).
        let mean = s.coherence()[1..32].iter().sum::<f64>() / 31.0;
        assert!((mean * HANN_LINES * s.looks - 1.0).abs() < 0.5, "{mean}");
    }

    #[test]
    fn a_delayed_copy_turns_the_phase_and_several_pairs_are_averaged() {
        let u = noise(4000, 3);
        let halves = [(&u[2..1500], &u[..1498]), (&u[1502..4000], &u[1500..3998])];
        let s = CrossSpectra::welch(halves, 32);
        for k in 1..16 {
            let apart =
                (s.uy[k] / s.uy[k].norm() - Complex::from_polar(1.0, -2.0 * s.omega(k))).norm();
            assert!(apart < 0.12, "line {k}: {apart}");
        }
        assert!(s.coherence()[1..16].iter().all(|c| *c > 0.9));
        // A record that is shorter than a segment counts too.
        assert!(CrossSpectra::welch([(&u[..20], &u[..20])], 32).looks > 0.2);
        assert_eq!(CrossSpectra::welch([(&u[..0], &u[..0])], 32).looks, 0.0);
    }
}
