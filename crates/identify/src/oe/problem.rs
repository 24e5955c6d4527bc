//! The least-squares problem of one delay in F, with B (and the initial state) eliminated.

use nalgebra::{DMatrix, DVector};
use pulp::Arch;

use super::kernel::SecondOrder;
use super::model::{Initial, OutputError};
use super::work::Work;
use crate::lag_products::lag_vector;
use crate::polynomial::{filter, is_stable, stabilised};
use crate::regression::{Record, dot};
use deadtime_signal::fit::Normal;

/// Σ a(t − i)·b(t − j) over a record, with signals zero before it.
fn lagged(a: &[f64], b: &[f64], i: usize, j: usize) -> f64 {
    let n = a.len();
    let lag = i.max(j);
    if lag >= n { 0.0 } else { dot(&a[lag - i..n - i], &b[lag - j..n - j]) }
}

fn weighted(a: &[f64], b: &[f64], i: usize, j: usize, w: &[f64]) -> f64 {
    (i.max(j)..a.len()).map(|t| w[t] * a[t - i] * b[t - j]).sum()
}

pub(super) struct OeProblem<'a> {
    orders: OutputError,
    pub(super) nk: usize,
    pub(super) records: Vec<Work<'a>>,
    /// Linear coefficients of the last evaluation: b, then the initial states record by record.
    pub(super) linear: DVector<f64>,
    /// Σ y².
    pub(super) power: f64,
    /// Exact second derivatives where available ([`OeProblem::is_second_order`]), else the product of first ones.
    pub(super) exact: bool,
    arch: Arch,
}

/// Inner products of the residuals' derivatives by F.
struct Sensitivity {
    /// With the residuals.
    gradient: DVector<f64>,
    /// With each other.
    information: DMatrix<f64>,
    /// With the columns of the linear part.
    cross: DMatrix<f64>,
}

