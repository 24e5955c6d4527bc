//! How good the verdict of `deadtime estimate` is on drawn records of the kinds that engineers bring: one JSON object a line of rates, or of single records.
//!
//! `cargo run --release --package deadtime-lab --bin verdict_study -- [--each] [--table FILE] DRAWS FIRST_SEED [KIND ...]`; with `--table` the rates are a page as well,
//! docs/results/studies/verdicts.md, which `scripts/verdict_gate --store` writes.
//!
//! Plants are advanced by their matrix exponential over a twentieth of a sample, apart from the crate's own simulation; dead times are multiples of that, so that a held input
//! changes between steps only.

use std::error::Error;

use deadtime::delay::report::Pair;
use deadtime::delay::{Condition, Job};
use deadtime::log::{Channel, Log};
use nalgebra::{SMatrix, SVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde_json::{Value, json};

/// Steps of a sample.
const FINE: usize = 20;
/// States of a plant at most.
const STATES: usize = 4;
/// Samples from which a jump is to be seen.
const LEAST_JUMP: f64 = 2.0;

/// ẋ = A·x + b·w, y = c·x + d·w, time in samples.
struct Plant {
    a: SMatrix<f64, STATES, STATES>,
    b: SVector<f64, STATES>,
    c: SVector<f64, STATES>,
    d: f64,
}

impl Plant {
    /// K(1 + zs)/Π(1 + Tᵢs), divided by s where it integrates.
    fn lags(lags: &[f64], zero: f64, integrates: bool) -> Self {
        let (mut a, mut b, mut c) = (SMatrix::zeros(), SVector::zeros(), SVector::zeros());
        for (i, lag) in lags.iter().enumerate() {
            a[(i, i)] = -1.0 / lag;
            if i == 0 { b[0] = 1.0 / lag } else { a[(i, i - 1)] = 1.0 / lag }
        }
        let n = lags.len();
        let mut d = 0.0;
        if integrates {
            // A pure integrator reads the input itself.
            if n == 0 {
                b[0] = 1.0
            } else {
                a[(n, n - 1)] = 1.0
            }
            c[n] = 1.0;
        } else if n == 0 {
            d = 1.0;
        } else {
            let last = lags[n - 1];
            c[n - 1] = 1.0 - zero / last;
            if n == 1 { d = zero / last } else { c[n - 2] = zero / last }
        }
        Self { a, b, c, d }
    }

    /// A pair of poles of this natural frequency, rad a sample, and damping.
    fn resonance(frequency: f64, damping: f64) -> Self {
        let mut plant =
            Self { a: SMatrix::zeros(), b: SVector::zeros(), c: SVector::zeros(), d: 0.0 };
        plant.a[(0, 1)] = 1.0;
        plant.a[(1, 0)] = -frequency * frequency;
        plant.a[(1, 1)] = -2.0 * damping * frequency;
        plant.b[1] = frequency * frequency;
        plant.c[0] = 1.0;
        plant
    }

    /// From rest.
    fn advance(&self) -> Advance {
        let mut whole = SMatrix::<f64, { STATES + 1 }, { STATES + 1 }>::zeros();
        whole.view_mut((0, 0), (STATES, STATES)).copy_from(&self.a);
        whole.view_mut((0, STATES), (STATES, 1)).copy_from(&self.b);
        Advance { step: (whole / FINE as f64).exp(), x: SVector::zeros() }
    }

    /// From rest; `delay` in steps at a step's number.
    fn respond(&self, u: &[f64], delay: impl Fn(usize) -> usize) -> Vec<f64> {
        let Advance { step, mut x } = self.advance();
        let mut y = Vec::with_capacity(u.len());
        for k in 0..u.len() {
            for i in 0..FINE {
                let at = k * FINE + i;
                x[STATES] = at.checked_sub(delay(at)).map_or(0.0, |at| u[at / FINE]);
                if i == 0 {
                    // The output is read before the command of its sample acts.
                    let before = at.checked_sub(delay(at) + 1).map_or(0.0, |at| u[at / FINE]);
                    let direct = if delay(at) == 0 { x[STATES] } else { before };
                    y.push(self.c.dot(&x.fixed_rows::<STATES>(0)) + self.d * direct);
                }
                let held = x[STATES];
                x = step * x;
                x[STATES] = held;
            }
        }
        y
    }
}

/// A plant's state and held input, and its matrix exponential over one step.
struct Advance {
    step: SMatrix<f64, { STATES + 1 }, { STATES + 1 }>,
    x: SVector<f64, { STATES + 1 }>,
}

impl Advance {
    fn state(&self) -> SVector<f64, STATES> {
        self.x.fixed_rows::<STATES>(0).into_owned()
    }

    /// By one sample; `input` of each of its steps.
    fn sample(&mut self, input: impl Fn(usize) -> f64) {
        for i in 0..FINE {
            self.x[STATES] = input(i);
            self.x = self.step * self.x;
        }
    }
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Levels that are held for some samples each: of two values, or of any.
fn held(rng: &mut ChaCha8Rng, samples: usize, least: usize, most: usize, binary: bool) -> Vec<f64> {
    let mut u = Vec::with_capacity(samples);
    while u.len() < samples {
        let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
        let level = if binary { sign } else { normal(rng) };
        let lasts = rng.random_range(least..=most).min(samples - u.len());
        u.extend(std::iter::repeat_n(level, lasts));
    }
    u
}

/// Noise of this pole and standard deviation.
fn noise(rng: &mut ChaCha8Rng, samples: usize, pole: f64, std: f64) -> Vec<f64> {
    let (scale, mut e) = ((1.0 - pole * pole).sqrt(), 0.0);
    (0..samples)
        .map(|_| {
            e = pole * e + scale * normal(rng);
            std * e
        })
        .collect()
}

fn std_dev(x: &[f64]) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / x.len() as f64).sqrt()
}

