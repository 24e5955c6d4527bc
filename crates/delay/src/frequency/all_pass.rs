//! The delay of the all-pass part of a model (DAP).
//!
//! Equation: G = G_mp·G_ap with G_mp minimum phase, τ̂ = −d arg G_ap(e^{iωTs})/dω at ω = 0. With x = q⁻¹, the numerator B(x) = Σ bₖxᵏ has the zeros xᵢ. Zeros
//! outside the z circle have |xᵢ| < 1; a pure delay has zeros at x = 0. Each of these adds Re (1 + xᵢ)/(1 − xᵢ) samples: τ̂ = Σ Re (1 + xᵢ)/(1 − xᵢ) over |xᵢ|
//! < 1. A zero on the circle adds nothing, so the sum is continuous in B except at x = 1.
//!
//! The published form is −arg G_ap(e^{iω₁})/ω₁ at ω₁ = 10⁻⁴, plus 1 for the hold; its G_ap leaves the zeros at infinity out. The limit ω₁ → 0 differs from it
//! only for zeros within about 10⁻⁴ of 1.
//!
//! Source: Isaksson, Horch and Dumont (2001), "Event-triggered deadtime estimation from closed-loop data", Proc. ACC, 3280-3285. Björklund (2003),
//! LiU-TEK-LIC-2003:60, class 1b. Björklund and Ljung (2009), "An improved phase method for time-delay estimation", Automatica 45(10), 2467-2470. Björklund and
//! Ljung show that the sum fails where noise puts a zero just outside z = 1, and exclude such zeros. The exact rule was not available. Here the excluded zeros
//! are those that alone would add more than the search window; no model needs them for a delay inside it.

use std::f64::consts::PI;

use nalgebra::{Complex, DMatrix};

use crate::estimate::DelayEstimate;
use crate::estimator::{NoDelay, PairRecords};
use deadtime_signal::stats::NORMAL_95;
use deadtime_signal::{polynomial, roots};

const ONE: Complex<f64> = Complex::new(1.0, 0.0);

/// Coefficients below this share of the largest are rounding: a delay of whole samples leaves exact zeros before the first one.
const ROUNDING: f64 = 1e-13;

/// The all-pass part of a model, from its numerator's coefficients and their covariance.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct AllPass {
    /// τ̂, in units of the variable's own delay.
    pub(crate) raw: f64,
    /// Its standard deviation, by the zeros' derivatives.
    pub(crate) std: f64,
    /// Delay that noise adds, as a range. The ends assume a gain that stays constant beyond the frequency where noise exceeds it, and one that falls as 1/ω².
    pub(crate) hidden: [f64; 2],
    /// Number of excluded zeros near 1.
    left_out: usize,
}

/// The all-pass part of Σ bₖxᵏ. `covariance` is that of b; `noise` is the part that hides the gain (equal, unless nearly cancelling poles and zeros share some
/// of it). Zeros that add more than `longest` are excluded. `None` where all coefficients are zero or one is not finite.
pub(crate) fn all_pass(
    b: &[f64],
    [covariance, noise]: [&DMatrix<f64>; 2],
    longest: f64,
) -> Option<AllPass> {
    let largest = b.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let counts = |v: &f64| v.abs() > ROUNDING * largest;
    let (first, last) = (b.iter().position(counts)?, b.iter().rposition(counts)?);
    // A fixed scale makes the last digits of the roots reproducible.
    let trimmed: Vec<f64> = b.get(first..=last)?.iter().map(|v| v / largest).collect();
    let (mut raw, mut left_out) = (first as f64, 0);
    let mut gradient = vec![0.0; b.len()];
    for x in roots(&trimmed).into_iter().filter(|x| x.norm_sqr() < 1.0) {
        let adds = ((ONE + x) / (ONE - x)).re;
        if adds > longest {
            left_out += 1;
            continue;
        }
        raw += adds;
        // dxᵢ/dbₖ = −xᵢᵏ/B′(xᵢ), and (1 + x)/(1 − x) has the derivative 2/(1 − x)².
        let [_, slope] = polynomial(&trimmed, x);
        let mut share = -(ONE - x).powi(-2) * 2.0 / (slope * largest);
        for g in gradient.iter_mut().skip(first).take(trimmed.len()) {
            *g += share.re;
            share *= x;
        }
    }
    let along =
        |i: usize| gradient.iter().enumerate().map(|(j, g)| covariance[(i, j)] * g).sum::<f64>();
    let variance: f64 = gradient.iter().enumerate().map(|(i, g)| g * along(i)).sum();
    let found = AllPass { raw, std: variance.max(0.0).sqrt(), hidden: hidden(b, noise), left_out };
    let sound =
        found.raw.is_finite() && variance.is_finite() && found.hidden.iter().all(|h| h.is_finite());
    sound.then_some(found)
}

