//! ARMAX models A(q) y = B(q) u(t − nk) + C(q) e, fitted for many delays by their one-step-ahead prediction errors.

use nalgebra::{DMatrix, DVector};

use super::arx::scan as arx_scan;
use super::oe::{filter, is_stable};
use super::polynomial::reflected;
use super::regression::{Record, dot};
use crate::fit::{LevenbergMarquardt, Normal, Stopped};

/// Orders of an ARMAX model.
///
/// The predictor e = (A y − B u)/C is kept stable; A may have its roots anywhere. A, B and the predictor's start in every stretch without a missing output enter
/// linearly and are eliminated (variable projection, Kaufman's Jacobian), so only C is searched.
/// Starts: C = 1, the second stage of Hannan and Rissanen, a table of slow and fast roots, and the solutions of the neighbouring delays, upwards and downwards.
///
/// Source: Ljung (1999), "System Identification", 2nd ed., sections 4.2, 7.2 and 10.2; Golub and Pereyra (2003), doi:10.1088/0266-5611/19/2/201;
/// Hannan and Rissanen (1982), Biometrika 69(1), 81-94, doi:10.1093/biomet/69.1.81.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Armax {
    /// Past outputs.
    pub na: usize,
    /// Most input coefficients.
    pub nb: usize,
    /// Past errors.
    pub nc: usize,
}

/// An ARMAX model of one delay and one number of input coefficients.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmaxFit {
    /// Σ e²/rows.
    pub loss: f64,
    /// a₁ … a_na, of A = 1 + a₁q⁻¹ + …
    pub a: Vec<f64>,
    /// b₀ …
    pub b: Vec<f64>,
    /// c₁ … c_nc, of C = 1 + c₁q⁻¹ + …
    pub c: Vec<f64>,
    /// Why the search stopped.
    pub stopped: Stopped,
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

/// A stretch of rows t = first … whose past outputs and inputs are all there.
struct Stretch<'a> {
    rows: usize,
    /// y(first − na) … and u(first − most) …
    y: &'a [f64],
    u: &'a [f64],
    yf: Vec<f64>,
    uf: Vec<f64>,
    /// nc zeros and the impulse response of 1/C.
    start: Vec<f64>,
    /// e, and nc zeros and e/C.
    e: Vec<f64>,
    ef: Vec<f64>,
}

struct Problem<'a> {
    orders: Armax,
    /// The largest input lag of any delay.
    most: usize,
    stretches: Vec<Stretch<'a>>,
    /// First input lag and number of input coefficients of the model at hand.
    nk: usize,
    m: usize,
    /// Σ y².
    power: f64,
    rows: usize,
    /// −a, then b, of the last evaluation.
    linear: DVector<f64>,
}

/// A relative ridge of rounding size, so that columns that repeat others need no rank decision: their sum is what matters.
const RIDGE: f64 = 1e-13;
/// Below this share of the signal's power the residual is computed again from what is left: the first solution's rounding is larger.
const REFINE: f64 = 1e-9;

