//! Output-error models y = B(q)/F(q) u(t − nk) + e, fitted for many delays at once.

use nalgebra::{DMatrix, DVector};
use pulp::{Arch, Simd, WithSimd};

use super::lag_products::lag_vector;
use super::regression::{Record, dot};
use crate::fit::{Fit, LevenbergMarquardt, Normal, Stopped, polish};

/// What is assumed about the model's state when a record starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Initial {
    /// At rest.
    #[default]
    Zero,
    /// Unknown: nf more parameters per record, estimated with the rest.
    Estimated,
}

/// Orders and start of an output-error model.
///
/// The predictor is kept stable. B (and the start) enter linearly and are eliminated (variable projection, Kaufman's Jacobian), so only F is searched.
/// Starts for each delay: a fixed table of pole positions, Steiglitz-McBride, and the neighbouring delays' solutions, upwards and downwards.
///
/// Source: Ljung (1999), "System Identification", 2nd ed., sections 4.2 and 10.2; Golub and Pereyra (2003), doi:10.1088/0266-5611/19/2/201;
/// Steiglitz and McBride (1965), doi:10.1109/TAC.1965.1098181.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputError {
    /// Numerator coefficients.
    pub nb: usize,
    /// Poles.
    pub nf: usize,
    /// The state at the start of a record.
    pub initial: Initial,
}

/// An output-error model of one delay.
#[derive(Debug, Clone, PartialEq)]
pub struct OeFit {
    /// Σ e²/samples.
    pub loss: f64,
    /// b₀ … b_nb−1.
    pub b: Vec<f64>,
    /// f₁ … f_nf, of F = 1 + f₁q⁻¹ + …
    pub f: Vec<f64>,
    /// Why the search stopped, at the best of its starts.
    pub stopped: Stopped,
}

/// F(q) has all roots well inside the unit circle (Schur-Cohn recursion).
pub(super) fn is_stable(f: &[f64]) -> bool {
    let mut a = [0.0; MAX_ORDER];
    let mut n = f.len();
    a[..n].copy_from_slice(f);
    while n > 0 {
        let k = a[n - 1];
        if k.is_nan() || k.abs() >= 1.0 - 1e-9 {
            return false;
        }
        let scale = 1.0 / (1.0 - k * k);
        let previous = a;
        for i in 0..n - 1 {
            a[i] = (previous[i] - k * previous[n - 2 - i]) * scale;
        }
        n -= 1;
    }
    true
}

/// Largest nf.
pub const MAX_ORDER: usize = 16;

/// out = x/F with zero initial state.
pub(super) fn filter(x: &[f64], f: &[f64], out: &mut [f64]) {
    if let &[f1, f2] = f {
        let (mut y1, mut y2) = (0.0, 0.0);
        for (o, &v) in out.iter_mut().zip(x) {
            let y = (v - f2 * y2) - f1 * y1;
            (y2, y1) = (y1, y);
            *o = y;
        }
        return;
    }
    for t in 0..x.len() {
        let past: f64 = f.iter().enumerate().filter(|(i, _)| *i < t).map(|(i, c)| c * out[t - 1 - i]).sum();
        out[t] = x[t] - past;
    }
}

/// Σ a(t − i)·b(t − j) over a record, signals being zero before it.
fn lagged(a: &[f64], b: &[f64], i: usize, j: usize) -> f64 {
    let n = a.len();
    let lag = i.max(j);
    if lag >= n { 0.0 } else { dot(&a[lag - i..n - i], &b[lag - j..n - j]) }
}

/// Work space for one record.
struct Work<'a> {
    u: &'a [f64],
    y: &'a [f64],
    /// 1 where the output was measured, 0 elsewhere; `None`: all.
    weight: Option<Vec<f64>>,
    uf: Vec<f64>,
    model: Vec<f64>,
    wf: Vec<f64>,
    impulse: Vec<f64>,
    residual: Vec<f64>,
}

struct Problem<'a> {
    orders: OutputError,
    nk: usize,
    records: Vec<Work<'a>>,
    /// Linear coefficients of the last evaluation: b, then the starts record by record.
    linear: DVector<f64>,
    /// Σ y².
    power: f64,
    arch: Arch,
}

