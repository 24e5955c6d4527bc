//! The slope of the phase that the magnitude does not explain.
//!
//! Equation: H = ±|H|·e^(iφ_mp)·e^(−iωτ), with φ_mp(ω) = (1/π)·∫ (d ln|H|/dν)·ln coth|ν/2| dν, ν = ln(u/ω). τ̂ is the slope of the phase minus φ_mp.
//!
//! ln|H| is linear over ln ω between the frequencies, and extrapolated linearly beyond the ends. The true continuation is unknown. One more pole above the last
//! frequency ω_N turns the phase below like a delay of 2/(π·ω_N). The phase error of such a pole is the interval's systematic part.

use nalgebra::Complex;

use super::estimator::{ResponseEstimator, ResponseMethod, ResponseSearch, ends};
use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::method::Class;
use deadtime_log::{FrequencyResponse, Quality};
use deadtime_signal::registry::entry;
use deadtime_signal::stats::{self, NORMAL_95};

/// Inputs: H(iω) at N frequencies. Output: seconds.
///
/// Assumes: a stable plant without zeros in the right half-plane (minimum phase except for the delay). The frequencies are so dense that ln|H| is linear
/// between them, resonances included.
/// Resolution and cost: ±0.64/ω_N by the continuation beyond the last frequency ω_N; O(N²).
/// Fails when: zeros lie in the right half-plane (each adds 2/z), few frequencies are on a resonance, or several delays fit the phase (`flat`).
/// Source: Bode (1945), "Network Analysis and Feedback Amplifier Design", chapter XIV, for the relation between magnitude and phase. The book leaves the
/// extrapolation open; here it is the mean slope of the last half octave.
///
/// # Example
/// ```
/// use deadtime_delay::{BodePhase, ResponseEstimator, ResponseSearch};
/// use deadtime_log::{FrequencyResponse, Quality};
/// use nalgebra::Complex;
/// let omega: Vec<f64> = (0..60).map(|k| 0.1 * 10.0_f64.powf(f64::from(k) / 25.0)).collect();
/// let values = omega.iter().map(|w| Complex::cis(-0.43 * w) * 2.0 / Complex::new(1.0, 0.8 * w)).collect();
/// let response = FrequencyResponse::new("sweep", omega, values, Quality::Unknown)?;
/// let search = ResponseSearch { max_delay_s: 2.0, stop: Default::default() };
/// let answer = BodePhase::default().estimate(&response, &search)?;
/// assert!((answer.delay_s.unwrap() - 0.43).abs() < 0.02);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BodePhase {}

/// Its line in the list.
pub(super) const METHOD: ResponseMethod = ResponseMethod {
    entry: entry!(
        "bode_phase",
        "slope of the phase that the magnitude does not explain",
        BodePhase,
        dyn ResponseEstimator
    ),
    class: Class::Frequency,
    needs: "a minimum-phase plant but for the delay, frequencies close enough to show its resonances",
    blind_to: "zeros in the right half-plane: it takes them for delay; what is beyond the last frequency",
};

/// Delays tested per period of the highest frequency.
const STEPS: f64 = 16.0;
/// Below this value the first terms of the power series suffice.
const NEAR: f64 = 0.1;
/// Another delay is equivalent from this share of the best phase sum.
const AS_GOOD: f64 = 0.97;

