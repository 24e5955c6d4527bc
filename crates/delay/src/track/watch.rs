//! Whether one delay describes a record, and where it changes.

use super::bent::one_delay_with_bends;
use super::line::{Line, best_line};
use super::path::{best_path, pruned, stretches, variances};
use super::rows::{Errors, ResponseShape, RowOrders, Rows};
use crate::estimator::Search;
use deadtime_identify::{Record, arx_scan};

/// A test for a time-varying delay.
///
/// y(t) = Σ aᵢ·y(t−i) + Σ bⱼ·u(t−d(t)−j) + c + e(t): the shape (a, b, c) is that of the whole record. The shape is fitted with the delays, and each change has
/// a penalty. Past outputs make e white for any noise colour, remain valid under feedback, and need no stable plant. Shape and path are fitted alternately. The
/// likelihood of delays has many maxima, so several starts are used: the best constant delays of halves and thirds of each record.
///
/// A change is reported where the log-likelihood of the path exceeds that of one constant delay by more than its penalty (a generalised likelihood ratio). Each
/// row is weighted by the errors around it. The path must exceed by as much the log-likelihood of one delay behind a static input nonlinearity (`bent`). Static
/// friction under a slow input resembles a growing delay. The default penalty was set on draws with one delay; `docs/results/studies/track.md` has the
/// false-alarm rate on others.
///
/// Wrong when: the signals rest around the change: its time is then uncertain between two motions, and reported so. Without later motion the change is not
/// detected. An input that repeats within the window fits delays one period apart equally. A plant change with the delay, or instead of it, is an alias: a
/// change of the lag is reported as one of the delay. Nonlinearities elsewhere than at the input are not modelled.
///
/// Source: for the generalised likelihood ratio Basseville and Nikiforov (1993), "Detection of Abrupt Changes", section 2.4. For a hidden Markov model whose
/// state is the delay, with its shape re-estimated along the best path: Rabiner (1989), Proc. IEEE 77(2), 257-286, doi:10.1109/5.18626.
#[derive(Debug, Clone, PartialEq)]
pub struct Watch {
    /// Past outputs of the model; default 8.
    pub na: usize,
    /// Input coefficients of the model; default 6.
    pub nb: usize,
    /// Penalty of a change of the delay, in units of log-likelihood; default 15.
    pub price: f64,
}

impl Default for Watch {
    fn default() -> Self {
        Self { na: 8, nb: 6, price: 15.0 }
    }
}

/// Share of the error that a reported change must explain: in a long record a slightly wrong model gains significantly by any extension.
const LEAST_SHARE: f64 = 0.01;
/// Rows by coefficient and delay that a record must have.
const ROWS: usize = 2;
/// Iterations of shape and path.
const TURNS: usize = 10;
/// Number of records whose parts are used as starts.
const RECORDS: usize = 8;
/// The share of the output's power below which no error is distinguishable from rounding.
const ROUNDING: f64 = 1e-12;

/// Rows of constant delay.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// The record.
    pub record: usize,
    /// Its samples, half-open.
    pub samples: std::ops::Range<usize>,
    /// Its beginning, 95 %: the first and the last sample that may be its first. `None` where a record begins.
    pub began: Option<[usize; 2]>,
    /// The raw delay, samples.
    pub delay: usize,
}

/// The result for a record.
pub struct Watched {
    pub(super) rows: Rows,
    pub(super) shape: ResponseShape,
    pub(super) variance: Vec<f64>,
    pub(super) path: Vec<usize>,
    /// The delay changes at a constant rate; `path` is then the rounded line.
    pub(super) line: Option<Line>,
    /// Samples by which the output is shifted earlier.
    pub(super) skip: usize,
    /// The residual of each row at one delay.
    pub(super) steady: Vec<f64>,
    /// The gain of the path over one delay minus the penalties of its changes; 0 without changes.
    pub gain: f64,
    /// The share of the squared errors of one delay that the path removes.
    pub share: f64,
}