impl<'a> Problem<'a> {
    fn new(orders: OutputError, records: &'a [Record]) -> Self {
        let work = |r: &'a Record| {
            let n = r.len();
            Work {
                u: &r.u[..n],
                y: &r.y[..n],
                weight: r.present.as_ref().map(|p| p.iter().map(|&p| f64::from(u8::from(p))).collect()),
                uf: vec![0.0; n],
                model: vec![0.0; n],
                wf: vec![0.0; n],
                impulse: vec![0.0; n],
                residual: vec![0.0; n],
            }
        };
        let power = records.iter().map(|r| dot(&r.y, &r.y)).sum();
        Self { orders, nk: 0, records: records.iter().map(work).collect(), linear: DVector::zeros(0), power, arch: Arch::new() }
    }

    fn linear_count(&self) -> usize {
        let starts = match self.orders.initial {
            Initial::Zero => 0,
            Initial::Estimated => self.orders.nf * self.records.len(),
        };
        self.orders.nb + starts
    }

    /// Columns of the linear part in record `at`: (column number, signal, shift).
    fn columns(&self, at: usize) -> impl Iterator<Item = (usize, &[f64], usize)> {
        let work = &self.records[at];
        let (nb, nf, nk) = (self.orders.nb, self.orders.nf, self.nk);
        let inputs = (0..nb).map(move |j| (j, work.uf.as_slice(), nk + j));
        let starts = if self.orders.initial == Initial::Estimated { nf } else { 0 };
        inputs.chain((0..starts).map(move |i| (nb + at * nf + i, work.impulse.as_slice(), i)))
    }

    /// Filters input and impulse by 1/F.
    fn filter(&mut self, f: &[f64]) {
        let estimated = self.orders.initial == Initial::Estimated;
        for work in &mut self.records {
            filter(work.u, f, &mut work.uf);
            if estimated {
                work.impulse.fill(0.0);
                if let Some(first) = work.impulse.first_mut() {
                    *first = 1.0;
                }
                let unit = work.impulse.clone();
                filter(&unit, f, &mut work.impulse);
            }
        }
    }

    /// Solves the linear part for filtered signals, leaves model and residual in the work space and returns the loss (Σ e²).
    fn project(&mut self) -> Option<(DMatrix<f64>, f64)> {
        let k = self.linear_count();
        let (mut gram, mut right) = (DMatrix::<f64>::zeros(k, k), DVector::<f64>::zeros(k));
        for at in 0..self.records.len() {
            let work = &self.records[at];
            let columns: Vec<_> = self.columns(at).collect();
            for (n, &(i, a, shift)) in columns.iter().enumerate() {
                right[i] += match &work.weight {
                    None => lagged(a, work.y, shift, 0),
                    Some(w) => weighted(a, work.y, shift, 0, w),
                };
                for &(j, b, other) in &columns[n..] {
                    let value = match &work.weight {
                        None => lagged(a, b, shift, other),
                        Some(w) => weighted(a, b, shift, other, w),
                    };
                    gram[(i, j)] += value;
                    if i != j {
                        gram[(j, i)] += value;
                    }
                }
            }
        }
        // A relative ridge of rounding size: starts and inputs may coincide (an impulse at the first sample), their sum is what matters.
        let mut ridged = gram.clone();
        for i in 0..k {
            ridged[(i, i)] += 1e-13 * gram[(i, i)] + f64::MIN_POSITIVE;
        }
        let factor = ridged.cholesky()?;
        self.linear = factor.solve(&right);
        let linear = self.linear.clone();
        let mut cost = 0.0;
        for at in 0..self.records.len() {
            let mut model = std::mem::take(&mut self.records[at].model);
            model.fill(0.0);
            for (i, signal, shift) in self.columns(at) {
                let c = linear[i];
                let n = model.len();
                if shift < n {
                    for (m, s) in model[shift..].iter_mut().zip(&signal[..n - shift]) {
                        *m += c * s;
                    }
                }
            }
            let work = &mut self.records[at];
            work.model = model;
            for (((r, y), m), t) in work.residual.iter_mut().zip(work.y).zip(&work.model).zip(0..) {
                let w = work.weight.as_ref().map_or(1.0, |w| w[t]);
                *r = w * (y - m);
            }
            cost += dot(&work.residual, &work.residual);
        }
        Some((factor.inverse(), cost))
    }

    /// The losses of all delays for filtered signals out of one correlation, good enough to rank starts; `None` but for one numerator coefficient, a start at
    /// rest and no sample missing.
    fn quick_costs(&self, max_delay: usize) -> Option<Vec<f64>> {
        if self.orders.nb != 1 || self.orders.initial != Initial::Zero || self.records.iter().any(|r| r.weight.is_some()) {
            return None;
        }
        let delays = max_delay + 1;
        let (mut power, mut right, mut gram) = (0.0, vec![0.0; delays], vec![0.0; delays]);
        for work in &self.records {
            power += dot(work.y, work.y);
            for (sum, value) in right.iter_mut().zip(lag_vector(work.y, &work.uf, delays)) {
                *sum += value;
            }
            let (n, mut energy) = (work.uf.len(), dot(&work.uf, &work.uf));
            for (nk, sum) in gram.iter_mut().enumerate().take(n) {
                *sum += energy;
                energy -= work.uf[n - 1 - nk].powi(2);
            }
        }
        Some(right.iter().zip(&gram).map(|(r, g)| if *g > 0.0 { power - r * r / g } else { power }).collect())
    }

    /// Cost, gradient and information at F; may be `None` where the cost is not below `limit`.
    fn evaluate(&mut self, f: &[f64], limit: f64) -> Option<Normal> {
        if !is_stable(f) {
            return None;
        }
        if let (&[f1, f2], 1, Initial::Zero) = (f, self.orders.nb, self.orders.initial)
            && self.records.iter().all(|r| r.weight.is_none())
        {
            return self.evaluate_second_order(f1, f2, limit);
        }
        self.filter(f);
        let (inverse, cost) = self.project()?;
        let (k, nf) = (self.linear_count(), f.len());
        let mut gradient = DVector::<f64>::zeros(nf);
        let mut information = DMatrix::<f64>::zeros(nf, nf);
        let mut cross = DMatrix::<f64>::zeros(k, nf);
        for at in 0..self.records.len() {
            {
                let work = &mut self.records[at];
                let mut wf = std::mem::take(&mut work.wf);
                filter(&work.model, f, &mut wf);
                work.wf = wf;
            }
            let work = &self.records[at];
            let weight = work.weight.as_deref();
            // d(model)/df_i = −wf(t − i), so the residual's derivative is +wf(t − i), i = 1 … nf.
            for i in 0..nf {
                gradient[i] += lagged(&work.wf, &work.residual, i + 1, 0);
                for j in i..nf {
                    let value = match weight {
                        None => lagged(&work.wf, &work.wf, i + 1, j + 1),
                        Some(w) => weighted(&work.wf, &work.wf, i + 1, j + 1, w),
                    };
                    information[(i, j)] += value;
                    if i != j {
                        information[(j, i)] += value;
                    }
                }
                for (column, signal, shift) in self.columns(at) {
                    cross[(column, i)] += match weight {
                        None => lagged(signal, &work.wf, shift, i + 1),
                        Some(w) => weighted(signal, &work.wf, shift, i + 1, w),
                    };
                }
            }
        }
        information -= cross.transpose() * inverse * &cross;
        Some(Normal { cost, gradient, information })
    }

    /// [`Self::evaluate`] for one numerator coefficient, two poles, a start at rest and no sample missing.
    fn evaluate_second_order(&mut self, f1: f64, f2: f64, limit: f64) -> Option<Normal> {
        let arch = self.arch;
        arch.dispatch(SecondOrder { records: &mut self.records, nk: self.nk, f1, f2, power: self.power, limit })
    }

    /// The loss alone.
    fn cost(&mut self, f: &[f64]) -> Option<f64> {
        if !is_stable(f) {
            return None;
        }
        self.filter(f);
        Some(self.project()?.1)
    }

    /// Steiglitz-McBride: ARX on signals filtered by the last 1/F.
    fn steiglitz_mcbride(&mut self, iterations: usize) -> Option<Vec<f64>> {
        let OutputError { nb, nf, .. } = self.orders;
        let columns = nf + nb;
        let mut f = vec![0.0; nf];
        for _ in 0..iterations {
            let mut gram = DMatrix::<f64>::zeros(columns, columns);
            let mut right = DVector::<f64>::zeros(columns);
            let mut rows = 0;
            for work in &mut self.records {
                filter(work.u, &f, &mut work.uf);
                filter(work.y, &f, &mut work.wf);
                let (first, end) = (nf.max(self.nk + nb - 1), work.y.len());
                if end <= first {
                    continue;
                }
                rows += end - first;
                let (uf, wf, nk) = (&work.uf, &work.wf, self.nk);
                // −y(t − 1) … −y(t − nf), u(t − nk) …
                let column =
                    |c: usize| if c < nf { &wf[first - 1 - c..end - 1 - c] } else { &uf[first - nk - (c - nf)..end - nk - (c - nf)] };
                let sign = |c: usize| if c < nf { -1.0 } else { 1.0 };
                for i in 0..columns {
                    right[i] += sign(i) * dot(column(i), &wf[first..]);
                    for j in 0..=i {
                        gram[(i, j)] += sign(i) * sign(j) * dot(column(i), column(j));
                    }
                }
            }
            if rows <= columns {
                return None;
            }
            // Only a start is wanted: a ridge of rounding size stands for a rank decision. The lower triangle is all that is read.
            for i in 0..columns {
                gram[(i, i)] += 1e-14 * gram[(i, i)] + f64::MIN_POSITIVE;
            }
            let solved = gram.cholesky()?.solve(&right);
            f = stabilised(solved.as_slice()[..nf].to_vec())?;
        }
        Some(f)
    }
}