/// A record in samples, its dead time, and whether the delay jumps.
struct Drawn {
    u: Vec<f64>,
    y: Vec<f64>,
    truth: Option<f64>,
    jumps: bool,
}

/// A plant of one to three lags, a zero on the left or a resonance, as most are.
fn plant(rng: &mut ChaCha8Rng) -> Plant {
    let mut lag = |most: f64| -> f64 { (rng.random_range(0.7_f64.ln()..most.ln())).exp() };
    let (a, b, c) = (lag(20.0), lag(6.0), lag(3.0));
    match rng.random_range(0..6) {
        0 => Plant::lags(&[a], 0.0, false),
        1 | 2 => Plant::lags(&[a, b], 0.0, false),
        3 => Plant::lags(&[a, b, c], 0.0, false),
        4 => Plant::lags(&[a, b], 0.7 * b.min(a), false),
        _ => Plant::resonance(1.0 / a.max(2.0), rng.random_range(0.2..0.9)),
    }
}

/// What moves it: random bits, held ones, slow levels.
fn input(rng: &mut ChaCha8Rng, samples: usize) -> Vec<f64> {
    match rng.random_range(0..4) {
        0 => held(rng, samples, 1, 1, true),
        1 => held(rng, samples, 2, 8, true),
        2 => held(rng, samples, 3, 30, false),
        _ => noise(rng, samples, 0.8, 1.0),
    }
}

fn steps(rng: &mut ChaCha8Rng, most: f64) -> usize {
    (rng.random_range(0.0..most) * FINE as f64).round() as usize
}

fn noisy(rng: &mut ChaCha8Rng, y: Vec<f64>, ratio: f64, pole: f64) -> Vec<f64> {
    let std = std_dev(&y) / ratio.sqrt();
    let e = noise(rng, y.len(), pole, std);
    y.iter().zip(&e).map(|(y, e)| y + e).collect()
}

fn ratio(rng: &mut ChaCha8Rng) -> f64 {
    [3.0, 10.0, 30.0, 100.0, 1000.0][rng.random_range(0..5)]
}

fn colour(rng: &mut ChaCha8Rng) -> f64 {
    [0.0, 0.0, 0.5, 0.9][rng.random_range(0..4)]
}

fn stationary(
    rng: &mut ChaCha8Rng,
    plant: &Plant,
    u: Vec<f64>,
    delay: usize,
    ratio: f64,
    pole: f64,
) -> Drawn {
    let y = plant.respond(&u, |_| delay);
    let y = noisy(rng, y, ratio, pole);
    Drawn { u, y, truth: Some(delay as f64 / FINE as f64), jumps: false }
}

