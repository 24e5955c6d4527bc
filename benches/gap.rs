//! A whole diagnosis with the full catalogue on two threads: of one log of 10 s, and of three logs of 60 s, at 100 Hz.

use criterion::{Criterion, criterion_main};
use deadtime::diagnose::{GapOptions, diagnose};
use deadtime::effect::{Applied, Chance, find};
use deadtime::log::{Channel, Log};
use deadtime::model::ModelDocument;
use deadtime::simulate::{Commands, System};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

#[allow(dead_code)]
mod support;

/// Three states, one input, two outputs.
const LINEAR: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/uav_lateral_stabilised.toml");
/// Four states, one input, two outputs.
const EQUATIONS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../benches/support/two_masses.toml");

/// A log of the model behind a lag of its actuator, with noise.
fn log(document: &ModelDocument, seed: u64, samples: usize) -> Result<Log, deadtime::Error> {
    let system = System::new(document, |_| Ok(0.0))?;
    let input = document.inputs()[0].clone();
    let lag = Applied {
        values: vec![0.08],
        ..Applied::nominal(&system, find("actuator_lag")?, &input.name)?
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let time_s: Vec<f64> = (0..samples).map(|k| k as f64 * 0.01).collect();
    let mut level = 0.0;
    let held = (0..samples).map(|k| {
        if k % 20 == 0 {
            level = 0.5 * rng.sample::<f64, _>(StandardNormal);
        }
        level
    });
    let inputs = [held.collect::<Vec<f64>>()];
    let plan = Applied::plan(&system, &[lag], Chance::Mean)?;
    let y = system
        .simulate(&plan, Commands { time_s: &time_s, inputs: &inputs }, &system.initial, None)?
        .y;
    let mut channels = vec![Channel::new(&input.name, input.unit.as_deref(), inputs[0].clone())];
    for (port, column) in document.outputs().iter().zip(y.column_iter()) {
        let spread = column.variance().sqrt();
        let values = column
            .iter()
            .map(|v| v + 0.03 * spread * rng.sample::<f64, _>(StandardNormal))
            .collect();
        channels.push(Channel::new(&port.name, port.unit.as_deref(), values));
    }
    Ok(Log::new(format!("log{seed}"), time_s, channels)?)
}

fn diagnoses(criterion: &mut Criterion) -> Result<(), deadtime::Error> {
    for (name, path, logs, samples) in [
        ("linear, one short log", LINEAR, 1, 1000),
        ("linear, 3 states", LINEAR, 3, 6000),
        ("equations, 4 states", EQUATIONS, 3, 6000),
    ] {
        let document = ModelDocument::read(path.as_ref())?;
        let logs: Vec<Log> =
            (1..=logs).map(|seed| log(&document, seed, samples)).collect::<Result<_, _>>()?;
        let mut group = criterion.benchmark_group("gap");
        group.sample_size(10);
        if let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(2).build() {
            group.bench_function(name, |b| {
                b.iter(|| {
                    pool.install(|| {
                        diagnose(&document, &logs, &[], &GapOptions::default(), &|_| ())
                    })
                })
            });
        }
    }
    Ok(())
}

/// Runs every bench of this file.
#[allow(clippy::expect_used)]
fn benches() {
    diagnoses(&mut support::criterion()).expect("the models are valid");
}

criterion_main!(benches);