/// One evaluation of y = b/(1 + f₁q⁻¹ + f₂q⁻²) u(t − nk), in two passes over the records.
struct SecondOrder<'a, 'b> {
    records: &'a mut [Work<'b>],
    nk: usize,
    f1: f64,
    f2: f64,
    power: f64,
    limit: f64,
}

impl WithSimd for SecondOrder<'_, '_> {
    type Output = Option<Normal>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Option<Normal> {
        // Fused where the processor can, which it can wherever it has vectors of four: the recursion waits for half as long.
        let fused = |a: f64, b: f64, c: f64| if S::F64_LANES >= 4 { a.mul_add(b, c) } else { a * b + c };
        let Self { records, nk, f1, f2, power, limit } = self;
        let (mut gram, mut right) = (0.0, 0.0);
        for work in records.iter_mut() {
            let delayed = work.y.get(nk..).unwrap_or_default();
            let (mut x1, mut x2) = (0.0, 0.0);
            for ((to, &u), &y) in work.uf.iter_mut().zip(work.u).zip(delayed) {
                let x = fused(-f1, x1, fused(-f2, x2, u));
                (x2, x1) = (x1, x);
                *to = x;
                gram = fused(x, x, gram);
                right = fused(x, y, right);
            }
        }
        // As in `project`.
        let ridged = gram + (1e-13 * gram + f64::MIN_POSITIVE);
        let b = right / ridged;
        // By Pythagoras, with room for its rounding.
        if power - b * right > limit + 1e-9 * power {
            return None;
        }
        let (mut cost, mut gradient, mut information, mut cross) = (0.0, [0.0; 2], [0.0; 3], [0.0; 2]);
        for work in records.iter() {
            let (before, delayed) = work.y.split_at(nk.min(work.y.len()));
            cost += dot(before, before);
            let (mut w1, mut w2) = (0.0, 0.0);
            for (&x, &y) in work.uf.iter().zip(delayed) {
                let model = b * x;
                let r = y - model;
                cost = fused(r, r, cost);
                gradient[0] = fused(w1, r, gradient[0]);
                gradient[1] = fused(w2, r, gradient[1]);
                information[0] = fused(w1, w1, information[0]);
                information[1] = fused(w1, w2, information[1]);
                information[2] = fused(w2, w2, information[2]);
                cross[0] = fused(x, w1, cross[0]);
                cross[1] = fused(x, w2, cross[1]);
                let w = fused(-f1, w1, fused(-f2, w2, model));
                (w2, w1) = (w1, w);
            }
        }
        let projected = |i: usize, j: usize| information[i + j] - cross[i] * cross[j] / ridged;
        ridged.is_finite().then(|| Normal {
            cost,
            gradient: DVector::from_column_slice(&gradient),
            information: DMatrix::from_fn(2, 2, projected),
        })
    }
}

