//! The reduction of the gap on held-out data.

use std::collections::BTreeMap;

use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::held_out::HeldOut;
use super::horizons::horizon_errors;
use crate::format::diagnosis::{Shrink, ShrinkOutput};
use crate::likelihood::errors::{explained, overall};
use crate::likelihood::gaussian::Likelihood;

/// Draws of the bootstrap.
const DRAWS: usize = 500;
/// Blocks per held-out span at least; and of all spans for an interval.
const BLOCKS: usize = 20;
const FEWEST: usize = 4;

/// Per block of held-out time, Σ over outputs of squared errors over the output's spread: of each list of residuals, and of the floor last.
pub(super) fn held_out_blocks(
    likelihood: &Likelihood<'_>,
    held: &HeldOut,
    of: &[&[DMatrix<f64>]],
    floor_std: &[f64],
) -> Vec<Vec<f64>> {
    let (records, block_s) = (likelihood.records, likelihood.predictor.settling_s);
    let Some(first) = of.first() else { return Vec::new() };
    let deviations = held.errors(records, first).deviations;
    let mut blocks = Vec::new();
    for (at, record) in records.iter().enumerate() {
        let Some(span) = held.span(at) else { continue };
        // Shorter stretches of the residual are not independent.
        let length =
            block_s.min((span.to_s - span.from_s) / BLOCKS as f64).max(record.sample_time_s);
        let mut sums: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for k in 0..record.time_s.len() {
            for i in (0..deviations.len())
                .filter(|&i| deviations[i] > 0.0 && record.measured_in(Some(span), i, k).is_some())
            {
                let block = ((record.time_s[k] - span.from_s) / length) as usize;
                let sum = sums.entry(block).or_insert_with(|| vec![0.0; of.len() + 1]);
                for (sum, error) in
                    sum.iter_mut().zip(of.iter().map(|r| r[at][(k, i)]).chain([floor_std[i]]))
                {
                    *sum += error.powi(2) / deviations[i];
                }
            }
        }
        blocks.extend(sums.into_values());
    }
    blocks
}

/// The 95 % interval of a number that follows from sums over blocks, which are drawn with replacement (Efron 1979, doi:10.1214/aos/1176344552).
pub(super) fn bootstrap(
    blocks: &[Vec<f64>],
    seed: u64,
    number: impl Fn(&[f64]) -> f64,
) -> Option<[f64; 2]> {
    if blocks.len() < FEWEST {
        return None;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = || {
        let mut sum = vec![0.0; blocks[0].len()];
        for _ in 0..blocks.len() {
            let block = &blocks[rng.random_range(0..blocks.len())];
            sum.iter_mut().zip(block).for_each(|(s, b)| *s += b);
        }
        number(&sum)
    };
    let mut draws: Vec<f64> = (0..DRAWS).map(|_| draw()).filter(|v| v.is_finite()).collect();
    draws.sort_by(f64::total_cmp);
    let last = draws.len().checked_sub(1)?;
    let at = |q: f64| draws[(q * last as f64).round() as usize];
    Some([at(0.025), at(0.975)])
}

/// The section `shrink`: errors of the nominal and of the written model, and with a latent sequence decoded where there is one.
pub(crate) fn improvement(
    likelihood: &Likelihood<'_>,
    held_out: &HeldOut,
    [before, after]: [&[DMatrix<f64>]; 2],
    decoded: Option<&[DMatrix<f64>]>,
    floor_std: &[f64],
    seed: u64,
) -> Shrink {
    let held = |residuals: &[DMatrix<f64>]| held_out.errors(likelihood.records, residuals);
    let (b, a) = (held(before), held(after));
    let floor = b.relative(floor_std);
    let (each_before, each_after) = (b.nrmse(), a.nrmse());
    let (all_before, all_after, all_floor) =
        (overall(&each_before), overall(&each_after), overall(&floor));
    let fraction = all_before.zip(all_after).filter(|(b, _)| *b > 0.0).map(|(b, a)| 1.0 - a / b);
    let of_explainable = all_before
        .zip(all_after)
        .zip(all_floor)
        .and_then(|((before, after), floor)| explained(before, after, floor));
    let names = likelihood.system.outputs.iter().map(|o| o.name.clone()).enumerate();
    let outputs = names
        .map(|(i, name)| ShrinkOutput {
            name,
            before: each_before[i],
            after: each_after[i],
            floor: floor[i],
        })
        .collect();
    let blocks = held_out_blocks(likelihood, held_out, &[before, after], floor_std);
    let ci95 =
        fraction.and_then(|_| bootstrap(&blocks, seed, |sum| 1.0 - (sum[1] / sum[0]).sqrt()));
    let decoded = decoded.and_then(|d| overall(&held(d).nrmse()));
    let horizons = horizon_errors(likelihood, held_out, [before, after]);
    Shrink {
        before: all_before,
        after: all_after,
        decoded,
        floor: all_floor,
        fraction,
        of_explainable,
        ci95,
        outputs,
        horizons,
    }
}
