//! The two scans that most estimators stand on: 20 delays of a record of 500 samples, on one core.

use std::hint::black_box;

use criterion::criterion_main;
use deadtime::identify::{Initial, OutputError, Record, arx_scan};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[allow(dead_code)]
mod support;

const SAMPLES: usize = 500;
const DELAYS: usize = 20;

/// A random binary input, ten samples of delay and two lags, and this share of noise.
fn record(noise: f64) -> Record<'static> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let u: Vec<f64> = (0..SAMPLES).map(|_| if rng.random::<bool>() { 1.0 } else { -1.0 }).collect();
    let mut y = vec![0.0; SAMPLES];
    for t in 10..SAMPLES {
        y[t] = 1.3 * y[t - 1] - 0.4 * y[t - 2] + 0.1 * u[t - 10];
    }
    for value in &mut y {
        *value += noise * rng.random_range(-1.0..1.0);
    }
    Record::new(u, y)
}

/// Runs every bench of this file.
#[allow(clippy::expect_used)]
fn benches() {
    let mut criterion = support::criterion();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    let mut group = criterion.benchmark_group("scan_of_20_delays");
    for (name, noise) in [("little noise", 0.05), ("much noise", 0.5)] {
        let records = [record(noise)];
        group.bench_function(format!("arx(10,5)/{name}"), |b| {
            b.iter(|| one.install(|| black_box(arx_scan(black_box(&records), 10, 5, DELAYS - 1))));
        });
        let oe = OutputError { nb: 1, nf: 2, initial: Initial::Zero };
        group.bench_function(format!("oe(2,1)/{name}"), |b| {
            b.iter(|| one.install(|| black_box(oe.scan(black_box(&records), DELAYS - 1))))
        });
    }
}

criterion_main!(benches);
