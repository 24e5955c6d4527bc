//! The delay against time, with its band: a hidden Markov model over delays, smoothed over the whole record.

use super::rows::split;
use super::watch::Watched;
use deadtime_identify::Record;

/// Steps of the grid of delays, samples; the finest one with rows times delays within [`MOST`] is used.
const STEPS: [f64; 3] = [0.25, 0.5, 1.0];
/// Largest number of rows times delays in memory.
const MOST: usize = 8_000_000;
/// Probabilities of a step to a neighbour, by row, of which the likeliest is used: a constant, drifting, or wandering delay.
const DRIFTS: [f64; 4] = [1e-6, 1e-3, 1e-2, 1e-1];
/// Expected number of jumps to any other delay in a record. Below one, because a wider prior makes the band uninformative for a constant delay.
const JUMPS: f64 = 0.1;
/// Iterations of shape and track.
const TURNS: usize = 2;

/// The delay against time: mean and 95 % band of its distribution given all rows. Values are raw samples, relative to the shape of [`Watched`].
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Record and sample of each row.
    pub at: Vec<(usize, usize)>,
    /// The mean.
    pub mean: Vec<f64>,
    /// The ends of the 95 % band, half a step of the grid on either side included.
    pub band: Vec<[f64; 2]>,
    /// Log-likelihood of the rows.
    pub log_likelihood: f64,
}

impl Watched {
    /// Forward and backward over all rows, O(rows·delays).
    ///
    /// Source: Rabiner (1989), Proc. IEEE 77(2), 257-286, eqs. 19-27, scaled as in section V.A, doi:10.1109/5.18626.
    #[must_use]
    pub fn track(&self) -> Track {
        let n = self.rows.len();
        let last = (self.rows.orders.delays - 1) as f64;
        let fits = |step: &f64| n * ((last / step) as usize + 1) <= MOST;
        let step = STEPS.into_iter().find(fits).unwrap_or(1.0);
        let grid: Vec<f64> = (0..=(last / step) as usize).map(|i| step * i as f64).collect();
        let mut shape = self.shape.clone();
        let mut best: Option<Smoothed> = None;
        // The chain is over the delay less the best line, whose middle is left in.
        let delay =
            |i: usize, d: f64| self.line.map_or(d, |line| (d + line.later(i)).clamp(0.0, last));
        for _ in 0..TURNS {
            let errors = self.rows.errors(&shape);
            let emission = |i: usize, to: &mut [f64]| {
                let half = 0.5 / self.variance[i];
                let mut least = f64::INFINITY;
                for (e, &d) in to.iter_mut().zip(&grid) {
                    *e = half * errors.between(i, delay(i, d)).powi(2);
                    least = least.min(*e);
                }
                to.iter_mut().for_each(|e| *e = (least - *e).exp());
                -least
            };
            let drifts =
                DRIFTS.map(|drift| (forward(n, grid.len(), drift, &emission, None), drift));
            let drift = drifts.iter().max_by(|a, b| a.0.total_cmp(&b.0)).map_or(DRIFTS[0], |d| d.1);
            let mut found = smoothed(n, &grid, drift, &emission);
            for (i, (mean, band)) in found.mean.iter_mut().zip(&mut found.band).enumerate() {
                (*mean, *band) = (delay(i, *mean), band.map(|end| delay(i, end)));
            }
            if let Some((fitted, _)) = self.rows.fit(|i| found.mean[i]) {
                shape = fitted;
            }
            best = Some(found);
        }
        let Smoothed { mean, band, log_likelihood } =
            best.unwrap_or(Smoothed { mean: Vec::new(), band: Vec::new(), log_likelihood: 0.0 });
        let at = (0..n).map(|i| self.place(i)).collect();
        let skip = self.skip as f64;
        let wide = |[low, high]: [f64; 2]| [low + skip - 0.5 * step, high + skip + 0.5 * step];
        Track {
            at,
            mean: mean.into_iter().map(|m| m + skip).collect(),
            band: band.into_iter().map(wide).collect(),
            log_likelihood,
        }
    }
}

/// A drift of the delay: its value at the first row, its rate by row, and its gain over one delay minus the penalty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// Raw samples at the first sample of the record.
    pub first: f64,
    /// Samples per sample.
    pub rate: f64,
    /// In units of log-likelihood.
    pub gain: f64,
}

