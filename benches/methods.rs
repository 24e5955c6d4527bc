//! Every delay estimator of the registry, with its default options, on a record of the kind that suits it.

use std::cell::LazyCell;
use std::hint::black_box;

use criterion::{Criterion, criterion_main};
use deadtime::delay::{METHODS, Search};
use deadtime::study::Common;

mod support;

#[allow(clippy::expect_used)]
fn methods(criterion: &mut Criterion) {
    for method in METHODS {
        let mut group = criterion.benchmark_group(format!("estimate/{}", method.entry.name));
        let estimator = method.entry.with(serde_json::json!({})).expect("the defaults are options");
        for samples in support::SAMPLES {
            support::pace(&mut group, samples);
            let study = Common { trials: 1, samples, ..Common::default() };
            // Only for benches that criterion's filter picks.
            let experiment = LazyCell::new(|| {
                study.experiment(method.reference, 0).expect("the plant and its record are valid").0
            });
            group.bench_function(samples.to_string(), |b| {
                let experiment = &*experiment;
                b.iter(|| black_box(estimator.estimate(experiment, &Search::default())));
            });
        }
    }
}

/// Runs every bench of this file.
fn benches() {
    methods(&mut support::criterion());
}

criterion_main!(benches);
