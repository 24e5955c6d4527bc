//! The model at given poles and dead times, with its linear part solved, and its derivatives.

use deadtime_signal::decompositions::svd;
use nalgebra::{DMatrix, DVector};

use super::filters::Poles;
use crate::regression::dot;
use deadtime_signal::fit::Normal;

/// Records in scaled units.
pub(super) struct Data {
    /// By stretch and input, `history` samples before the first output.
    pub(super) inputs: Vec<Vec<Vec<f64>>>,
    pub(super) outputs: Vec<Vec<f64>>,
    pub(super) history: usize,
    /// Coefficients of each B.
    pub(super) nb: usize,
}

/// Poles, and each input's dead time, samples.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Point {
    pub(super) poles: Poles,
    pub(super) delays: Vec<f64>,
}

/// The linear part: B of every input, one after the other, and the initial state and offset of every stretch.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Linear {
    pub(super) b: Vec<f64>,
    pub(super) own: Vec<Vec<f64>>,
}

/// The model at a point, with initial states and offsets projected out.
pub(super) struct Projected {
    b: Vec<f64>,
    /// B/A u of all stretches.
    pub(super) forced: Vec<f64>,
    pub(super) loss: f64,
    own: Vec<DMatrix<f64>>,
    shared: DMatrix<f64>,
}

/// The model at a point, with its best linear part.
pub(super) struct Solved {
    pub(super) linear: Linear,
    pub(super) loss: f64,
    /// y − ŷ of all stretches.
    pub(super) residual: DVector<f64>,
    /// Orthonormal columns of every stretch's own initial state and offset.
    own: Vec<DMatrix<f64>>,
    /// Orthonormal columns of all inputs, orthogonal to those.
    shared: DMatrix<f64>,
}

/// Steps of numeric derivatives: of a coefficient, relative, and of a delay, samples.
const STEP: f64 = 1e-5;
/// Columns below this share of the largest are zero.
const NONE: f64 = 1e-11;

impl Data {
    pub(super) fn rows(&self) -> usize {
        self.outputs.iter().map(Vec::len).sum()
    }

    pub(super) fn count(&self) -> usize {
        self.inputs.first().map_or(0, Vec::len)
    }

    /// The columns of B, one vector over all stretches each.
    pub(super) fn columns(&self, point: &Point) -> Vec<Vec<f64>> {
        let (m, n) = (self.count(), point.poles.order());
        let mut all = vec![Vec::with_capacity(self.rows()); m * self.nb];
        for stretch in &self.inputs {
            for (j, (u, delay)) in stretch.iter().zip(&point.delays).enumerate() {
                let states = point.poles.states(u, *delay, self.history);
                for i in 0..self.nb {
                    all[j * self.nb + i].extend_from_slice(&states[n - self.nb + i]);
                }
            }
        }
        all
    }

    /// The columns of the initial state and the offset of one stretch.
    fn own_columns(poles: &Poles, samples: usize) -> DMatrix<f64> {
        let mut all = poles.free(samples);
        all.push(vec![1.0; samples]);
        DMatrix::from_fn(samples, all.len(), |t, j| all[j][t])
    }

    fn own_matrices(&self, poles: &Poles) -> Vec<DMatrix<f64>> {
        self.outputs.iter().map(|y| Self::own_columns(poles, y.len())).collect()
    }

    /// A column minus its projection on each stretch's own columns.
    pub(super) fn beyond(&self, own: &[DMatrix<f64>], column: &[f64]) -> DVector<f64> {
        let mut all = DVector::from_column_slice(column);
        let mut from = 0;
        for q in own {
            let part = all.rows(from, q.nrows()).into_owned();
            let explained = q * (q.transpose() * &part);
            all.rows_mut(from, q.nrows()).copy_from(&(part - explained));
            from += q.nrows();
        }
        all
    }

    /// Orthonormal columns of every stretch's initial state and offset.
    pub(super) fn bases(&self, poles: &Poles) -> Vec<DMatrix<f64>> {
        self.own_matrices(poles).into_iter().map(|m| m.qr().q()).collect()
    }

    /// B of every input at a point, with initial states and offsets projected out; `None` for unstable poles or zero columns.
    pub(super) fn projected(&self, point: &Point) -> Option<Projected> {
        if !point.poles.is_stable() {
            return None;
        }
        let own = self.bases(&point.poles);
        let columns = self.columns(point);
        let target = self.beyond(&own, &self.outputs.concat());
        let beyond: Vec<DVector<f64>> = columns.iter().map(|c| self.beyond(&own, c)).collect();
        let shared = DMatrix::from_columns(&beyond);
        if !shared.iter().all(|v| v.is_finite()) {
            return None;
        }
        let qr = shared.qr();
        let (shared, r) = (qr.q(), qr.r());
        let largest = r.diagonal().amax();
        if largest.is_nan()
            || largest <= 0.0
            || r.diagonal().iter().any(|v| v.abs() <= NONE * largest)
        {
            return None;
        }
        let explained = shared.tr_mul(&target);
        let b = r.solve_upper_triangular(&explained)?.iter().copied().collect::<Vec<f64>>();
        let loss = (&target - &shared * &explained).norm_squared();
        let forced = combined(&columns, &b);
        Some(Projected { b, forced, loss, own, shared })
    }