fn ordinary(rng: &mut ChaCha8Rng) -> Drawn {
    let samples = rng.random_range(300..1200);
    let (plant, u, delay) = (plant(rng), input(rng, samples), steps(rng, 15.0));
    let (ratio, pole) = (ratio(rng), colour(rng));
    stationary(rng, &plant, u, delay, ratio, pole)
}

/// Björklund's plants and inputs, with a dead time that is drawn.
fn benchmark(rng: &mut ChaCha8Rng) -> Drawn {
    let plant = match rng.random_range(0..3) {
        0 => Plant::lags(&[10.0, 1.0], 0.0, false),
        1 => Plant::lags(&[1.0, 0.1], 0.0, false),
        _ => Plant::lags(&[10.0, 1.0 / 0.3, 1.0], 0.5, false),
    };
    let u = match rng.random_range(0..3) {
        0 => held(rng, 500, 1, 1, true),
        1 => held(rng, 500, 3, 10, true),
        _ => (0..500)
            .map(|k| {
                if k < 50 {
                    0.0
                } else if (200..350).contains(&k) {
                    -1.0
                } else {
                    1.0
                }
            })
            .collect(),
    };
    let (delay, ratio) = (steps(rng, 15.0), [1.0, 100.0][rng.random_range(0..2)]);
    stationary(rng, &plant, u, delay, ratio, 0.0)
}

fn inverse(rng: &mut ChaCha8Rng) -> Drawn {
    let slow = rng.random_range(4.0..22.0);
    let fast = slow * rng.random_range(0.15..0.6);
    let plant = Plant::lags(&[slow, fast], -rng.random_range(0.4..1.2) * slow, false);
    let samples = rng.random_range(700..1800);
    let (u, delay) = (held(rng, samples, 1, 20, false), steps(rng, 15.0));
    let ratio = [100.0, 1000.0][rng.random_range(0..2)];
    stationary(rng, &plant, u, delay, ratio, 0.0)
}

fn slow(rng: &mut ChaCha8Rng) -> Drawn {
    let plant = Plant::lags(&[rng.random_range(4.0_f64.ln()..6.0).exp()], 0.0, false);
    let (u, delay) = (held(rng, 2000, 1, 60, true), steps(rng, 30.0));
    let ratio = ratio(rng).max(30.0);
    stationary(rng, &plant, u, delay, ratio, 0.0)
}

fn far(rng: &mut ChaCha8Rng) -> Drawn {
    let samples = rng.random_range(700..2000_usize);
    let (plant, u) = (plant(rng), held(rng, samples, 1, 8, true));
    let delay = 36 * FINE + steps(rng, samples as f64 / 4.0 - 36.0);
    let ratio = ratio(rng).max(10.0);
    stationary(rng, &plant, u, delay, ratio, 0.0)
}

fn integrating(rng: &mut ChaCha8Rng) -> Drawn {
    let lag = rng.random_range(1.0..15.0);
    let lags: &[f64] = if rng.random::<bool>() { &[lag] } else { &[] };
    let plant = Plant::lags(lags, 0.0, true);
    let samples = rng.random_range(400..1200_usize);
    let delay = steps(rng, 20.0);
    let u = match rng.random_range(0..3) {
        0 => {
            let at = rng.random_range(40..samples / 3);
            (0..samples).map(|k| f64::from(u8::from(k >= at))).collect()
        }
        1 => {
            let (at, lasts) = (rng.random_range(40..samples / 3), rng.random_range(10..60));
            (0..samples)
                .map(|k| if k < at { 0.0 } else { [1.0, 0.0, -1.0, 0.0][((k - at) / lasts) % 4] })
                .collect()
        }
        _ => held(rng, samples, 5, 30, true),
    };
    let y = plant.respond(&u, |_| delay);
    let std = std_dev(&y) * [0.005, 0.02, 0.05][rng.random_range(0..3)];
    let e = noise(rng, samples, 0.0, std);
    let y = y.iter().zip(&e).map(|(y, e)| y + e).collect();
    Drawn { u, y, truth: Some(delay as f64 / FINE as f64), jumps: false }
}

/// A delayed copy: two sensors of one signal, of relative degree 0. The hold of the simulation adds a sample to the delay.
fn copy(rng: &mut ChaCha8Rng) -> Drawn {
    let samples = rng.random_range(500..2000);
    let (u, delay) = (noise(rng, samples, 0.5, 1.0), FINE * rng.random_range(1..20_usize));
    let ratio = ratio(rng);
    let drawn = stationary(rng, &Plant::lags(&[], 0.0, false), u, delay, ratio, 0.0);
    Drawn { truth: drawn.truth.map(|samples| samples + 1.0), ..drawn }
}

