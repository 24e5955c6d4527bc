//! Subspace models of drawn plants against the tolerances of ControlSystemIdentification.jl's tests, as a table in Markdown.
//!
//! `cargo run --release --package deadtime-lab --bin subspace_study -- [DRAWS] [FIRST SEED]`; `lab/study subspace` writes it into the documents.
//! Plants, noise and tolerances are those of `n4sid and era/okid` in its test/test_subspace.jl, with random numbers of another generator.

use std::collections::BTreeMap;
use std::error::Error;

use deadtime::identify::subspace::{
    Identified, Identifier, InnovationsModel, Moesp, N4sid, Named, Pbsidopt, Recordings, Settings,
    Stretch,
};
use deadtime::progress::HowFar;
use deadtime::time::SampleTime;
use nalgebra::{Complex, DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

const SAMPLES: usize = 500;
const METHODS: [&str; 3] = ["n4sid", "moesp", "pbsidopt"];
/// Frequencies at which responses are compared, rad/sample: 30 from 1e-3 to pi.
const FREQUENCIES: usize = 30;

/// x(t+1) = A x + B u, y = C x.
struct Plant {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
}

/// Tests that passed, and all, by what was asked.
type Counts = BTreeMap<&'static str, (usize, usize)>;

fn normal(rng: &mut ChaCha8Rng, rows: usize, columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |_, _| StandardNormal.sample(rng))
}

/// Inputs, outputs without noise, and the record.
fn record(
    plant: &Plant,
    noise: f64,
    rng: &mut ChaCha8Rng,
) -> Result<(DMatrix<f64>, Recordings), Box<dyn Error>> {
    let (m, l) = (plant.b.ncols(), plant.c.nrows());
    let u = normal(rng, m, SAMPLES);
    let mut x = DVector::from_column_slice(normal(rng, plant.a.nrows(), 1).as_slice());
    let mut clean = DMatrix::zeros(l, SAMPLES);
    for t in 0..SAMPLES {
        clean.set_column(t, &(&plant.c * &x));
        x = &plant.a * &x + &plant.b * u.column(t);
    }
    let y = &clean + normal(rng, l, SAMPLES) * noise;
    let named = |letter: &str, count: usize| {
        (0..count).map(|i| Named { name: format!("{letter}{i}"), unit: None }).collect()
    };
    let recordings = Recordings {
        sample_time: SampleTime::new(1.0)?,
        inputs: named("u", m),
        outputs: named("y", l),
        stretches: vec![Stretch { u, y }],
    };
    Ok((clean, recordings))
}

fn identified(method: &str, order: Option<usize>, record: &Recordings) -> Option<Identified> {
    let settings = Settings { order, draws: 0, ..Settings::default() };
    let far = HowFar::default();
    let found = match method {
        "n4sid" => N4sid(settings).identify(record, &far),
        "moesp" => Moesp(settings).identify(record, &far),
        _ => Pbsidopt(settings).identify(record, &far),
    };
    found.ok()
}

fn response([a, b, c, d]: [&DMatrix<f64>; 4], omega: f64) -> Option<DMatrix<Complex<f64>>> {
    let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
    let shift = DMatrix::identity(a.nrows(), a.nrows()) * Complex::from_polar(1.0, omega);
    Some(complex(c) * (shift - complex(a)).lu().solve(&complex(b))? + complex(d))
}