impl ResponseEstimator for BodePhase {
    fn estimate(
        &self,
        response: &FrequencyResponse,
        search: &ResponseSearch,
    ) -> Result<DelayEstimate, DelayError> {
        let phases = Phases::of(response);
        let (_, last) = ends(response);
        let steps =
            (search.max_delay_s * last * STEPS / std::f64::consts::TAU).ceil().max(8.0) as usize;
        let step = search.max_delay_s / steps as f64;
        let profile: Vec<f64> =
            (0..=steps).map(|k| phases.sum(step * k as f64).abs() / phases.total).collect();
        let without = |outcome, note: String| Ok(DelayEstimate::without(outcome, note));
        let best = profile.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((at, height)) = best else {
            return without(Outcome::Flat, "no delay of the window can be tried".to_owned());
        };
        let count = response.omega_rad_s().len() as f64;
        let chance = 3.0 / count.sqrt();
        if height < chance.min(0.9) {
            let note = format!(
                "the phases add up to {height:.2} of what they could at best: no straight line"
            );
            return without(Outcome::NotVisible, note);
        }
        let PhaseLine { tau, rest, squares } = phases.line(step * at as f64);
        let (total, freedom) = (phases.total, (count - 1.0).max(1.0));
        // The variance of a phase of mean weight; correlated errors, as those of linear interpolation, count as 25 %.
        let noise = (4.0 * rest / total * count / freedom * total / count / squares).sqrt();
        let systematic = 2.0 / (std::f64::consts::PI * last);
        let std = noise.hypot(systematic / 3.0_f64.sqrt());
        let half = NORMAL_95 * noise + systematic;
        let others = profile.iter().enumerate().filter(|(k, v)| {
            **v > AS_GOOD * height
                && (step * *k as f64 - tau).abs() > half.max(std::f64::consts::PI / last)
        });
        if let Some((k, _)) = others.max_by(|a, b| a.1.total_cmp(b.1)) {
            let note = format!(
                "delays of {tau:.4} and {:.4} s put the phases on a line alike: a narrow band, or frequencies too far apart",
                step * k as f64
            );
            return without(Outcome::Flat, note);
        }
        if tau < -half {
            let note =
                "the phase lags less than the magnitude says: no delay, or an unstable plant";
            return without(Outcome::NotVisible, note.to_owned());
        }
        let at_edge = tau > search.max_delay_s - step;
        let delay = tau.max(0.0);
        let interval = [(tau - half).max(0.0), (tau + half).max(delay)];
        Ok(DelayEstimate::in_seconds(delay, std, interval, at_edge))
    }
}

/// The phases that the magnitude does not explain, as unit phasors, each with its weight.
struct Phases<'a> {
    omega: &'a [f64],
    left: Vec<Complex<f64>>,
    weights: Vec<f64>,
    /// Σ weights.
    total: f64,
}

/// The straight line through the phases, in radians: its slope, its residual, and Σ weight·ω².
struct PhaseLine {
    tau: f64,
    rest: f64,
    squares: f64,
}

impl<'a> Phases<'a> {
    fn of(response: &'a FrequencyResponse) -> Self {
        let (omega, values) = (response.omega_rad_s(), response.values());
        let left: Vec<Complex<f64>> = values
            .iter()
            .zip(minimum_phase(omega, values))
            .map(|(h, phase)| h / h.norm() * Complex::cis(-phase))
            .collect();
        let weights: Vec<f64> = match response.quality() {
            Quality::Unknown => vec![1.0; omega.len()],
            Quality::Coherence(c) => c.iter().map(|c| c / (1.0 - c).max(1e-3)).collect(),
            Quality::Std(s) => s.iter().zip(values).map(|(s, h)| h.norm_sqr() / (s * s)).collect(),
        };
        let total = weights.iter().sum();
        Self { omega, left, weights, total }
    }

    /// Phase, frequency and weight.
    fn each(&self) -> impl Iterator<Item = (&Complex<f64>, &f64, &f64)> {
        self.left.iter().zip(self.omega).zip(&self.weights).map(|((p, w), weight)| (p, w, weight))
    }

    /// The weighted sum of the phasors behind a delay.
    fn sum(&self, tau: f64) -> f64 {
        self.each().map(|(p, w, weight)| weight * (p * Complex::cis(w * tau)).re).sum()
    }

    /// A straight line through the phases, which are small around the best grid delay.
    fn line(&self, mut tau: f64) -> PhaseLine {
        let (mut rest, mut squares) = (0.0, 1.0);
        for _ in 0..4 {
            let sign = self.sum(tau).signum();
            let (mut along, mut power, mut about) = (0.0, 0.0, 0.0);
            for (p, w, weight) in self.each() {
                let phase = (p * Complex::cis(w * tau) * sign).arg();
                along += weight * w * phase;
                power += weight * w * w;
                about += weight * phase * phase;
            }
            tau -= along / power;
            (rest, squares) = (about, power);
        }
        PhaseLine { tau, rest, squares }
    }
}