fn direct(rng: &mut ChaCha8Rng) -> Drawn {
    let lag = rng.random_range(2.0..20.0);
    let plant = Plant::lags(&[lag], rng.random_range(0.2..3.0) * lag, false);
    let samples = rng.random_range(500..1500);
    let u = held(rng, samples, 1, 8, true);
    let ratio = ratio(rng).max(30.0);
    stationary(rng, &plant, u, 0, ratio, 0.0)
}

/// A slow input: a ramp and then a step, triangles, a sine that grows, or ramps from level to level.
fn ramps(rng: &mut ChaCha8Rng, samples: usize) -> Vec<f64> {
    let period = rng.random_range(samples / 5..samples / 2) as f64;
    let kind = rng.random_range(0..4);
    let levels = held(rng, samples / 40 + 3, 1, 1, false);
    let at = |k: usize| {
        let (share, turn) = (k as f64 / samples as f64, k as f64 / period);
        match kind {
            0 if share < 0.5 => 2.0 * share,
            0 if share < 0.6 => 0.0,
            0 => 1.5,
            1 => 4.0 * ((turn + 0.25).rem_euclid(1.0) - 0.5).abs() - 1.0,
            2 => (0.4 + share) * (std::f64::consts::TAU * turn).sin(),
            _ => {
                let part = (k % 40) as f64 / 40.0;
                levels[k / 40] * (1.0 - part) + levels[k / 40 + 1] * part
            }
        }
    };
    (0..samples).map(at).collect()
}

/// A motor that friction holds under a slow input: a threshold in one direction, a dead zone, or Coulomb friction on a mass.
fn friction(rng: &mut ChaCha8Rng) -> Drawn {
    let samples = rng.random_range(800..1500_usize);
    let (lag, delay, holds) =
        (rng.random_range(3.0..15.0), steps(rng, 8.0), rng.random_range(0.1..0.4));
    let u = ramps(rng, samples);
    let y = match rng.random_range(0..3) {
        0 => {
            let moved: Vec<f64> = u.iter().map(|u| (u - holds).max(0.0)).collect();
            Plant::lags(&[lag], 0.0, false).respond(&moved, |_| delay)
        }
        1 => {
            let moved: Vec<f64> = u.iter().map(|u| u - u.clamp(-holds, holds)).collect();
            Plant::lags(&[lag], 0.0, false).respond(&moved, |_| delay)
        }
        _ => coulomb(&u, lag, holds, delay),
    };
    let y = noisy(rng, y, 1000.0, 0.0);
    Drawn { u, y, truth: Some(delay as f64 / FINE as f64), jumps: false }
}

/// The speed of a mass under viscous friction, whose time constant is `lag`, and Coulomb friction of this size.
fn coulomb(u: &[f64], lag: f64, holds: f64, delay: usize) -> Vec<f64> {
    let keeps = (-1.0 / (FINE as f64 * lag)).exp();
    let mut speed: f64 = 0.0;
    let mut y = Vec::with_capacity(u.len());
    for k in 0..u.len() {
        y.push(speed);
        for i in 0..FINE {
            let force = (k * FINE + i).checked_sub(delay).map_or(0.0, |at| u[at / FINE]);
            let sign = if speed == 0.0 { force.signum() } else { speed.signum() };
            if speed == 0.0 && force.abs() <= holds {
                continue;
            }
            let next = keeps * speed + (1.0 - keeps) * (force - sign * holds);
            speed = if next * sign < 0.0 { 0.0 } else { next };
        }
    }
    y
}

fn sparse(rng: &mut ChaCha8Rng) -> Drawn {
    let samples = rng.random_range(600..2000_usize);
    let mut u = vec![0.0; samples];
    for _ in 0..rng.random_range(2..6) {
        let (at, lasts) = (rng.random_range(20..samples - 60), rng.random_range(3..40));
        u[at..at + lasts].fill(rng.random_range(0.5..2.0));
    }
    let (plant, delay, ratio) = (plant(rng), steps(rng, 15.0), ratio(rng).max(30.0));
    stationary(rng, &plant, u, delay, ratio, 0.0)
}