/// The largest difference of log10 |G|² over frequencies and channels.
fn apart(plant: &Plant, model: &InnovationsModel) -> f64 {
    let none = DMatrix::zeros(plant.c.nrows(), plant.b.ncols());
    let at = |k: usize| {
        let share = k as f64 / (FREQUENCIES - 1) as f64;
        let omega = 1e-3 * (std::f64::consts::PI / 1e-3).powf(share);
        let g = response([&plant.a, &plant.b, &plant.c, &none], omega)?;
        let h = response([&model.a, &model.b, &model.c, &model.d], omega)?;
        let log = |v: &Complex<f64>| v.norm_sqr().log10();
        Some(g.iter().zip(h.iter()).map(|(g, h)| (log(g) - log(h)).abs()).fold(0.0, f64::max))
    };
    (0..FREQUENCIES).map(|k| at(k).unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
}

fn count(counts: &mut Counts, what: &'static str, passes: bool) {
    let entry = counts.entry(what).or_default();
    entry.0 += usize::from(passes);
    entry.1 += 1;
}

/// Integrators of which one grows by 1 % a sample: one-step predictions of the noise-free output err by less than 1 % of its power.
fn growing(
    method: &str,
    (n, m, l): (usize, usize, usize),
    rng: &mut ChaCha8Rng,
    counts: &mut Counts,
) -> Result<(), Box<dyn Error>> {
    let mut a = DMatrix::identity(n, n);
    a[(0, 0)] = 1.01;
    let one = |rows: usize, columns: usize| DMatrix::from_element(rows, columns, 1.0);
    let (clean, record) = record(&Plant { a, b: one(n, m), c: one(l, n) }, 0.1, rng)?;
    let share = identified(method, Some(n), &record).map(|found| {
        let measured = &record.stretches[0];
        let errors = found.model.innovations(&found.scales.centred(measured));
        let late = |m: &DMatrix<f64>| m.columns(found.past, SAMPLES - found.past).norm_squared();
        late(&(&clean - (&measured.y - errors))) / late(&clean)
    });
    count(counts, "growing plants: one-step predictions", share.is_some_and(|s| s < 0.01));
    Ok(())
}

/// Stable plants of drawn matrices, noise 0.001.
fn drawn(
    method: &str,
    (n, m, l): (usize, usize, usize),
    rng: &mut ChaCha8Rng,
    counts: &mut Counts,
) -> Result<(), Box<dyn Error>> {
    let noise = 0.001;
    let plant = Plant { a: normal(rng, n, n) * 0.2, b: normal(rng, n, m), c: normal(rng, l, n) };
    let (_, record) = record(&plant, noise, rng)?;
    let found = identified(method, Some(n), &record);
    let mut of = |what, passes: &dyn Fn(&Identified) -> bool| {
        count(counts, what, found.as_ref().is_some_and(passes));
    };
    of("drawn plants: order as given", &|f| f.model.order() == n);
    of("drawn plants: standard deviation of innovations", &|f| {
        let std = f.innovations.diagonal().map(f64::sqrt);
        let wanted = DVector::from_element(l, noise);
        (&std - &wanted).norm() <= 0.5 * std.norm().max(wanted.norm())
    });
    of("drawn plants: K times covariance", &|f| (&f.model.k * &f.innovations).norm() < noise);
    of("drawn plants: response", &|f| apart(&plant, &f.model) < 0.2 * (m * l) as f64);
    let chosen = identified(method, None, &record);
    let passes = chosen.is_some_and(|f| f.model.order() <= n);
    count(counts, "drawn plants: chosen order", passes);
    Ok(())
}

/// b/(z − a), noise 0.01.
fn first_order(
    method: &str,
    (a, b): (f64, f64),
    rng: &mut ChaCha8Rng,
    counts: &mut Counts,
) -> Result<(), Box<dyn Error>> {
    let one = |v: f64| DMatrix::from_element(1, 1, v);
    let plant = Plant { a: one(a), b: one(1.0), c: one(b) };
    let (_, record) = record(&plant, 0.01, rng)?;
    let found = identified(method, Some(1), &record);
    let mut of = |what, passes: &dyn Fn(&InnovationsModel) -> bool| {
        count(counts, what, found.as_ref().is_some_and(|f| passes(&f.model)));
    };
    of("first order: pole", &|f| (f.a[(0, 0)] - a).abs() < 0.01);
    of("first order: gain of the numerator", &|f| ((&f.c * &f.b)[(0, 0)] - b).abs() < 0.01);
    of("first order: no direct path", &|f| f.d[(0, 0)].abs() < 0.01);
    of("first order: response", &|f| apart(&plant, f) < 0.01);
    Ok(())
}

fn one_draw(method: &str, seed: u64, counts: &mut Counts) -> Result<(), Box<dyn Error>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for n in 1..=5 {
        for (m, l) in [(1, 1), (1, 2), (2, 1), (2, 2)] {
            growing(method, (n, m, l), &mut rng, counts)?;
            drawn(method, (n, m, l), &mut rng, counts)?;
        }
    }
    for i in 0..10 {
        for j in 0..10 {
            let even = |k: i32, most: f64| most * (2.0 * f64::from(k) / 9.0 - 1.0);
            first_order(method, (even(i, 0.99), even(j, 5.0)), &mut rng, counts)?;
        }
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let draws: u64 = arguments.next().map_or(Ok(5), |a| a.parse())?;
    let first: u64 = arguments.next().map_or(Ok(1), |a| a.parse())?;
    println!(
        "{draws} draws of 20 growing plants, 20 drawn ones and 100 of first order, {SAMPLES} samples each, seeds from {first} on: plants, noise and tolerances of \
         ControlSystemIdentification.jl's own\ntests of `n4sid` (test/test_subspace.jl), 520 a draw.\n"
    );
    let mut all: Vec<Counts> = Vec::new();
    for method in METHODS {
        let mut counts = Counts::new();
        for seed in first..first + draws {
            one_draw(method, seed, &mut counts)?;
        }
        all.push(counts);
    }
    println!("| test | of | `{}` |\n| --- | ---: | ---: | ---: | ---: |", METHODS.join("` | `"));
    let row = |name: &str, of: usize, passed: &[usize]| {
        let passed: Vec<String> = passed.iter().map(ToString::to_string).collect();
        println!("| {name} | {of} | {} |", passed.join(" | "));
    };
    for (what, (_, of)) in &all[0] {
        row(what, *of, &all.iter().map(|c| c.get(what).map_or(0, |c| c.0)).collect::<Vec<_>>());
    }
    let total = |c: &Counts| c.values().fold((0, 0), |s, c| (s.0 + c.0, s.1 + c.1));
    row("all", total(&all[0]).1, &all.iter().map(|c| total(c).0).collect::<Vec<_>>());
    Ok(())
}
