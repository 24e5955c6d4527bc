//! The straight line of delays that fits a record best.
//!
//! A path of whole delays pays for each of its steps. For an input of a narrow spectrum, delays one period apart fit nearly alike: few jumps of whole periods are
//! then cheaper than the many steps of a drift.
//!
//! Equation: minimise Σ e² over the delays at the first and the last row, with the shape fitted anew for each line; a grid of both, then steps that halve.
//!
//! How it can be wrong: a grid that is coarse against the input's period, in a long search window; a drift that bends.

use super::rows::{Errors, ResponseShape, Rows};

/// Largest number of delays at either end.
const ENDS: usize = 20;
/// Least step of the grid, samples: 25 % of the shortest period that most plants pass on, about eight samples.
const LEAST_STEP: f64 = 2.0;
/// Rows of a fit in the scan; of a longer record rows at even distances.
const ROWS: usize = 1000;
/// Halvings of the grid's step.
const HALVINGS: usize = 4;

/// Delays at the first and at the last row, samples; between them the delay changes at a constant rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    ends: [f64; 2],
    last_row: f64,
    longest: f64,
}

impl Line {
    fn of(rows: &Rows, ends: [f64; 2]) -> Self {
        let longest = (rows.orders.delays - 1) as f64;
        Self { ends, last_row: rows.len().saturating_sub(1).max(1) as f64, longest }
    }

    /// The delay at a row.
    pub(super) fn at(&self, row: usize) -> f64 {
        let [from, to] = self.ends;
        (from + (to - from) * row as f64 / self.last_row).clamp(0.0, self.longest)
    }

    /// How much later the delay is at a row than in the middle.
    pub(super) fn later(&self, row: usize) -> f64 {
        let [from, to] = self.ends;
        (to - from) * (row as f64 / self.last_row - 0.5)
    }

    /// e² of each row.
    pub(super) fn squares(&self, errors: &Errors<'_>, rows: usize) -> Vec<f64> {
        (0..rows).map(|i| errors.between(i, self.at(i)).powi(2)).collect()
    }
}

/// The best line of one record, and the shape along it. `None` for several records, whose times differ, and where no line that falls or rises exceeds the best
/// level one by `price` in log-likelihood.
pub(super) fn best_line(rows: &Rows, price: f64) -> Option<(Line, ResponseShape)> {
    if rows.begins.len() != 1 {
        return None;
    }
    let stride = rows.len().div_ceil(ROWS);
    let loss = |ends: [f64; 2]| {
        let line = Line::of(rows, ends);
        rows.fit_every(stride, |i| line.at(i)).map_or(f64::INFINITY, |(_, left)| left)
    };
    let lower = |best: ([f64; 2], f64), ends: [f64; 2]| {
        let loss = loss(ends);
        if loss < best.1 { (ends, loss) } else { best }
    };
    let longest = (rows.orders.delays - 1) as f64;
    let step = LEAST_STEP.max(longest / ENDS as f64);
    let grid: Vec<f64> = (0..=(longest / step) as usize).map(|i| step * i as f64).collect();
    let none = ([0.0; 2], f64::INFINITY);
    let mut level = grid.iter().map(|d| [*d; 2]).fold(none, lower);
    let ends = grid.iter().flat_map(|from| grid.iter().map(move |to| [*from, *to]));
    let mut best = ends.fold(level, lower);
    let mut near = step;
    for _ in 0..HALVINGS {
        near *= 0.5;
        let around = [-near, 0.0, near];
        let [from, to] = best.0;
        let ends = around.iter().flat_map(|a| around.iter().map(move |b| [from + a, to + b]));
        best = ends.fold(best, lower);
        let [at, _] = level.0;
        level = around.iter().map(|a| [at + a; 2]).fold(level, lower);
    }
    let gain = 0.5 * rows.len() as f64 * (level.1 / best.1.max(f64::MIN_POSITIVE)).ln();
    let line = Line::of(rows, best.0);
    let (shape, _) = rows.fit(|i| line.at(i)).filter(|_| gain > price)?;
    Some((line, shape))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::rows::RowOrders;
    use deadtime_identify::Record;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use std::f64::consts::TAU;

    const SAMPLES: usize = 1000;

    /// A lag behind a sum of sines, whose delay changes from `from` to `to`; 1 % noise.
    fn drawn(rng: &mut ChaCha8Rng, from: f64, to: f64) -> [Record<'static>; 1] {
        let phases: Vec<f64> = (0..20).map(|_| rng.random_range(0.0..TAU)).collect();
        let input = |t: f64| -> f64 {
            let line =
                |(k, phase): (usize, &f64)| (TAU * 5.0 * k as f64 * t / 1000.0 + phase).sin();
            phases.iter().enumerate().map(line).sum()
        };
        let pole = rng.random_range(0.3..0.9);
        let (mut x, mut u, mut y) = (0.0, Vec::new(), Vec::new());
        for k in 0..SAMPLES {
            let t = k as f64;
            u.push(input(t));
            x = pole * x + (1.0 - pole) * input(t - from - (to - from) * t / SAMPLES as f64);
            let noise: f64 = StandardNormal.sample(rng);
            y.push(x + 0.03 * noise);
        }
        [Record::new(u, y)]
    }

    #[test]
    fn the_line_has_the_rate_of_a_drift_and_a_constant_delay_has_none() {
        for seed in 0..8 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let from: f64 = rng.random_range(3.0..20.0);
            let by: f64 = if seed % 2 == 0 { 8.0 } else { -2.5 };
            let orders = RowOrders { na: 8, nb: 6, delays: 36 };
            let records = drawn(&mut rng, from, from + by);
            let (line, _) = best_line(&Rows::new(&records, orders), 15.0).unwrap();
            let [start, end] = line.ends;
            // From the first row to the last one.
            let rate = by * line.last_row / SAMPLES as f64;
            assert!((end - start - rate).abs() < 0.5, "{by}: {start} to {end}");
            let records = drawn(&mut rng, from, from);
            assert!(best_line(&Rows::new(&records, orders), 15.0).is_none());
        }
    }
}