fn step(rng: &mut ChaCha8Rng) -> Drawn {
    let samples = rng.random_range(200..800_usize);
    let at = samples / 4;
    let u = (0..samples).map(|k| f64::from(u8::from(k >= at))).collect();
    let (plant, delay, ratio) = (plant(rng), steps(rng, 15.0), ratio(rng).max(100.0));
    stationary(rng, &plant, u, delay, ratio, 0.0)
}

/// A lag in a loop with a proportional and integrating controller and a set point.
fn looped(rng: &mut ChaCha8Rng) -> Drawn {
    let samples = rng.random_range(800..2000);
    let (lag, delay): (f64, usize) = (rng.random_range(5.0..20.0), rng.random_range(1..8));
    let pole = (-1.0 / lag).exp();
    let reference = held(rng, samples, 20, 80, false);
    let (gain, integral) = (0.3 * lag / (delay as f64 + 2.0), 0.3 / (delay as f64 + 2.0));
    let shade = colour(rng);
    let e = noise(rng, samples, shade, 0.05);
    let (mut x, mut sum): (f64, f64) = (0.0, 0.0);
    let (mut u, mut y) = (Vec::with_capacity(samples), Vec::with_capacity(samples));
    for k in 0..samples {
        let before: f64 = k.checked_sub(delay + 1).map_or(0.0, |at| u[at]);
        x = pole * x + (1.0 - pole) * before;
        y.push(x + e[k]);
        let off = reference[k] - y[k];
        sum += integral * off;
        u.push(gain * off + sum);
    }
    Drawn { u, y, truth: Some(delay as f64), jumps: false }
}

/// A plant of one or two lags and any dead time under a PI controller by Skogestad's rules (2003, J. Process Control 13(4), 291-309,
/// doi:10.1016/S0959-1524(02)00062-8). The set point moves, or a random binary signal is added to the command.
fn regulated(rng: &mut ChaCha8Rng) -> Drawn {
    let samples = rng.random_range(600..2000);
    let lag: f64 = rng.random_range(3.0_f64.ln()..30.0_f64.ln()).exp();
    let second = if rng.random::<bool>() { lag * rng.random_range(0.1..0.6) } else { 0.0 };
    let delay = FINE + steps(rng, 12.0);
    let plant = if second > 0.0 { vec![lag, second] } else { vec![lag] };
    let plant = Plant::lags(&plant, 0.0, false);
    // The half rule, with the controller's sample among the dead time.
    let (slow, dead) = (lag + 0.5 * second, delay as f64 / FINE as f64 + 0.5 * second + 0.5);
    let closed = dead * rng.random_range(0.8..2.5);
    let gain = slow / (closed + dead);
    let integral = gain / slow.min(4.0 * (closed + dead));
    let dithered = rng.random::<bool>();
    let (reference, dither) = if dithered {
        (vec![0.0; samples], held(rng, samples, 1, 6, true))
    } else {
        (held(rng, samples, 10, 80, false), vec![0.0; samples])
    };
    let shade = colour(rng);
    let std = rng.random_range(0.01_f64.ln()..0.1_f64.ln()).exp();
    let e = noise(rng, samples, shade, std);
    let mut advance = plant.advance();
    let (mut sum, mut u, mut y) = (0.0, Vec::with_capacity(samples), Vec::with_capacity(samples));
    for k in 0..samples {
        let now: f64 = plant.c.dot(&advance.state()) + e[k];
        let off = reference[k] - now;
        sum += integral * off;
        u.push(gain * off + sum + dither[k]);
        y.push(now);
        advance.sample(|i| (k * FINE + i).checked_sub(delay).map_or(0.0, |at| u[at / FINE]));
    }
    Drawn { u, y, truth: Some(delay as f64 / FINE as f64), jumps: false }
}

fn jump(rng: &mut ChaCha8Rng) -> Drawn {
    let samples = rng.random_range(700..1500_usize);
    let (plant, u) = (plant(rng), held(rng, samples, 1, 6, true));
    let before = steps(rng, 12.0);
    let by = FINE * rng.random_range(LEAST_JUMP..8.0) as usize;
    let after = if before >= by && rng.random::<bool>() { before - by } else { before + by };
    let at = FINE * rng.random_range(3 * samples / 10..7 * samples / 10);
    let y = plant.respond(&u, |k| if k < at { before } else { after });
    let ratio = ratio(rng).max(30.0);
    let y = noisy(rng, y, ratio, 0.0);
    Drawn { u, y, truth: None, jumps: true }
}

