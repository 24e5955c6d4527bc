//! Bias, spread and coverage of transfer functions identified from sampled records against the Cramér-Rao bound, as a table in Markdown.
//!
//! `cargo run --release --package deadtime-lab --bin continuous_study -- [RECORDS] [FIRST SEED]`; `lab/study continuous` writes it into the documents.
//! Responses and bounds are computed here from matrix exponentials, by no code of the crate.

use std::error::Error;

use deadtime::delay::identifier;
use deadtime::identify::Parameter;
use deadtime::identify::subspace::{Named, Recordings, Stretch};
use deadtime::progress::HowFar;
use deadtime::time::SampleTime;
use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde_json::{Value, json};

/// Samples of a record, and those before it that nobody sees.
const SAMPLES: usize = 1000;
const BEFORE: usize = 600;
/// Longest dead time that the methods search, samples.
const SEARCHED: usize = 12;

/// B(s)/A(s) behind a dead time, and the sample time, s.
struct Plant {
    name: &'static str,
    a: &'static [f64],
    b: &'static [f64],
    delay_s: f64,
    ts: f64,
    /// Samples for which the input stands at least.
    held: usize,
}

/// The system of Rao and Garnier (2002), "Numerical illustrations of the relevance of direct continuous-time model identification", IFAC, and three more.
const PLANTS: [Plant; 4] = [
    Plant {
        name: "Rao-Garnier",
        a: &[5.0, 408.0, 416.0, 1600.0],
        b: &[-6400.0, 1600.0],
        delay_s: 0.0,
        ts: 0.01,
        held: 1,
    },
    Plant {
        name: "Rao-Garnier, 34 ms late",
        a: &[5.0, 408.0, 416.0, 1600.0],
        b: &[-6400.0, 1600.0],
        delay_s: 0.034,
        ts: 0.01,
        held: 1,
    },
    Plant {
        name: "two lags, 0.337 s late",
        a: &[3.0, 2.0],
        b: &[4.0],
        delay_s: 0.337,
        ts: 0.1,
        held: 5,
    },
    Plant {
        name: "resonance and zero, 0.113 s late",
        a: &[0.8, 25.0],
        b: &[2.0, 30.0],
        delay_s: 0.113,
        ts: 0.05,
        held: 3,
    },
];

/// Numbers in the order a, b, dead time.
fn response(plant: &Plant, values: &[f64], u: &[f64]) -> Vec<f64> {
    let (n, m) = (plant.a.len(), plant.b.len());
    let (a, b, delay) = (&values[..n], &values[n..n + m], values[n + m] / plant.ts);
    let mut block = DMatrix::zeros(n + 1, n + 1);
    for j in 0..n {
        block[(0, j)] = -a[j];
    }
    for i in 1..n {
        block[(i, i - 1)] = 1.0;
    }
    block[(0, n)] = 1.0;
    let held = |share: f64| {
        let e = (&block * (plant.ts * share)).exp();
        (e.view((0, 0), (n, n)).into_owned(), e.view((0, n), (n, 1)).into_owned())
    };
    let (whole, part) = (delay.floor(), delay - delay.floor());
    let (phi, _) = held(1.0);
    let (late_phi, late) = held(1.0 - part);
    let early = late_phi * held(part).1;
    let mut x = DMatrix::zeros(n, 1);
    let at = |k: isize| if k < 0 { 0.0 } else { u[k as usize] };
    let mut y = Vec::with_capacity(u.len());
    for k in 0..u.len() as isize {
        y.push((0..m).map(|i| b[i] * x[(n - m + i, 0)]).sum());
        let first = k - whole as isize;
        x = &phi * &x + &early * at(first - 1) + &late * at(first);
    }
    y
}

/// The sampled model's numbers f₁ …, b₀ … of a plant whose dead time is whole samples.
fn sampled(plant: &Plant) -> Vec<f64> {
    let (n, count) = (plant.a.len(), 2 * plant.a.len() + 2);
    let values = truth(plant);
    let impulse: Vec<f64> = (0..count).map(|k| f64::from(u8::from(k == 0))).collect();
    let h = response(plant, &[&values[..values.len() - 1], &[0.0]].concat(), &impulse);
    // The recursion that the impulse response obeys from its (n + 1)-th sample on.
    let rows = DMatrix::from_fn(n, n, |i, j| h[n + i - j]);
    let right = DVector::from_fn(n, |i, _| -h[n + 1 + i]);
    let f = rows.lu().solve(&right).unwrap_or_else(|| DVector::zeros(n));
    let b = (1..=n).map(|k| h[k] + (1..k).map(|i| f[i - 1] * h[k - i]).sum::<f64>());
    f.iter().copied().chain(b).collect()
}

fn difference_equation(n: usize, values: &[f64], u: &[f64]) -> Vec<f64> {
    let (f, b) = values.split_at(n);
    let mut y = vec![0.0; u.len()];
    for t in 0..u.len() {
        let past = |c: &[f64], x: &[f64]| -> f64 {
            c.iter().enumerate().filter(|(i, _)| t > *i).map(|(i, c)| c * x[t - 1 - i]).sum()
        };
        y[t] = past(b, u) - past(f, &y);
    }
    y
}

