//! Conversion of every kind, simulation, and optimal gains.

use std::hint::black_box;

use criterion::{Criterion, criterion_main};
use deadtime::model::c2d::{CONVERSIONS, Conversion, ZeroOrderHold};
use deadtime::model::uav::{self, Dynamics};
use deadtime::model::{Continuous, ModelError, StateSpace, dare, dlqr};
use deadtime::simulate::{Hold, Options, lsim};
use deadtime::time::SampleTime;
use nalgebra::DMatrix;

mod support;

type Outcome = Result<(), deadtime::Error>;

/// One input and one output of the lateral dynamics, which every conversion takes; without and with a delay of one and a half samples.
fn conversions(criterion: &mut Criterion, ts: SampleTime) -> Outcome {
    let pair = Dynamics::Lateral.model().pair(0, 0)?;
    let mut group = criterion.benchmark_group("c2d");
    support::pace(&mut group, 0);
    for conversion in CONVERSIONS {
        for (name, delay_s) in
            [("3 states", 0.0), ("3 states, 1.5 samples of delay", 1.5 * ts.seconds())]
        {
            let sys = pair.clone().with_input_delay(vec![delay_s])?;
            let defaults = (conversion.build)(serde_json::json!({})).map_err(|source| {
                deadtime::registry::RegistryError::Options {
                    name: conversion.name,
                    defaults: (conversion.defaults)(),
                    source,
                }
            })?;
            // Impulse invariance with feedthrough kept refuses a fractional delay only where there is feedthrough: here there is none.
            defaults.c2d(&sys, ts)?;
            group.bench_function(format!("{}/{name}", conversion.name), |b| {
                b.iter(|| black_box(defaults.c2d(&sys, ts)))
            });
        }
    }
    let whole = uav::model();
    group.bench_function("zoh/9 states", |b| {
        b.iter(|| black_box(ZeroOrderHold::default().c2d(&whole, ts)))
    });
    Ok(())
}

fn simulations(criterion: &mut Criterion) -> Outcome {
    // Short steps keep the unstable UAV finite over a million of them.
    let ts = SampleTime::new(1e-4)?;
    let sys = uav::model();
    let mut group = criterion.benchmark_group("lsim, 9 states");
    for samples in support::SAMPLES {
        support::pace(&mut group, samples);
        let u = DMatrix::from_fn(samples, sys.inputs(), |k, j| {
            ((k * 7919 + j * 104_729) % 23) as f64 / 11.0 - 1.0
        });
        for (name, hold) in [("zero", Hold::Zero), ("linear", Hold::Linear)] {
            let options = Options { hold, ..Options::default() };
            group.bench_function(format!("{name} hold/{samples}"), |b| {
                b.iter(|| black_box(lsim(&sys, &u, ts, &options)))
            });
        }
    }
    Ok(())
}

fn regulators(criterion: &mut Criterion, ts: SampleTime) -> Outcome {
    let mut group = criterion.benchmark_group("riccati");
    support::pace(&mut group, 0);
    let sampled = |sys: StateSpace<Continuous>| -> Result<_, ModelError> {
        ZeroOrderHold::default().c2d(&sys, ts)
    };
    for (name, sys) in
        [("3 states", sampled(Dynamics::Lateral.model())?), ("9 states", sampled(uav::model())?)]
    {
        let (q, r) = (
            DMatrix::identity(sys.order(), sys.order()),
            DMatrix::identity(sys.inputs(), sys.inputs()),
        );
        group.bench_function(format!("dlqr/{name}"), |b| {
            b.iter(|| black_box(dlqr(sys.a(), sys.b(), &q, &r, None)))
        });
        group.bench_function(format!("dare/{name}"), |b| {
            b.iter(|| black_box(dare(sys.a(), sys.b(), &q, &r, None)))
        });
    }
    Ok(())
}

/// Runs every bench of this file.
#[allow(clippy::expect_used)]
fn benches() {
    let mut criterion = support::criterion();
    let ts = SampleTime::new(0.01).expect("a sample time");
    conversions(&mut criterion, ts).expect("the models are valid");
    simulations(&mut criterion).expect("the models are valid");
    regulators(&mut criterion, ts).expect("the models are valid");
}

criterion_main!(benches);
