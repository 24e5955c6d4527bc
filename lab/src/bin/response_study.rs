//! How often the 95 % interval of a dead time from a frequency response, or from a table of a step response, holds the true one, over random plants: tables in Markdown.
//!
//! `cargo run --release --package deadtime-lab --bin response_study -- [DRAWS] [FIRST SEED]`; `lab/study responses` writes them into the documents.

use std::collections::BTreeMap;
use std::error::Error;
use std::f64::consts::FRAC_1_SQRT_2;

use deadtime::delay::{Feedback, Job, ResponseJob, STEP_METHODS, Scope, Verdict, chosen};
use deadtime::log::{Channel, FrequencyResponse, Log, Quality, STEP};
use deadtime::nalgebra::Complex;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

/// What a drawn record was answered: the interval's width over the slowest time constant, and whether it holds the dead time; `None` without an answer.
type Answer = Option<(f64, bool)>;

/// A number between two, equally likely in logarithms.
fn between(from: f64, to: f64, rng: &mut ChaCha8Rng) -> f64 {
    from * (to / from).powf(rng.random_range(0.0..1.0))
}

fn answer(verdict: &Verdict, delay_s: f64, slowest_s: f64) -> Answer {
    let [from, to] = verdict.ci95_s?;
    Some(((to - from) / slowest_s, from <= delay_s && delay_s <= to))
}

/// Poles and zeros of a plant: time constants of lags, a resonance (rad/s and damping), and a time constant of a zero, negative in the right half-plane.
struct Plant {
    lags_s: Vec<f64>,
    resonance: Option<(f64, f64)>,
    zero_s: Option<f64>,
}

impl Plant {
    fn at(&self, omega: f64) -> Complex<f64> {
        let s = Complex::new(0.0, omega);
        let lags: Complex<f64> = self.lags_s.iter().map(|t| s * *t + 1.0).product();
        let ringing = self
            .resonance
            .map_or(Complex::new(1.0, 0.0), |(w, d)| s * s / (w * w) + s * (2.0 * d / w) + 1.0);
        (s * self.zero_s.unwrap_or(0.0) + 1.0) / (lags * ringing)
    }
}

