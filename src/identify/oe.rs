//! Output-error models y = B(q)/F(q) u(t − nk) + e, fitted for many delays at once.

use nalgebra::{DMatrix, DVector};

use super::least_squares;
use super::regression::{Record, dot};
use crate::fit::{LevenbergMarquardt, Normal, Stopped};

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
fn is_stable(f: &[f64]) -> bool {
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
fn filter(x: &[f64], f: &[f64], out: &mut [f64]) {
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
        Self { orders, nk: 0, records: records.iter().map(work).collect(), linear: DVector::zeros(0) }
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

    /// Cost, gradient and information at F.
    fn evaluate(&mut self, f: &[f64]) -> Option<Normal> {
        if !is_stable(f) {
            return None;
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
        let mut f = vec![0.0; nf];
        for _ in 0..iterations {
            let mut columns: Vec<Vec<f64>> = vec![Vec::new(); nf + nb];
            let mut target = Vec::new();
            for work in &mut self.records {
                filter(work.u, &f, &mut work.uf);
                filter(work.y, &f, &mut work.wf);
                let first = nf.max(self.nk + nb - 1);
                for t in first..work.y.len() {
                    let past = (0..nf).map(|i| -work.wf[t - 1 - i]);
                    let inputs = (0..nb).map(|j| work.uf[t - self.nk - j]);
                    for (column, value) in columns.iter_mut().zip(past.chain(inputs)) {
                        column.push(value);
                    }
                    target.push(work.wf[t]);
                }
            }
            if target.len() <= nf + nb {
                return None;
            }
            let small: Vec<f64> = columns.iter().map(|c| 1e-11 * c.iter().map(|v| v * v).sum::<f64>().sqrt()).collect();
            let solved = least_squares::solve(&mut columns, &mut target, &small);
            let next = solved.coefficients[..nf].to_vec();
            f = stabilised(next)?;
        }
        Some(f)
    }
}

/// The polynomial, its roots pulled in by a common factor until they are inside the unit circle.
fn stabilised(mut f: Vec<f64>) -> Option<Vec<f64>> {
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

impl OutputError {
    /// The best model for nk = 0 … `max_delay`; `None` for a delay whose model cannot be evaluated (the input is zero, say).
    ///
    /// All samples count, also for nk = 0: before a record the input is taken to be zero.
    #[must_use]
    pub fn scan(&self, records: &[Record], max_delay: usize) -> Vec<Option<OeFit>> {
        let mut problem = Problem::new(*self, records);
        let power: f64 = records.iter().map(|r| dot(&r.y, &r.y)).sum();
        let search = LevenbergMarquardt {
            max_iterations: 60,
            gradient_tolerance: 1e-9,
            step_tolerance: 1e-9,
            cost_floor: 1e-28 * power,
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
                    let fit = search.minimise(start, |f| problem.evaluate(f));
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
                let fit = fit?;
                problem.nk = nk;
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
            for (nk, entries) in ranked.iter_mut().enumerate() {
                problem.nk = nk;
                if let Some((_, cost)) = problem.project().filter(|(_, c)| c.is_finite()) {
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
    let n = f.len();
    if n == 0 {
        return 0.0;
    }
    let companion = DMatrix::from_fn(n, n, |i, j| if i == 0 { -f[j] } else { f64::from(u8::from(i == j + 1)) });
    companion.complex_eigenvalues().iter().map(|p| p.norm()).fold(0.0, f64::max)
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
                let normal = problem.evaluate(&at).unwrap();
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
}
