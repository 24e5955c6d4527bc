//! Every delay estimator of the registry, with its default options, on records of 150, 5 000 and 1 000 000 samples.

use std::hint::black_box;

use criterion::{Criterion, criterion_main};
use deadtime::delay::{Experiment, METHODS, PlantModel, Recording, Scope, Search};
use deadtime::model::uav::Dynamics;
use deadtime::simulate::{Options, lsim};
use deadtime::time::SampleTime;
use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

mod support;

/// Delay of the records, s.
const DELAY_S: f64 = 0.05;

fn experiment(scope: Scope, samples: usize) -> Result<Experiment, deadtime::Error> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let sample_time = SampleTime::new(0.01)?;
    let u: Vec<f64> = (0..samples).map(|_| if rng.random::<bool>() { 1.0 } else { -1.0 }).collect();
    let mut noise = || rng.random_range(-0.05..0.05);
    Ok(match scope {
        Scope::Pair => {
            let mut y = vec![0.0; samples];
            for t in 6..samples {
                y[t] = 1.5 * y[t - 1] - 0.6 * y[t - 2] + 0.1 * u[t - 6];
            }
            for value in &mut y {
                *value += noise();
            }
            Experiment::siso(sample_time, u, y)
        }
        Scope::States => {
            let plant = Dynamics::Vertical.model();
            let delayed = plant.clone().with_input_delay(vec![DELAY_S])?;
            let input = DMatrix::from_column_slice(samples, 1, &u);
            let response = lsim(&delayed, &input, sample_time, &Options::default())?;
            let states = vec![response.x.column(0).iter().map(|x| x + noise()).collect()];
            let outputs = vec![response.y.column(0).iter().copied().collect::<Vec<f64>>().into()];
            Experiment {
                sample_time,
                inputs: vec!["delta_ver".into()],
                outputs: vec!["az".into()],
                recordings: vec![Recording { inputs: vec![u], outputs, states }],
                model: Some(PlantModel::Continuous(plant)),
                events: Vec::new(),
            }
        }
        Scope::Events => {
            let mut time = 0.0;
            let first: Vec<f64> = u
                .iter()
                .map(|u| {
                    time += 0.01 + 0.003 * u + 0.02 * noise().abs();
                    time
                })
                .collect();
            let second = first.iter().map(|t| t + DELAY_S + 0.001 * noise()).collect();
            Experiment::of_events(sample_time, first, second)
        }
    })
}

#[allow(clippy::expect_used)]
fn methods(criterion: &mut Criterion) {
    for method in METHODS {
        let mut group = criterion.benchmark_group(format!("estimate/{}", method.entry.name));
        let estimator = method.entry.with(serde_json::json!({})).expect("the defaults are options");
        for samples in support::SAMPLES {
            support::pace(&mut group, samples);
            let experiment = experiment(method.scope, samples).expect("the plant and its record are valid");
            group.bench_function(samples.to_string(), |b| b.iter(|| black_box(estimator.estimate(&experiment, &Search::default()))));
        }
    }
}

/// Runs every bench of this file.
fn benches() {
    methods(&mut support::criterion());
}

criterion_main!(benches);
