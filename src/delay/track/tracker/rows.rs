//! Rows of the regression as they come, and their running Gram matrix.

use nalgebra::DMatrix;

use super::past::Past;

/// Fills `row` with past outputs, the inputs at the lags, 1 and the output; false where an output is missing.
pub(super) fn fill(row: &mut [f64], u: &Past<f64>, y: &Past<Option<f64>>, now: f64, na: usize, lags: std::ops::Range<usize>) -> bool {
    for (i, value) in row[..na].iter_mut().enumerate() {
        let Some(past) = y.at(i) else { return false };
        *value = past;
    }
    let count = lags.len();
    for (value, lag) in row[na..na + count].iter_mut().zip(lags) {
        *value = u.at(lag);
    }
    row[na + count] = 1.0;
    row[na + count + 1] = now;
    true
}

/// gram ← forget·gram + row·rowᵀ, the upper triangle.
pub(super) fn accumulate(gram: &mut DMatrix<f64>, row: &[f64], forget: f64) {
    for (c, right) in row.iter().enumerate() {
        let mut column = gram.column_mut(c);
        for (r, left) in row[..=c].iter().enumerate() {
            column[r] = forget * column[r] + left * right;
        }
    }
}

/// The inverse of the normal equations' matrix, a trace of each diagonal added.
pub(super) fn inverse(gram: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = gram.nrows() - 1;
    let mut normal = gram.view((0, 0), (size, size)).into_owned();
    for i in 0..size {
        normal[(i, i)] = normal[(i, i)] * (1.0 + 1e-9) + f64::MIN_POSITIVE;
    }
    Some(normal.cholesky()?.inverse())
}

/// xᵀ·P·x.
pub(super) fn leverage(p: &DMatrix<f64>, x: &[f64]) -> f64 {
    let size = p.nrows();
    (0..size).map(|i| x[i] * p.column(i).iter().zip(x).map(|(p, x)| p * x).sum::<f64>()).sum::<f64>().max(0.0)
}
