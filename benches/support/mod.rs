//! What the benches share.

use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, SamplingMode};

/// Lengths of the records.
pub(crate) const SAMPLES: [usize; 3] = [150, 5_000, 1_000_000];

/// Short warm-up and measurement: the whole of `cargo bench` ends within minutes.
pub(crate) fn criterion() -> Criterion {
    Criterion::default()
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
        .configure_from_args()
}

/// Few runs of the long records.
pub(crate) fn pace(group: &mut BenchmarkGroup<'_, WallTime>, samples: usize) {
    let long = samples >= 1_000_000;
    group
        .sampling_mode(if long { SamplingMode::Flat } else { SamplingMode::Auto })
        .sample_size(if long { 10 } else { 40 });
}