impl Watched {
    /// The straight line through the track of one record, weighted by its band; `None` for several records, whose times differ.
    #[must_use]
    pub fn drift(&self, track: &Track, price: f64) -> Option<Drift> {
        if self.rows.begins.len() != 1 || track.mean.len() < 2 {
            return None;
        }
        let points = || {
            track
                .at
                .iter()
                .zip(&track.mean)
                .zip(&track.band)
                .map(|((at, m), b)| (at.1 as f64, *m, (b[1] - b[0]).max(1e-3).powi(-2)))
        };
        let weight: f64 = points().map(|p| p.2).sum();
        let (t, d) = (
            points().map(|p| p.2 * p.0).sum::<f64>() / weight,
            points().map(|p| p.2 * p.1).sum::<f64>() / weight,
        );
        let spread: f64 = points().map(|p| p.2 * (p.0 - t).powi(2)).sum();
        let rate = points().map(|p| p.2 * (p.0 - t) * (p.1 - d)).sum::<f64>()
            / spread.max(f64::MIN_POSITIVE);
        let (first, skip) = (d - rate * t, self.skip as f64);
        let last = (self.rows.orders.delays - 1) as f64;
        let along = |i: usize| (first + rate * track.at[i].1 as f64 - skip).clamp(0.0, last);
        let (shape, _) = self.rows.fit(along)?;
        let errors = self.rows.errors(&shape);
        let of = |i: usize| {
            0.5 * (self.steady[i] - errors.between(i, along(i)).powi(2)) / self.variance[i]
        };
        Some(Drift { first, rate, gain: (0..self.rows.len()).map(of).sum::<f64>() - price })
    }
}

