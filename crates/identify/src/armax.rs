//! ARMAX models A(q) y = B(q) u(t − nk) + C(q) e, fitted for many delays by their one-step-ahead prediction errors.

use nalgebra::{DMatrix, DVector};

use super::arx::scan as arx_scan;
use super::polynomial::{filter, filter_both, impulse_response, is_stable, reflected};
use super::regression::{Record, dot};
use deadtime_signal::fit::{LevenbergMarquardt, Normal, Stopped};
use deadtime_signal::stop::Stop;

/// Orders of an ARMAX model.
///
/// The predictor e = (A y − B u)/C is kept stable; A may have roots anywhere. The likelihood is exact given the first outputs. The errors before a stretch
/// without missing outputs have the same variance, and are estimated with it. These errors, A and B enter linearly and are eliminated (variable projection,
/// Kaufman's Jacobian), so the search is over C alone. The loss is Σ e²·det^(1/rows)/rows, det the determinant of the errors' covariance. Without det, roots of
/// C would accumulate on the unit circle for short stretches. Starts: C = 1, the second stage of Hannan and Rissanen, a table of slow and fast roots. Solutions
/// of the neighbouring delays follow, upwards and downwards.
///
/// Source: Ljung (1999), "System Identification", 2nd ed., sections 4.2, 7.2 and 10.2. Golub and Pereyra (2003), doi:10.1088/0266-5611/19/2/201. Hannan and
/// Rissanen (1982), Biometrika 69(1), 81-94, doi:10.1093/biomet/69.1.81. Box, Jenkins and Reinsel (2008), "Time Series Analysis", 4th ed., section 7.1 (the
/// determinant).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Armax {
    /// Past outputs.
    pub na: usize,
    /// Largest number of input coefficients.
    pub nb: usize,
    /// Past errors.
    pub nc: usize,
}

/// An ARMAX model of one delay and one number of input coefficients.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmaxFit {
    /// Σ e²/rows times det^(1/rows); e includes the errors before the record.
    pub loss: f64,
    /// a₁ … a_na, of A = 1 + a₁q⁻¹ + …
    pub a: Vec<f64>,
    /// b₀ …
    pub b: Vec<f64>,
    /// c₁ … c_nc, of C = 1 + c₁q⁻¹ + …
    pub c: Vec<f64>,
    /// Why the search stopped.
    pub stopped: Stopped,
    /// Predicted reduction of rows·ln(loss) by the quadratic model at the end: 0 at a minimum. A search may end without a minimum and with a negligible
    /// reduction. The loss then barely depends on C, or roots of C are on the unit circle.
    pub to_gain: f64,
}

/// The fits of all delays, over the same rows.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmaxScan {
    /// `fits[nk][m − 1]` has m input coefficients, from lag nk on; `None` where the model cannot be evaluated.
    pub fits: Vec<Vec<Option<ArmaxFit>>>,
    /// The model without any input: A(q) y = C(q) e.
    pub without_input: Option<ArmaxFit>,
    /// Σ y²/rows.
    pub power: f64,
    /// Rows behind every loss.
    pub rows: usize,
}

/// A stretch of rows t = first … whose past outputs and inputs are complete.
struct ArmaxStretch<'a> {
    rows: usize,
    /// y(first − na) … and u(first − most) …
    y: &'a [f64],
    u: &'a [f64],
    yf: Vec<f64>,
    uf: Vec<f64>,
    /// nc zeros and the impulse response of 1/C down to rounding.
    impulse: Vec<f64>,
    /// The effect of an error before the stretch, the last one first, on (A y − B u)/C: as long as the impulse response.
    before: Vec<Vec<f64>>,
    /// nc errors before the stretch, then its own.
    e: Vec<f64>,
}

impl ArmaxStretch<'_> {
    /// The column of a filtered signal that begins `from` samples before `x(t − lag)` at the first row, with zeros before that row.
    fn column(&self, filtered: &[f64], from: usize, c: &[f64]) -> Vec<f64> {
        let mut column = filtered[from..from + self.rows].to_vec();
        for k in 0..c.len() {
            let carried: f64 =
                (k + 1..=c.len().min(from + k)).map(|j| c[j - 1] * filtered[from + k - j]).sum();
            self.add_impulse(&mut column, k, carried);
        }
        column
    }

    fn add_impulse(&self, column: &mut [f64], shift: usize, weight: f64) {
        for (v, h) in column.iter_mut().zip(&self.impulse[self.before.len() - shift..]) {
            *v += weight * h;
        }
    }
}