impl<'a> Problem<'a> {
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
                // A stretch must say more than it asks for.
                if t > first + nc {
                    let (rows, y, u) = (t - first, &record.y[first - na..t], &record.u[first - most..t]);
                    total += rows;
                    power += dot(&y[na..], &y[na..]);
                    stretches.push(Stretch {
                        rows,
                        y,
                        u,
                        yf: vec![0.0; y.len()],
                        uf: vec![0.0; u.len()],
                        start: vec![0.0; nc + rows],
                        e: vec![0.0; rows],
                        ef: vec![0.0; nc + rows],
                    });
                }
                from = t + 1;
            }
        }
        Self { orders, most, stretches, nk: 0, m: nb, power, rows: total, linear: DVector::zeros(0) }
    }

    /// Rows that are left for A, B and C when every stretch has taken its start.
    fn freedom(&self) -> usize {
        self.rows - self.orders.nc * self.stretches.len()
    }

    fn filter(&mut self, c: &[f64]) {
        for s in &mut self.stretches {
            filter(s.y, c, &mut s.yf);
            filter(s.u, c, &mut s.uf);
            s.e.fill(0.0);
            if let Some(first) = s.e.first_mut() {
                *first = 1.0;
            }
            filter(&s.e, c, &mut s.start[c.len()..]);
        }
    }

    /// Past outputs, then inputs, of the model at hand.
    fn columns<'s>(&'s self, s: &'s Stretch<'a>) -> Vec<&'s [f64]> {
        let (na, most) = (self.orders.na, self.most);
        let outputs = (1..=na).map(|i| &s.yf[na - i..na - i + s.rows]);
        let inputs = (self.nk..self.nk + self.m).map(|l| &s.uf[most - l..most - l + s.rows]);
        outputs.chain(inputs).collect()
    }

    fn starts<'s>(&'s self, s: &'s Stretch<'a>) -> Vec<&'s [f64]> {
        let nc = self.orders.nc;
        (0..nc).map(|i| &s.start[nc - i..nc - i + s.rows]).collect()
    }

    /// Solves for A, B and the starts with the signals filtered; leaves e in the stretches. The factor of the Gram matrix of A's and B's columns, the starts'
    /// share taken out, and Σ e².
    fn project(&mut self) -> Option<(Gram, f64)> {
        let k = self.orders.na + self.m;
        let na = self.orders.na;
        let mut stretches = std::mem::take(&mut self.stretches);
        for s in &mut stretches {
            s.e.copy_from_slice(&s.yf[na..]);
        }
        let gram = self.gram(&stretches);
        let mut solved = None;
        if let Some(gram) = gram {
            self.linear = DVector::zeros(k);
            let mut cost = self.step(&mut stretches, &gram);
            if cost < REFINE * self.power {
                cost = self.step(&mut stretches, &gram);
            }
            solved = Some((gram, cost));
        }
        self.stretches = stretches;
        solved.filter(|(_, cost)| cost.is_finite())
    }

    fn gram(&self, stretches: &[Stretch<'a>]) -> Option<Gram> {
        let k = self.orders.na + self.m;
        let mut whole = DMatrix::zeros(k, k);
        let mut blocks = Vec::with_capacity(stretches.len());
        for s in stretches {
            let (columns, starts) = (self.columns(s), self.starts(s));
            whole += products(&columns, &columns);
            let own = ridged(products(&starts, &starts)).cholesky()?;
            let cross = products(&starts, &columns);
            whole -= cross.tr_mul(&own.solve(&cross));
            blocks.push(Block { own, cross });
        }
        Some(Gram { factor: ridged(whole).cholesky()?, blocks })
    }

    /// Takes off e what the columns explain of it; adds to the linear coefficients.
    fn step(&mut self, stretches: &mut [Stretch<'a>], gram: &Gram) -> f64 {
        let k = self.linear.len();
        let mut right = DVector::zeros(k);
        let mut of_starts = Vec::with_capacity(stretches.len());
        for (s, block) in stretches.iter().zip(&gram.blocks) {
            let target = [s.e.as_slice()];
            let start = products(&self.starts(s), &target);
            right += products(&self.columns(s), &target).column(0) - block.cross.tr_mul(&block.own.solve(&start)).column(0);
            of_starts.push(start);
        }
        let change = gram.factor.solve(&right);
        let mut cost = 0.0;
        for ((s, block), start) in stretches.iter_mut().zip(&gram.blocks).zip(of_starts) {
            let own = block.own.solve(&(start - &block.cross * &change));
            let mut e = std::mem::take(&mut s.e);
            for (column, weight) in self.columns(s).into_iter().zip(change.iter()).chain(self.starts(s).into_iter().zip(own.iter())) {
                for (e, x) in e.iter_mut().zip(column) {
                    *e -= weight * x;
                }
            }
            cost += dot(&e, &e);
            s.e = e;
        }
        self.linear += change;
        cost
    }

    fn cost(&mut self, c: &[f64]) -> Option<f64> {
        if !is_stable(c) {
            return None;
        }
        self.filter(c);
        self.project().map(|(_, cost)| cost)
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
        let mut stretches = std::mem::take(&mut self.stretches);
        for (s, block) in stretches.iter_mut().zip(&gram.blocks) {
            filter(&s.e, c, &mut s.ef[nc..]);
            let s = &*s;
            // de/dcᵢ = −(e/C)(t − i).
            let moved: Vec<&[f64]> = (1..=nc).map(|i| &s.ef[nc - i..nc - i + s.rows]).collect();
            let start = products(&self.starts(s), &moved);
            let own = block.own.solve(&start);
            gradient -= products(&moved, &[&s.e]).column(0);
            information += products(&moved, &moved) - start.tr_mul(&own);
            cross += products(&self.columns(s), &moved) - block.cross.tr_mul(&own);
        }
        self.stretches = stretches;
        information -= cross.tr_mul(&gram.factor.solve(&cross));
        Some(Normal { cost, gradient, information })
    }

    /// The second stage of Hannan and Rissanen: `errors` of a long ARX model, one per row of each stretch, as if they were measured.
    fn from_errors(&mut self, errors: &[Vec<f64>]) -> Option<Vec<f64>> {
        let nc = self.orders.nc;
        self.filter(&vec![0.0; nc]);
        let k = self.orders.na + self.m + nc;
        let (mut gram, mut right) = (DMatrix::zeros(k, k), DVector::zeros(k));
        for (s, e) in self.stretches.iter().zip(errors) {
            let padded = [vec![0.0; nc], e.clone()].concat();
            let mut columns = self.columns(s);
            columns.extend((1..=nc).map(|i| &padded[nc - i..nc - i + s.rows]));
            gram += products(&columns, &columns);
            right += products(&columns, &[&s.yf[self.orders.na..]]).column(0);
        }
        let solution = ridged(gram).cholesky()?.solve(&right);
        let c: Vec<f64> = solution.iter().skip(k - nc).copied().collect();
        reflected(&c).filter(|c| is_stable(c))
    }

    /// The errors of the ARX model whose coefficients (−a, then b from lag `nk` on) are given, 0 where a row does not see all of them.
    fn long_errors(&self, na: usize, nk: usize, coefficients: &[f64]) -> Vec<Vec<f64>> {
        let (own, most) = (self.orders.na, self.most);
        let each = |s: &Stretch<'a>| {
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

/// One stretch's start columns with themselves, and with the others.
struct Block {
    own: nalgebra::Cholesky<f64, nalgebra::Dyn>,
    cross: DMatrix<f64>,
}

struct Gram {
    factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
    blocks: Vec<Block>,
}

fn products(a: &[&[f64]], b: &[&[f64]]) -> DMatrix<f64> {
    DMatrix::from_fn(a.len(), b.len(), |i, j| dot(a[i], b[j]))
}

fn ridged(mut gram: DMatrix<f64>) -> DMatrix<f64> {
    for i in 0..gram.nrows() {
        gram[(i, i)] += RIDGE * gram[(i, i)].abs() + f64::MIN_POSITIVE;
    }
    gram
}

/// Past outputs of the long ARX model that stands for the errors, and for a bound of the losses, before C is known.
const LONG: usize = 20;
/// A delay whose long ARX model is e^−60 as probable as the best is not searched further: its weight is nothing, whatever C.
const HOPELESS: f64 = 120.0;

/// Noise polynomials that between them are near most: roots at one place, from fast to slow.
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

impl Armax {
    /// Least rows of a scan: twice the parameters.
    #[must_use]
    pub fn rows_needed(&self) -> usize {
        2 * (self.na + self.nb + 2 * self.nc)
    }

    /// The best models for nk = 0 … `max_delay` with 1 … nb input coefficients.
    #[must_use]
    pub fn scan(&self, records: &[Record], max_delay: usize) -> ArmaxScan {
        let mut problem = Problem::new(*self, records, max_delay);
        let delays = max_delay + 1;
        #[allow(clippy::cast_precision_loss)]
        let rows = problem.rows.max(1) as f64;
        let power = problem.power / rows;
        let mut fits: Vec<Vec<Option<ArmaxFit>>> = vec![vec![None; self.nb]; delays];
        if problem.rows < self.rows_needed() || problem.freedom() <= self.na + self.nb + self.nc {
            return ArmaxScan { fits, without_input: None, power, rows: problem.freedom() };
        }
        let (long, errors) = self.long(&problem, records, max_delay);
        let without_input = self.without_input(&mut problem, &errors);
        let hopeless = {
            let smallest = long.iter().copied().fold(f64::INFINITY, f64::min).max(1e-20 * power).max(f64::MIN_POSITIVE);
            move |nk: usize| long.get(nk).is_some_and(|v| rows * (v / smallest).ln() > HOPELESS)
        };
        for m in 1..=self.nb {
            problem.m = m;
            for upwards in [true, false] {
                for step in 0..delays {
                    let nk = if upwards { step } else { max_delay - step };
                    problem.nk = nk;
                    let neighbour = if upwards { nk.checked_sub(1) } else { Some(nk + 1) };
                    let neighbour = neighbour.and_then(|n| fits.get(n)?[m - 1].as_ref()).map(|f| f.c.clone());
                    let fewer = m.checked_sub(2).and_then(|at| fits[nk][at].as_ref()).map(|f| f.c.clone());
                    let starts: Vec<Vec<f64>> = if hopeless(nk) {
                        if upwards { vec![vec![0.0; self.nc]] } else { Vec::new() }
                    } else if upwards {
                        let own = self.best_seed(&mut problem, &errors);
                        own.into_iter().chain(neighbour).chain(fewer).collect()
                    } else {
                        neighbour.into_iter().collect()
                    };
                    for start in starts {
                        let known = fits[nk][m - 1].as_ref();
                        if known.is_some_and(|f| f.c.iter().zip(&start).all(|(a, b)| (a - b).abs() <= 1e-3)) {
                            continue;
                        }
                        let fit = if hopeless(nk) { at(&mut problem, &start) } else { search(&mut problem, &start) };
                        if let Some(fit) = fit
                            && known.is_none_or(|k| fit.loss < k.loss)
                        {
                            fits[nk][m - 1] = Some(fit);
                        }
                    }
                }
            }
        }
        ArmaxScan { fits, without_input, power, rows: problem.freedom() }
    }

    /// The losses of a long ARX model for every delay, and the errors of the best of them.
    fn long(&self, problem: &Problem<'_>, records: &[Record], max_delay: usize) -> (Vec<f64>, Vec<Vec<f64>>) {
        let na = LONG.min(problem.rows / 10).max(self.na);
        let scan = arx_scan(records, na, self.nb, max_delay);
        let best = (0..scan.loss.len()).filter(|&nk| scan.loss[nk].is_finite()).min_by(|&a, &b| scan.loss[a].total_cmp(&scan.loss[b]));
        // Too few rows for the long model: no bound, no errors.
        match best.filter(|_| scan.rows > 2 * (na + self.nb)) {
            Some(nk) => {
                let errors = problem.long_errors(na, nk, &scan.coefficients[nk]);
                (scan.loss, errors)
            }
            None => (Vec::new(), Vec::new()),
        }
    }

    fn without_input(&self, problem: &mut Problem<'_>, errors: &[Vec<f64>]) -> Option<ArmaxFit> {
        (problem.nk, problem.m) = (0, 0);
        let starts = table(self.nc).into_iter().chain(problem.from_errors(errors));
        let fits: Vec<ArmaxFit> = starts.filter_map(|c| search(problem, &c)).collect();
        fits.into_iter().min_by(|a, b| a.loss.total_cmp(&b.loss))
    }

    /// The best of the starts that need no other fit.
    fn best_seed(&self, problem: &mut Problem<'_>, errors: &[Vec<f64>]) -> Option<Vec<f64>> {
        let starts = table(self.nc).into_iter().chain(problem.from_errors(errors));
        let ranked: Vec<(f64, Vec<f64>)> = starts.filter_map(|c| Some((problem.cost(&c)?, c))).collect();
        ranked.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, c)| c)
    }

    /// The prediction errors of a fitted model and the inputs at the same rows, stretch after stretch; nothing where it cannot be evaluated.
    #[must_use]
    pub fn residuals(&self, records: &[Record], max_delay: usize, nk: usize, fit: &ArmaxFit) -> Vec<(Vec<f64>, Vec<f64>)> {
        let mut problem = Problem::new(*self, records, max_delay);
        (problem.nk, problem.m) = (nk, fit.b.len());
        if problem.cost(&fit.c).is_none() {
            return Vec::new();
        }
        let most = problem.most;
        problem.stretches.into_iter().map(|s| (s.e, s.u[most..].to_vec())).collect()
    }
}

fn at(problem: &mut Problem<'_>, c: &[f64]) -> Option<ArmaxFit> {
    let cost = problem.cost(c)?;
    Some(problem.fit(cost, c.to_vec(), Stopped::Iterations))
}

fn search(problem: &mut Problem<'_>, start: &[f64]) -> Option<ArmaxFit> {
    let method = LevenbergMarquardt {
        max_iterations: 40,
        gradient_tolerance: 1e-5,
        step_tolerance: 1e-5,
        cost_floor: 1e-26 * problem.power,
        ..LevenbergMarquardt::default()
    };
    let fit = method.minimise(start, |c| problem.evaluate(c));
    let cost = problem.cost(&fit.parameters)?;
    Some(problem.fit(cost, fit.parameters, fit.stopped))
}

impl Problem<'_> {
    fn fit(&self, cost: f64, c: Vec<f64>, stopped: Stopped) -> ArmaxFit {
        let na = self.orders.na;
        #[allow(clippy::cast_precision_loss)]
        let rows = self.freedom().max(1) as f64;
        ArmaxFit {
            loss: cost / rows,
            a: self.linear.iter().take(na).map(|v| -v).collect(),
            b: self.linear.iter().skip(na).copied().collect(),
            c,
            stopped,
        }
    }
}
