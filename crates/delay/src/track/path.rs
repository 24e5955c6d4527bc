//! The path of delays that fits the rows best with a penalty per change.

use super::rows::{Errors, Rows};

/// Minimises Σ e²/(2·variance) + price·(changes) over all paths of whole delays, one per row. Each row has its own variance; dynamic programming takes
/// O(rows·delays).
///
/// Source: the Viterbi algorithm for a hidden Markov model whose states are the delays. A change to any other delay has the same price, so the best predecessor
/// is either the same delay or the best of all. With this price it is optimal partitioning: Jackson et al. (2005), IEEE Signal Process. Lett. 12(2), 105-108,
/// doi:10.1109/LSP.2001.838216.
pub(super) fn best_path(
    rows: &Rows,
    errors: &Errors<'_>,
    variance: &[f64],
    price: f64,
) -> Vec<usize> {
    let delays = rows.orders.delays;
    let mut score = vec![0.0; delays];
    // For each row: the best delay before it, and the delays reached from that one.
    let (mut best_before, mut came) =
        (Vec::with_capacity(rows.len()), vec![false; rows.len() * delays]);
    for (i, variance) in variance.iter().enumerate() {
        let half = 0.5 / variance;
        let (best, least) = score
            .iter()
            .copied()
            .enumerate()
            .fold((0, f64::INFINITY), |m, s| if s.1 < m.1 { s } else { m });
        best_before.push(best);
        for (d, s) in score.iter_mut().enumerate() {
            // Relative to the least, so that sums stay small; the first row is reached from any delay.
            let stay = *s - least;
            let jump = if i == 0 { 0.0 } else { price };
            came[i * delays + d] = jump < stay;
            *s = stay.min(jump) + half * errors.whole(i, d).powi(2);
        }
    }
    let mut at = score
        .iter()
        .enumerate()
        .fold((0, f64::INFINITY), |m, (d, s)| if *s < m.1 { (d, *s) } else { m })
        .0;
    let mut path = vec![0; rows.len()];
    for i in (0..rows.len()).rev() {
        path[i] = at;
        if came[i * delays + at] {
            at = best_before[i];
        }
    }
    path
}

/// Rows on either side whose errors give the noise of a row.
const NEAR: usize = 20;

/// The variance of each row: the mean square of the errors around it, bounded below by that of all. Noise bursts, and model failures at any delay, reduce the
/// weight of a row.
pub(super) fn variances(squares: &[f64], floor: f64) -> Vec<f64> {
    let n = squares.len();
    let mut sums = Vec::with_capacity(n + 1);
    sums.push(0.0);
    squares.iter().fold(0.0, |sum, e| {
        sums.push(sum + e);
        sum + e
    });
    let all = sums[n] / n.max(1) as f64;
    let near = |i: usize| {
        let (from, to) = (i.saturating_sub(NEAR), (i + NEAR + 1).min(n));
        (sums[to] - sums[from]) / (to - from) as f64
    };
    (0..n).map(|i| near(i).max(all).max(floor)).collect()
}

/// Stretches of a path at one delay: rows and delay.
pub(super) fn stretches(path: &[usize]) -> Vec<(std::ops::Range<usize>, usize)> {
    let mut found: Vec<(std::ops::Range<usize>, usize)> = Vec::new();
    for (i, &d) in path.iter().enumerate() {
        match found.last_mut() {
            Some((rows, at)) if *at == d => rows.end = i + 1,
            _ => found.push((i..i + 1, d)),
        }
    }
    found
}

/// The gain in log-likelihood of a stretch's rows at its own delay over another delay.
fn gain(
    errors: &Errors<'_>,
    variance: &[f64],
    rows: std::ops::Range<usize>,
    own: usize,
    other: usize,
) -> f64 {
    rows.map(|i| {
        (errors.whole(i, other).powi(2) - errors.whole(i, own).powi(2)) * 0.5 / variance[i]
    })
    .sum()
}