fn truth(plant: &Plant) -> Vec<f64> {
    [plant.a, plant.b, &[plant.delay_s]].concat()
}

fn input(plant: &Plant, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let mut level = 1.0;
    (0..SAMPLES + BEFORE)
        .map(|k| {
            let drawn: f64 = StandardNormal.sample(rng);
            if k % plant.held == 0 && drawn > 0.0 {
                level = -level;
            }
            level
        })
        .collect()
}

/// The response's slopes by every number: central differences of a model.
fn differences(model: &dyn Fn(&[f64]) -> Vec<f64>, values: &[f64]) -> Vec<Vec<f64>> {
    let column = |i: usize| {
        let step = 1e-5 * values[i].abs().max(1e-3);
        let moved = |by: f64| {
            let mut moved = values.to_vec();
            moved[i] += by;
            model(&moved)
        };
        // One-sided where a dead time of 0 has no other side.
        let low = if values[i] == 0.0 { 0.0 } else { -step };
        let (up, down) = (moved(step), moved(low));
        up.iter().zip(&down).map(|(a, b)| (a - b) / (step - low)).collect::<Vec<f64>>()
    };
    (0..values.len()).map(column).collect()
}

/// The same of a difference equation, whose poles a difference would move out of the unit circle: −y/F by f₁ …, u/F by b₀ …, each a sample later.
fn recursions(n: usize, values: &[f64], u: &[f64]) -> Vec<Vec<f64>> {
    let y = difference_equation(n, values, u);
    let alone = |x: &[f64], sign: f64, lag: usize| {
        let only = [&values[..n], &vec![0.0; lag - 1], &[sign]].concat();
        difference_equation(n, &only, x)
    };
    let by_f = (1..=n).map(|lag| alone(&y, -1.0, lag));
    by_f.chain((1..=values.len() - n).map(|lag| alone(u, 1.0, lag))).collect()
}

/// Standard deviations of the Cramér-Rao bound for white noise: the numbers beside a start and a level that are free.
fn bound(slopes: &[Vec<f64>], poles: &[f64], history: usize, noise: f64) -> Vec<f64> {
    let mut columns: Vec<Vec<f64>> =
        slopes.iter().map(|s| s[BEFORE + history..].to_vec()).collect();
    let n = poles.len();
    for i in 0..n {
        let mut last: Vec<f64> = (0..n).map(|j| f64::from(u8::from(i == j))).collect();
        columns.push(
            (0..SAMPLES - history)
                .map(|_| {
                    let next =
                        -poles.iter().zip(last.iter().rev()).map(|(f, y)| f * y).sum::<f64>();
                    last.push(next);
                    last.remove(0)
                })
                .collect(),
        );
    }
    columns.push(vec![1.0; SAMPLES - history]);
    let j = DMatrix::from_fn(SAMPLES - history, columns.len(), |t, k| columns[k][t]);
    let size: Vec<f64> = j.column_iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    let scaled = DMatrix::from_fn(j.nrows(), j.ncols(), |t, k| j[(t, k)] / size[k]);
    let r = scaled.qr().r();
    let inverse = r.try_inverse().unwrap_or_else(|| DMatrix::zeros(columns.len(), columns.len()));
    (0..slopes.len()).map(|k| noise * inverse.row(k).norm() / size[k]).collect()
}

fn record(
    plant: &Plant,
    u: &[f64],
    clean: &[f64],
    noise: f64,
    rng: &mut ChaCha8Rng,
) -> Result<Recordings, Box<dyn Error>> {
    let y: Vec<f64> = clean[BEFORE..]
        .iter()
        .map(|y| {
            let e: f64 = StandardNormal.sample(rng);
            y + noise * e
        })
        .collect();
    let named = |name: &str| vec![Named { name: name.to_owned(), unit: None }];
    Ok(Recordings {
        sample_time: SampleTime::new(plant.ts)?,
        inputs: named("u"),
        outputs: named("y"),
        stretches: vec![Stretch {
            u: DMatrix::from_row_slice(1, SAMPLES, &u[BEFORE..]),
            y: DMatrix::from_row_slice(1, SAMPLES, &y),
        }],
    })
}

/// A record's numbers with the bound of each.
struct Trial {
    found: Option<Vec<Parameter>>,
    bound: Vec<f64>,
}

struct Way {
    method: &'static str,
    options: Value,
    names: Vec<String>,
    truth: Vec<f64>,
    history: usize,
}