/// The search has come back to a known minimum: its loss is hardly above it, and the quadratic model says that nothing lies between.
fn is_same_minimum(f: &[f64], normal: &Normal, known: &Fit) -> bool {
    let excess = NEAR * known.normal.cost;
    let away = DVector::from_iterator(f.len(), f.iter().zip(&known.parameters).map(|(a, b)| a - b));
    normal.cost >= known.normal.cost
        && normal.cost - known.normal.cost <= excess
        && (&known.normal.information * &away).dot(&away) <= 2.0 * excess
}

/// A loss this close to a minimum, relative, with parameters that explain it, belongs to that minimum.
const NEAR: f64 = 1e-5;

/// The polynomial, its roots pulled in by a common factor until they are inside the unit circle.
pub(super) fn stabilised(mut f: Vec<f64>) -> Option<Vec<f64>> {
    for _ in 0..60 {
        if is_stable(&f) {
            return Some(f);
        }
        let mut factor = 0.9;
        for c in &mut f {
            *c *= factor;
            factor *= 0.9;
        }
    }
    None
}

fn weighted(a: &[f64], b: &[f64], i: usize, j: usize, w: &[f64]) -> f64 {
    (i.max(j)..a.len()).map(|t| w[t] * a[t - i] * b[t - j]).sum()
}