struct ArmaxProblem<'a> {
    orders: Armax,
    /// The largest input lag of any delay.
    most: usize,
    stretches: Vec<ArmaxStretch<'a>>,
    /// First input lag and number of input coefficients of the current model.
    nk: usize,
    m: usize,
    /// Σ y².
    power: f64,
    rows: usize,
    /// C of the last filtering.
    c: Vec<f64>,
    /// −a, then b, of the last evaluation.
    linear: DVector<f64>,
}

/// A relative ridge of rounding size: linearly dependent columns need no rank decision, because only their sum matters.
const RIDGE: f64 = 1e-13;
/// Below this share of the signal's power the solution is refined on its residual, because the first solution's rounding is larger.
const REFINE: f64 = 1e-9;

impl<'a> ArmaxProblem<'a> {
    fn new(orders: Armax, records: &'a [Record], max_delay: usize) -> Self {
        let Armax { na, nb, nc } = orders;
        let most = (max_delay + nb).saturating_sub(1);
        let mut stretches = Vec::new();
        let (mut power, mut total) = (0.0, 0);
        for record in records {
            let end = record.len();
            let there = |t: usize| record.present.as_ref().is_none_or(|p| p[t]);
            let mut from = 0;
            for t in 0..=end {
                if t < end && there(t) {
                    continue;
                }
                let first = (from + na).max(most);
                // A stretch must have more rows than unknowns.
                if t > first + nc {
                    let (rows, y, u) =
                        (t - first, &record.y[first - na..t], &record.u[first - most..t]);
                    total += rows;
                    power += dot(&y[na..], &y[na..]);
                    stretches.push(ArmaxStretch {
                        rows,
                        y,
                        u,
                        yf: vec![0.0; y.len()],
                        uf: vec![0.0; u.len()],
                        impulse: vec![0.0; nc],
                        before: vec![Vec::new(); nc],
                        e: vec![0.0; nc + rows],
                    });
                }
                from = t + 1;
            }
        }
        Self {
            orders,
            most,
            stretches,
            nk: 0,
            m: nb,
            power,
            rows: total,
            c: Vec::new(),
            linear: DVector::zeros(0),
        }
    }

    fn filter(&mut self, c: &[f64]) {
        self.c = c.to_vec();
        let nc = c.len();
        let mut h = Vec::new();
        for s in &mut self.stretches {
            if c.iter().all(|c| *c == 0.0) {
                s.yf.copy_from_slice(s.y);
                s.uf.copy_from_slice(s.u);
            } else {
                filter_both([s.y, s.u], c, [&mut s.yf, &mut s.uf]);
            }
            impulse_response(c, s.rows, NOTHING, &mut h);
            s.impulse.truncate(nc);
            s.impulse.extend_from_slice(&h);
            for j in 1..=nc {
                let mut column = std::mem::take(&mut s.before[j - 1]);
                column.clear();
                column.resize((h.len() + nc).min(s.rows), 0.0);
                for k in 0..=nc - j {
                    s.add_impulse(&mut column, k, c[k + j - 1]);
                }
                s.before[j - 1] = column;
            }
        }
    }

    /// ln det of the covariance of (A y − B u) over all stretches, per row and in units of the errors' variance.
    fn determinant(&self, c: &[f64]) -> Option<f64> {
        let mut known: Vec<(usize, f64)> = Vec::new();
        let mut sum = 0.0;
        for s in &self.stretches {
            let rows = s.rows.min(REMEMBERED);
            let value = match known.iter().find(|(r, _)| *r == rows) {
                Some((_, value)) => *value,
                None => {
                    let value = ln_determinant(c, rows)?;
                    known.push((rows, value));
                    value
                }
            };
            sum += value;
        }
        let rows = self.rows as f64;
        Some(sum / rows)
    }

    /// Past outputs, then inputs, of the current model.
    fn columns(&self, s: &ArmaxStretch<'a>) -> Vec<Vec<f64>> {
        let (na, most) = (self.orders.na, self.most);
        let outputs = (1..=na).map(|i| s.column(&s.yf, na - i, &self.c));
        let inputs = (self.nk..self.nk + self.m).map(|l| s.column(&s.uf, most - l, &self.c));
        outputs.chain(inputs).collect()
    }

