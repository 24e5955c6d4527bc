//! How far the gap shrinks on held-out data.

use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::diagnose::format::diagnosis::{Shrink, ShrinkOutput};
use crate::diagnose::input::record::LogRecord;
use crate::diagnose::likelihood::errors::{Errors, explained, overall};
use crate::simulate::System;

/// Draws of the bootstrap.
const DRAWS: usize = 500;
/// Blocks per held-out span at least.
const BLOCKS: usize = 20;

/// The section `shrink`. `block_s`: shorter stretches of the residual are not independent.
pub(in crate::diagnose) fn improvement(
    system: &System,
    records: &[LogRecord],
    before: &[DMatrix<f64>],
    after: &[DMatrix<f64>],
    floor_std: &[f64],
    block_s: f64,
    seed: u64,
) -> Shrink {
    let held = |r: &LogRecord| r.held;
    let (b, a) = (Errors::of(records, before, held), Errors::of(records, after, held));
    let floor = b.relative(floor_std);
    let (each_before, each_after) = (b.nrmse(), a.nrmse());
    let (all_before, all_after, all_floor) = (overall(&each_before), overall(&each_after), overall(&floor));
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
    records: &[LogRecord],
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