impl<'a> OeProblem<'a> {
    pub(super) fn new(orders: OutputError, records: &'a [Record]) -> Self {
        let work = |r: &'a Record| {
            let n = r.len();
            Work {
                u: &r.u[..n],
                y: &r.y[..n],
                weight: r
                    .present
                    .as_ref()
                    .map(|p| p.iter().map(|&p| f64::from(u8::from(p))).collect()),
                uf: vec![0.0; n],
                model: vec![0.0; n],
                wf: vec![0.0; n],
                impulse: vec![0.0; n],
                residual: vec![0.0; n],
            }
        };
        let power = records.iter().map(|r| dot(&r.y, &r.y)).sum();
        Self {
            orders,
            nk: 0,
            records: records.iter().map(work).collect(),
            linear: DVector::zeros(0),
            power,
            exact: true,
            arch: Arch::new(),
        }
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
    pub(super) fn filter(&mut self, f: &[f64]) {
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

    /// Solves the linear part for filtered signals, stores model and residual in the work space and returns the loss (Σ e²).
    pub(super) fn project(&mut self) -> Option<(DMatrix<f64>, f64)> {
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
        // A relative ridge of rounding size: initial states and inputs may coincide (an impulse at the first sample), only their sum matters.
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

    /// The losses (Σ e²) of all delays for one F, accurate enough to rank starts; NaN where undefined.
    pub(super) fn costs(&mut self, f: &[f64], max_delay: usize) -> Vec<f64> {
        self.filter(f);
        self.quick_costs(max_delay).unwrap_or_else(|| {
            let cost = |nk| {
                self.nk = nk;
                self.project().map_or(f64::NAN, |(_, cost)| cost)
            };
            (0..=max_delay).map(cost).collect()
        })
    }

    /// The losses of all delays for filtered signals from one correlation, accurate enough to rank starts. `None` unless one numerator coefficient, a start at
    /// rest and no missing sample.
    pub(super) fn quick_costs(&self, max_delay: usize) -> Option<Vec<f64>> {
        if self.orders.nb != 1
            || self.orders.initial != Initial::Zero
            || self.records.iter().any(|r| r.weight.is_some())
        {
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
        Some(
            right
                .iter()
                .zip(&gram)
                .map(|(r, g)| if *g > 0.0 { power - r * r / g } else { power })
                .collect(),
        )
    }

    /// One numerator coefficient, two poles, a start at rest and no missing sample: [`Self::evaluate`] then has exact second derivatives.
    pub(super) fn is_second_order(&self) -> bool {
        let OutputError { nb, nf, initial } = self.orders;
        (nb, nf, initial) == (1, 2, Initial::Zero)
            && self.records.iter().all(|r| r.weight.is_none())
    }

    /// Cost, gradient and information at F (second derivatives where [`Self::is_second_order`]); may be `None` where the cost is not below `limit`.
    pub(super) fn evaluate(&mut self, f: &[f64], limit: f64) -> Option<Normal> {
        if !is_stable(f) {
            return None;
        }
        if let (&[f1, f2], true) = (f, self.is_second_order()) {
            return self.evaluate_second_order(f1, f2, limit);
        }
        self.filter(f);
        let (inverse, cost) = self.project()?;
        let Sensitivity { gradient, mut information, cross } = self.sensitivity(f);
        information -= cross.transpose() * inverse * &cross;
        Some(Normal { cost, gradient, information })
    }

    /// Inner products of the residuals' derivatives by F with the residuals, with each other and with the linear part, at the last projection.
    fn sensitivity(&mut self, f: &[f64]) -> Sensitivity {
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
        Sensitivity { gradient, information, cross }
    }

    /// JᵀJ over the linear part (B, then the initial states) and F, and the loss.
    pub(super) fn information(&mut self, f: &[f64]) -> Option<(DMatrix<f64>, f64)> {
        if !is_stable(f) {
            return None;
        }
        self.filter(f);
        let (inverse, cost) = self.project()?;
        let linear = inverse.try_inverse()?;
        let Sensitivity { information, cross, .. } = self.sensitivity(f);
        let (k, nf) = (linear.nrows(), f.len());
        let mut all = DMatrix::zeros(k + nf, k + nf);
        all.view_mut((0, 0), (k, k)).copy_from(&linear);
        // The model's derivative by a coefficient of F is minus the residual's.
        all.view_mut((0, k), (k, nf)).copy_from(&-&cross);
        all.view_mut((k, 0), (nf, k)).copy_from(&-cross.transpose());
        all.view_mut((k, k), (nf, nf)).copy_from(&information);
        Some((all, cost))
    }

    /// [`Self::evaluate`] for one numerator coefficient, two poles, a start at rest and no missing sample.
    fn evaluate_second_order(&mut self, f1: f64, f2: f64, limit: f64) -> Option<Normal> {
        let arch = self.arch;
        arch.dispatch(SecondOrder {
            records: &mut self.records,
            nk: self.nk,
            f1,
            f2,
            power: self.power,
            limit,
            exact: self.exact,
        })
    }

    /// The loss alone.
    pub(super) fn cost(&mut self, f: &[f64]) -> Option<f64> {
        if !is_stable(f) {
            return None;
        }
        self.filter(f);
        Some(self.project()?.1)
    }

    /// Steiglitz-McBride: ARX on signals filtered by the last 1/F.
    pub(super) fn steiglitz_mcbride(&mut self, iterations: usize) -> Option<Vec<f64>> {
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
                let column = |c: usize| {
                    if c < nf {
                        &wf[first - 1 - c..end - 1 - c]
                    } else {
                        &uf[first - nk - (c - nf)..end - nk - (c - nf)]
                    }
                };
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
            // A ridge of rounding size replaces a rank decision, which suffices for a start. Only the lower triangle is read.
            for i in 0..columns {
                gram[(i, i)] += 1e-14 * gram[(i, i)] + f64::MIN_POSITIVE;
            }
            let solved = gram.cholesky()?.solve(&right);
            f = stabilised(solved.as_slice()[..nf].to_vec())?;
        }
        Some(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The analytic gradient of the projected problem equals differences of its cost.
    #[test]
    fn the_gradient_is_the_derivative_of_the_cost() {
        let u: Vec<f64> = (0..120).map(|k| f64::from((k * 7919 % 13) as u8) - 6.0).collect();
        let mut y = vec![0.0; 120];
        filter(&u, &[-1.2, 0.5], &mut y);
        let noisy: Vec<f64> =
            y.iter().enumerate().map(|(k, v)| v + ((k * 31 % 17) as f64 - 8.0) * 0.05).collect();
        let present = Some((0..120).map(|t| t % 11 != 3).collect());
        for initial in [Initial::Zero, Initial::Estimated] {
            for present in [None, present.clone()] {
                let records = [Record { present, ..Record::new(&u, &noisy) }];
                let mut problem = OeProblem::new(OutputError { nb: 2, nf: 2, initial }, &records);
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
                    assert!(
                        (normal.gradient[i] - numeric).abs() < 1e-6 * numeric.abs().max(1.0),
                        "{} {numeric}",
                        normal.gradient[i]
                    );
                }
            }
        }
    }

    #[test]
    fn the_two_pass_evaluation_agrees_with_the_general_one() {
        let u: Vec<f64> = (0..200).map(|k| f64::from((k * 7919 % 13) as u8) - 6.0).collect();
        let mut y = vec![0.0; 200];
        filter(&u, &[-1.2, 0.5], &mut y);
        let noisy: Vec<f64> =
            y.iter().enumerate().map(|(k, v)| v + ((k * 31 % 17) as f64 - 8.0) * 0.3).collect();
        // Weights of 1 select the general evaluation.
        let records = [
            Record::new(u.clone(), noisy.clone()),
            Record::new(u[..90].to_vec(), noisy[..90].to_vec()),
        ];
        let weighted =
            records.clone().map(|r| Record { present: Some(vec![true; r.len()].into()), ..r });
        let orders = OutputError { nb: 1, nf: 2, initial: Initial::Zero };
        let (mut quick, mut general) =
            (OeProblem::new(orders, &records), OeProblem::new(orders, &weighted));
        let mut upwards = 0;
        for nk in [0, 3, 120] {
            (quick.nk, general.nk) = (nk, nk);
            let at = [-0.9, 0.3];
            let (a, b) = (
                quick.evaluate(&at, f64::INFINITY).unwrap(),
                general.evaluate(&at, f64::INFINITY).unwrap(),
            );
            assert!((a.cost - b.cost).abs() < 1e-12 * b.cost);
            assert!((&a.gradient - &b.gradient).amax() < 1e-10 * b.gradient.amax());
            // Half the second derivatives of the loss, from differences of the gradient.
            for i in 0..2 {
                let h = 1e-5;
                let mut gradient = |by: f64| {
                    let mut moved = at;
                    moved[i] += by;
                    general.evaluate(&moved, f64::INFINITY).unwrap().gradient
                };
                let numeric = (gradient(h) - gradient(-h)) / (2.0 * h);
                let off = (a.information.column(i) - numeric).amax();
                // Under negative curvature, the product of first derivatives replaces it.
                let bends = (&a.information - &b.information).amax() < 1e-10 * b.information.amax();
                assert!(bends || off < 1e-6 * a.information.amax(), "{nk}: {off}");
                upwards += usize::from(!bends);
            }
            assert!(quick.evaluate(&at, 0.5 * b.cost).is_none());
            quick.filter(&at);
            let ranked = quick.quick_costs(nk).unwrap()[nk];
            assert!((ranked - b.cost).abs() < 1e-10 * b.cost);
        }
        assert!(upwards > 0, "second derivatives were compared nowhere");
    }
}