/// As many samples as a test bench records in a second or two.
fn short(rng: &mut ChaCha8Rng) -> Drawn {
    let samples = rng.random_range(80..200);
    let (plant, u) = (Plant::lags(&[rng.random_range(1.0..6.0)], 0.0, false), input(rng, samples));
    let (delay, ratio) = (steps(rng, 8.0), ratio(rng).max(10.0));
    stationary(rng, &plant, u, delay, ratio, 0.0)
}

type Kind = (&'static str, fn(&mut ChaCha8Rng) -> Drawn);

const KINDS: [Kind; 15] = [
    ("ordinary", ordinary),
    ("benchmark", benchmark),
    ("inverse", inverse),
    ("slow", slow),
    ("far", far),
    ("integrating", integrating),
    ("copy", copy),
    ("direct", direct),
    ("friction", friction),
    ("sparse", sparse),
    ("step", step),
    ("short", short),
    ("loop", looped),
    ("regulated", regulated),
    ("jump", jump),
];

/// The method that the verdict is held against.
const AGAINST: &str = "oe_posterior";

/// What was answered of one record, in samples.
fn answered(drawn: &Drawn) -> Result<Pair, Box<dyn Error + Send + Sync>> {
    let time_s = (0..drawn.u.len()).map(|k| k as f64).collect();
    let channels =
        vec![Channel::new("u", None, drawn.u.clone()), Channel::new("y", None, drawn.y.clone())];
    let log = Log::new("drawn", time_s, channels)?;
    let mut report = Job::new(vec![log], ["u"], ["y"]).run()?;
    Ok(report.pairs.remove(0))
}

/// One record as a JSON object: truth, verdict and every method's answer.
fn single(kind: &str, seed: u64, drawn: &Drawn, pair: &Pair) -> Value {
    let estimates: Vec<Value> = pair
        .estimates
        .iter()
        .map(|e| {
            json!({
                "m": e.method, "class": format!("{:?}", e.class), "o": format!("{:?}", e.outcome), "d": e.delay_s,
                "std": e.std_s, "ci": e.ci95_s, "raw": e.raw_delay_s, "bias": e.degree_bias_samples,
                "pred": e.predicted_std_s, "counts": e.counts(), "contra": e.contradicted,
                "distrust": e.distrust.iter().map(|c| format!("{c:?}")).collect::<Vec<_>>(), "t": e.time_s,
            })
        })
        .collect();
    json!({
        "kind": kind, "seed": seed, "n": drawn.u.len(), "truth": drawn.truth, "jumps": drawn.jumps,
        "delay": pair.verdict.delay_s, "ci": pair.verdict.ci95_s, "why": pair.verdict.why,
        "moving": pair.moving.is_some(), "agree": pair.verdict.grounds.agree,
        "findings": pair.findings.iter().map(|f| format!("{:?}", f.condition)).collect::<Vec<_>>(),
        "estimates": estimates,
    })
}

/// The median; none of nothing.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn rms(errors: &[f64]) -> Option<f64> {
    (!errors.is_empty())
        .then(|| (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt())
}

/// The rates of a kind.
fn rates(kind: &str, records: &[(Drawn, Pair)]) -> Value {
    let (mut errors, mut against) = (Vec::new(), Vec::new());
    let (mut widths, mut held) = (Vec::new(), 0);
    let (mut widths_against, mut held_against) = (Vec::new(), 0);
    for (drawn, pair) in records {
        let Some(truth) = drawn.truth else { continue };
        let (Some(delay), Some(interval)) = (pair.verdict.delay_s, pair.verdict.ci95_s) else {
            continue;
        };
        let holds = |[from, to]: [f64; 2]| usize::from(from - 1e-6 <= truth && truth <= to + 1e-6);
        held += holds(interval);
        widths.push(interval[1] - interval[0]);
        let other = pair.estimates.iter().find(|e| e.method == AGAINST);
        if let Some((other, [from, to])) = other.and_then(|e| Some((e.delay_s?, e.ci95_s?))) {
            errors.push(delay - truth);
            against.push(other - truth);
            held_against += holds([from, to]);
            widths_against.push(to - from);
        }
    }
    let shows = |p: &Pair| p.findings.iter().any(|f| f.condition == Condition::Feedback);
    json!({
        "kind": kind, "records": records.len(), "answered": widths.len(), "held": held,
        "rms_samples": rms(&errors), "width_samples": median(widths),
        "compared": against.len(), "held_by_oe_posterior": held_against,
        "rms_of_oe_posterior": rms(&against), "width_of_oe_posterior": median(widths_against),
        "jumps": records.iter().filter(|(d, _)| d.jumps).count(),
        "said_to_move": records.iter().filter(|(_, p)| p.moving.is_some()).count(),
        "said_to_be_looped": records.iter().filter(|(_, p)| shows(p)).count(),
    })
}

/// The page of the rates of all kinds.
fn page(rows: &[Value], draws: u64, first: u64) -> String {
    let number =
        |row: &Value, name: &str| row[name].as_f64().map_or(NONE.to_owned(), |v| format!("{v:.2}"));
    let share = |row: &Value, name: &str, of: &str| {
        let [part, of] = [&row[name], &row[of]].map(|v| v.as_f64().unwrap_or(0.0));
        if of > 0.0 { format!("{:.0} %", 100.0 * part / of) } else { NONE.to_owned() }
    };
    let mut text = format!(
        "# Verdicts\n\n{draws} drawn records of each kind, seeds from {first}, by `verdict_study --table` (lab/src/bin/verdict_study.rs has the kinds); `scripts/verdict_gate --store`\nwrites this page. \
         Errors and widths are in samples, widths are medians. `oe_posterior` alone is what the verdict is held against, where both answer. Records of `jump` have a dead\ntime that jumps \
         by two samples or more, those of `loop` and `regulated` are of closed loops; all others are of open loops with one dead time.\n\n\
         | kind | answered | interval holds | RMS | RMS of oe_posterior | its interval holds | width | width by oe_posterior's | said to move | said to be looped |\n\
         | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
    );
    for row in rows {
        let ratio = row["width_samples"]
            .as_f64()
            .zip(row["width_of_oe_posterior"].as_f64())
            .filter(|(_, other)| *other > 0.0);
        text.push_str(&format!(
            "| {} | {} | {} | {} | {} | {} | {} | {} | {} of {} | {} of {} |\n",
            row["kind"].as_str().unwrap_or_default(),
            share(row, "answered", "records"),
            share(row, "held", "answered"),
            number(row, "rms_samples"),
            number(row, "rms_of_oe_posterior"),
            share(row, "held_by_oe_posterior", "compared"),
            number(row, "width_samples"),
            ratio.map_or(NONE.to_owned(), |(own, other)| format!("{:.2}", own / other)),
            row["said_to_move"],
            row["records"],
            row["said_to_be_looped"],
            row["records"],
        ));
    }
    text
}

/// A cell without a number.
const NONE: &str = "–";

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let each =
        arguments.iter().position(|a| a == "--each").map(|at| arguments.remove(at)).is_some();
    let table = arguments.iter().position(|a| a == "--table").map(|at| {
        arguments.remove(at);
        arguments.remove(at)
    });
    let draws: u64 = arguments.first().map_or(Ok(10), |a| a.parse())?;
    let first: u64 = arguments.get(1).map_or(Ok(1), |a| a.parse())?;
    let asked = arguments.get(2..).unwrap_or_default();
    let mut rows = Vec::new();
    for (kind, draw) in
        KINDS.iter().filter(|(k, _)| asked.is_empty() || asked.iter().any(|a| a == k))
    {
        let one = |seed: u64| {
            let drawn = draw(&mut ChaCha8Rng::seed_from_u64(seed));
            let pair = answered(&drawn)?;
            if each {
                println!("{}", single(kind, seed, &drawn, &pair));
            }
            Ok((drawn, pair))
        };
        let records: Result<Vec<_>, Box<dyn Error + Send + Sync>> =
            (first..first + draws).into_par_iter().map(one).collect();
        rows.push(rates(kind, &records?));
        if let Some(row) = rows.last().filter(|_| !each) {
            println!("{row}");
        }
        if let Some(table) = &table {
            std::fs::write(table, page(&rows, draws, first))?;
        }
    }
    Ok(())
}