impl Track {
    /// The records with their inputs shifted so that one delay, `reference`, describes them. The command at τ moves to `reference` samples before its effect in
    /// the track.
    #[must_use]
    pub fn straightened<'a>(&self, records: &'a [Record<'_>], reference: f64) -> Vec<Record<'a>> {
        let ahead = reference.round().max(0.0) as usize;
        let of = |(number, record): (usize, &'a Record<'_>)| {
            let mut delay: Vec<f64> = Vec::with_capacity(record.len());
            for ((_, sample), &mean) in
                self.at.iter().zip(&self.mean).filter(|((r, _), _)| *r == number)
            {
                let held = delay.last().copied().unwrap_or(mean);
                delay.resize((*sample).max(delay.len()), held);
                delay.push(mean);
            }
            let end = delay.last().copied().unwrap_or(reference);
            delay.resize(record.len().max(delay.len()), end);
            let moved = |tau: usize| {
                let d = delay.get(tau + ahead).copied().unwrap_or(end);
                let from = (tau as f64 + reference - d).clamp(0.0, (record.len() - 1) as f64);
                let (low, part) = split(from);
                record.u[low] * (1.0 - part)
                    + if part > 0.0 { part * record.u[low + 1] } else { 0.0 }
            };
            let u: Vec<f64> = (0..record.len()).map(moved).collect();
            Record {
                u: u.into(),
                y: (&*record.y).into(),
                present: record.present.as_deref().map(Into::into),
            }
        };
        records.iter().enumerate().map(of).collect()
    }
}

struct Smoothed {
    mean: Vec<f64>,
    band: Vec<[f64; 2]>,
    log_likelihood: f64,
}

/// One step of the chain: stays, moves to a neighbour, or jumps anywhere; p and the result sum to 1.
pub(in crate::track) fn step(p: &[f64], drift: f64, jump: f64, to: &mut [f64]) {
    let count = p.len();
    let anywhere = jump / count as f64;
    for (d, next) in to.iter_mut().enumerate() {
        // The ends reflect.
        let low = p[d.saturating_sub(1)];
        let high = p[(d + 1).min(count - 1)];
        *next = (1.0 - jump) * ((1.0 - drift) * p[d] + 0.5 * drift * (low + high)) + anywhere;
    }
}

/// The filter: log-likelihood, and on request the concatenated distributions of each row.
fn forward(
    n: usize,
    count: usize,
    drift: f64,
    emission: &impl Fn(usize, &mut [f64]) -> f64,
    mut keep: Option<&mut Vec<f32>>,
) -> f64 {
    let jump = JUMPS / n.max(1) as f64;
    let (mut p, mut next, mut e) =
        (vec![1.0 / count as f64; count], vec![0.0; count], vec![0.0; count]);
    let mut log = 0.0;
    for i in 0..n {
        step(&p, drift, jump, &mut next);
        log += emission(i, &mut e);
        let total: f64 = next
            .iter_mut()
            .zip(&e)
            .map(|(p, e)| {
                *p *= e;
                *p
            })
            .sum();
        let scale = total.max(f64::MIN_POSITIVE).recip();
        next.iter_mut().for_each(|p| *p *= scale);
        log += total.max(f64::MIN_POSITIVE).ln();
        std::mem::swap(&mut p, &mut next);
        if let Some(kept) = keep.as_deref_mut() {
            kept.extend(p.iter().map(|p| *p as f32));
        }
    }
    log
}

/// Forward, then backward; the chain is symmetric, so one step back is one step.
fn smoothed(
    n: usize,
    grid: &[f64],
    drift: f64,
    emission: &impl Fn(usize, &mut [f64]) -> f64,
) -> Smoothed {
    let count = grid.len();
    let jump = JUMPS / n.max(1) as f64;
    let mut kept: Vec<f32> = Vec::with_capacity(n * count);
    let log_likelihood = forward(n, count, drift, emission, Some(&mut kept));
    let (mut beta, mut e, mut weighed) =
        (vec![1.0 / count as f64; count], vec![0.0; count], vec![0.0; count]);
    let (mut mean, mut band) = (vec![0.0; n], vec![[0.0; 2]; n]);
    for i in (0..n).rev() {
        let alpha = &kept[i * count..(i + 1) * count];
        weighed.iter_mut().zip(alpha).zip(&beta).for_each(|((w, a), b)| *w = f64::from(*a) * b);
        let total: f64 = weighed.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        mean[i] = weighed.iter().zip(grid).map(|(w, d)| w * d).sum::<f64>() / total;
        let end = |share: f64| {
            let mut sum = 0.0;
            let at = weighed.iter().position(|w| {
                sum += w;
                sum >= share * total
            });
            grid[at.unwrap_or(count - 1)]
        };
        band[i] = [end(0.025), end(0.975)];
        emission(i, &mut e);
        weighed.iter_mut().zip(&beta).zip(&e).for_each(|((w, b), e)| *w = b * e);
        let sum: f64 = weighed.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        weighed.iter_mut().for_each(|w| *w /= sum);
        step(&weighed, drift, jump, &mut beta);
    }
    Smoothed { mean, band, log_likelihood }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_the_chain_is_that_over_all_its_paths() {
        let grid = [0.0, 0.5, 1.0];
        let likelihood = [[0.7, 0.2, 0.4], [0.1, 0.9, 0.3], [0.5, 0.5, 0.2], [0.05, 0.3, 0.8]];
        let emission = |i: usize, to: &mut [f64]| {
            to.copy_from_slice(&likelihood[i]);
            0.0
        };
        let drift = 0.1;
        let transition = |from: usize, to: usize| {
            let (mut p, mut next) = ([0.0; 3], [0.0; 3]);
            p[from] = 1.0;
            step(&p, drift, JUMPS / 4.0, &mut next);
            next[to]
        };
        let (mut total, mut first) = (0.0, [0.0; 4]);
        for n in 0..81usize {
            let path = [n % 3, n / 3 % 3, n / 9 % 3, n / 27];
            // The first row is one step from a uniform start, which remains uniform.
            let mut p = 1.0 / 3.0;
            for i in 0..4 {
                p *= likelihood[i][path[i]]
                    * if i > 0 { transition(path[i - 1], path[i]) } else { 1.0 };
            }
            total += p;
            path.iter().zip(&mut first).for_each(|(d, f)| *f += p * grid[*d]);
        }
        let found = smoothed(4, &grid, drift, &emission);
        assert!((found.log_likelihood - f64::ln(total)).abs() < 1e-12);
        for (got, sum) in found.mean.iter().zip(first) {
            assert!((got - sum / total).abs() < 1e-6, "{got} and {}", sum / total);
        }
    }
}