impl Watch {
    /// Tests the records of one pair, means subtracted. `None` where they are too short for the window and the orders, or without a finite solution.
    #[must_use]
    pub fn look(&self, records: &[Record<'_>], search: &Search) -> Option<Watched> {
        let skip = search.min_delay.min(search.max_delay.saturating_sub(1));
        let records: Vec<Record<'_>> = records.iter().map(|r| r.ahead(skip)).collect();
        let max_delay = search.max_delay - skip;
        let orders = RowOrders { na: self.na.max(1), nb: self.nb.max(1), delays: max_delay + 1 };
        let rows = Rows::new(&records, orders);
        let n = rows.len();
        if n < ROWS * (orders.columns() + orders.delays) {
            return None;
        }
        let small = (ROUNDING * rows.power / n as f64).max(f64::MIN_POSITIVE);
        let scan = arx_scan(&records, orders.na, orders.nb, max_delay);
        let mut ranked: Vec<usize> =
            (0..orders.delays).filter(|&k| scan.loss[k].is_finite()).collect();
        ranked.sort_by(|&a, &b| scan.loss[a].total_cmp(&scan.loss[b]));
        let constant = ranked.iter().take(3).filter_map(|&k| Some((k, rows.fit(|_| k as f64)?)));
        let (one, (shape, left)) = constant.min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
        let squares = squares(&rows, &shape, &vec![one; n]);
        let steady = squares.clone();
        let mut best = Watched {
            variance: variances(&squares, small),
            path: vec![one; n],
            line: None,
            shape: shape.clone(),
            skip,
            steady,
            gain: 0.0,
            share: 0.0,
            rows,
        };
        let mut starts = vec![(shape, left / n as f64)];
        starts.extend(parts(&records).iter().filter_map(|part| start(part, orders, max_delay)));
        for (shape, variance) in starts {
            self.improve(&mut best, shape, variance.max(small), small);
        }
        self.straighten(&mut best, small);
        if best.gain > 0.0 && !self.outdoes_bends(&best, one) {
            best.variance = variances(&best.steady, small);
            best.path.fill(one);
            best.shape = best.rows.fit(|_| one as f64)?.0;
            (best.gain, best.share, best.line) = (0.0, 0.0, None);
        }
        Some(best)
    }

    /// A straight line with a larger gain replaces the best path. Its rate is one change.
    fn straighten(&self, best: &mut Watched, small: f64) {
        let Some((line, shape)) = best_line(&best.rows, self.price) else { return };
        let n = best.rows.len();
        let squares = line.squares(&best.rows.errors(&shape), n);
        let variance = variances(&squares, small);
        let (gain, share) = best.gained(&squares, &variance);
        let gain = gain - self.price;
        if gain > best.gain && share > LEAST_SHARE {
            best.path = (0..n).map(|i| line.at(i).round() as usize).collect();
            (best.gain, best.share, best.line) = (gain, share, Some(line));
            (best.shape, best.variance) = (shape, variance);
        }
    }

    /// The path fits the rows better than one delay behind a static nonlinearity of the input, by more than the penalties of its changes. `one`: the best
    /// constant delay.
    fn outdoes_bends(&self, found: &Watched, one: usize) -> bool {
        let shown = stretches(&found.path);
        let mut delays: Vec<usize> = shown.iter().map(|(_, delay)| *delay).chain([one]).collect();
        delays.sort_unstable();
        delays.dedup();
        let Some(alternative) = one_delay_with_bends(&found.rows, &delays) else { return true };
        let own = match found.line {
            Some(line) => line.squares(&found.rows.errors(&found.shape), found.rows.len()),
            None => squares(&found.rows, &found.shape, &found.path),
        };
        let changes = if found.line.is_some() { 1 } else { shown.len() - 1 };
        let rows = alternative.iter().zip(&own).zip(&found.variance);
        let gain: f64 = rows.map(|((r, e), v)| 0.5 * (r - e) / v).sum();
        gain > self.price * changes as f64
    }

    /// Alternating fits of shape and path from one start; a larger gain replaces the best.
    fn improve(&self, best: &mut Watched, mut shape: ResponseShape, variance: f64, small: f64) {
        let n = best.rows.len();
        let mut variance = vec![variance; n];
        let mut path: Vec<usize> = Vec::new();
        for _ in 0..TURNS {
            let errors = best.rows.errors(&shape);
            let found = best_path(&best.rows, &errors, &variance, self.price);
            let next = pruned(&found, &errors, &variance, self.price, best.rows.orders.delays);
            if next == path {
                return;
            }
            path = next;
            let Some((fitted, _)) = best.rows.fit(|i| path[i] as f64) else { return };
            let squares = squares(&best.rows, &fitted, &path);
            variance = variances(&squares, small);
            let changes = stretches(&path).len() - 1;
            let (gain, share) = best.gained(&squares, &variance);
            let gain = gain - self.price * changes as f64;
            if changes > 0 && gain > best.gain && share > LEAST_SHARE {
                (best.gain, best.share) = (gain, share);
                (best.shape, best.variance, best.path) =
                    (fitted.clone(), variance.clone(), path.clone());
            }
            shape = fitted;
        }
    }
}

impl Watched {
    /// The gain in log-likelihood of rows with these squared errors over one delay, and the share of its squared errors that they remove.
    fn gained(&self, squares: &[f64], variance: &[f64]) -> (f64, f64) {
        let rows = self.steady.iter().zip(squares).zip(variance);
        let gain = rows.map(|((s, e), v)| 0.5 * (s - e) / v).sum();
        let all: f64 = self.steady.iter().sum();
        (gain, 1.0 - squares.iter().sum::<f64>() / all.max(f64::MIN_POSITIVE))
    }

