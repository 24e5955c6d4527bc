//! How often the 95 % bands of identified models hold the truth: frequency responses, poles and zeros, over drawn records, as tables in Markdown.
//!
//! `cargo run --release --package deadtime-lab --bin band_study -- [RECORDS] [FIRST SEED]`; `lab/study bands` writes them into the documents.

use std::error::Error;

use deadtime::identify::Identifier;
use deadtime::identify::subspace::{
    Identified, Moesp, N4sid, Named, Pbsidopt, Recordings, Root, Settings, Stretch,
};
use deadtime::model::StateSpace;
use deadtime::progress::HowFar;
use deadtime::time::SampleTime;
use nalgebra::{Complex, DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

const SAMPLE_TIME_S: f64 = 0.1;
const SAMPLES: usize = 2000;
/// Frequencies of a response.
const FREQUENCIES: usize = 12;
/// Normal intervals of 95 %.
const NORMAL: f64 = 1.959_964;

/// x(t+1) = A·x + B·u + K·e, y = C·x + e; u = r − feedback·y.
struct Machine {
    name: &'static str,
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    k: DMatrix<f64>,
    noise: f64,
    feedback: Vec<f64>,
}

fn machines() -> Vec<Machine> {
    let two = |name, noise, feedback: f64| Machine {
        name,
        a: DMatrix::from_row_slice(2, 2, &[1.5, -0.7, 1.0, 0.0]),
        b: DMatrix::from_row_slice(2, 1, &[1.0, 0.0]),
        c: DMatrix::from_row_slice(1, 2, &[0.5, 0.3]),
        k: DMatrix::from_row_slice(2, 1, &[0.6, 0.3]),
        noise,
        feedback: vec![feedback],
    };
    vec![
        two("open loop, stable", 0.5, 0.0),
        two("closed loop, stable", 0.5, 0.3),
        Machine {
            name: "closed loop, unstable plant",
            a: DMatrix::from_row_slice(2, 2, &[1.6, -0.57, 1.0, 0.0]),
            b: DMatrix::from_row_slice(2, 1, &[1.0, 0.0]),
            c: DMatrix::from_row_slice(1, 2, &[0.5, -0.2]),
            k: DMatrix::from_row_slice(2, 1, &[1.2, 0.9]),
            noise: 0.3,
            feedback: vec![0.6],
        },
        Machine {
            name: "open loop, two outputs",
            a: DMatrix::from_row_slice(3, 3, &[0.9, 0.2, 0.0, -0.2, 0.9, 0.1, 0.0, 0.0, 0.6]),
            b: DMatrix::from_row_slice(3, 1, &[0.2, 0.5, 1.0]),
            c: DMatrix::from_row_slice(2, 3, &[1.0, 0.0, 0.0, 0.0, 0.5, 1.0]),
            k: DMatrix::from_row_slice(3, 2, &[0.5, 0.0, 0.1, 0.2, 0.0, 0.3]),
            noise: 0.5,
            feedback: vec![0.0, 0.0],
        },
    ]
}

impl Machine {
    fn record(&self, seed: u64) -> Result<Recordings, Box<dyn Error>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let (n, l) = (self.a.nrows(), self.c.nrows());
        let (mut x, before) = (DVector::zeros(n), 200);
        let (mut u, mut y) = (DMatrix::zeros(1, SAMPLES), DMatrix::zeros(l, SAMPLES));
        for t in 0..SAMPLES + before {
            let e = DVector::from_fn(l, |_, _| self.noise * normal());
            let out = &self.c * &x + &e;
            let fed: f64 = self.feedback.iter().zip(out.iter()).map(|(f, y)| f * y).sum();
            let command = normal() - fed;
            if t >= before {
                u[(0, t - before)] = command;
                y.set_column(t - before, &out);
            }
            x = &self.a * &x + self.b.column(0) * command + &self.k * e;
        }
        let named = |name: &str| Named { name: name.to_owned(), unit: None };
        Ok(Recordings {
            sample_time: SampleTime::new(SAMPLE_TIME_S)?,
            inputs: vec![named("u")],
            outputs: (0..l).map(|i| named(&format!("y{}", i + 1))).collect(),
            stretches: vec![Stretch { u, y }],
        })
    }

    fn truth(&self) -> Result<StateSpace<deadtime::model::Sampled>, Box<dyn Error>> {
        let d = DMatrix::zeros(self.c.nrows(), 1);
        Ok(StateSpace::sampled(
            self.a.clone(),
            self.b.clone(),
            self.c.clone(),
            d,
            SampleTime::new(SAMPLE_TIME_S)?,
        )?)
    }
}

/// What one record says: intervals that hold the truth, and all, of gains, phases, poles and zeros.
#[derive(Clone, Copy, Default)]
struct Held {
    counts: [[usize; 2]; 4],
    other_order: bool,
    failed: bool,
}