/// Frequencies between 0 and Nyquist's at which gain and noise are compared.
const FREQUENCIES: usize = 256;
/// A gain whose square is below this multiple of its variance is not significant: the variance's exponential distribution exceeds it once in 20 times.
const SEEN: f64 = 3.0;

/// Range of the phase delay that noise in the gain adds, samples, as [`AllPass::hidden`].
///
/// τ is the mean of the response minus the part that Bode's gain-phase relation explains. The explained part is ½ times the mean over the circle of (ln|B(0)| −
/// ln|B(ω)|)/sin²(ω/2). From the frequency ω_c on, noise exceeds the gain, and the estimate follows the noise. Source of the relation: Oppenheim and Schafer
/// (2010), "Discrete-Time Signal Processing", 3rd ed., section 12.3.
fn hidden(b: &[f64], covariance: &DMatrix<f64>) -> [f64; 2] {
    let taps = b.len();
    let variances: Vec<f64> = (0..taps)
        .map(|lag| {
            (0..taps - lag).map(|i| covariance[(i, i + lag)]).sum::<f64>()
                * if lag == 0 { 1.0 } else { 2.0 }
        })
        .collect();
    let frequency = |i: usize| PI * (i as f64 + 0.5) / FREQUENCIES as f64;
    // Powers of e^{−iω} by Horner's rule; the variance is real and even.
    let gain: Vec<f64> = (0..FREQUENCIES)
        .map(|i| polynomial(b, Complex::cis(-frequency(i)))[0].norm_sqr())
        .collect();
    let under =
        |i: &usize| gain[*i] < SEEN * polynomial(&variances, Complex::cis(-frequency(*i)))[0].re;
    let Some(from) = (0..FREQUENCIES).find(under) else { return [0.0; 2] };
    let edge = gain[from.saturating_sub(1)].max(f64::MIN_POSITIVE);
    let mut hidden = [0.0; 2];
    for (i, gain) in gain.iter().enumerate().skip(from) {
        let w = frequency(i);
        let excess = 0.5 * (gain.max(f64::MIN_POSITIVE) / edge).ln();
        let fall = ((0.5 * w).tan() / (0.5 * frequency(from)).tan()).ln();
        for (sum, slope) in hidden.iter_mut().zip([0.0, 2.0]) {
            let share = 0.5 / FREQUENCIES as f64;
            *sum += share * (excess + slope * fall) / (0.5 * w).sin().powi(2);
        }
    }
    hidden
}

/// Largest delay that a minimum-phase part hides, samples. A dead time that ends within a sample has a numerator b₀ + b₁x. The zero lies outside the circle
/// only in the second half of the sample. Even then it adds only twice the time beyond the half (for a plant slow compared with the sample).
const FRACTION: f64 = 0.5;

impl AllPass {
    /// The same in units of `scale` samples plus `more` samples. `spread` is the standard deviation of the delay that the model misses.
    pub(crate) fn scaled(self, scale: f64, more: f64, spread: f64) -> Self {
        Self {
            raw: scale * self.raw + more,
            std: (scale * self.std).hypot(spread),
            hidden: self.hidden.map(|h| scale * h),
            ..self
        }
    }

    /// The same for a numerator without its first `samples` coefficients.
    pub(crate) fn behind(self, samples: usize) -> Self {
        let samples = samples as f64;
        Self { raw: self.raw + samples, ..self }
    }