    /// Solves for A, B and the errors before each stretch on the filtered signals; stores e in the stretches. Returns the factor of the Gram matrix of A's and
    /// B's columns, with the errors before the stretch eliminated, and Σ e².
    fn project(&mut self) -> Option<(Gram, f64)> {
        let (na, nc) = (self.orders.na, self.orders.nc);
        let mut stretches = std::mem::take(&mut self.stretches);
        for s in &mut stretches {
            let target = s.column(&s.yf, na, &self.c);
            s.e[..nc].fill(0.0);
            s.e[nc..].copy_from_slice(&target);
        }
        let solved = self.gram(&stretches).map(|gram| {
            self.linear = DVector::zeros(na + self.m);
            let mut cost = self.step(&mut stretches, &gram);
            if cost < REFINE * self.power {
                cost = self.step(&mut stretches, &gram);
            }
            (gram, cost)
        });
        self.stretches = stretches;
        solved.filter(|(_, cost)| cost.is_finite())
    }

    fn gram(&self, stretches: &[ArmaxStretch<'a>]) -> Option<Gram> {
        let k = self.orders.na + self.m;
        let mut whole = DMatrix::zeros(k, k);
        let mut blocks = Vec::with_capacity(stretches.len());
        for s in stretches {
            let columns = self.columns(s);
            let mut own = squares(&s.before);
            for j in 0..own.nrows() {
                own[(j, j)] += 1.0;
            }
            let own = own.cholesky()?;
            let cross = products(&s.before, &columns);
            whole += squares(&columns) - cross.tr_mul(&own.solve(&cross));
            blocks.push(Block { columns, own, cross });
        }
        Some(Gram { factor: ridged(whole).cholesky()?, blocks })
    }

    /// Subtracts from e its projection on the columns; adds it to the linear coefficients.
    fn step(&mut self, stretches: &mut [ArmaxStretch<'a>], gram: &Gram) -> f64 {
        let nc = self.orders.nc;
        let mut right = DVector::zeros(self.linear.len());
        let mut of_before = Vec::with_capacity(stretches.len());
        for (s, block) in stretches.iter().zip(&gram.blocks) {
            let (past, target) = s.e.split_at(nc);
            // The estimate so far of the errors before the stretch penalises a further increase.
            let before = DVector::from_fn(nc, |j, _| {
                dot(&s.before[j], &target[..s.before[j].len()]) - past[nc - 1 - j]
            });
            let of_columns = DVector::from_fn(right.len(), |i, _| dot(&block.columns[i], target));
            right += of_columns - block.cross.tr_mul(&block.own.solve(&before));
            of_before.push(before);
        }
        let change = gram.factor.solve(&right);
        let mut cost = 0.0;
        for ((s, block), before) in stretches.iter_mut().zip(&gram.blocks).zip(of_before) {
            let own = block.own.solve(&(before - &block.cross * &change));
            let (past, e) = s.e.split_at_mut(nc);
            for (column, weight) in
                block.columns.iter().zip(change.iter()).chain(s.before.iter().zip(own.iter()))
            {
                for (e, x) in e.iter_mut().zip(column) {
                    *e -= weight * x;
                }
            }
            for (past, own) in past.iter_mut().rev().zip(own.iter()) {
                *past += own;
            }
            cost += dot(&s.e, &s.e);
        }
        self.linear += change;
        cost
    }

    /// The loss times rows.
    fn cost(&mut self, c: &[f64]) -> Option<f64> {
        if !is_stable(c) {
            return None;
        }
        self.filter(c);
        let (_, cost) = self.project()?;
        Some(cost * self.determinant(c)?.exp())
    }

    fn evaluate(&mut self, c: &[f64]) -> Option<Normal> {
        if !is_stable(c) {
            return None;
        }
        self.filter(c);
        let (gram, cost) = self.project()?;
        let nc = c.len();
        let (mut gradient, mut information) = (DVector::zeros(nc), DMatrix::zeros(nc, nc));
        let mut cross = DMatrix::zeros(self.linear.len(), nc);
        let mut moved = vec![Vec::new(); nc];
        for (s, block) in self.stretches.iter_mut().zip(&gram.blocks) {
            // de/dcᵢ = −(1/C) e(t − i), with zeros before the stretch.
            for i in 0..nc {
                let mut own = std::mem::take(&mut moved[i]);
                own.resize(s.rows, 0.0);
                match i.checked_sub(1).map(|last| &moved[last]) {
                    None => filter(&s.e[nc - 1..][..s.rows], c, &mut own),
                    // One sample later, plus the effect of the first error.
                    Some(last) => {
                        own[0] = 0.0;
                        own[1..].copy_from_slice(&last[..s.rows - 1]);
                        s.add_impulse(&mut own, 0, s.e[nc - 1 - i]);
                    }
                }
                moved[i] = own;
            }
            let before = products(&s.before, &moved);
            let own = block.own.solve(&before);
            gradient -= DVector::from_fn(nc, |i, _| dot(&moved[i], &s.e[nc..]));
            information += squares(&moved) - before.tr_mul(&own);
            cross += products(&block.columns, &moved) - block.cross.tr_mul(&own);
        }
        information -= cross.tr_mul(&gram.factor.solve(&cross));
        // Residuals times √det^(1/rows): half the slope of ln det each.
        let scale = self.determinant(c)?.exp();
        let mut shifted = c.to_vec();
        let mut slope = DVector::zeros(nc);
        for i in 0..nc {
            let mut at = |by: f64| {
                shifted[i] = c[i] + by;
                self.determinant(&shifted)
            };
            let (up, down) = (at(DIFFERENCE)?, at(-DIFFERENCE)?);
            shifted[i] = c[i];
            slope[i] = 0.5 * (up - down) / (2.0 * DIFFERENCE);
        }
        information += &gradient * slope.transpose()
            + &slope * gradient.transpose()
            + &slope * slope.transpose() * cost;
        gradient += &slope * cost;
        Some(Normal {
            cost: cost * scale,
            gradient: gradient * scale,
            information: information * scale,
        })
    }

    /// The second stage of Hannan and Rissanen: `errors` of a long ARX model, one per row of each stretch, serve as measured.
    fn start_by_errors(&mut self, errors: &[Vec<f64>]) -> Option<Vec<f64>> {
        let nc = self.orders.nc;
        self.filter(&vec![0.0; nc]);
        let k = self.orders.na + self.m + nc;
        let (mut gram, mut right) = (DMatrix::zeros(k, k), DVector::zeros(k));
        for (s, e) in self.stretches.iter().zip(errors) {
            let padded = [vec![0.0; nc], e.clone()].concat();
            let mut columns = self.columns(s);
            columns.extend((1..=nc).map(|i| padded[nc - i..nc - i + s.rows].to_vec()));
            gram += squares(&columns);
            right += DVector::from_fn(k, |i, _| dot(&columns[i], &s.y[self.orders.na..]));
        }
        let solution = ridged(gram).cholesky()?.solve(&right);
        let c: Vec<f64> = solution.iter().skip(k - nc).copied().collect();
        reflected(&c).filter(|c| is_stable(c))
    }

    /// The errors of the ARX model with given coefficients (−a, then b from lag `nk` on). Errors are 0 where a row lacks some of its regressors.
    fn long_errors(&self, na: usize, nk: usize, coefficients: &[f64]) -> Vec<Vec<f64>> {
        let (own, most) = (self.orders.na, self.most);
        let each = |s: &ArmaxStretch<'a>| {
            let error = |t: usize| {
                if own + t < na {
                    return 0.0;
                }
                let past: f64 = (1..=na).map(|i| coefficients[i - 1] * s.y[own + t - i]).sum();
                let inputs: f64 = coefficients
                    .iter()
                    .skip(na)
                    .enumerate()
                    .map(|(j, b)| if nk + j > most { 0.0 } else { b * s.u[most + t - nk - j] })
                    .sum();
                s.y[own + t] - past - inputs
            };
            (0..s.rows).map(error).collect()
        };
        self.stretches.iter().map(each).collect()
    }
}

/// One stretch's columns; the Gram matrix of the errors before it, and its products with the columns.
struct Block {
    columns: Vec<Vec<f64>>,
    own: nalgebra::Cholesky<f64, nalgebra::Dyn>,
    cross: DMatrix<f64>,
}

struct Gram {
    factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
    blocks: Vec<Block>,
}

/// Products of two lists of signals; a shorter signal is zero beyond its end.
fn products(a: &[Vec<f64>], b: &[Vec<f64>]) -> DMatrix<f64> {
    let short = |a: &[f64], b: &[f64]| {
        let rows = a.len().min(b.len());
        dot(&a[..rows], &b[..rows])
    };
    DMatrix::from_fn(a.len(), b.len(), |i, j| short(&a[i], &b[j]))
}

fn squares(a: &[Vec<f64>]) -> DMatrix<f64> {
    let mut gram = DMatrix::zeros(a.len(), a.len());
    for i in 0..a.len() {
        for j in 0..=i {
            gram[(i, j)] = dot(&a[i], &a[j]);
            gram[(j, i)] = gram[(i, j)];
        }
    }
    gram
}

/// Step of the differences of ln det.
const DIFFERENCE: f64 = 1e-6;
/// An impulse response below this value is lost in rounding …
const NOTHING: f64 = 1e-20;
/// … and its squares are negligible against the square of its first value, 1.
const NO_SQUARE: f64 = 1e-10;
/// Rows after which the errors before a stretch have decayed.
const REMEMBERED: usize = 1000;

/// ln det(I + SᵀS), S the effect of the errors before on `rows` of 1/C.
fn ln_determinant(c: &[f64], rows: usize) -> Option<f64> {
    let nc = c.len();
    let mut h = Vec::new();
    impulse_response(c, rows, NO_SQUARE, &mut h);
    let rows = (h.len() + nc).min(rows);
    let before: Vec<Vec<f64>> = (1..=nc)
        .map(|j| {
            let mut column = vec![0.0; rows];
            for k in 0..=nc - j {
                for (v, h) in column.iter_mut().skip(k).zip(&h) {
                    *v += c[k + j - 1] * h;
                }
            }
            column
        })
        .collect();
    let mut gram = squares(&before);
    for j in 0..nc {
        gram[(j, j)] += 1.0;
    }
    let factor = gram.cholesky()?;
    Some(2.0 * factor.l_dirty().diagonal().map(f64::ln).sum())
}

fn ridged(mut gram: DMatrix<f64>) -> DMatrix<f64> {
    for i in 0..gram.nrows() {
        gram[(i, i)] += RIDGE * gram[(i, i)].abs() + f64::MIN_POSITIVE;
    }
    gram
}

/// Past outputs of the long ARX model, which approximates the errors and bounds the losses before C is known.
const LONG: usize = 20;
/// A delay is skipped if its long ARX model is e^−60 as probable as the best: its weight is negligible for any C.
const HOPELESS: f64 = 120.0;

/// Noise polynomials close to most others: roots at one place, from fast to slow.
fn table(nc: usize) -> Vec<Vec<f64>> {
    let binomial = |root: f64| {
        let mut c = vec![1.0];
        for _ in 0..nc.min(2) {
            let mut next = c.clone();
            next.push(0.0);
            for (i, v) in c.iter().enumerate() {
                next[i + 1] -= root * v;
            }
            c = next;
        }
        let mut c = c[1..].to_vec();
        c.resize(nc, 0.0);
        c
    };
    [0.0, 0.6, 0.9, -0.5].into_iter().map(binomial).collect()
}

/// Precomputed data of a scan.
struct ScanKnown<'a> {
    /// The errors of the best long ARX model.
    errors: &'a [Vec<f64>],
    /// Costs of the table's noise polynomials, by delay.
    seeds: Vec<Vec<(f64, Vec<f64>)>>,
    /// Delays that are not searched.
    hopeless: &'a [bool],
    rows: f64,
}