fn ways(plant: &Plant) -> Vec<Way> {
    let (n, m) = (plant.a.len(), plant.b.len());
    let named = |letter: &str, from: usize, count: usize| {
        (from..from + count).map(|i| format!("{letter}{i}")).collect::<Vec<_>>()
    };
    let mut names = [named("a", 1, n), named("b", 0, m)].concat();
    let mut all = Vec::new();
    // A dead time of 0 is a bound of its own; there it is given.
    let mut options = json!({ "nf": n, "nb": m, "draws": 0, "max_delay": SEARCHED });
    let mut values = truth(plant);
    if plant.delay_s == 0.0 {
        options["delay_s"] = json!([0.0]);
        values.pop();
    } else {
        names.push("dead_time".to_owned());
    }
    let history = if plant.delay_s == 0.0 { 1 } else { SEARCHED + 1 };
    all.push(Way { method: "srivc", options, names, truth: values, history });
    if plant.delay_s == 0.0 {
        let options = json!({ "nf": n, "nb": n, "nk": [1], "draws": 0 });
        let names = [named("f", 1, n), named("b", 0, n)].concat();
        all.push(Way { method: "riv", options, names, truth: sampled(plant), history: 1 });
    }
    all
}

fn trial(plant: &Plant, way: &Way, share: f64, seed: u64) -> Result<Trial, Box<dyn Error>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let u = input(plant, &mut rng);
    let clean = response(plant, &truth(plant), &u);
    let power = clean[BEFORE..].iter().map(|y| y * y).sum::<f64>() / SAMPLES as f64;
    let noise = (share * power).sqrt();
    let record = record(plant, &u, &clean, noise, &mut rng)?;
    let found = identifier(way.method)?
        .entry
        .with(way.options.clone())?
        .identify(&record, &HowFar::default());
    let found = found.ok().and_then(|f| f.parametric).map(|p| p.parameters);
    let n = plant.a.len();
    let model = |values: &[f64]| {
        let with_delay =
            [values, &[0.0][..usize::from(values.len() < n + plant.b.len() + 1)]].concat();
        response(plant, &with_delay, &u)
    };
    let slopes = match way.method {
        "riv" => recursions(n, &way.truth, &u),
        _ => differences(&model, &way.truth),
    };
    let bound = bound(&slopes, &sampled(plant)[..n], way.history, noise);
    Ok(Trial { found, bound })
}

fn row(
    plant: &Plant,
    way: &Way,
    snr_db: f64,
    records: u64,
    first: u64,
) -> Result<String, Box<dyn Error>> {
    let share = 10f64.powf(-snr_db / 10.0);
    let trials: Vec<Trial> = (first..first + records)
        .into_par_iter()
        .map(|seed| trial(plant, way, share, seed).map_err(|e| e.to_string()))
        .collect::<Result<_, _>>()?;
    let answered: Vec<(&Vec<Parameter>, &Vec<f64>)> =
        trials.iter().filter_map(|t| Some((t.found.as_ref()?, &t.bound))).collect();
    let (mut bias, mut spread, mut held) = (Vec::new(), Vec::new(), Vec::new());
    for (k, (name, truth)) in way.names.iter().zip(&way.truth).enumerate() {
        let errors: Vec<(f64, bool)> = answered
            .iter()
            .filter_map(|(found, bound)| {
                let p = found.iter().find(|p| p.name == *name)?;
                let inside = p.ci95.is_some_and(|[from, to]| from <= *truth && *truth <= to);
                Some(((p.value - truth) / bound[k], inside))
            })
            .collect();
        let count = errors.len().max(1) as f64;
        let mean = errors.iter().map(|e| e.0).sum::<f64>() / count;
        bias.push(mean.abs());
        spread.push((errors.iter().map(|e| (e.0 - mean).powi(2)).sum::<f64>() / count).sqrt());
        held.push(100.0 * errors.iter().filter(|e| e.1).count() as f64 / count);
    }
    let ends = |list: &[f64]| {
        let least = list.iter().copied().fold(f64::INFINITY, f64::min);
        (least, list.iter().copied().fold(f64::NEG_INFINITY, f64::max))
    };
    let (spread, held) = (ends(&spread), ends(&held));
    Ok(format!(
        "| {} | {snr_db:.0} | `{}` | {} | {:.2} | {:.2} to {:.2} | {:.1} to {:.1} |",
        plant.name,
        way.method,
        trials.len() - answered.len(),
        ends(&bias).1,
        spread.0,
        spread.1,
        held.0,
        held.1
    ))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let records = arguments.next().map_or(Ok(200), |a| a.parse())?;
    let first = arguments.next().map_or(Ok(1), |a| a.parse())?;
    println!(
        "{records} records of {SAMPLES} samples each, seeds from {first} on: a random binary input, white noise. Errors are in standard deviations of the Cramér-Rao bound\n\
         of each record, with a start and a level that are free. Bias: the largest of any number. Spread and coverage of 95 % intervals: the smallest and the largest.\n"
    );
    println!(
        "| plant | signal-to-noise ratio (dB) | method | refused | bias | spread | coverage (%) |\n| --- | ---: | --- | ---: | ---: | ---: | ---: |"
    );
    for plant in &PLANTS {
        for snr_db in [10.0, 20.0, 40.0] {
            for way in ways(plant) {
                println!("{}", row(plant, &way, snr_db, records, first)?);
            }
        }
    }
    Ok(())
}
