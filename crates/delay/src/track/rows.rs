//! The rows of y(t) = Σ aᵢ·y(t−i) + Σ bⱼ·u(t−d(t)−j) + c + e(t). The shape (a, b, c) is constant, the delay d(t) varies.

use nalgebra::{DMatrix, DVector};

use deadtime_identify::Record;
use deadtime_signal::stats;

/// Orders and delays of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RowOrders {
    /// Past outputs.
    pub(super) na: usize,
    /// Input coefficients.
    pub(super) nb: usize,
    /// Delays, from 0.
    pub(super) delays: usize,
}

impl RowOrders {
    /// The first row that needs no sample before the record, at any delay.
    pub(super) fn first(self) -> usize {
        self.na.max(self.delays + self.nb - 1)
    }

    /// Coefficients of the shape.
    pub(super) fn columns(self) -> usize {
        self.na + self.nb + 1
    }
}

/// The response without its delay: the coefficients of the past outputs, those of the input from its delay on, and the offset.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::track) struct ResponseShape {
    pub(in crate::track) a: Vec<f64>,
    pub(in crate::track) b: Vec<f64>,
    pub(in crate::track) level: f64,
}

/// Relative ridge on the diagonal: smooth inputs and noise-free outputs make columns nearly dependent.
const RIDGE: f64 = 1e-11;

/// The concatenated samples of all records, and the rows without samples of another record or missing ones.
pub(super) struct Rows {
    pub(super) orders: RowOrders,
    u: Vec<f64>,
    y: Vec<f64>,
    /// The sample of each row.
    pub(super) at: Vec<usize>,
    /// The first sample of each record.
    pub(super) begins: Vec<usize>,
    /// Σy² over the rows, about their mean.
    pub(super) power: f64,
}

impl Rows {
    pub(super) fn new(records: &[Record<'_>], orders: RowOrders) -> Self {
        let first = orders.first();
        let (mut u, mut y, mut at, mut begins) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for record in records {
            let begin = u.len();
            begins.push(begin);
            u.extend_from_slice(&record.u[..record.len()]);
            y.extend_from_slice(&record.y[..record.len()]);
            let there = |t: usize| record.present.as_ref().is_none_or(|p| p[t]);
            at.extend(
                (first..record.len())
                    .filter(|&t| (t - orders.na..=t).all(there))
                    .map(|t| begin + t),
            );
        }
        let mean = stats::mean(at.iter().map(|&t| y[t])).unwrap_or(0.0);
        let power = at.iter().map(|&t| (y[t] - mean).powi(2)).sum();
        Self { orders, u, y, at, begins, power }
    }

    pub(super) fn len(&self) -> usize {
        self.at.len()
    }

    /// The record and the sample in it of a row.
    pub(super) fn place(&self, row: usize) -> (usize, usize) {
        let t = self.at[row];
        let record = self.begins.partition_point(|&b| b <= t) - 1;
        (record, t - self.begins[record])
    }

    /// The best-fitting shape for the delay `path(i)` in row i, and its Σe². `None` without a finite solution. A fractional delay interpolates linearly between
    /// its inputs.
    pub(super) fn fit(&self, path: impl Fn(usize) -> f64) -> Option<(ResponseShape, f64)> {
        self.fit_every(1, path)
    }

    /// The same over every `stride`-th row.
    pub(super) fn fit_every(
        &self,
        stride: usize,
        path: impl Fn(usize) -> f64,
    ) -> Option<(ResponseShape, f64)> {
        let RowOrders { na, nb, .. } = self.orders;
        let columns = na + nb + 1;
        let mut gram = DMatrix::<f64>::zeros(columns + 1, columns + 1);
        let mut row = vec![0.0; columns + 1];
        for (i, &t) in self.at.iter().enumerate().step_by(stride) {
            let (d, part) = split(path(i));
            for (k, value) in row[..na].iter_mut().enumerate() {
                *value = self.y[t - 1 - k];
            }
            for (j, value) in row[na..na + nb].iter_mut().enumerate() {
                *value = self.u[t - d - j] * (1.0 - part)
                    + if part > 0.0 { part * self.u[t - d - j - 1] } else { 0.0 };
            }
            row[na + nb] = 1.0;
            row[columns] = self.y[t];
            add_products(&mut gram, &row);
        }
        gram.fill_lower_triangle_with_upper_triangle();
        let (theta, left) = solve(&gram)?;
        let shape = ResponseShape {
            a: theta[..na].to_vec(),
            b: theta[na..na + nb].to_vec(),
            level: theta[na + nb],
        };
        Some((shape, left))
    }

    /// e² of every row at one delay, where each input has its own coefficients: least squares. `None` without a finite solution.
    pub(super) fn squares_of(&self, delay: usize, inputs: &[&[f64]]) -> Option<Vec<f64>> {
        let RowOrders { na, nb, .. } = self.orders;
        let columns = na + nb * inputs.len() + 1;
        let fill = |t: usize, row: &mut [f64]| {
            for (k, value) in row[..na].iter_mut().enumerate() {
                *value = self.y[t - 1 - k];
            }
            for (values, input) in row[na..columns - 1].chunks_exact_mut(nb).zip(inputs) {
                for (j, value) in values.iter_mut().enumerate() {
                    *value = input[t - delay - j];
                }
            }
            row[columns - 1] = 1.0;
            row[columns] = self.y[t];
        };
        let mut gram = DMatrix::<f64>::zeros(columns + 1, columns + 1);
        let mut row = vec![0.0; columns + 1];
        for &t in &self.at {
            fill(t, &mut row);
            add_products(&mut gram, &row);
        }
        gram.fill_lower_triangle_with_upper_triangle();
        let (theta, _) = solve(&gram)?;
        let square = |&t: &usize| {
            fill(t, &mut row);
            let fitted: f64 = theta.iter().zip(&row).map(|(a, b)| a * b).sum();
            (row[columns] - fitted).powi(2)
        };
        Some(self.at.iter().map(square).collect())
    }

    /// The concatenated input of all records.
    pub(super) fn input(&self) -> &[f64] {
        &self.u
    }

    /// The residual of each row after past outputs and offset, and the drive Σ bⱼ·u(t−j) at every sample. The error of delay d is `left[i] − drive[at[i] − d]`.
    pub(super) fn errors(&self, shape: &ResponseShape) -> Errors<'_> {
        let left = (self.at.iter())
            .map(|&t| {
                self.y[t]
                    - shape.level
                    - shape.a.iter().enumerate().map(|(k, a)| a * self.y[t - 1 - k]).sum::<f64>()
            })
            .collect();
        let drive = (0..self.u.len())
            .map(|t| {
                shape
                    .b
                    .iter()
                    .enumerate()
                    .filter(|(j, _)| *j <= t)
                    .map(|(j, b)| b * self.u[t - j])
                    .sum()
            })
            .collect();
        Errors { at: &self.at, left, drive }
    }
}

