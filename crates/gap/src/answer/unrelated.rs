//! Whether the residual depends on the commands at all.
//!
//! The residual is whitened by an autoregression; a whitened sample is independent of every earlier command, also under feedback.
//! The whitened residual is regressed on past commands and their absolute values and, for a free run, on the model's outputs and their squares.
//! The regression is tested against chance (Wald 1943, doi:10.1090/S0002-9947-1943-0012401-3; a test of causality as in Granger 1969, doi:10.2307/1912791).
//!
//! How it can be wrong: a relation over more lags than tested, or with a product of commands, is not detected. A short record has no power and gets no answer.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::baseline::noise::Noise;
use crate::format::contributions::Unrelated;
use crate::format::diagnosis::Mode;
use crate::likelihood::gaussian::Likelihood;

/// The lags of the commands before the explained sample, in samples.
const LAGS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
/// Samples that a column needs.
const ROWS_PER_COLUMN: usize = 10;
/// The term added to the diagonal of the normal equations, relative to each column.
const RIDGE: f64 = 1e-9;

/// The relation of the residuals of the training spans with the commands; `None` where the samples are too few.
pub(super) fn unrelated(
    likelihood: &Likelihood<'_>,
    residuals: &[DMatrix<f64>],
    smallest: &[f64],
) -> Option<Unrelated> {
    let records: Vec<_> = likelihood.records.iter().collect();
    let all: Vec<&DMatrix<f64>> = residuals.iter().collect();
    let noise = Noise::fit(&records, &all, smallest, &likelihood.criteria);
    let outputs = smallest.len();
    let mut parts: Vec<Part> = Vec::new();
    for (record, residual) in records.iter().zip(residuals) {
        let white = noise.whiten(record, record.train, residual);
        let mut signals: Vec<Vec<f64>> = Vec::new();
        for u in &record.inputs {
            signals.extend(with_size(u));
        }
        if likelihood.predictor.mode == Mode::Simulation {
            for i in 0..outputs {
                let y = |k: usize| record.measured[i].get(k).map(|y| y - residual[(k, i)]);
                // Where nothing was measured the model's last output stays.
                let mut last = 0.0;
                let held = (0..record.time_s.len()).map(|k| {
                    last = y(k).unwrap_or(last);
                    last
                });
                signals.extend(with_size(&held.collect::<Vec<_>>()));
            }
        }
        let there = |i: usize, k: usize| record.measured_in(record.train, i, k).is_some();
        let white = (0..outputs)
            .map(|i| {
                (0..record.time_s.len())
                    .map(|k| there(i, k).then(|| white[(k, i)]).filter(|v| v.is_finite()))
                    .collect()
            })
            .collect();
        parts.push(Part { white, signals });
    }
    of_parts(&parts, outputs)
}

/// A signal about its mean, and its size there.
fn with_size(u: &[f64]) -> [Vec<f64>; 2] {
    let mean = u.iter().sum::<f64>() / u.len().max(1) as f64;
    [u.iter().map(|v| v - mean).collect(), u.iter().map(|v| (v - mean).abs()).collect()]
}

/// One record.
struct Part {
    /// Per output, what whitening leaves; `None`: not measured.
    white: Vec<Vec<Option<f64>>>,
    signals: Vec<Vec<f64>>,
}

fn of_parts(parts: &[Part], outputs: usize) -> Option<Unrelated> {
    let mut least = Unrelated { chance: 1.0, explained: 0.0 };
    let mut tested = 0;
    for output in 0..outputs {
        if let Some(one) = of_output(parts, output) {
            tested += 1;
            least.chance = f64::min(least.chance, one.chance);
            least.explained = f64::max(least.explained, one.explained);
        }
    }
    least.chance = (least.chance * f64::from(tested)).min(1.0);
    (tested > 0).then_some(least)
}

