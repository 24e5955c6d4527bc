//! Normalised errors, and how far they shrink on held-out data.

use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use super::data::{Record, Span};
use super::diagnosis::{Shrink, ShrinkOutput};
use super::problem::{Acting, Problem};
use crate::simulate::System;

/// Draws of the bootstrap.
const DRAWS: usize = 500;
/// Blocks per held-out span at least.
const BLOCKS: usize = 20;

/// Sums of squared errors and of squared deviations of the measurement, per output.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Errors {
    squares: Vec<f64>,
    /// Σ (y − mean)².
    deviations: Vec<f64>,
    count: Vec<f64>,
}

impl Errors {
    /// Of residuals inside the spans.
    pub(super) fn of(records: &[Record], residuals: &[DMatrix<f64>], span: impl Fn(&Record) -> Option<Span>) -> Self {
        let outputs = records.first().map_or(0, |r| r.measured.len());
        let mut errors = Self { squares: vec![0.0; outputs], deviations: vec![0.0; outputs], count: vec![0.0; outputs] };
        for i in 0..outputs {
            for (record, residual) in records.iter().zip(residuals) {
                let inside: Vec<(f64, f64)> =
                    (0..record.time_s.len()).filter_map(|k| Some((record.measured_in(span(record), i, k)?, residual[(k, i)]))).collect();
                let count = inside.len() as f64;
                let mean = inside.iter().map(|v| v.0).sum::<f64>() / count.max(1.0);
                errors.squares[i] += inside.iter().map(|v| v.1 * v.1).sum::<f64>();
                errors.deviations[i] += inside.iter().map(|v| (v.0 - mean).powi(2)).sum::<f64>();
                errors.count[i] += count;
            }
        }
        errors
    }

    /// Root of the mean squared error, per output.
    pub(super) fn rms(&self) -> Vec<f64> {
        self.squares.iter().zip(&self.count).map(|(e, n)| (e / n.max(1.0)).sqrt()).collect()
    }

    /// Per output; `None` where it stands still.
    pub(super) fn nrmse(&self) -> Vec<Option<f64>> {
        self.squares.iter().zip(&self.deviations).map(|(e, d)| (*d > 0.0).then(|| (e / d).sqrt())).collect()
    }

    /// A standard deviation of each output's error as nrmse.
    pub(super) fn relative(&self, std: &[f64]) -> Vec<Option<f64>> {
        let parts = std.iter().zip(&self.deviations).zip(&self.count);
        parts.map(|((s, d), n)| (*d > 0.0).then(|| s * (n / d).sqrt())).collect()
    }
}

/// The rms of the outputs' numbers; `None` where there is none.
pub(super) fn together(outputs: &[Option<f64>]) -> Option<f64> {
    let known: Vec<f64> = outputs.iter().flatten().copied().collect();
    let count = known.len() as f64;
    (count > 0.0).then(|| (known.iter().map(|v| v * v).sum::<f64>() / count).sqrt())
}

/// The share of the explainable that an explanation takes away, of errors before and after it; `None` where there is nothing to explain.
pub(super) fn explained(before: f64, after: f64, floor: f64) -> Option<f64> {
    (before > floor).then(|| (before * before - after * after) / (before * before - floor * floor))
}

/// Residuals from the posterior start of each record, by the same rule for every explanation: of a held-out log its own samples, else the training span.
pub(super) fn residuals<'e>(problem: &Problem<'_>, acting: impl Into<Acting<'e>>) -> Option<Vec<DMatrix<f64>>> {
    let acting = acting.into();
    (0..problem.records.len())
        .into_par_iter()
        .map(|at| {
            let record = &problem.records[at];
            let span = record.train.or(record.held)?;
            Some(problem.residual(at, &problem.predict_from_posterior(at, acting, span)?))
        })
        .collect()
}

/// The same of the training spans alone; of anything else nothing that means something.
pub(super) fn trained<'e>(problem: &Problem<'_>, acting: impl Into<Acting<'e>>) -> Option<Vec<DMatrix<f64>>> {
    let acting = acting.into();
    (0..problem.records.len())
        .map(|at| {
            let record = &problem.records[at];
            if record.train.is_none() {
                return Some(DMatrix::zeros(record.time_s.len(), record.measured.len()));
            }
            Some(problem.residual(at, &problem.predict_trained_from_posterior(at, acting)?))
        })
        .collect()
}

/// The section `shrink`. `block_s`: shorter stretches of the residual are not independent.
pub(super) fn shrink(
    system: &System,
    records: &[Record],
    before: &[DMatrix<f64>],
    after: &[DMatrix<f64>],
    floor_std: &[f64],
    block_s: f64,
    seed: u64,
) -> Shrink {
    let held = |r: &Record| r.held;
    let (b, a) = (Errors::of(records, before, held), Errors::of(records, after, held));
    let floor = b.relative(floor_std);
    let (each_before, each_after) = (b.nrmse(), a.nrmse());
    let (all_before, all_after, all_floor) = (together(&each_before), together(&each_after), together(&floor));
    let fraction = all_before.zip(all_after).filter(|(b, _)| *b > 0.0).map(|(b, a)| 1.0 - a / b);
    let of_explainable = all_before.zip(all_after).zip(all_floor).and_then(|((before, after), floor)| explained(before, after, floor));
    let outputs = (0..system.outputs.len())
        .map(|i| ShrinkOutput { name: system.outputs[i].name.clone(), before: each_before[i], after: each_after[i], floor: floor[i] })
        .collect();
    let ci95 = fraction.and_then(|_| bootstrap(records, before, after, &b.deviations, block_s, seed));
    Shrink { before: all_before, after: all_after, floor: all_floor, fraction, of_explainable, ci95, outputs }
}

/// The 95 % interval of 1 − after/before over resampled blocks of time, all outputs together.
fn bootstrap(
    records: &[Record],
    before: &[DMatrix<f64>],
    after: &[DMatrix<f64>],
    deviations: &[f64],
    block_s: f64,
    seed: u64,
) -> Option<[f64; 2]> {
    // Per block, Σ over outputs of squared errors over the output's spread: before and after.
    let mut blocks: Vec<[f64; 2]> = Vec::new();
    for ((record, before), after) in records.iter().zip(before).zip(after) {
        let Some(span) = record.held else { continue };
        let length = block_s.min((span.to_s - span.from_s) / BLOCKS as f64).max(record.sample_time_s);
        let mut sums: std::collections::BTreeMap<usize, [f64; 2]> = std::collections::BTreeMap::new();
        for k in 0..record.time_s.len() {
            for i in (0..deviations.len()).filter(|&i| deviations[i] > 0.0 && record.measured_in(record.held, i, k).is_some()) {
                let block = ((record.time_s[k] - span.from_s) / length) as usize;
                let sum = sums.entry(block).or_default();
                sum[0] += before[(k, i)].powi(2) / deviations[i];
                sum[1] += after[(k, i)].powi(2) / deviations[i];
            }
        }
        blocks.extend(sums.into_values());
    }
    if blocks.len() < 4 {
        return None;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut draws: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let sum = (0..blocks.len()).fold([0.0, 0.0], |[b, a], _| {
                let block = blocks[rng.random_range(0..blocks.len())];
                [b + block[0], a + block[1]]
            });
            1.0 - (sum[1] / sum[0]).sqrt()
        })
        .filter(|v| v.is_finite())
        .collect();
    draws.sort_by(f64::total_cmp);
    let last = draws.len().checked_sub(1)?;
    let at = |q: f64| draws[(q * last as f64).round() as usize];
    Some([at(0.025), at(0.975)])
}
