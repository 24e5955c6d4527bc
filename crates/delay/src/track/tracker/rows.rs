//! Regression rows of a stream, and their running Gram matrix.

use nalgebra::{DMatrix, DVector};

use super::past::Past;

/// Fills `row` with past outputs, the inputs at the lags, 1 and the output; `false` where an output is missing.
pub(super) fn fill(
    row: &mut [f64],
    u: &Past<f64>,
    y: &Past<Option<f64>>,
    now: f64,
    na: usize,
    lags: std::ops::Range<usize>,
) -> bool {
    fill_earlier(row, u, y, [0, 0], now, na, lags)
}

/// The same for an earlier row, with the given offsets into the past of the input and of the output.
pub(super) fn fill_earlier(
    row: &mut [f64],
    u: &Past<f64>,
    y: &Past<Option<f64>>,
    [back_u, back_y]: [usize; 2],
    now: f64,
    na: usize,
    lags: std::ops::Range<usize>,
) -> bool {
    for (i, value) in row[..na].iter_mut().enumerate() {
        let Some(past) = y.at(back_y + i) else { return false };
        *value = past;
    }
    let count = lags.len();
    for (value, lag) in row[na..na + count].iter_mut().zip(lags) {
        *value = u.at(back_u + lag);
    }
    row[na + count] = 1.0;
    row[na + count + 1] = now;
    true
}

/// gram ← `forget`·gram + row·rowᵀ, the upper triangle.
pub(super) fn accumulate(gram: &mut DMatrix<f64>, row: &[f64], forget: f64) {
    for (c, right) in row.iter().enumerate() {
        let mut column = gram.column_mut(c);
        for (r, left) in row[..=c].iter().enumerate() {
            column[r] = forget * column[r] + left * right;
        }
    }
}

/// The inverse of the normal equations' matrix, with a relative ridge on the diagonal.
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
    (0..size)
        .map(|i| x[i] * p.column(i).iter().zip(x).map(|(p, x)| p * x).sum::<f64>())
        .sum::<f64>()
        .max(0.0)
}

/// Errors of a regression whose coefficients are normally distributed about their nominal values.
pub(super) struct Unsure {
    /// The information of the fit, and XᵀX of the rows.
    information: DMatrix<f64>,
    /// Xᵀe.
    common: DVector<f64>,
    squares: f64,
    rows: f64,
}

/// The residual of the rows: eᵀ(I + XPXᵀ)⁻¹e, ln det(I + XPXᵀ) up to a constant, and their number.
pub(super) struct Left {
    pub(super) left: f64,
    pub(super) log_volume: f64,
    pub(super) rows: f64,
}

impl Unsure {
    /// From the running Gram matrix of the fit, with the covariance of its coefficients multiplied by `times`.
    pub(super) fn new(gram: &DMatrix<f64>, times: f64) -> Self {
        let size = gram.nrows() - 1;
        let mut information = gram.view((0, 0), (size, size)).into_owned() / times;
        information.fill_lower_triangle_with_upper_triangle();
        for i in 0..size {
            information[(i, i)] = information[(i, i)] * (1.0 + 1e-9) + f64::MIN_POSITIVE;
        }
        Self { information, common: DVector::zeros(size), squares: 0.0, rows: 0.0 }
    }

    /// One row and its error.
    pub(super) fn add(&mut self, row: &[f64], error: f64) {
        let row = DVector::from_column_slice(row);
        self.information.ger(1.0, &row, &row, 1.0);
        self.common.axpy(error, &row, 1.0);
        self.squares += error * error;
        self.rows += 1.0;
    }

    /// `None` where rounding prevents a result.
    pub(super) fn evidence(self) -> Option<Left> {
        let factor = self.information.cholesky()?;
        let left = self.squares - self.common.dot(&factor.solve(&self.common));
        let log_volume = 2.0 * factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        (left.is_finite() && log_volume.is_finite()).then_some(Left {
            left: left.max(0.0),
            log_volume,
            rows: self.rows,
        })
    }
}