/// Searches from `start` at the problem's delay and number of coefficients, or only evaluates there on request; keeps the better result.
fn improve(
    problem: &mut ArmaxProblem<'_>,
    fits: &mut [Vec<Option<ArmaxFit>>],
    start: &[f64],
    evaluates: bool,
) {
    let place = &mut fits[problem.nk][problem.m - 1];
    let near = |f: &ArmaxFit| f.c.iter().zip(start).all(|(a, b)| (a - b).abs() <= 1e-3);
    if place.as_ref().is_some_and(|f| f.to_gain.is_finite() && near(f)) {
        return;
    }
    let fit = if evaluates { at(problem, start) } else { search(problem, start) };
    let better = |fit: &ArmaxFit, k: &ArmaxFit| {
        fit.loss < k.loss || k.to_gain.is_infinite() && fit.loss <= k.loss
    };
    if let Some(fit) = fit
        && place.as_ref().is_none_or(|k| better(&fit, k))
    {
        *place = Some(fit);
    }
}

impl Armax {
    /// Minimum number of rows of a scan: twice the parameters.
    #[must_use]
    pub fn rows_needed(&self) -> usize {
        2 * (self.na + self.nb + self.nc)
    }

    /// The best models for nk = `first` … `max_delay` with 1 … nb input coefficients; smaller delays have none.
    #[must_use]
    pub fn scan(&self, records: &[Record], first: usize, max_delay: usize) -> ArmaxScan {
        self.scan_until(records, first, max_delay, &Stop::default())
    }