/// A draw by name.
type Drawn<T> = (&'static str, fn(&mut ChaCha8Rng) -> T);

/// Plants of which frequency responses are drawn; the slowest time constant is 1 s.
const PLANTS: [Drawn<Plant>; 5] = [
    ("one lag", |_| Plant { lags_s: vec![1.0], resonance: None, zero_s: None }),
    ("two lags", |rng| Plant {
        lags_s: vec![1.0, between(0.05, 1.0, rng)],
        resonance: None,
        zero_s: None,
    }),
    ("three lags", |rng| Plant {
        lags_s: vec![1.0, between(0.1, 1.0, rng), between(0.05, 0.5, rng)],
        resonance: None,
        zero_s: None,
    }),
    ("a lag and a resonance", |rng| Plant {
        lags_s: vec![1.0],
        resonance: Some((between(2.0, 10.0, rng), between(0.02, 0.5, rng))),
        zero_s: None,
    }),
    ("two lags and a zero to the right", |rng| Plant {
        lags_s: vec![1.0, between(0.1, 1.0, rng)],
        resonance: None,
        zero_s: Some(-between(0.1, 0.5, rng)),
    }),
];

/// What is known of the errors, and how they were drawn.
const ERRORS: [&str; 5] = [
    "in proportion, not told",
    "of one size, not told",
    "coherence",
    "standard deviations",
    "follow each other, not told",
];

/// A frequency response with errors of 0.5 to 5 %, and the verdict on it.
fn of_frequencies(
    plant: usize,
    errors: usize,
    seed: u64,
) -> Result<Answer, Box<dyn Error + Send + Sync>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let drawn = PLANTS[plant].1(&mut rng);
    let delay_s = between(0.02, 1.0, &mut rng);
    let count = rng.random_range(30..=150_usize);
    let (first, last) = (between(0.05, 0.3, &mut rng), between(10.0, 60.0, &mut rng));
    let omega: Vec<f64> =
        (0..count).map(|k| first * (last / first).powf(k as f64 / (count as f64 - 1.0))).collect();
    let clean: Vec<Complex<f64>> =
        omega.iter().map(|w| drawn.at(*w) * Complex::cis(-w * delay_s)).collect();
    let share = between(0.005, 0.05, &mut rng);
    let largest = clean.iter().map(|h| h.norm()).fold(0.0, f64::max);
    // Errors of one size are small beside the largest response, not beside the smallest.
    let size = |k: usize| match errors {
        1 => 0.2 * share * largest,
        2 | 3 => share * (1.0 + 4.0 * omega[k] / last) * clean[k].norm(),
        _ => share * clean[k].norm(),
    };
    let white: Vec<Complex<f64>> = (0..count)
        .map(|_| {
            Complex::new(rng.sample::<f64, _>(StandardNormal), rng.sample::<f64, _>(StandardNormal))
                * FRAC_1_SQRT_2
        })
        .collect();
    // As a window over three lines of a spectrum makes them.
    let at = |k: usize| white[k.min(count - 1)];
    let noise = |k: usize| {
        if errors == 4 {
            (at(k.saturating_sub(1)) * 0.5 + at(k) + at(k + 1) * 0.5) / 1.5_f64.sqrt()
        } else {
            at(k)
        }
    };
    let values: Vec<Complex<f64>> = (0..count).map(|k| clean[k] + noise(k) * size(k)).collect();
    let quality = match errors {
        // (1 − γ²)/γ² = 2n·s², of n = 16 averages.
        2 => Quality::Coherence(
            (0..count).map(|k| 1.0 / (1.0 + 32.0 * (size(k) / clean[k].norm()).powi(2))).collect(),
        ),
        3 => Quality::Std((0..count).map(|k| size(k) * FRAC_1_SQRT_2).collect()),
        _ => Quality::Unknown,
    };
    let report =
        ResponseJob::new(FrequencyResponse::new("drawn", omega, values, quality)?).run()?;
    Ok(report.pairs.first().and_then(|pair| answer(&pair.verdict, delay_s, 1.0)))
}

/// Time constants of plants of which step responses are drawn, over the slowest.
const STEPS: [Drawn<Vec<f64>>; 4] = [
    ("one pole", |_| vec![1.0]),
    ("a pole and one of 0.2", |_| vec![1.0, 0.2]),
    ("two poles", |rng| vec![1.0, rng.random_range(0.3..0.95)]),
    ("three poles", |rng| vec![1.0, rng.random_range(0.55..0.9), rng.random_range(0.2..0.5)]),
];

/// 1 − Σ Tᵢⁿ⁻¹/Π(Tᵢ − Tⱼ)·e^(−t/Tᵢ).
fn step_response(constants: &[f64], t: f64) -> f64 {
    let part = |at: f64| {
        constants.iter().filter(|p| **p != at).map(|p| at / (at - p)).product::<f64>()
            * (-t / at).exp()
    };
    1.0 - constants.iter().map(|at| part(*at)).sum::<f64>()
}