/// The errors of every row at every delay.
pub(super) struct Errors<'a> {
    at: &'a [usize],
    left: Vec<f64>,
    drive: Vec<f64>,
}

impl Errors<'_> {
    /// At a whole delay.
    pub(super) fn whole(&self, row: usize, delay: usize) -> f64 {
        self.left[row] - self.drive[self.at[row] - delay]
    }

    /// At a fractional delay, by linear interpolation of the responses, as for a held input and a plant slow compared with the sample.
    pub(super) fn between(&self, row: usize, delay: f64) -> f64 {
        let (low, part) = split(delay);
        let next = if part > 0.0 { part * self.drive[self.at[row] - low - 1] } else { 0.0 };
        self.left[row] - (1.0 - part) * self.drive[self.at[row] - low] - next
    }
}

/// Whole samples, and the fraction.
pub(super) fn split(delay: f64) -> (usize, f64) {
    let whole = delay.max(0.0).floor();
    (whole as usize, delay.max(0.0) - whole)
}

/// The upper triangle of a row's products.
fn add_products(gram: &mut DMatrix<f64>, row: &[f64]) {
    for (c, &right) in row.iter().enumerate() {
        let mut column = gram.column_mut(c);
        for (r, &left) in row[..=c].iter().enumerate() {
            column[r] += left * right;
        }
    }
}

/// θ of the normal equations from a Gram matrix of [regressors, target], columns scaled to norm 1, and its Σe².
pub(in crate::track) fn solve(gram: &DMatrix<f64>) -> Option<(Vec<f64>, f64)> {
    let columns = gram.nrows() - 1;
    let scale: Vec<f64> = (0..columns)
        .map(|i| gram[(i, i)].sqrt())
        .map(|s| if s > 0.0 { s.recip() } else { 0.0 })
        .collect();
    let normal = DMatrix::from_fn(columns, columns, |i, j| {
        let same = if i == j { RIDGE + f64::from(u8::from(scale[i] == 0.0)) } else { 0.0 };
        gram[(i, j)] * scale[i] * scale[j] + same
    });
    let target = DVector::from_fn(columns, |i, _| gram[(i, columns)] * scale[i]);
    let solution = normal.cholesky()?.solve(&target);
    let theta: Vec<f64> = solution.iter().zip(&scale).map(|(x, s)| x * s).collect();
    // θᵀGθ − 2θᵀg + yᵀy, which holds for any θ.
    let quadratic: f64 = (0..columns)
        .map(|i| theta[i] * (0..columns).map(|j| gram[(i, j)] * theta[j]).sum::<f64>())
        .sum();
    let product: f64 = (0..columns).map(|i| theta[i] * gram[(i, columns)]).sum();
    let left = (gram[(columns, columns)] - 2.0 * product + quadratic).max(0.0);
    (left.is_finite() && theta.iter().all(|v| v.is_finite())).then_some((theta, left))
}