    /// [`Self::scan`] with cancellation; a cancelled scan has no valid result.
    #[must_use]
    pub fn scan_until(
        &self,
        records: &[Record],
        first: usize,
        max_delay: usize,
        stop: &Stop,
    ) -> ArmaxScan {
        let mut problem = ArmaxProblem::new(*self, records, max_delay);
        let delays = max_delay + 1;
        let rows = problem.rows.max(1) as f64;
        let power = problem.power / rows;
        let mut fits: Vec<Vec<Option<ArmaxFit>>> = vec![vec![None; self.nb]; delays];
        if problem.rows < self.rows_needed() {
            return ArmaxScan { fits, without_input: None, power, rows: problem.rows };
        }
        let (long, errors) = self.long(&problem, records, first, max_delay);
        let without_input = self.without_input(&mut problem, &errors);
        let smallest = long.iter().skip(first).copied().fold(f64::INFINITY, f64::min);
        let smallest = smallest.max(1e-20 * power).max(f64::MIN_POSITIVE);
        let hopeless: Vec<bool> = (0..delays)
            .map(|nk| long.get(nk).is_some_and(|v| rows * (v / smallest).ln() > HOPELESS))
            .collect();
        for m in 1..=self.nb {
            problem.m = m;
            let seeds =
                self.seeds(&mut problem, (first..delays).filter(|nk| !hopeless[*nk]), delays);
            let known = ScanKnown { errors: &errors, seeds, hopeless: &hopeless, rows };
            for upwards in [true, false] {
                for step in first..delays {
                    if stop.is_set() {
                        return ArmaxScan { fits, without_input, power, rows: problem.rows };
                    }
                    let nk = if upwards { step } else { max_delay + first - step };
                    problem.nk = nk;
                    let starts = self.starts(&mut problem, &fits, &known, upwards);
                    for start in starts {
                        improve(&mut problem, &mut fits, &start, upwards && hopeless[nk]);
                    }
                }
            }
        }
        ArmaxScan { fits, without_input, power, rows: problem.rows }
    }