/// The path without weak stretches, which take the previous or next delay. A stretch is weak if it gains less than `price` over that delay, or has fewer than
/// `least` rows. The weakest stretch is removed first.
pub(super) fn pruned(
    path: &[usize],
    errors: &Errors<'_>,
    variance: &[f64],
    price: f64,
    least: usize,
) -> Vec<usize> {
    let mut kept = stretches(path);
    // Many at once while there are many, which bounds the run time for a path with constant changes.
    while kept.len() > 1 {
        let weakness = |s: usize| {
            let (rows, own) = &kept[s];
            let neighbours =
                [s.checked_sub(1), Some(s + 1)].into_iter().flatten().filter_map(|b| kept.get(b));
            let gains = neighbours
                .map(|(_, other)| (gain(errors, variance, rows.clone(), *own, *other), *other));
            let (gained, other) = gains.min_by(|a, b| a.0.total_cmp(&b.0))?;
            let short = if rows.len() < least { f64::NEG_INFINITY } else { gained };
            (short < price).then_some((short, gained, s, other))
        };
        let mut weak: Vec<(f64, f64, usize, usize)> =
            (0..kept.len()).filter_map(weakness).collect();
        if weak.is_empty() {
            break;
        }
        weak.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        weak.truncate(weak.len().div_ceil(AT_ONCE));
        let mut touched = vec![false; kept.len() + 2];
        for &(_, _, s, other) in &weak {
            // A stretch whose neighbour was just removed is kept.
            if !(touched[s] || touched[s + 1] || touched[s + 2]) {
                kept[s].1 = other;
                touched[s + 1] = true;
            }
        }
        let mut joined: Vec<(std::ops::Range<usize>, usize)> = Vec::with_capacity(kept.len());
        for (rows, d) in kept {
            match joined.last_mut() {
                Some((before, at)) if *at == d => before.end = rows.end,
                _ => joined.push((rows, d)),
            }
        }
        kept = joined;
    }
    kept.into_iter().flat_map(|(rows, d)| rows.map(move |_| d)).collect()
}

/// One in this many weak stretches is removed at once.
const AT_ONCE: usize = 10;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::rows::RowOrders;
    use deadtime_identify::Record;

    /// Every path of this number of rows and delays.
    fn every(rows: usize, delays: usize) -> Vec<Vec<usize>> {
        (0..delays.pow(rows as u32))
            .map(|n| (0..rows).map(|i| n / delays.pow(i as u32) % delays).collect())
            .collect()
    }

    #[test]
    fn the_best_path_is_the_best_of_all() {
        let wave =
            |k: f64, f: f64| (0..12).map(|t| (f * f64::from(t) + k).sin()).collect::<Vec<f64>>();
        for (k, price) in [(0.1, 0.05), (0.7, 0.4), (1.9, 2.0)] {
            let record = [Record::new(wave(k, 1.3), wave(2.0 * k, 0.9))];
            let rows = Rows::new(&record, RowOrders { na: 1, nb: 2, delays: 3 });
            let (shape, _) = rows.fit(|_| 1.0).unwrap();
            let errors = rows.errors(&shape);
            let variance: Vec<f64> = (0..rows.len()).map(|i| 0.1 + 0.05 * i as f64).collect();
            let cost = |path: &Vec<usize>| -> f64 {
                let moved = path.windows(2).filter(|w| w[0] != w[1]).count() as f64;
                (0..rows.len())
                    .map(|i| errors.whole(i, path[i]).powi(2) * 0.5 / variance[i])
                    .sum::<f64>()
                    + price * moved
            };
            let least = every(rows.len(), 3).iter().map(cost).fold(f64::INFINITY, f64::min);
            let found = best_path(&rows, &errors, &variance, price);
            assert!(
                (cost(&found) - least).abs() < 1e-9,
                "price {price}: {} and {least}",
                cost(&found)
            );
        }
    }
}
