//! The delay of the all-pass part of a model (DAP).
//!
//! Equation: G = G_mp·G_ap with G_mp minimum phase, τ̂ = −d arg G_ap(e^{iωTs})/dω at ω = 0. In x = q⁻¹ the numerator B(x) = Σ bₖxᵏ has its zeros outside the
//! z circle at |xᵢ| < 1, a pure delay being zeros at x = 0, and each adds Re (1 + xᵢ)/(1 − xᵢ) samples: τ̂ = Σ over |xᵢ| < 1. A zero on the circle adds nothing, so
//! the sum is continuous in B but at x = 1.
//!
//! The published form is −arg G_ap(e^{iω₁})/ω₁ at ω₁ = 10⁻⁴ with 1 added for the hold, where G_ap leaves the zeros at infinity out; the limit ω₁ → 0 differs from it
//! only for zeros within about 10⁻⁴ of 1.
//!
//! Source: Isaksson, Horch and Dumont (2001), "Event-triggered deadtime estimation from closed-loop data", Proc. ACC, 3280-3285; Björklund (2003),
//! LiU-TEK-LIC-2003:60, class 1b; Björklund and Ljung (2009), "An improved phase method for time-delay estimation", Automatica 45(10), 2467-2470.
//! The last of these shows that the sum fails where noise puts a zero just outside z = 1, and guards against it. Which zeros exactly its guard leaves out was not to be
//! had; here they are those that alone would add more than the search window, which no model needs to represent a delay inside it.

use nalgebra::{Complex, DMatrix};

use crate::delay::{DelayEstimate, Experiment, Outcome};
use crate::signal::{polynomial, roots};

/// The delay of the all-pass part, in units of its variable's own delay.
pub(in crate::delay) struct AllPass {
    /// τ̂.
    pub(in crate::delay) delay: f64,
    /// ∂τ̂/∂bₖ.
    pub(in crate::delay) gradient: Vec<f64>,
    /// Zeros too near to 1 to belong to a delay.
    pub(in crate::delay) left_out: usize,
}

const ONE: Complex<f64> = Complex::new(1.0, 0.0);

/// Coefficients below this share of the largest are rounding: a delay of whole samples leaves exact zeros before the first one.
const ROUNDING: f64 = 1e-13;

/// Of Σ bₖxᵏ; `longest` is the most that one zero may add. `None` where all coefficients are zero or one is no number.
pub(in crate::delay) fn all_pass(b: &[f64], longest: f64) -> Option<AllPass> {
    let largest = b.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let counts = |v: &&f64| v.abs() > ROUNDING * largest;
    let first = b.iter().position(|v| counts(&v))?;
    let last = b.iter().rposition(|v| counts(&v))?;
    let trimmed = b.get(first..=last)?;
    #[allow(clippy::cast_precision_loss)]
    let mut all_pass = AllPass { delay: first as f64, gradient: vec![0.0; b.len()], left_out: 0 };
    for x in roots(trimmed).into_iter().filter(|x| x.norm_sqr() < 1.0) {
        let adds = ((ONE + x) / (ONE - x)).re;
        if adds > longest {
            all_pass.left_out += 1;
            continue;
        }
        all_pass.delay += adds;
        // dxᵢ/dbₖ = −xᵢᵏ/B′(xᵢ), and (1 + x)/(1 − x) has the derivative 2/(1 − x)².
        let [_, slope] = polynomial(trimmed, x);
        let mut share = -(ONE - x).powi(-2) * 2.0 / slope;
        for g in all_pass.gradient.iter_mut().skip(first).take(trimmed.len()) {
            *g += share.re;
            share *= x;
        }
    }
    (all_pass.delay.is_finite() && all_pass.gradient.iter().all(|g| g.is_finite())).then_some(all_pass)
}

/// The most that a minimum-phase part hides, samples: a dead time that ends within a sample makes a numerator b₀ + b₁x whose zero lies outside the circle only in
/// the second half of it, and even then adds but twice what is beyond the half (for a plant slow against the sample).
pub(in crate::delay) const HIDDEN: f64 = 0.5;

impl AllPass {
    /// Its standard deviation by propagation of the coefficients' covariance.
    fn std(&self, covariance: &DMatrix<f64>) -> f64 {
        let sum: f64 = (self.gradient.iter().enumerate())
            .map(|(i, gi)| gi * self.gradient.iter().enumerate().map(|(j, gj)| covariance[(i, j)] * gj).sum::<f64>())
            .sum();
        sum.max(0.0).sqrt()
    }

