//! Correlation of 2^20 samples over all lags and over 36 of them, beside numpy's in the same run where a Python with numpy is at hand: $`DEADTIME_PYTHON`, or
//! .venv/bin/python. The ratio is printed, never asserted.

use std::hint::black_box;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_main};
use deadtime::signal::Correlator;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SAMPLES: usize = 1 << 20;
/// The lags of the default search window.
const LAGS: isize = 36;
/// The best of so many runs counts, on either side.
const RUNS: usize = 10;

/// One thread: the library's correlation uses one too. Prints the best time over all lags by FFT, the same over few lags, and the few lags as dot products, s.
const NUMPY: &str = "
import os
os.environ.update(OMP_NUM_THREADS='1', OPENBLAS_NUM_THREADS='1', MKL_NUM_THREADS='1')
import numpy as np, time
n, lags, runs = SAMPLES, LAGS, RUNS
rng = np.random.default_rng(1)
a, b = rng.standard_normal(n), rng.standard_normal(n)
def fft(size):
    return np.fft.irfft(np.conj(np.fft.rfft(a, size)) * np.fft.rfft(b, size), size)
def dots():
    return [np.dot(a[:n - l], b[l:]) for l in range(lags)]
def best(f):
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        f()
        times.append(time.perf_counter() - start)
    return min(times)
print(best(lambda: fft(2 * n)), best(lambda: fft(2 * n)[:lags]), best(dots))
";

fn numpy() -> Option<[f64; 3]> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.venv/bin/python");
    let python = std::env::var_os("DEADTIME_PYTHON").map_or(own, Into::into);
    let values =
        [("SAMPLES", SAMPLES.to_string()), ("LAGS", LAGS.to_string()), ("RUNS", RUNS.to_string())];
    let script =
        values.iter().fold(NUMPY.to_owned(), |text, (name, value)| text.replace(name, value));
    let output = Command::new(python).args(["-c", &script]).output().ok()?;
    let times: Vec<f64> = String::from_utf8(output.stdout)
        .ok()?
        .split_whitespace()
        .filter_map(|t| t.parse().ok())
        .collect();
    times.try_into().ok()
}

fn best(run: impl Fn() -> Vec<f64>) -> f64 {
    let time = |_| {
        let clock = Instant::now();
        black_box(run());
        clock.elapsed().as_secs_f64()
    };
    (0..RUNS).map(time).fold(f64::INFINITY, f64::min)
}

/// Runs every bench of this file.
fn benches() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut signal = || (0..SAMPLES).map(|_| rng.random_range(-1.0..1.0)).collect::<Vec<f64>>();
    let (a, b) = (signal(), signal());
    let last = isize::try_from(SAMPLES).unwrap_or(isize::MAX) - 1;
    // Planned once: numpy keeps its plans too.
    let (all_lags, few_lags) =
        (Correlator::new([SAMPLES; 2], -last..=last), Correlator::new([SAMPLES; 2], 0..=LAGS - 1));
    let all = || all_lags.correlate(&a, &b);
    let few = || few_lags.correlate(&a, &b);
    let mut criterion = Criterion::default()
        .measurement_time(Duration::from_secs(2))
        .sample_size(10)
        .configure_from_args();
    let mut group = criterion.benchmark_group("correlation");
    group.bench_function("all_lags", |b| b.iter(all));
    group.bench_function("36_lags", |b| b.iter(few));
    group.finish();
    let (of_all, of_few) = (best(all), best(few));
    let Some([fft, fft_few, dots]) = numpy() else {
        println!(
            "no Python with numpy (DEADTIME_PYTHON, .venv/bin/python): nothing to compare with"
        );
        return;
    };
    let ms = |s: f64| s * 1e3;
    println!(
        "2^20 samples, all lags: {:.1} ms, numpy by FFT {:.1} ms: {:.2} times as fast",
        ms(of_all),
        ms(fft),
        fft / of_all
    );
    println!(
        "2^20 samples, {LAGS} lags: {:.1} ms, numpy by FFT {:.1} ms and by dot products {:.1} ms: {:.2} and {:.2} times as fast",
        ms(of_few),
        ms(fft_few),
        ms(dots),
        fft_few / of_few,
        dots / of_few
    );
}

criterion_main!(benches);