fn of_output(parts: &[Part], output: usize) -> Option<Unrelated> {
    let signals = parts.first()?.signals.len();
    let width = signals * LAGS.len() + 1;
    let reach = *LAGS.last()?;
    let mut gram: DMatrix<f64> = DMatrix::zeros(width, width);
    let mut right: DVector<f64> = DVector::zeros(width);
    let (mut energy, mut count) = (0.0, 0_usize);
    for part in parts {
        let values = part.white.get(output)?;
        let mut rows: Vec<f64> = Vec::new();
        let mut left: Vec<f64> = Vec::new();
        for (k, value) in values.iter().enumerate().skip(reach) {
            let Some(value) = value else { continue };
            for signal in &part.signals {
                rows.extend(LAGS.iter().map(|lag| signal[k - lag]));
            }
            rows.push(1.0);
            left.push(*value);
        }
        let columns = DMatrix::from_vec(width, left.len(), rows);
        let left = DVector::from_vec(left);
        gram += &columns * columns.transpose();
        right += &columns * &left;
        energy += left.norm_squared();
        count += left.len();
    }
    if count < ROWS_PER_COLUMN * width || energy <= 0.0 {
        return None;
    }
    // The mean is no relation.
    let mean = right[width - 1] / count as f64;
    let energy = energy - mean * mean * count as f64;
    let size: Vec<f64> = (0..width).map(|i| gram[(i, i)].max(f64::MIN_POSITIVE).sqrt()).collect();
    let moving = size.iter().filter(|s| **s > 1e-150).count().saturating_sub(1);
    let scaled = DMatrix::from_fn(width, width, |i, j| {
        gram[(i, j)] / (size[i] * size[j]) + if i == j { RIDGE } else { 0.0 }
    });
    let right = DVector::from_fn(width, |i, _| right[i] / size[i]);
    let fitted = right.dot(&scaled.cholesky()?.solve(&right)) - mean * mean * count as f64;
    let freedom = count - width;
    let left = (energy - fitted).max(f64::MIN_POSITIVE);
    let statistic = fitted.max(0.0) / (left / freedom as f64);
    let chance = 1.0 - ChiSquared::new(moving.max(1) as f64).ok()?.cdf(statistic);
    // The part beyond what as many columns of chance take (Ezekiel's adjusted R²).
    let explained = 1.0 - (left / freedom as f64) / (energy / (count - 1) as f64);
    Some(Unrelated { chance, explained: explained.max(0.0) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    /// White noise and a command that holds its values, which reacts to past noise where there is feedback.
    fn drawn(
        seed: u64,
        samples: usize,
        feedback: bool,
        acts: impl Fn(&[f64], usize) -> f64,
    ) -> Part {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut white, mut u) = (Vec::new(), Vec::new());
        for k in 0..samples {
            let normal: f64 = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
            let command = match k % 9 {
                0 => rng.random::<f64>() - 0.5,
                _ => u.last().copied().unwrap_or(0.0),
            };
            let back = if feedback { white.last().copied().flatten().unwrap_or(0.0) } else { 0.0 };
            u.push(command - 0.3 * back);
            white.push(Some(normal + acts(&u, k)));
        }
        Part { white: vec![white], signals: with_size(&u).to_vec() }
    }

    #[test]
    fn noise_alone_is_related_to_the_commands_by_chance_only() {
        let mut related = [0; 2];
        for seed in 0..300 {
            let feedback = seed % 2 == 1;
            let part = drawn(seed, 700, feedback, |_, _| 0.0);
            let found = of_parts(&[part], 1).unwrap();
            related[usize::from(feedback)] += usize::from(found.chance < 0.01);
            assert!(found.explained < 0.1, "{}", found.explained);
        }
        // 150 draws at 1 %: more than 6 in 1 of 700.
        assert!(related.iter().all(|n| *n <= 6), "{related:?}");
    }

    #[test]
    fn late_bent_and_lagged_commands_are_seen() {
        let kinds: [fn(&[f64], usize) -> f64; 3] = [
            |u, k| if k < 5 { 0.0 } else { 1.2 * u[k - 5] },
            |u, k| if k < 3 { 0.0 } else { 3.0 * u[k - 3].abs() },
            |u, k| (0..k.min(40)).map(|n| 0.15 * 0.9_f64.powi(n as i32) * u[k - n]).sum(),
        ];
        for (at, kind) in kinds.into_iter().enumerate() {
            let seen = (0..40)
                .filter(|seed| {
                    of_parts(&[drawn(*seed, 900, false, kind)], 1).unwrap().chance < 0.01
                })
                .count();
            assert!(seen >= 38, "kind {at}: {seen}");
        }
    }

    #[test]
    fn few_samples_and_commands_at_rest_say_nothing_wrong() {
        assert!(of_parts(&[drawn(1, 150, false, |_, _| 0.0)], 1).is_none());
        let mut part = drawn(2, 900, false, |_, _| 0.0);
        part.signals.iter_mut().for_each(|s| s.fill(0.0));
        let found = of_parts(&[part], 1).unwrap();
        assert!(found.chance > 0.01 && found.explained < 0.02, "{found:?}");
    }
}
