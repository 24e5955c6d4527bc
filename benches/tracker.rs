//! A delay that is watched sample by sample: what one more sample costs a tracker that has learnt its machine.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_main};
use deadtime::delay::track::{Tracker, TrackerOptions};
use deadtime::time::SampleTime;

#[allow(dead_code)]
mod support;

/// Samples of one run; before it the tracker learns from twice as many.
const SAMPLES: usize = 1500;

/// y(t) = 0.9·y(t−1) + 0.1·u(t−6), a command that jumps every few samples, noise that repeats.
fn flight(samples: usize) -> Vec<(f64, f64)> {
    let u: Vec<f64> =
        (0..samples).map(|k| if (k / 7 * 7919) % 23 < 11 { -1.0 } else { 1.0 }).collect();
    let mut y = 0.0;
    let one = |k: usize| {
        y = 0.9 * y + 0.1 * u[k.saturating_sub(6)];
        (u[k], y + 0.01 * (((k * 7919) % 101) as f64 / 50.0 - 1.0))
    };
    (0..samples).map(one).collect()
}

fn tracking(criterion: &mut Criterion) -> Result<(), Box<dyn std::error::Error>> {
    let samples = flight(3 * SAMPLES);
    let (known, new) = samples.split_at(2 * SAMPLES);
    let mut tracker = Tracker::new(SampleTime::new(0.01)?, TrackerOptions::default())?;
    for &(u, y) in known {
        tracker.push(u, Some(y))?;
    }
    let mut group = criterion.benchmark_group("tracker");
    support::pace(&mut group, SAMPLES);
    group.throughput(Throughput::Elements(SAMPLES as u64));
    group.bench_function(format!("{SAMPLES} samples, learnt"), |b| {
        b.iter_batched(
            || tracker.clone(),
            |mut tracker| {
                for &(u, y) in new {
                    let _ = black_box(tracker.push(u, Some(y)));
                }
            },
            criterion::BatchSize::SmallInput,
        );
    });
    Ok(())
}

/// Runs every bench of this file.
#[allow(clippy::expect_used)]
fn benches() {
    tracking(&mut support::criterion()).expect("the options are in range");
}

criterion_main!(benches);
