//! Inputs that excite too little for a dead time by any method: one steady sine, or a few samples.
//!
//! Equation: u(t) = c + a·cos ωt + b·sin ωt + r(t). A plant in its steady state responds with one gain and one phase −ωL − φ(ω), φ the lag of its poles. Every
//! L up to −phase/ω fits with some lag, and so does L + k·2π/ω.
//!
//! How it can be wrong: a small remainder r that is independent of the line carries information, and so does a start from rest. Both are tested before a
//! refusal. A sine whose amplitude or frequency drifts is no single line and passes.

use std::f64::consts::TAU;

use deadtime_signal::dft;
use nalgebra::{Complex, Matrix3, Vector3};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

use crate::posterior::{effective_samples, unseen};
use deadtime_identify::Record;

/// Samples below which only the response to one step is estimated; a diagnosis needs as many.
pub(super) const SHORTEST: usize = 50;

/// Share of the input's power off the line up to which only the line is used.
const OFF_LINE: f64 = 0.05;
/// Share of power at which the remainder is rounding.
const ROUNDING: f64 = 1e-18;
/// Periods that a line must have in the longest record.
const PERIODS: f64 = 2.0;
/// Minimum number of samples in a first period whose power is compared.
const FIRST: usize = 10;
/// The probability that a steady response passes for a start.
const BY_CHANCE: f64 = 1e-3;
/// Points of the spectrum for each sample.
const PADDED: usize = 4;
/// Iterations of the golden-section search for the frequency.
const STEPS: usize = 60;

/// The single frequency of an input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OneFrequency {
    /// Its period, samples.
    pub(super) period: f64,
    /// The delay of the output's phase, samples, from 0 to a period: an upper bound of the dead time within the first period.
    pub(super) phase_delay: f64,
}

/// A constant, a cosine and a sine of frequency `omega`, fitted to the measured samples of `x` by least squares, and the residuals.
fn fitted(x: &[f64], there: Option<&[bool]>, omega: f64) -> Option<(Vector3<f64>, Vec<f64>)> {
    let middle = 0.5 * x.len() as f64;
    let row = |t: usize| {
        let (sin, cos) = (omega * (t as f64 - middle)).sin_cos();
        Vector3::new(1.0, cos, sin)
    };
    let counts = |t: usize| there.is_none_or(|p| p[t]);
    let (mut gram, mut by) = (Matrix3::zeros(), Vector3::zeros());
    for (t, v) in x.iter().enumerate().filter(|(t, _)| counts(*t)) {
        let row = row(t);
        gram += row * row.transpose();
        by += row * *v;
    }
    let weights = gram.cholesky()?.solve(&by);
    let left = |(t, v): (usize, &f64)| if counts(t) { v - weights.dot(&row(t)) } else { 0.0 };
    let left = x.iter().enumerate().map(left).collect();
    Some((weights, left))
}

fn power(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum()
}

/// The frequency, radians per sample, of the strongest line of `x`.
fn strongest(x: &[f64]) -> Option<f64> {
    let points = (PADDED * x.len()).next_power_of_two();
    let mean = x.iter().sum::<f64>() / x.len().max(1) as f64;
    let mut spectrum: Vec<Complex<f64>> = x.iter().map(|v| Complex::new(v - mean, 0.0)).collect();
    spectrum.resize(points, Complex::new(0.0, 0.0));
    dft(&mut spectrum);
    let peak = (1..points / 2)
        .max_by(|a, b| spectrum[*a].norm_sqr().total_cmp(&spectrum[*b].norm_sqr()))?;
    let bin = TAU / points as f64;
    let (mut low, mut high) = (bin * (peak as f64 - 2.0).max(0.5), bin * (peak as f64 + 2.0));
    let cost = |omega| fitted(x, None, omega).map_or(f64::INFINITY, |(_, left)| power(&left));
    // Share of a bracket that each step keeps.
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let inner = |low: f64, high: f64| [high - golden * (high - low), low + golden * (high - low)];
    let mut at = inner(low, high);
    let mut costs = at.map(cost);
    for _ in 0..STEPS {
        if costs[0] < costs[1] {
            high = at[1];
            at = inner(low, high);
            costs = [cost(at[0]), costs[0]];
        } else {
            low = at[0];
            at = inner(low, high);
            costs = [costs[1], cost(at[1])];
        }
        if high - low < 1e-12 {
            break;
        }
    }
    Some(0.5 * (low + high))
}