    /// The estimate of a method.
    pub(crate) fn answer(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let longest = pair.max_delay as f64;
        let delay = self.raw - 0.5 * (self.hidden[0] + self.hidden[1]);
        let [least, most] =
            [self.hidden[0].min(self.hidden[1]), self.hidden[0].max(self.hidden[1])];
        let interval = [
            self.raw - most - NORMAL_95 * self.std,
            self.raw - least.min(0.0) + NORMAL_95 * self.std + FRACTION,
        ];
        // The hidden delay is uniform between its ends.
        let std = self.std.hypot((most - least).hypot(FRACTION) / 12.0_f64.sqrt());
        pair.narrows(std)?;
        let note = (self.left_out > 0)
            .then(|| format!("{} zeros near z = 1 left out of the all-pass part", self.left_out));
        let estimate = pair.counted_at(delay, std, interval, delay > longest - FRACTION);
        Ok(estimate.with_raw_s(pair.seconds(self.raw)).noting(note))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    /// Without noise.
    fn alone(b: &[f64], longest: f64) -> Option<AllPass> {
        let none = DMatrix::zeros(b.len(), b.len());
        all_pass(b, [&none; 2], longest)
    }

    /// τ as the mean of the pulse response minus the part of Bode's gain-phase relation, without zeros.
    fn by_gain_and_phase(b: &[f64]) -> f64 {
        let sum: f64 = b.iter().sum();
        let mean = b.iter().enumerate().map(|(k, b)| k as f64 * b).sum::<f64>() / sum;
        let points = 1 << 15;
        let gain = |w: f64| {
            b.iter()
                .enumerate()
                .map(|(k, b)| Complex::from_polar(*b, -w * k as f64))
                .sum::<Complex<f64>>()
                .norm()
                .ln()
        };
        let explained: f64 = (0..points)
            .map(|i| {
                let w = 2.0 * PI * (i as f64 + 0.5) / points as f64;
                (gain(w) - sum.abs().ln()) / (0.5 * w).sin().powi(2)
            })
            .sum::<f64>()
            / points as f64;
        mean + 0.5 * explained
    }

    #[test]
    fn the_zeros_give_what_gain_and_phase_give() {
        let mut noisy: Vec<f64> =
            (0..40).map(|k| if k < 7 { 0.0 } else { 0.8_f64.powi(k - 7) }).collect();
        noisy.iter_mut().enumerate().for_each(|(k, b)| *b += 0.01 * (k as f64 * 12.9898).sin());
        for b in [
            vec![0.0, 0.0, 1.0, -0.5],
            vec![1.0, -2.0],
            vec![1.0, 3.0],
            vec![0.3, -0.2, 1.0, 0.4],
            noisy,
        ] {
            let (zeros, relation) = (alone(&b, 1e6).unwrap().raw, by_gain_and_phase(&b));
            assert!((zeros - relation).abs() < 2e-3, "{b:?}: {zeros} {relation}");
        }
    }

    #[test]
    fn known_zeros_add_what_their_formula_says() {
        // z − 2, x = ½: (1 + ½)/(1 − ½) = 3. z + 3: (1 − ⅓)/(1 + ⅓) = ½.
        assert_abs_diff_eq!(alone(&[1.0, -2.0], 9.0).unwrap().raw, 3.0, epsilon = 1e-12);
        assert_abs_diff_eq!(alone(&[0.0, 1.0, 3.0], 9.0).unwrap().raw, 1.5, epsilon = 1e-12);
        let guarded = alone(&[0.0, 0.0, 1.0, -1.0 / 0.999], 9.0).unwrap();
        assert_eq!((guarded.raw, guarded.left_out), (2.0, 1));
        assert!(alone(&[0.0, 0.0], 9.0).is_none() && alone(&[], 9.0).is_none());
    }

    #[test]
    fn the_standard_deviation_is_that_of_the_difference_quotients() {
        let b: Vec<f64> = (0..20)
            .map(|k| if k < 5 { 0.0 } else { 0.7_f64.powi(k - 5) } + 1e-3 * (k as f64 * 3.7).cos())
            .collect();
        let variance = 1e-8;
        let squares: f64 = (0..20)
            .map(|k| {
                let moved = |h: f64| {
                    let mut c = b.clone();
                    c[k] += h;
                    alone(&c, 1e6).unwrap().raw
                };
                ((moved(1e-6) - moved(-1e-6)) / 2e-6).powi(2)
            })
            .sum();
        let std = all_pass(&b, [&(DMatrix::identity(20, 20) * variance); 2], 1e6).unwrap().std;
        assert!(
            (std / (variance * squares).sqrt() - 1.0).abs() < 1e-3,
            "{std} {}",
            (variance * squares).sqrt()
        );
    }

    #[test]
    fn a_gain_above_the_noise_hides_nothing_and_one_that_drowns_hides_what_the_integral_says() {
        let b = [0.0, 1.0, 0.9];
        assert_eq!(hidden(&b, &DMatrix::zeros(3, 3)), [0.0; 2]);
        // Flat noise and a flat gain below it from the first frequency on. A constant gain adds nothing. A gain that falls as 1/ω² adds ∫
        // ln(tan(ω/2)/tan(ω_c/2))/sin²(ω/2) dω/π, with the leading part 2/tan(ω_c/2)/π.
        let flat = hidden(&[1.0], &DMatrix::from_element(1, 1, 1.0));
        let leading = 2.0 / PI / (0.25 * PI / FREQUENCIES as f64).tan();
        assert!(
            flat[0].abs() < 1e-12 && (flat[1] / leading - 1.0).abs() < 0.5,
            "{flat:?} {leading}"
        );
    }
}