/// Denominators that between them are near most sampled dynamics: real and complex pole pairs from fast to slow.
fn table(nf: usize) -> Vec<Vec<f64>> {
    let real = [0.0, 0.5, 0.8, 0.95, 0.99];
    let mut seeds: Vec<Vec<f64>> = Vec::new();
    if nf == 1 {
        return [-0.5, 0.0, 0.4, 0.7, 0.9, 0.97, 0.995].iter().map(|p| vec![-p]).collect();
    }
    for (i, p) in real.iter().enumerate() {
        for q in &real[i..] {
            seeds.push(vec![-(p + q), p * q]);
        }
    }
    for radius in [0.7, 0.9, 0.98] {
        for angle in [0.1, 0.3, 0.8, 1.6, 2.4_f64] {
            seeds.push(vec![-2.0 * radius * angle.cos(), radius * radius]);
        }
    }
    for f in &mut seeds {
        f.resize(nf, 0.0);
    }
    seeds
}

/// Slope and relative step at which a minimum is found.
const TIGHT: f64 = 1e-9;

impl OutputError {
    /// The best model for nk = 0 … `max_delay`; `None` for a delay whose model cannot be evaluated (the input is zero, say).
    ///
    /// All samples count, also for nk = 0: before a record the input is taken to be zero.
    #[must_use]
    pub fn scan(&self, records: &[Record], max_delay: usize) -> Vec<Option<OeFit>> {
        let mut problem = Problem::new(*self, records);
        let search = LevenbergMarquardt {
            max_iterations: 60,
            gradient_tolerance: 1e-4,
            step_tolerance: 1e-4,
            cost_floor: 1e-28 * problem.power,
            ..LevenbergMarquardt::default()
        };
        let seeds = self.seeds(&mut problem, max_delay);
        let mut best: Vec<Option<crate::fit::Fit>> = vec![None; max_delay + 1];
        for upwards in [true, false] {
            for step in 0..=max_delay {
                let nk = if upwards { step } else { max_delay - step };
                problem.nk = nk;
                let mut starts: Vec<&[f64]> = Vec::new();
                if upwards {
                    starts.extend(seeds[nk].iter().map(Vec::as_slice));
                }
                let neighbour = if upwards { nk.checked_sub(1) } else { Some(nk + 1).filter(|&n| n <= max_delay) };
                let neighbour = neighbour.and_then(|n| best[n].as_ref()).map(|fit| fit.parameters.clone());
                starts.extend(neighbour.as_deref());
                for start in starts {
                    // A second start is worth a search only where it does not lead to the same minimum at once.
                    let known = best[nk]
                        .as_ref()
                        .is_some_and(|fit| fit.stopped.converged() && fit.parameters.iter().zip(start).all(|(a, b)| (a - b).abs() <= 1e-6));
                    if known {
                        continue;
                    }
                    let known = best[nk].as_ref().filter(|fit| fit.stopped.converged());
                    let (mut returned, mut lowest) = (false, f64::INFINITY);
                    let fit = search.minimise(start, |f| {
                        let mut normal = problem.evaluate(f, lowest)?;
                        lowest = lowest.min(normal.cost);
                        if known.is_some_and(|known| is_same_minimum(f, &normal, known)) {
                            returned = true;
                            normal.gradient.fill(0.0);
                        }
                        Some(normal)
                    });
                    if returned {
                        continue;
                    }
                    if fit.stopped != Stopped::Undefined
                        && best[nk].as_ref().is_none_or(|b| fit.normal.cost < b.normal.cost * (1.0 - 1e-12))
                    {
                        best[nk] = Some(fit);
                    }
                }
            }
        }
        let samples = count(records);
        best.into_iter()
            .enumerate()
            .map(|(nk, fit)| {
                let mut fit = fit?;
                problem.nk = nk;
                // The search only finds the valley; the minimum in it is Newton's, and where curvature does not let it, that of a search with tight tolerances.
                if fit.stopped != Stopped::Cost {
                    fit = polish(fit, |f| problem.evaluate(f, f64::INFINITY));
                    if fit.normal.slope(&vec![true; fit.parameters.len()]) > TIGHT {
                        let tight = LevenbergMarquardt { gradient_tolerance: TIGHT, step_tolerance: TIGHT, ..search.clone() };
                        fit = polish(tight.minimise(&fit.parameters, |f| problem.evaluate(f, f64::INFINITY)), |f| {
                            problem.evaluate(f, f64::INFINITY)
                        });
                    }
                }
                problem.cost(&fit.parameters)?;
                let b = problem.linear.iter().take(self.nb).copied().collect();
                Some(OeFit { loss: fit.normal.cost / samples, b, f: fit.parameters, stopped: fit.stopped })
            })
            .collect()
    }