    /// Initial noise polynomials at the problem's delay and number of coefficients. Upwards: the best of the table, the neighbour's, and that of one
    /// coefficient less. Downwards: the neighbour's.
    fn starts(
        &self,
        problem: &mut ArmaxProblem<'_>,
        fits: &[Vec<Option<ArmaxFit>>],
        known: &ScanKnown<'_>,
        upwards: bool,
    ) -> Vec<Vec<f64>> {
        let (nk, m) = (problem.nk, problem.m);
        let neighbour = if upwards { nk.checked_sub(1) } else { Some(nk + 1) };
        let neighbour = neighbour.and_then(|n| fits.get(n)?[m - 1].as_ref()).map(|f| f.c.clone());
        let fewer = m.checked_sub(2).and_then(|at| fits[nk][at].as_ref()).map(|f| f.c.clone());
        if known.hopeless[nk] {
            let smallest = fits
                .iter()
                .filter_map(|f| Some(f[m - 1].as_ref()?.loss))
                .fold(f64::INFINITY, f64::min);
            let near = |f: &ArmaxFit| {
                known.rows * (f.loss / smallest.max(f64::MIN_POSITIVE)).ln() <= HOPELESS
            };
            // The downward pass also searches delays that the long model wrongly excluded.
            return match &fits[nk][m - 1] {
                Some(fit) if !upwards && near(fit) => {
                    let seeds = self.seeds(problem, std::iter::once(nk), fits.len());
                    problem.nk = nk;
                    let own = self.best_seed(problem, known.errors, &seeds[nk]);
                    own.into_iter().chain(neighbour).collect()
                }
                _ if upwards => vec![vec![0.0; self.nc]],
                _ => Vec::new(),
            };
        }
        if upwards {
            let own = self.best_seed(problem, known.errors, &known.seeds[nk]);
            own.into_iter().chain(neighbour).chain(fewer).collect()
        } else {
            neighbour.into_iter().collect()
        }
    }

    /// The losses of a long ARX model for every delay, and the errors of the best of them.
    fn long(
        &self,
        problem: &ArmaxProblem<'_>,
        records: &[Record],
        first: usize,
        max_delay: usize,
    ) -> (Vec<f64>, Vec<Vec<f64>>) {
        let na = LONG.min(problem.rows / 10).max(self.na);
        let scan = arx_scan(records, na, self.nb, max_delay);
        let best = (first..scan.loss.len())
            .filter(|&nk| scan.loss[nk].is_finite())
            .min_by(|&a, &b| scan.loss[a].total_cmp(&scan.loss[b]));
        // Too few rows for the long model: no bound, no errors.
        match best.filter(|_| scan.rows > 2 * (na + self.nb)) {
            Some(nk) => {
                let errors = problem.long_errors(na, nk, &scan.coefficients[nk]);
                (scan.loss, errors)
            }
            None => (Vec::new(), Vec::new()),
        }
    }

    fn without_input(
        &self,
        problem: &mut ArmaxProblem<'_>,
        errors: &[Vec<f64>],
    ) -> Option<ArmaxFit> {
        (problem.nk, problem.m) = (0, 0);
        let starts = table(self.nc).into_iter().chain(problem.start_by_errors(errors));
        let fits: Vec<ArmaxFit> = starts.filter_map(|c| search(problem, &c)).collect();
        fits.into_iter().min_by(|a, b| a.loss.total_cmp(&b.loss))
    }