    /// One delay describes the records.
    #[must_use]
    pub fn is_steady(&self) -> bool {
        self.gain <= 0.0
    }

    /// The stretches of constant delay; a new record begins a new stretch.
    #[must_use]
    pub fn stretches(&self) -> Vec<Stretch> {
        let errors = self.rows.errors(&self.shape);
        let found = stretches(&self.path);
        let mut shown: Vec<Stretch> = Vec::new();
        for (s, (rows, delay)) in found.iter().enumerate() {
            let before = s.checked_sub(1).and_then(|b| found.get(b));
            let mut began = before
                .map(|(before, from)| self.began(&errors, before.start..rows.end, *from, *delay));
            for row in rows.clone() {
                let (record, sample) = self.place(row);
                match shown
                    .last_mut()
                    .filter(|l| l.record == record && l.delay == delay + self.skip)
                {
                    Some(last) => last.samples.end = sample + 1,
                    None => {
                        let same = shown.last().is_some_and(|l| l.record == record);
                        let began =
                            began.take().filter(|_| same).map(|b| b.map(|row| self.place(row).1));
                        shown.push(Stretch {
                            record,
                            samples: sample..sample + 1,
                            began,
                            delay: delay + self.skip,
                        });
                    }
                }
                if let Some(last) = shown.last_mut() {
                    last.delay = *delay + self.skip;
                }
            }
        }
        shown
    }

    /// The stretches between changes; of a delay that changes at a constant rate the whole record.
    #[must_use]
    pub fn of_one_change(&self) -> Vec<Stretch> {
        let mut stretches = self.stretches();
        if self.line.is_some()
            && let Some(end) = stretches.last().map(|s| s.samples.end)
        {
            stretches.truncate(1);
            stretches[0].samples.end = end;
        }
        stretches
    }

    /// The record and the sample of a row.
    pub(super) fn place(&self, row: usize) -> (usize, usize) {
        let (record, sample) = self.rows.place(row);
        (record, sample + self.skip)
    }

    /// The first and the last row of a change from one delay to another, 95 %, from its normalised likelihood over all rows.
    fn began(
        &self,
        errors: &Errors<'_>,
        rows: std::ops::Range<usize>,
        from: usize,
        to: usize,
    ) -> [usize; 2] {
        let start = rows.start;
        let mut log = Vec::with_capacity(rows.len());
        let mut sum = 0.0;
        for i in rows {
            log.push(sum);
            sum += 0.5 * (errors.whole(i, to).powi(2) - errors.whole(i, from).powi(2))
                / self.variance[i];
            // After a change behind row i, row i still has the earlier delay.
        }
        let top = log.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = log.iter().map(|l| (l - top).exp()).collect();
        let total: f64 = weights.iter().sum();
        let mut below = 0.0;
        let mut ends = [start, start + weights.len().saturating_sub(1)];
        for (i, w) in weights.iter().enumerate() {
            if below <= 0.025 * total {
                ends[0] = start + i;
            }
            below += w;
            if below >= 0.975 * total {
                ends[1] = start + i;
                break;
            }
        }
        ends
    }
}

/// e² of each row along a path.
fn squares(rows: &Rows, shape: &ResponseShape, path: &[usize]) -> Vec<f64> {
    let errors = rows.errors(shape);
    path.iter().enumerate().map(|(i, &d)| errors.whole(i, d).powi(2)).collect()
}

/// Halves and thirds of the records.
fn parts<'a>(records: &'a [Record<'_>]) -> Vec<Record<'a>> {
    let cut = |record: &'a Record<'_>| {
        let len = record.len();
        let each = [2, 3].into_iter().flat_map(|count| (0..count).map(move |part| (part, count)));
        each.map(move |(part, count)| (len * part / count, len * (part + 1) / count))
            .map(|(from, to)| record.part(from, from, to - from))
    };
    records.iter().take(RECORDS).flat_map(cut).collect()
}

/// The shape of the best constant delay of a part, and its mean square error per row.
fn start(part: &Record<'_>, orders: RowOrders, max_delay: usize) -> Option<(ResponseShape, f64)> {
    let scan = arx_scan(std::slice::from_ref(part), orders.na, orders.nb, max_delay);
    let best = (0..orders.delays)
        .filter(|&k| scan.loss[k].is_finite())
        .min_by(|&a, &b| scan.loss[a].total_cmp(&scan.loss[b]))?;
    let (a, b) = scan.coefficients[best].split_at(orders.na);
    (scan.rows >= 2 * orders.columns())
        .then(|| (ResponseShape { a: a.to_vec(), b: b.to_vec(), level: 0.0 }, scan.loss[best]))
}