    /// The residuals e of a fitted model, record after record (0 where the output is missing).
    #[must_use]
    pub fn residuals(&self, records: &[Record], nk: usize, f: &[f64]) -> Option<Vec<f64>> {
        let mut problem = Problem::new(*self, records);
        problem.nk = nk;
        problem.cost(f)?;
        Some(problem.records.into_iter().flat_map(|w| w.residual).collect())
    }

    /// Starting denominators for every delay: the best of the table, and Steiglitz-McBride.
    fn seeds(&self, problem: &mut Problem<'_>, max_delay: usize) -> Vec<Vec<Vec<f64>>> {
        let mut ranked: Vec<Vec<(f64, Vec<f64>)>> = vec![Vec::new(); max_delay + 1];
        for f in table(self.nf) {
            if self.nf == 0 || !is_stable(&f) {
                continue;
            }
            problem.filter(&f);
            let quick = problem.quick_costs(max_delay);
            for (nk, entries) in ranked.iter_mut().enumerate() {
                problem.nk = nk;
                let cost = match &quick {
                    Some(costs) => Some(costs[nk]),
                    None => problem.project().map(|(_, cost)| cost),
                };
                if let Some(cost) = cost.filter(|c| c.is_finite()) {
                    entries.push((cost, f.clone()));
                }
            }
        }
        (ranked.into_iter().enumerate())
            .map(|(nk, mut entries)| {
                entries.sort_by(|a, b| a.0.total_cmp(&b.0));
                let mut seeds: Vec<Vec<f64>> = entries.into_iter().take(2).map(|e| e.1).collect();
                problem.nk = nk;
                seeds.extend(problem.steiglitz_mcbride(3));
                if self.nf == 0 {
                    seeds.push(Vec::new());
                }
                seeds
            })
            .collect()
    }
}

/// The largest magnitude among the roots of F.
pub(crate) fn largest_pole(f: &[f64]) -> f64 {
    super::polynomial::roots(f).map_or(f64::NAN, |roots| roots.iter().map(|p| p.norm()).fold(0.0, f64::max))
}

/// A record without missing samples, both channels through 1/C from rest.
pub(crate) fn prefiltered(record: &Record, c: &[f64]) -> Record {
    let through = |x: &[f64]| {
        let mut out = vec![0.0; x.len()];
        filter(x, c, &mut out);
        out
    };
    Record::new(through(&record.u), through(&record.y))
}

/// Mean square of the measured output samples.
pub(crate) fn power(records: &[Record]) -> f64 {
    let measured =
        |r: &Record| r.y.iter().enumerate().filter(|(t, _)| r.present.as_ref().is_none_or(|p| p[*t])).map(|(_, y)| y * y).sum::<f64>();
    records.iter().map(measured).sum::<f64>() / count(records).max(1.0)
}

