//! The noise floor: the part of a residual that no deterministic model can explain.
//!
//! How it can be wrong: a gap that is the same everywhere and unrelated to inputs and predictions looks like noise; coloured noise has few independent
//! samples, so calm stretches come by chance. Both estimates are therefore corrected for the noise's memory, and the smaller one counts.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::data::Record;
use super::noise::Noise;

/// Windows per record in which calm is looked for.
const WINDOWS: usize = 20;

/// Root mean square over the training samples, per output, and the floor below it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Floor {
    /// Rms of the residual given.
    pub(super) residual: Vec<f64>,
    /// What of it is noise.
    pub(super) floor: Vec<f64>,
}

/// From the residuals and predictions of the best explanation, one matrix per record (samples × outputs).
pub(super) fn estimate(records: &[Record], residuals: &[DMatrix<f64>], predicted: &[DMatrix<f64>], settling_s: f64) -> Floor {
    let outputs = residuals.first().map_or(0, DMatrix::ncols);
    let mut floor = Floor { residual: Vec::with_capacity(outputs), floor: Vec::with_capacity(outputs) };
    for i in 0..outputs {
        let samples: Vec<(usize, usize)> = (records.iter().enumerate())
            .flat_map(|(at, r)| (0..r.time_s.len()).filter(move |&k| r.measured_in(r.train, i, k).is_some()).map(move |k| (at, k)))
            .collect();
        let square = mean_square(samples.iter().map(|&(at, k)| residuals[at][(k, i)]));
        let related = 1.0 - explained(records, residuals, predicted, settling_s, i, &samples);
        let calm = calmest(records, residuals, i) / square.max(f64::MIN_POSITIVE);
        floor.residual.push(square.sqrt());
        floor.floor.push((square * related.min(calm).clamp(0.0, 1.0)).sqrt());
    }
    floor
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

/// Mean square in the calmest quarter of the windows, corrected for how calm the calmest quarter of this noise is by chance.
#[allow(clippy::cast_precision_loss)]
fn calmest(records: &[Record], residuals: &[DMatrix<f64>], output: usize) -> f64 {
    let mut windows: Vec<f64> = Vec::new();
    let mut length: f64 = 0.0;
    for (record, residual) in records.iter().zip(residuals) {
        let inside: Vec<f64> = (0..record.time_s.len())
            .filter(|&k| record.measured_in(record.train, output, k).is_some())
            .map(|k| residual[(k, output)])
            .collect();
        let size = (inside.len() / WINDOWS).max(20);
        for window in inside.chunks_exact(size) {
            windows.push(mean_square(window.iter().copied()));
            length += size as f64;
        }
    }
    if windows.len() < 8 {
        return f64::INFINITY;
    }
    length /= windows.len() as f64;
    windows.sort_by(f64::total_cmp);
    let quarter = windows.len() / 4;
    let calm = windows[..quarter].iter().sum::<f64>() / quarter as f64;
    let (records, residuals): (Vec<&Record>, Vec<&DMatrix<f64>>) = records.iter().zip(residuals).filter(|(r, _)| r.train.is_some()).unzip();
    let freedom = (length / memory(&records, &residuals, output)).max(1.0);
    // The calmest quarter of such windows by chance: near the 12.5 % point of their distribution.
    ChiSquared::new(freedom).map_or(f64::INFINITY, |chi| calm * freedom / chi.inverse_cdf(0.125).max(1e-3))
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