fn held(
    found: &Identified,
    truth: &StateSpace<deadtime::model::Sampled>,
) -> Result<Held, Box<dyn Error>> {
    let mut counts = [[0, 0]; 4];
    let mut count = |which: usize, holds: bool| {
        counts[which][0] += usize::from(holds);
        counts[which][1] += 1;
    };
    for (output, response) in found.responses(&[0], FREQUENCIES)?.iter().enumerate() {
        for band in &response.bands {
            let g = truth.frequency_response(band.omega_rad_s)[(output, 0)];
            count(0, band.gain_ci95.is_some_and(|[low, high]| (low..=high).contains(&g.norm())));
            let off = (g / Complex::from_polar(1.0, band.phase_rad)).arg();
            count(1, band.phase_std_rad.is_some_and(|s| off.abs() <= NORMAL * s));
        }
    }
    let poles = truth.poles();
    // With another order there is nothing to compare poles and zeros with.
    let other_order = found.poles().len() != poles.len();
    if !other_order {
        roots(&found.poles(), &poles).into_iter().for_each(|holds| count(2, holds));
        let zeros = truth.zeros();
        if found.zeros().len() == zeros.len() {
            roots(&found.zeros(), &zeros).into_iter().for_each(|holds| count(3, holds));
        }
    }
    Ok(Held { counts, other_order, failed: false })
}

/// Whether the nearest root that is left holds each true one.
fn roots(found: &[Root], truth: &[Complex<f64>]) -> Vec<bool> {
    let mut left = found.to_vec();
    let far = |r: &Root, z: &Complex<f64>| (Complex::new(r.re, r.im) - z).norm();
    let one = |z: &Complex<f64>| {
        let nearest =
            (0..left.len()).min_by(|a, b| far(&left[*a], z).total_cmp(&far(&left[*b], z)))?;
        Some(left.swap_remove(nearest).covers(*z))
    };
    truth.iter().map(one).map(|holds| holds.unwrap_or(false)).collect()
}

/// The share over all records with its standard error by records: values of one record err together.
fn share(all: &[Held], which: usize) -> String {
    let shares: Vec<f64> = all
        .iter()
        .filter(|h| h.counts[which][1] > 0)
        .map(|h| h.counts[which][0] as f64 / h.counts[which][1] as f64)
        .collect();
    if shares.is_empty() {
        return "–".to_owned();
    }
    let n = shares.len() as f64;
    let mean = shares.iter().sum::<f64>() / n;
    let error =
        (shares.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n * (n - 1.0).max(1.0))).sqrt();
    let missed = if (0.90..=0.98).contains(&mean) { "" } else { " missed" };
    format!("{:.1} ± {:.1}{missed}", 100.0 * mean, 100.0 * error)
}

/// What is tried on a machine of this order; replicates cost as many identifications, and are tried on one.
fn methods(order: usize, replicates: bool) -> Vec<(&'static str, Box<dyn Identifier>)> {
    let given = Settings { order: Some(order), ..Settings::default() };
    let blocks = Settings { past: Some(12), bootstrap: 100, ..given.clone() };
    let mut all: Vec<(&'static str, Box<dyn Identifier>)> = vec![
        ("pbsidopt, order given", Box::new(Pbsidopt(given))),
        ("pbsidopt, order chosen", Box::new(Pbsidopt(Settings::default()))),
    ];
    if replicates {
        all.push(("pbsidopt, order given, bootstrap of 100", Box::new(Pbsidopt(blocks.clone()))));
        all.push(("n4sid, order given, bootstrap of 100", Box::new(N4sid(blocks.clone()))));
        all.push(("moesp, order given, bootstrap of 100", Box::new(Moesp(blocks))));
    }
    all
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let records: u64 = words.next().map_or(Ok(400), |w| w.parse())?;
    let first: u64 = words.next().map_or(Ok(1), |w| w.parse())?;
    println!(
        "Each row: {records} records of {SAMPLES} samples, seeds from {first}; shares in % of the intervals of 95 % that hold the truth, with the"
    );
    println!(
        "standard error over records. Responses at {FREQUENCIES} frequencies. A share below 90 or above 98 is *missed*.\n"
    );
    println!("| machine | method | gain | phase | poles | zeros | another order found | failed |");
    println!("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |");
    for (which, machine) in machines().iter().enumerate() {
        let truth = machine.truth()?;
        for (name, method) in methods(machine.a.nrows(), which == 0) {
            let one = |i: u64| {
                let found = machine
                    .record(first + i)
                    .ok()
                    .and_then(|r| method.identify(&r, &HowFar::default()).ok());
                found
                    .and_then(|f| held(&f, &truth).ok())
                    .unwrap_or(Held { failed: true, ..Held::default() })
            };
            let all: Vec<Held> = (0..records).into_par_iter().map(one).collect();
            let of = |which| share(&all, which);
            let (other, failed) = (
                all.iter().filter(|h| h.other_order).count(),
                all.iter().filter(|h| h.failed).count(),
            );
            println!(
                "| {} | {name} | {} | {} | {} | {} | {other} | {failed} |",
                machine.name,
                of(0),
                of(1),
                of(2),
                of(3)
            );
        }
    }
    Ok(())
}