/// Measured output samples.
fn count(records: &[Record]) -> f64 {
    let samples: usize = records.iter().map(|r| r.present.as_ref().map_or(r.len(), |p| p.iter().filter(|&&p| p).count())).sum();
    #[allow(clippy::cast_precision_loss)]
    let samples = samples as f64;
    samples
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stability_is_that_of_the_roots() {
        assert!(is_stable(&[-1.8, 0.81]));
        assert!(!is_stable(&[-2.0, 1.0]));
        assert!(!is_stable(&[-2.1, 1.05]));
        assert!(is_stable(&[]));
        assert!(!is_stable(&[f64::NAN, 0.0]));
        // (z − 0.9)(z² + 0.5z + 0.8): inside; (z − 1.1)(…): outside.
        let cubic = |p: f64| vec![0.5 - p, 0.8 - 0.5 * p, -0.8 * p];
        assert!(is_stable(&cubic(0.9)));
        assert!(!is_stable(&cubic(1.1)));
    }

    /// The analytic gradient of the projected problem against differences of its cost.
    #[test]
    fn the_gradient_is_the_derivative_of_the_cost() {
        let u: Vec<f64> = (0..120).map(|k| f64::from((k * 7919 % 13) as u8) - 6.0).collect();
        let mut y = vec![0.0; 120];
        filter(&u, &[-1.2, 0.5], &mut y);
        let noisy: Vec<f64> = y.iter().enumerate().map(|(k, v)| v + ((k * 31 % 17) as f64 - 8.0) * 0.05).collect();
        let present = Some((0..120).map(|t| t % 11 != 3).collect());
        for initial in [Initial::Zero, Initial::Estimated] {
            for present in [None, present.clone()] {
                let records = [Record { u: u.clone(), y: noisy.clone(), present }];
                let mut problem = Problem::new(OutputError { nb: 2, nf: 2, initial }, &records);
                problem.nk = 1;
                let at = [-0.9, 0.3];
                let normal = problem.evaluate(&at, f64::INFINITY).unwrap();
                for i in 0..2 {
                    let mut shifted = at;
                    let h = 1e-6;
                    shifted[i] += h;
                    let up = problem.cost(&shifted).unwrap();
                    shifted[i] -= 2.0 * h;
                    let down = problem.cost(&shifted).unwrap();
                    let numeric = (up - down) / (2.0 * h) / 2.0;
                    assert!((normal.gradient[i] - numeric).abs() < 1e-6 * numeric.abs().max(1.0), "{} {numeric}", normal.gradient[i]);
                }
            }
        }
    }

    #[test]
    fn the_two_pass_evaluation_agrees_with_the_general_one() {
        let u: Vec<f64> = (0..200).map(|k| f64::from((k * 7919 % 13) as u8) - 6.0).collect();
        let mut y = vec![0.0; 200];
        filter(&u, &[-1.2, 0.5], &mut y);
        let noisy: Vec<f64> = y.iter().enumerate().map(|(k, v)| v + ((k * 31 % 17) as f64 - 8.0) * 0.3).collect();
        // Weights that are all 1 lead through the general evaluation.
        let records = [Record::new(u.clone(), noisy.clone()), Record::new(u[..90].to_vec(), noisy[..90].to_vec())];
        let weighted = records.clone().map(|r| Record { present: Some(vec![true; r.len()]), ..r });
        let orders = OutputError { nb: 1, nf: 2, initial: Initial::Zero };
        let (mut quick, mut general) = (Problem::new(orders, &records), Problem::new(orders, &weighted));
        for nk in [0, 3, 120] {
            (quick.nk, general.nk) = (nk, nk);
            let at = [-0.9, 0.3];
            let (a, b) = (quick.evaluate(&at, f64::INFINITY).unwrap(), general.evaluate(&at, f64::INFINITY).unwrap());
            assert!((a.cost - b.cost).abs() < 1e-12 * b.cost);
            assert!((&a.gradient - &b.gradient).amax() < 1e-10 * b.gradient.amax());
            assert!((&a.information - &b.information).amax() < 1e-10 * b.information.amax());
            assert!(quick.evaluate(&at, 0.5 * b.cost).is_none());
            quick.filter(&at);
            let ranked = quick.quick_costs(nk).unwrap()[nk];
            assert!((ranked - b.cost).abs() < 1e-10 * b.cost);
        }
    }
}