/// φ_mp at each frequency.
fn minimum_phase(omega: &[f64], values: &[Complex<f64>]) -> Vec<f64> {
    let nu: Vec<f64> = omega.iter().map(|w| w.ln()).collect();
    let gain: Vec<f64> = values.iter().map(|h| h.norm().ln()).collect();
    let slopes: Vec<f64> = nu
        .windows(2)
        .zip(gain.windows(2))
        .map(|(n, g)| (g[1] - g[0]) / (n[1] - n[0]).max(f64::MIN_POSITIVE))
        .collect();
    let (low, high) = (
        end_slope(nu.iter().copied().zip(gain.iter().copied())),
        end_slope(nu.iter().rev().copied().zip(gain.iter().rev().copied())),
    );
    let whole = 0.25 * std::f64::consts::PI.powi(2);
    nu.iter()
        .map(|at| {
            let before: Vec<f64> = nu.iter().map(|n| integral(n - at)).collect();
            let inside: f64 =
                slopes.iter().zip(before.windows(2)).map(|(m, f)| m * (f[1] - f[0])).sum();
            let (first, last) =
                (before.first().copied().unwrap_or(0.0), before.last().copied().unwrap_or(0.0));
            (inside + low * (first + whole) + high * (whole - last)) / std::f64::consts::PI
        })
        .collect()
}

/// The slope of a straight line through the points within half an octave of the first, at least four.
fn end_slope(points: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let Some((end, _)) = points.clone().next() else { return 0.0 };
    let near: Vec<(f64, f64)> = points
        .enumerate()
        .filter(|(i, (n, _))| *i < 4 || (n - end).abs() < 0.5 * 2.0_f64.ln())
        .map(|(_, p)| p)
        .collect();
    let x = stats::mean(near.iter().map(|p| p.0)).unwrap_or(0.0);
    let y = stats::mean(near.iter().map(|p| p.1)).unwrap_or(0.0);
    let power: f64 = near.iter().map(|p| (p.0 - x).powi(2)).sum();
    near.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / power.max(f64::MIN_POSITIVE)
}

/// ∫₀^ν ln coth|t/2| dt, odd: π²/4 − 2·Σ e^(−k|ν|)/k² over odd k for ν above 0. Near 0, where that converges slowly: ν·(1 − ln ν/2) + ν³/36.
fn integral(nu: f64) -> f64 {
    let size = nu.abs();
    if size == 0.0 {
        return 0.0;
    }
    if size < NEAR {
        return nu * (1.0 - (0.5 * size).ln()) + nu.powi(3) / 36.0;
    }
    let base = (-size).exp();
    let (mut power, mut sum, mut k) = (base, 0.0, 1.0);
    while power > 1e-16 {
        sum += power / (k * k);
        power *= base * base;
        k += 2.0;
    }
    (0.25 * std::f64::consts::PI.powi(2) - 2.0 * sum) * nu.signum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_phase_of_a_lag_follows_from_its_magnitude() {
        let omega: Vec<f64> = (0..200).map(|k| 10.0_f64.powf(-2.0 + f64::from(k) / 50.0)).collect();
        let lag: Vec<Complex<f64>> = omega.iter().map(|w| 3.0 / Complex::new(1.0, *w)).collect();
        let worst = minimum_phase(&omega, &lag)
            .iter()
            .zip(&omega)
            .map(|(p, w)| (p + w.atan()).abs())
            .fold(0.0, f64::max);
        assert!(worst < 2e-3, "{worst}");
        // An integrator is a straight line: a quarter turn everywhere.
        let integrator: Vec<Complex<f64>> =
            omega.iter().map(|w| Complex::new(0.0, *w).inv()).collect();
        assert!(
            minimum_phase(&omega, &integrator)
                .iter()
                .all(|p| (p + std::f64::consts::FRAC_PI_2).abs() < 1e-3)
        );
    }

    #[test]
    fn the_integral_is_that_of_many_small_steps() {
        for nu in [0.05, 0.3, 1.0, 2.5] {
            let steps = 200_000;
            let h = nu / f64::from(steps);
            let sum: f64 =
                (0..steps).map(|k| -((0.5 * h * (f64::from(k) + 0.5)).tanh()).ln() * h).sum();
            assert!((integral(nu) - sum).abs() < 1e-5, "{nu}: {} {sum}", integral(nu));
            assert_eq!(integral(-nu), -integral(nu));
        }
    }
}