    /// The costs of the table's noise polynomials at all `delays`: each filters the signals once for all delays.
    fn seeds(
        &self,
        problem: &mut ArmaxProblem<'_>,
        wanted: impl Iterator<Item = usize>,
        delays: usize,
    ) -> Vec<Vec<(f64, Vec<f64>)>> {
        let wanted: Vec<usize> = wanted.collect();
        let mut seeds = vec![Vec::new(); delays];
        for c in table(self.nc).into_iter().filter(|c| is_stable(c)) {
            problem.filter(&c);
            let Some(determinant) = problem.determinant(&c) else { continue };
            for &nk in &wanted {
                problem.nk = nk;
                if let (Some((_, cost)), Some(seeds)) = (problem.project(), seeds.get_mut(nk)) {
                    seeds.push((cost * determinant.exp(), c.clone()));
                }
            }
        }
        seeds
    }

    /// The best of the starts that are independent of other fits.
    fn best_seed(
        &self,
        problem: &mut ArmaxProblem<'_>,
        errors: &[Vec<f64>],
        seeds: &[(f64, Vec<f64>)],
    ) -> Option<Vec<f64>> {
        let own = problem.start_by_errors(errors).and_then(|c| Some((problem.cost(&c)?, c)));
        seeds.iter().cloned().chain(own).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, c)| c)
    }

    /// The prediction errors of a fitted model and the inputs at the same rows, stretch by stretch; empty where the model cannot be evaluated.
    #[must_use]
    pub fn residuals(
        &self,
        records: &[Record],
        max_delay: usize,
        nk: usize,
        fit: &ArmaxFit,
    ) -> Vec<(Vec<f64>, Vec<f64>)> {
        let mut problem = ArmaxProblem::new(*self, records, max_delay);
        (problem.nk, problem.m) = (nk, fit.b.len());
        if problem.cost(&fit.c).is_none() {
            return Vec::new();
        }
        let most = problem.most;
        problem
            .stretches
            .into_iter()
            .map(|s| (s.e[self.nc..].to_vec(), s.u[most..].to_vec()))
            .collect()
    }
}

fn at(problem: &mut ArmaxProblem<'_>, c: &[f64]) -> Option<ArmaxFit> {
    let cost = problem.cost(c)?;
    Some(problem.fit(cost, c.to_vec(), Stopped::Iterations, f64::INFINITY))
}

fn search(problem: &mut ArmaxProblem<'_>, start: &[f64]) -> Option<ArmaxFit> {
    let method = LevenbergMarquardt {
        max_iterations: 100,
        gradient_tolerance: 1e-5,
        step_tolerance: 1e-5,
        cost_floor: 1e-26 * problem.power,
        ..LevenbergMarquardt::default()
    };
    let fit = method.minimise(start, |c| problem.evaluate(c));
    let cost = problem.cost(&fit.parameters)?;
    let Normal { gradient, information, .. } = fit.normal;
    let step = ridged(information).cholesky().map(|c| c.solve(&gradient));
    let to_gain = step.map_or(f64::INFINITY, |s| {
        problem.rows as f64 * s.dot(&gradient) / cost.max(f64::MIN_POSITIVE)
    });
    Some(problem.fit(cost, fit.parameters, fit.stopped, to_gain))
}