/// A table of a step response with noise of 0.3 to 3 % of its height, and the verdict on it.
fn of_a_step(plant: usize, seed: u64) -> Result<Answer, Box<dyn Error + Send + Sync>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let constants = STEPS[plant].1(&mut rng);
    let slowest_s = between(1.0, 100.0, &mut rng);
    let (count, length) = (rng.random_range(100..=300_usize), rng.random_range(6.0..12.0));
    let (delay, gain, level) =
        (rng.random_range(0.1..1.5), between(0.1, 10.0, &mut rng), rng.random_range(-5.0..5.0));
    let noise = between(0.003, 0.03, &mut rng);
    let time: Vec<f64> = (0..count).map(|k| length * k as f64 / count as f64).collect();
    let clean = |t: f64| if t > delay { step_response(&constants, t - delay) } else { 0.0 };
    let values = time
        .iter()
        .map(|t| level + gain * (clean(*t) + noise * rng.sample::<f64, _>(StandardNormal)))
        .collect();
    let table = Log::new(
        "drawn",
        time.iter().map(|t| t * slowest_s).collect(),
        vec![Channel::new("y", None, values)],
    )?;
    let log = Log::of_step(&table, None, 1.0, None)?;
    let quarter_s = 0.25 * log.duration_s();
    let methods = chosen(&STEP_METHODS.map(str::to_owned), &BTreeMap::new(), &[Scope::Pair])?;
    let job = Job {
        methods,
        max_delay_s: Some(quarter_s),
        feedback: Feedback::Open,
        ..Job::new(vec![log], [STEP], ["y"])
    };
    let report = job.run()?;
    Ok(report.pairs.first().and_then(|pair| answer(&pair.verdict, delay * slowest_s, slowest_s)))
}

fn percent(part: usize, of: usize) -> String {
    if of == 0 {
        "–".to_owned()
    } else {
        format!("{:.1} % of {of}", 100.0 * part as f64 / of as f64)
    }
}

/// How many were answered, how many of these hold the truth, and the median width.
fn row(answers: &[Answer]) -> String {
    let told: Vec<(f64, bool)> = answers.iter().flatten().copied().collect();
    let held = told.iter().filter(|t| t.1).count();
    let mut widths: Vec<f64> = told.iter().map(|t| t.0).collect();
    widths.sort_by(f64::total_cmp);
    let width = widths.get(widths.len() / 2).map_or("–".to_owned(), |w| format!("{w:.3}"));
    format!("{} | {} | {width}", percent(told.len(), answers.len()), percent(held, told.len()))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let draws: u64 = arguments.next().map_or(Ok(200), |a| a.parse())?;
    let first: u64 = arguments.next().map_or(Ok(1_000_000), |a| a.parse())?;
    let all = |one: &(dyn Fn(u64) -> Result<Answer, Box<dyn Error + Send + Sync>> + Sync),
               table: u64| {
        (first..first + draws)
            .into_par_iter()
            .map(|seed| one(100 * seed + table))
            .collect::<Result<Vec<_>, _>>()
            .map_err(|e| e.to_string())
    };
    println!(
        "## Frequency responses\n\n30 to 150 frequencies from 0.05–0.3 to 10–60 rad/s, dead times of 0.02 to 1 s beside a slowest time constant of 1 s, errors of 0.5 to 5 % of the"
    );
    println!(
        "response (of one size: 0.1 to 1 % of the largest). Errors that follow each other are those of a window over three lines.\n"
    );
    println!(
        "| plant | errors | answered | holds | median width, s |\n| --- | --- | ---: | ---: | ---: |"
    );
    let mut total = Vec::new();
    for (at, (plant, _)) in PLANTS.iter().enumerate() {
        for (which, errors) in ERRORS.iter().enumerate() {
            let answers = all(&|seed| of_frequencies(at, which, seed), (10 * at + which) as u64)?;
            println!("| {plant} | {errors} | {} |", row(&answers));
            total.extend(answers);
        }
    }
    println!("| all | | {} |\n", row(&total));
    println!(
        "## Step tables\n\n100 to 300 rows over 6 to 12 times the slowest time constant, dead times of 0.1 to 1.5 times that, noise of 0.3 to 3 % of the height.\n"
    );
    println!(
        "| plant | answered | holds | median width over the slowest time constant |\n| --- | ---: | ---: | ---: |"
    );
    let mut total = Vec::new();
    for (at, (plant, _)) in STEPS.iter().enumerate() {
        let answers = all(&|seed| of_a_step(at, seed), 50 + at as u64)?;
        println!("| {plant} | {} |", row(&answers));
        total.extend(answers);
    }
    println!("| all | {} |", row(&total));
    Ok(())
}