    /// The answer of a method: `scale` samples for each unit and `more` besides; `spread` is the standard deviation of what the model misses.
    pub(in crate::delay) fn answer(
        &self,
        covariance: &DMatrix<f64>,
        (scale, more, spread): (f64, f64, f64),
        bias: usize,
        max_delay: usize,
        experiment: &Experiment,
    ) -> DelayEstimate {
        let raw = more + scale * self.delay;
        let noise = (scale * self.std(covariance)).hypot(spread);
        #[allow(clippy::cast_precision_loss)]
        let (longest, off) = (max_delay as f64, bias as f64);
        let note = (self.left_out > 0).then(|| format!("{} zeros near z = 1 left out of the all-pass part", self.left_out));
        if !(noise <= longest / 12.0_f64.sqrt()) {
            let note = format!("a standard deviation of {noise:.1} samples says no more than the search window does");
            return DelayEstimate::without(Outcome::Flat, note);
        }
        // What is hidden is anywhere between 0 and its most.
        let std = noise.hypot(HIDDEN / 12.0_f64.sqrt());
        let interval = [raw - 1.96 * noise, raw + 1.96 * noise + HIDDEN];
        DelayEstimate::measured(raw, std, interval, raw > longest - HIDDEN, off, experiment.sample_time).noting(note)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// τ as the mean of the pulse response minus what Bode's relation between gain and phase explains: no zeros are looked for.
    fn by_gain_and_phase(b: &[f64]) -> f64 {
        let sum: f64 = b.iter().sum();
        let mean = b.iter().enumerate().map(|(k, b)| k as f64 * b).sum::<f64>() / sum;
        let points = 1 << 15;
        let gain = |w: f64| b.iter().enumerate().map(|(k, b)| Complex::from_polar(*b, -w * k as f64)).sum::<Complex<f64>>().norm().ln();
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
        let mut noisy: Vec<f64> = (0..40).map(|k| if k < 7 { 0.0 } else { 0.8_f64.powi(k - 7) }).collect();
        noisy.iter_mut().enumerate().for_each(|(k, b)| *b += 0.01 * (k as f64 * 12.9898).sin());
        for b in [vec![0.0, 0.0, 1.0, -0.5], vec![1.0, -2.0], vec![1.0, 3.0], vec![0.3, -0.2, 1.0, 0.4], noisy] {
            let (zeros, relation) = (all_pass(&b, 1e6).unwrap().delay, by_gain_and_phase(&b));
            assert!((zeros - relation).abs() < 2e-3, "{b:?}: {zeros} {relation}");
        }
    }

    #[test]
    fn known_zeros_add_what_their_formula_says() {
        // z − 2, x = ½: (1 + ½)/(1 − ½) = 3. z + 3: (1 − ⅓)/(1 + ⅓) = ½.
        assert!((all_pass(&[1.0, -2.0], 9.0).unwrap().delay - 3.0).abs() < 1e-12);
        assert!((all_pass(&[0.0, 1.0, 3.0], 9.0).unwrap().delay - 1.5).abs() < 1e-12);
        let guarded = all_pass(&[0.0, 0.0, 1.0, -1.0 / 0.999], 9.0).unwrap();
        assert_eq!((guarded.delay, guarded.left_out), (2.0, 1));
        assert!(all_pass(&[0.0, 0.0], 9.0).is_none() && all_pass(&[], 9.0).is_none());
    }

    #[test]
    fn the_gradient_is_the_difference_quotient() {
        let b: Vec<f64> = (0..20).map(|k| if k < 5 { 0.0 } else { 0.7_f64.powi(k - 5) } + 0.01 * (k as f64 * 3.7).cos()).collect();
        let at = all_pass(&b, 1e6).unwrap();
        for k in 0..20 {
            let moved = |h: f64| {
                let mut c = b.clone();
                c[k] += h;
                all_pass(&c, 1e6).unwrap().delay
            };
            let quotient = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!((quotient - at.gradient[k]).abs() < 1e-4 * quotient.abs().max(1.0), "{k}: {quotient} {}", at.gradient[k]);
        }
    }
}
