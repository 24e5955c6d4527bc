//! The noise floor: the part of a residual that no deterministic model can explain.
//!
//! How it can be wrong: a gap that is the same everywhere and unrelated to inputs and predictions looks like noise; coloured noise has few independent
//! samples, so calm stretches come by chance. Both estimates are therefore corrected for the noise's memory, and the smaller one counts.

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

use super::data::Record;
use super::noise::{Noise, autoregression_of, memory_of};
use super::problem::Problem;
use super::shrink::Errors;

/// Windows per record in which calm is looked for: what comes and goes may do so slowly or fast.
const WINDOWS: [usize; 3] = [20, 60, 180];
/// Samples of the shortest window.
const SHORTEST: usize = 10;
/// A window holds at least so many times the noise's memory.
const MEMORIES: f64 = 4.0;
/// Samples of noise that are simulated to see how calm calm windows are by chance.
const SIMULATED: usize = 400_000;

/// What of each output's residual is noise: its standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Floor {
    /// Per output.
    pub(super) floor: Vec<f64>,
}

/// From the residuals of the best explanation, one matrix per record (samples × outputs). `reached` are the errors of all leading explanations: no
/// floor is above what a model reaches.
pub(super) fn estimate(problem: &Problem<'_>, residuals: &[DMatrix<f64>], reached: &[Errors]) -> Floor {
    let (records, settling_s) = (problem.records, problem.prediction.settling_s);
    let outputs = residuals.first().map_or(0, DMatrix::ncols);
    let predicted = problem.predictions(residuals);
    let one = |i: usize| {
        let samples: Vec<(usize, usize)> = (records.iter().enumerate())
            .flat_map(|(at, r)| (0..r.time_s.len()).filter(move |&k| r.measured_in(r.train, i, k).is_some()).map(move |k| (at, k)))
            .collect();
        let square = mean_square(samples.iter().map(|&(at, k)| residuals[at][(k, i)]));
        let related = 1.0 - explained(records, residuals, &predicted, settling_s, i, &samples);
        let calm = calmest(records, residuals, i) / square.max(f64::MIN_POSITIVE);
        let lowest = reached.iter().map(|e| e.rms()[i]).fold(f64::INFINITY, f64::min);
        (square * related.min(calm).clamp(0.0, 1.0)).sqrt().min(lowest)
    };
    Floor { floor: (0..outputs).map(one).collect() }
}

#[allow(clippy::cast_precision_loss)]
fn mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_usize), |(s, n), v| (s + v * v, n + 1));
    sum / count.max(1) as f64
}

/// The memory of a residual in samples, by its own autoregression.
fn memory(records: &[&Record], residuals: &[&DMatrix<f64>], output: usize) -> f64 {
    let smallest = vec![0.0; residuals.first().map_or(0, |r| r.ncols())];
    Noise::fit(records, residuals, &smallest).memory(output)
}

/// Mean square in the calmest quarter of the windows, over what the calmest quarter of stationary noise would have by chance; infinite where the windows
/// differ no more than those of such noise. The noise is simulated with the autoregression of the calmer half: a gap that comes and goes must not
/// pass for its colour. Windows shorter than the noise's memory tell nothing.
fn calmest(records: &[Record], residuals: &[DMatrix<f64>], output: usize) -> f64 {
    let series: Vec<Vec<Option<f64>>> = (records.iter().zip(residuals))
        .filter(|(r, _)| r.train.is_some())
        .map(|(record, residual)| {
            let inside = (0..record.time_s.len()).filter(|&k| record.train.is_some_and(|s| s.holds(record.time_s[k])));
            inside.map(|k| record.measured[output].get(k).map(|_| residual[(k, output)])).collect()
        })
        .collect();
    WINDOWS.iter().map(|&count| calmest_of(&series, count)).fold(f64::INFINITY, f64::min)
}

/// As [`calmest`], with so many windows per record.
#[allow(clippy::cast_precision_loss)]
fn calmest_of(series: &[Vec<Option<f64>>], count: usize) -> f64 {
    let mut windows: Vec<Vec<Option<f64>>> = Vec::new();
    for inside in series {
        let size = (inside.len() / count).max(SHORTEST);
        windows.extend(inside.chunks_exact(size).filter(|w| 2 * w.iter().flatten().count() > size).map(<[_]>::to_vec));
    }
    if windows.len() < 8 {
        return f64::INFINITY;
    }
    windows.sort_by(|a, b| power(a).total_cmp(&power(b)));
    let powers: Vec<f64> = windows.iter().map(|w| power(w)).collect();
    let (calm, all) = calm_and_all(&powers);
    let ar = autoregression_of(&windows[..windows.len().div_ceil(2)]);
    let samples: usize = windows.iter().map(Vec::len).sum();
    if (samples / windows.len()) as f64 <= MEMORIES * memory_of(&ar) {
        return f64::INFINITY;
    }
    let draws = (SIMULATED / samples.max(1)).clamp(20, 200);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut ratios: Vec<f64> = (0..draws)
        .map(|_| {
            let mut powers: Vec<f64> = windows.iter().map(|w| power(&simulated(&ar, w.len(), &mut rng))).collect();
            powers.sort_by(f64::total_cmp);
            let (calm, all) = calm_and_all(&powers);
            calm / all
        })
        .collect();
    ratios.sort_by(f64::total_cmp);
    let usual = ratios.iter().sum::<f64>() / draws as f64;
    if calm / all < ratios[draws / 100] { calm / usual } else { f64::INFINITY }
}