/// The line of the input, where no other part of the records carries information on the plant. Power off the line is then invisible in the output, and no
/// record starts from rest.
pub(super) fn one_frequency(records: &[Record<'_>], max_delay: usize) -> Option<OneFrequency> {
    let longest = records.iter().max_by_key(|r| r.len())?;
    let omega = strongest(&longest.u)?;
    let period = TAU / omega;
    if (longest.len() as f64) < PERIODS * period {
        return None;
    }
    let (mut off_line, mut all) = (0.0, 0.0);
    let mut cross = Complex::new(0.0, 0.0);
    let mut left: Vec<Record<'static>> = Vec::with_capacity(records.len());
    for r in records {
        let (input, u) = fitted(&r.u, None, omega)?;
        let (output, y) = fitted(&r.y, r.present.as_deref(), omega)?;
        off_line += power(&u);
        all += power(&u) + 0.5 * r.len() as f64 * (input[1].powi(2) + input[2].powi(2));
        // a·cos + b·sin is the real part of (a − ib)·e^{iωt}.
        let line = |w: Vector3<f64>| Complex::new(w[1], -w[2]);
        cross += line(output) * line(input).conj();
        let present = r.present.as_ref().map(|p| p.to_vec().into());
        left.push(Record { u: u.into(), y: y.into(), present });
    }
    if off_line > OFF_LINE * all || left.iter().any(|r| starts(r, period)) {
        return None;
    }
    if off_line > ROUNDING * all && unseen(&left, max_delay).is_none() {
        return None;
    }
    let phase_delay = (-cross.arg()).rem_euclid(TAU) / omega;
    Some(OneFrequency { period, phase_delay })
}

/// The first period has significantly more power off the line than the others: a transient.
fn starts(left: &Record<'_>, period: f64) -> bool {
    let first = (period.ceil() as usize).max(FIRST);
    if left.len() < 2 * first {
        return false;
    }
    let (head, tail) = left.y.split_at(first);
    let count = |from: usize, to: usize| {
        left.present.as_ref().map_or(to - from, |p| p[from..to].iter().filter(|p| **p).count())
    };
    let of_head = count(0, first) as f64;
    let of_tail = count(first, left.len()) as f64;
    let share = effective_samples(tail) / tail.len() as f64;
    let ratio = power(head) / of_head.max(1.0) / (power(tail) / of_tail.max(1.0)).max(1e-300);
    FisherSnedecor::new((share * of_head).max(1.0), (share * of_tail).max(1.0))
        .is_ok_and(|f| ratio > f.inverse_cdf(1.0 - BY_CHANCE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// The response of a lag behind a delay to `u`, sample by sample, from rest.
    fn answer(u: &[f64], pole: f64, delay: usize) -> Vec<f64> {
        let mut x = 0.0;
        (0..u.len())
            .map(|t| {
                x = pole * x + (1.0 - pole) * t.checked_sub(delay + 1).map_or(0.0, |at| u[at]);
                x
            })
            .collect()
    }

    struct Drawn {
        rng: ChaCha8Rng,
        omega: f64,
        pole: f64,
        delay: usize,
        noise: f64,
    }

    impl Drawn {
        fn new(seed: u64) -> Self {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let omega = TAU / rng.random_range(7.0..60.0);
            let (pole, delay) = (rng.random_range(0.2..0.9), rng.random_range(0..15));
            let noise = rng.random_range(0.005..0.1);
            Self { rng, omega, pole, delay, noise }
        }

        /// The samples behind the first `head`, with noise on the output.
        fn record(&mut self, u: &[f64], head: usize) -> Record<'static> {
            let y = answer(u, self.pole, self.delay);
            let mut noisy = |v: &f64| -> f64 {
                let e: f64 = StandardNormal.sample(&mut self.rng);
                v + self.noise * e
            };
            let y: Vec<f64> = y[head..].iter().map(&mut noisy).collect();
            Record::new(u[head..].to_vec(), y)
        }

        fn sine(&mut self, samples: usize) -> Vec<f64> {
            let phase = self.rng.random_range(0.0..TAU);
            (0..samples).map(|t| (self.omega * t as f64 + phase).sin()).collect()
        }
    }

    #[test]
    fn one_steady_sine_is_one_frequency_with_the_phase_of_plant_and_delay() {
        for seed in 0..60 {
            let mut drawn = Drawn::new(seed);
            let mut u = drawn.sine(900);
            // Every third command was logged with noise that did not reach the plant.
            let exact = drawn.record(&u, 300);
            if seed % 3 == 0 {
                for v in &mut u {
                    let e: f64 = StandardNormal.sample(&mut drawn.rng);
                    *v += 0.02 * e;
                }
            }
            let record = Record { u: u[300..].to_vec().into(), ..exact };
            let found = one_frequency(&[record], 35).unwrap_or_else(|| panic!("{seed}"));
            let pole = Complex::from_polar(1.0, -drawn.omega);
            let plant = pole * (1.0 - drawn.pole) / (1.0 - drawn.pole * pole);
            let lag = drawn.delay as f64 - plant.arg() / drawn.omega;
            let period = TAU / drawn.omega;
            let off = (found.phase_delay - lag + 0.5 * period).rem_euclid(period) - 0.5 * period;
            assert!((found.period / period - 1.0).abs() < 0.01, "{seed}: {found:?}");
            assert!(off.abs() < 0.03 * period, "{seed}: {found:?}, {lag}");
        }
    }

    #[test]
    fn what_tells_more_than_one_phase_is_no_single_frequency() {
        let mut passed = 0;
        for seed in 0..40 {
            let mut drawn = Drawn::new(100 + seed);
            drawn.noise = 0.01;
            let sine = drawn.sine(900);
            let binary: Vec<f64> =
                (0..900).map(|_| if drawn.rng.random::<bool>() { 1.0 } else { -1.0 }).collect();
            let sum = |by: f64| sine.iter().zip(&binary).map(|(s, b)| s + by * b).collect();
            let dithered: Vec<f64> = sum(0.15);
            let second: Vec<f64> =
                (0..900).map(|t| sine[t] + 0.5 * (0.37 * drawn.omega * t as f64).sin()).collect();
            let chirp: Vec<f64> = (0..900)
                .map(|t| (drawn.omega * t as f64 * (1.0 + t as f64 / 900.0)).sin())
                .collect();
            for (u, head) in [(&dithered, 300), (&second, 300), (&chirp, 300), (&binary, 300)] {
                let record = drawn.record(u, head);
                assert_eq!(one_frequency(&[record], 35), None, "{seed}");
            }
            // The same sine from rest.
            let record = drawn.record(&sine, 0);
            passed += usize::from(one_frequency(&[record], 35).is_none());
        }
        assert!(passed >= 32, "a start from rest is seen in {passed} of 40");
    }
}
