//! How often the 95 % intervals of process models and transfer functions hold the truth, over drawn records, as a table in Markdown.
//!
//! `cargo run --release --package deadtime-lab --bin structure_study -- [RECORDS] [FIRST SEED]`; `lab/study structures` writes it into the documents.
//! Responses are closed forms of steps that add up, none of the crate's own.

use std::error::Error;

use deadtime::delay::identifier;
use deadtime::identify::subspace::{Named, Recordings, Stretch};
use deadtime::progress::HowFar;
use deadtime::time::SampleTime;
use nalgebra::DMatrix;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde_json::{Value, json};

/// Sample time, s.
const TS: f64 = 0.5;
/// Samples of a record, and those before it that nobody sees.
const SAMPLES: usize = 500;
const BEFORE: usize = 200;

/// The numbers of a machine by the names that reports use; s.
struct Machine {
    name: &'static str,
    method: &'static str,
    options: Value,
    truth: Vec<(&'static str, f64)>,
    /// One step rather than a random binary input.
    step: bool,
    noise: f64,
}

fn machines() -> Vec<Machine> {
    let one = |name, method, truth: &[(&'static str, f64)], noise| Machine {
        name,
        method,
        options: json!({ "draws": 0 }),
        truth: truth.to_vec(),
        step: false,
        noise,
    };
    let fopdt = [("K", 1.7), ("T1", 8.0), ("dead_time", 3.37)];
    let riv = [("f1", -1.5), ("f2", 0.7), ("b0", 1.0), ("b1", 0.5)];
    vec![
        Machine { step: true, ..one("one lag, one step", "p1d", &fopdt, 0.1) },
        one("one lag", "p1d", &fopdt, 0.2),
        one(
            "one lag and a zero",
            "p1dz",
            &[("K", 1.7), ("T1", 8.0), ("Tz", 3.0), ("dead_time", 3.0)],
            0.2,
        ),
        one("two lags", "p2d", &[("K", 1.7), ("T1", 8.0), ("T2", 3.0), ("dead_time", 3.37)], 0.1),
        one(
            "two lags and a zero",
            "p2dz",
            &[("K", 1.7), ("T1", 8.0), ("T2", 3.0), ("Tz", -2.0), ("dead_time", 3.37)],
            0.05,
        ),
        one("integrator", "p0di", &[("K", 0.8), ("dead_time", 3.37), ("u0", 2.1)], 0.5),
        one(
            "integrator and a lag",
            "p1di",
            &[("K", 0.8), ("T1", 4.0), ("dead_time", 3.37), ("u0", 2.1)],
            0.5,
        ),
        Machine {
            options: json!({ "draws": 0, "nf": 2, "nb": 2 }),
            ..one("transfer function, lag 4", "riv", &riv, 1.0)
        },
    ]
}

impl Machine {
    fn number(&self, name: &str) -> f64 {
        self.truth.iter().find(|(n, _)| *n == name).map_or(0.0, |(_, v)| *v)
    }

    /// The output `t` s after a unit step of the input.
    fn step_response(&self, t: f64) -> f64 {
        let t = t - self.number("dead_time");
        if t < 0.0 {
            return 0.0;
        }
        let (k, t1, t2, tz) =
            (self.number("K"), self.number("T1"), self.number("T2"), self.number("Tz"));
        let e = |lag: f64| (-t / lag).exp();
        match self.method {
            "p0di" => k * t,
            "p1di" => k * (t - t1 * (1.0 - e(t1))),
            "p1d" | "p1dz" => k * (1.0 - (1.0 - tz / t1) * e(t1)),
            _ => k * (1.0 - ((t1 - tz) * e(t1) - (t2 - tz) * e(t2)) / (t1 - t2)),
        }
    }

    fn outputs(&self, u: &[f64]) -> Vec<f64> {
        let n = u.len();
        if self.method == "riv" {
            let (mut y, at) = (vec![0.0; n], |t: usize, lag: usize| {
                t.checked_sub(lag).map_or(0.0, |t| u[t] - 2.0)
            });
            for t in 2..n {
                y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + at(t, 4) + 0.5 * at(t, 5);
            }
            return y;
        }
        let off = if self.number("u0") > 0.0 { self.number("u0") } else { 2.0 };
        let mut y = vec![0.0; n];
        let mut before = off;
        for (j, u) in u.iter().enumerate().filter(|(j, v)| *j == 0 || **v != u[j - 1]) {
            let jump = u - before;
            before = *u;
            for (t, y) in y.iter_mut().enumerate().skip(j) {
                *y += jump * self.step_response((t - j) as f64 * TS);
            }
        }
        y
    }

    fn record(&self, seed: u64, colour: f64) -> Result<Recordings, Box<dyn Error>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let held = if self.method == "riv" { 1 } else { 8 };
        let mut level = 2.0;
        let u: Vec<f64> = (0..SAMPLES + BEFORE)
            .map(|t| {
                if self.step {
                    return if t < BEFORE + 50 { 2.0 } else { 3.0 };
                }
                if t % held == 0 {
                    level = if normal() > 0.0 { 3.0 } else { 1.0 };
                }
                level
            })
            .collect();
        let mut e = 0.0;
        // Of the same variance whatever the colour.
        let size = self.noise * (1.0 - colour * colour).sqrt();
        let y: Vec<f64> = self
            .outputs(&u)
            .into_iter()
            .map(|y| {
                e = colour * e + size * normal();
                20.0 + y + e
            })
            .collect();
        let named = |name: &str| vec![Named { name: name.to_owned(), unit: None }];
        let row = |v: &[f64]| DMatrix::from_row_slice(1, SAMPLES, &v[BEFORE..]);
        let stretches = vec![Stretch { u: row(&u), y: row(&y) }];
        Ok(Recordings {
            sample_time: SampleTime::new(TS)?,
            inputs: named("u"),
            outputs: named("y"),
            stretches,
        })
    }

    /// Of each number: its error over its standard deviation, and whether its interval holds it; `None` where there is no model.
    fn judged(&self, seed: u64, colour: f64) -> Option<Vec<(f64, bool)>> {
        let method = identifier(self.method).ok()?.entry.with(self.options.clone()).ok()?;
        let found = method.identify(&self.record(seed, colour).ok()?, &HowFar::default()).ok()?;
        let parameters = found.parametric?.parameters;
        let one = |(name, truth): &(&str, f64)| {
            let p = parameters.iter().find(|p| p.name == *name)?;
            let [low, high] = p.ci95?;
            Some(((p.value - truth) / p.std?, (low - 1e-9..=high + 1e-9).contains(truth)))
        };
        self.truth.iter().map(one).collect()
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let records: u64 = words.next().map_or(Ok(400), |w| w.parse())?;
    let first: u64 = words.next().map_or(Ok(1), |w| w.parse())?;
    println!(
        "Each row: {records} records of {SAMPLES} samples every {TS} s, seeds from {first}; the share in % of the intervals of 95 % that hold the truth, with"
    );
    println!(
        "its standard error, and the middle size of errors over standard deviations (0.67 if these are right). A share below 90 or above 98 is *missed*."
    );
    println!("Noise is white or autoregressive with the pole 0.8, of the same variance.\n");
    println!("| machine | method | noise | number | truth | share | error over std | no model |");
    println!("| --- | --- | --- | --- | ---: | ---: | ---: | ---: |");
    for machine in machines() {
        for (noise, colour) in [("white", 0.0), ("coloured", 0.8)] {
            let all: Vec<_> =
                (0..records).into_par_iter().map(|i| machine.judged(first + i, colour)).collect();
            let found: Vec<&Vec<(f64, bool)>> = all.iter().flatten().collect();
            for (i, (name, truth)) in machine.truth.iter().enumerate() {
                let n = found.len().max(1) as f64;
                let share = found.iter().filter(|f| f[i].1).count() as f64 / n;
                let error = (share * (1.0 - share) / n).sqrt();
                let missed = if (0.90..=0.98).contains(&share) { "" } else { " missed" };
                let mut sizes: Vec<f64> = found.iter().map(|f| f[i].0.abs()).collect();
                sizes.sort_by(f64::total_cmp);
                let middle = sizes.get(sizes.len() / 2).copied().unwrap_or(f64::NAN);
                println!(
                    "| {} | {} | {noise} | {name} | {truth} | {:.1} ± {:.1}{missed} | {middle:.2} | {} |",
                    machine.name,
                    machine.method,
                    100.0 * share,
                    100.0 * error,
                    all.len() - found.len()
                );
            }
        }
    }
    Ok(())
}