/// Mean square of the samples that are there.
fn power(window: &[Option<f64>]) -> f64 {
    mean_square(window.iter().flatten().copied())
}

/// Means of the calmest quarter and of all, of sorted powers.
#[allow(clippy::cast_precision_loss)]
fn calm_and_all(powers: &[f64]) -> (f64, f64) {
    let mean = |p: &[f64]| p.iter().sum::<f64>() / p.len().max(1) as f64;
    (mean(&powers[..powers.len() / 4]), mean(powers))
}

/// A stretch of autoregressive noise of unit innovations, from rest and after settling.
fn simulated(ar: &[f64], samples: usize, rng: &mut ChaCha8Rng) -> Vec<Option<f64>> {
    let settle = if ar.is_empty() { 0 } else { 200 };
    let mut past: Vec<f64> = Vec::with_capacity(samples + settle);
    for k in 0..samples + settle {
        let next: f64 = ar.iter().zip(past[..k].iter().rev()).map(|(a, r)| a * r).sum::<f64>() + rng.sample::<f64, _>(StandardNormal);
        past.push(next);
    }
    past.drain(..settle);
    past.into_iter().map(Some).collect()
}

/// The share of a residual's variance that inputs and predictions, straight, bent and late, explain in the same samples; adjusted for their number against
/// the independent samples there are.
fn explained(
    records: &[Record],
    residuals: &[DMatrix<f64>],
    predicted: &[DMatrix<f64>],
    settling_s: f64,
    output: usize,
    samples: &[(usize, usize)],
) -> f64 {
    // The same lags in seconds for all records, whatever their sample times.
    let finest = records.iter().map(|r| r.sample_time_s).fold(f64::INFINITY, f64::min);
    let mut lags_s = vec![0.0];
    let mut lag_s = finest;
    while lag_s <= settling_s.clamp(2.0 * finest, 400.0 * finest) {
        lags_s.push(lag_s);
        lag_s *= 3.0;
    }
    let rows: Vec<Vec<f64>> = samples.iter().map(|&(at, k)| regressors(&records[at], &predicted[at], &lags_s, k)).collect();
    let Some(width) = rows.first().map(Vec::len) else { return 0.0 };
    if rows.len() < 4 * width {
        return 0.0;
    }
    let mut gram = DMatrix::zeros(width, width);
    let mut right: DVector<f64> = DVector::zeros(width);
    let mut total = 0.0;
    for (row, &(at, k)) in rows.iter().zip(samples) {
        let r = residuals[at][(k, output)];
        total += r * r;
        for i in 0..width {
            right[i] += row[i] * r;
            for j in 0..=i {
                gram[(i, j)] += row[i] * row[j];
            }
        }
    }
    let scale: Vec<f64> = (0..width).map(|i| f64::max(gram[(i, i)], f64::MIN_POSITIVE).sqrt()).collect();
    let scaled = DMatrix::from_fn(width, width, |i, j| {
        let entry = if i >= j { gram[(i, j)] } else { gram[(j, i)] };
        entry / (scale[i] * scale[j]) + if i == j { 1e-8 } else { 0.0 }
    });
    let Some(factor) = scaled.cholesky() else { return 0.0 };
    let beta = factor.solve(&DVector::from_fn(width, |i, _| right[i] / scale[i]));
    let mut left = residuals.to_vec();
    let mut rest = 0.0;
    for (row, &(at, k)) in rows.iter().zip(samples) {
        let fit: f64 = row.iter().zip(&scale).zip(beta.iter()).map(|((x, s), b)| x / s * b).sum();
        left[at][(k, output)] -= fit;
        rest += left[at][(k, output)].powi(2);
    }
    let (trained, left): (Vec<&Record>, Vec<&DMatrix<f64>>) = records.iter().zip(&left).filter(|(r, _)| r.train.is_some()).unzip();
    #[allow(clippy::cast_precision_loss)]
    let independent = samples.len() as f64 / memory(&trained, &left, output);
    #[allow(clippy::cast_precision_loss)]
    let spare = independent - width as f64;
    if spare <= 0.0 || total <= 0.0 { 0.0 } else { (1.0 - rest / total * independent / spare).max(0.0) }
}

/// 1, every input and prediction, straight and squared with its sign, now and at growing lags up to the settling time.
fn regressors(record: &Record, predicted: &DMatrix<f64>, lags_s: &[f64], k: usize) -> Vec<f64> {
    let mut row = vec![1.0];
    for lag_s in lags_s {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let at = k.saturating_sub((lag_s / record.sample_time_s).round() as usize);
        for u in &record.inputs {
            row.extend([u[at], u[at] * u[at].abs()]);
        }
        for j in 0..predicted.ncols() {
            row.push(predicted[(at, j)]);
        }
    }
    for j in 0..predicted.ncols() {
        row.push(predicted[(k, j)] * predicted[(k, j)].abs());
    }
    row
}