impl ArmaxProblem<'_> {
    fn fit(&self, cost: f64, c: Vec<f64>, stopped: Stopped, to_gain: f64) -> ArmaxFit {
        let na = self.orders.na;
        let rows = self.rows.max(1) as f64;
        ArmaxFit {
            loss: cost / rows,
            a: self.linear.iter().take(na).map(|v| -v).collect(),
            b: self.linear.iter().skip(na).copied().collect(),
            c,
            stopped,
            to_gain,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(samples: usize, gaps: &[usize]) -> Record<'static> {
        let mut state = 7_u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let u: Vec<f64> = (0..samples).map(|_| next()).collect();
        let e: Vec<f64> = (0..samples).map(|_| next()).collect();
        let mut y = vec![0.0; samples];
        for t in 0..samples {
            let past = |x: &[f64], lag: usize| if t >= lag { x[t - lag] } else { 0.0 };
            y[t] = 1.2 * past(&y, 1) - 0.4 * past(&y, 2) + 0.5 * past(&u, 3) + e[t]
                - 0.7 * past(&e, 1);
        }
        let present =
            (!gaps.is_empty()).then(|| (0..samples).map(|t| !gaps.contains(&t)).collect());
        Record { present, ..Record::new(u, y) }
    }

    /// The oracle: generalised least squares with the explicit covariance matrix.
    fn direct(
        record: &Record,
        stretches: &[(usize, usize)],
        (na, nk, m): (usize, usize, usize),
        c: &[f64],
    ) -> f64 {
        let nc = c.len();
        let rows: usize = stretches.iter().map(|(from, to)| to - from).sum();
        let (mut x, mut y) = (DMatrix::zeros(rows, na + m), DVector::zeros(rows));
        let mut covariance = DMatrix::zeros(rows, rows);
        let mut at = 0;
        for &(from, to) in stretches {
            let n = to - from;
            let mut moving = DMatrix::<f64>::zeros(n, n + nc);
            for t in 0..n {
                moving[(t, t + nc)] = 1.0;
                for i in 1..=nc {
                    moving[(t, t + nc - i)] = c[i - 1];
                }
                y[at + t] = record.y[from + t];
                for i in 1..=na {
                    x[(at + t, i - 1)] = record.y[from + t - i];
                }
                for j in 0..m {
                    x[(at + t, na + j)] = record.u[from + t - nk - j];
                }
            }
            covariance.view_mut((at, at), (n, n)).copy_from(&(&moving * moving.transpose()));
            at += n;
        }
        let factor = covariance.cholesky().unwrap();
        let ln_det = 2.0 * factor.l().diagonal().map(f64::ln).sum();
        let solve = |b: &DMatrix<f64>| factor.l().solve_lower_triangular(b).unwrap();
        let (xw, yw) = (solve(&x), solve(&DMatrix::from_column_slice(rows, 1, y.as_slice())));
        let theta = (xw.transpose() * &xw).cholesky().unwrap().solve(&(xw.transpose() * &yw));
        (yw - xw * theta).norm_squared() * (ln_det / rows as f64).exp()
    }

    #[test]
    fn the_loss_is_that_of_generalised_least_squares() {
        let record = record(160, &[40, 41, 90]);
        let orders = Armax { na: 2, nb: 2, nc: 2 };
        let records = [record.clone()];
        let mut problem = ArmaxProblem::new(orders, &records, 6);
        for (nk, m, c) in
            [(0, 2, [-0.5, 0.3]), (6, 1, [-1.9, 0.9999]), (3, 2, [0.0, 0.0]), (2, 2, [1.2, 0.9])]
        {
            (problem.nk, problem.m) = (nk, m);
            let expected = direct(&record, &[(7, 40), (44, 90), (93, 160)], (2, nk, m), &c);
            let got = problem.cost(&c).unwrap();
            assert!((got / expected - 1.0).abs() < 1e-8, "{nk} {m} {c:?}: {got} {expected}");
        }
    }

    #[test]
    fn the_gradient_is_the_derivative_of_the_cost() {
        let records = [record(90, &[]), record(60, &[30])];
        let mut problem = ArmaxProblem::new(Armax { na: 2, nb: 1, nc: 2 }, &records, 5);
        problem.nk = 3;
        for c in [[-0.5, 0.3], [-1.5, 0.7]] {
            let normal = problem.evaluate(&c).unwrap();
            for i in 0..2 {
                let mut at = |by: f64| {
                    let mut shifted = c;
                    shifted[i] += by;
                    problem.cost(&shifted).unwrap()
                };
                let numeric = (at(1e-6) - at(-1e-6)) / 4e-6;
                assert!(
                    (normal.gradient[i] - numeric).abs() < 1e-5 * numeric.abs().max(1.0),
                    "{} {numeric}",
                    normal.gradient[i]
                );
            }
        }
    }

    #[test]
    fn a_scan_finds_the_polynomials_that_made_the_record() {
        let records = [record(20_000, &[])];
        let scan = Armax { na: 2, nb: 1, nc: 1 }.scan(&records, 0, 8);
        let best = (0..9)
            .min_by(|&a, &b| {
                scan.fits[a][0]
                    .as_ref()
                    .unwrap()
                    .loss
                    .total_cmp(&scan.fits[b][0].as_ref().unwrap().loss)
            })
            .unwrap();
        let fit = scan.fits[best][0].as_ref().unwrap();
        assert_eq!(best, 3);
        for (got, want) in fit.a.iter().chain(&fit.b).chain(&fit.c).zip([-1.2, 0.4, 0.5, -0.7]) {
            assert!((got - want).abs() < 0.03, "{fit:?}");
        }
    }
}