    /// The best linear part at a point, with the initial state and the offset of every stretch.
    pub(super) fn solved(&self, point: &Point) -> Option<Solved> {
        let Projected { b, forced, loss, own, shared } = self.projected(point)?;
        let y = self.outputs.concat();
        let left: Vec<f64> = y.iter().zip(&forced).map(|(y, x)| y - x).collect();
        let mut from = 0;
        let mut starts = Vec::with_capacity(own.len());
        for m in self.own_matrices(&point.poles) {
            let part = DVector::from_column_slice(&left[from..from + m.nrows()]);
            from += m.nrows();
            let start = svd(&m)?.solve(&part, NONE).ok()?;
            starts.push(start.iter().copied().collect());
        }
        let linear = Linear { b, own: starts };
        let residual = DVector::from_vec(y) - DVector::from_vec(self.output(point, &linear));
        Some(Solved { linear, loss, residual, own, shared })
    }

    /// The model's output.
    pub(super) fn output(&self, point: &Point, linear: &Linear) -> Vec<f64> {
        let mut all = combined(&self.columns(point), &linear.b);
        let mut from = 0;
        for (y, own) in self.outputs.iter().zip(&linear.own) {
            let response =
                Self::own_columns(&point.poles, y.len()) * DVector::from_column_slice(own);
            all[from..from + y.len()].iter_mut().zip(response.iter()).for_each(|(a, r)| *a += r);
            from += y.len();
        }
        all
    }

    /// The output's derivatives by the poles' coefficients and the free delays.
    pub(super) fn slopes(&self, point: &Point, linear: &Linear, free: &[bool]) -> Vec<Vec<f64>> {
        let between = |up: &Point, down: &Point, width: f64| {
            let (up, down) = (self.output(up, linear), self.output(down, linear));
            up.iter().zip(&down).map(|(a, b)| (a - b) / width).collect::<Vec<f64>>()
        };
        let mut all = Vec::new();
        for i in 0..point.poles.order() {
            let step = STEP * point.poles.a[i].abs().max(STEP);
            let moved = |by: f64| {
                let mut moved = point.clone();
                moved.poles.a[i] += by;
                moved
            };
            all.push(between(&moved(step), &moved(-step), 2.0 * step));
        }
        for j in (0..free.len()).filter(|j| free[*j]) {
            let moved = |by: f64| {
                let mut moved = point.clone();
                moved.delays[j] = (moved.delays[j] + by).max(0.0);
                moved
            };
            let (up, down) = (moved(STEP), moved(-STEP));
            let width = up.delays[j] - down.delays[j];
            all.push(between(&up, &down, width));
        }
        all
    }

    /// Residuals and derivatives with the linear part projected out (Kaufman's approximation).
    ///
    /// Source: Kaufman (1975), "A variable projection method for solving separable nonlinear least squares problems", BIT 15, 49-57, doi:10.1007/BF01932995.
    pub(super) fn normal(&self, point: &Point, free: &[bool]) -> Option<Normal> {
        let solved = self.solved(point)?;
        let without = |column: &[f64]| {
            let beyond = self.beyond(&solved.own, column);
            let explained = &solved.shared * solved.shared.tr_mul(&beyond);
            beyond - explained
        };
        let slopes = self.slopes(point, &solved.linear, free);
        let columns: Vec<DVector<f64>> = slopes.iter().map(|s| -without(s)).collect();
        let residual = without(solved.residual.as_slice());
        Some(Normal::new(&residual, &DMatrix::from_columns(&columns)))
    }

    /// All derivatives: by the poles, the free delays, B, and the initial state of each stretch.
    pub(super) fn all_slopes(
        &self,
        point: &Point,
        linear: &Linear,
        free: &[bool],
    ) -> Vec<Vec<f64>> {
        let mut all = self.slopes(point, linear, free);
        all.extend(self.columns(point));
        let rows = self.rows();
        let mut from = 0;
        for y in &self.outputs {
            for start in point.poles.free(y.len()) {
                let mut column = vec![0.0; rows];
                column[from..from + y.len()].copy_from_slice(&start);
                all.push(column);
            }
            from += y.len();
        }
        all
    }
}

/// Σ w·column.
fn combined(columns: &[Vec<f64>], weights: &[f64]) -> Vec<f64> {
    let mut all = vec![0.0; columns.first().map_or(0, Vec::len)];
    for (column, w) in columns.iter().zip(weights) {
        all.iter_mut().zip(column).for_each(|(a, c)| *a += w * c);
    }
    all
}

/// Σ x².
pub(super) fn power(x: &[f64]) -> f64 {
    dot(x, x)
}
