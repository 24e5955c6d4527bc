//! Finite impulse responses with their covariance.

use nalgebra::{DMatrix, DVector};

use super::regression::{DEPENDENT, Rank, Record, Regression};

/// A finite impulse response estimated by least squares.
#[derive(Debug, Clone, PartialEq)]
pub struct Fir {
    /// h₀ … h_taps−1.
    pub coefficients: DVector<f64>,
    /// Their covariance, taps × taps.
    pub covariance: DMatrix<f64>,
    /// Residual variance, Σ e²/(rows − taps).
    pub variance: f64,
    /// Rows of the regression.
    pub rows: usize,
}

/// y(t) = Σ hᵢ u(t − i) + e(t), i < taps, over the rows that need no sample before the record.
///
/// Covariance: residual variance times the inverse Gram matrix, as MATLAB's `arx` with na = 0 reports.
/// Source: Ljung (1999), "System Identification", 2nd ed., section 4.2.
pub fn estimate(records: &[Record], taps: usize) -> Result<Fir, Rank> {
    let triangle = Regression { na: 0, lags: taps }.factor(records);
    let rank = (0..taps)
        .filter(|&i| {
            triangle.r[(i, i)].abs() > DEPENDENT * triangle.norms[i].max(f64::MIN_POSITIVE)
        })
        .count();
    if rank < taps || triangle.rows <= taps {
        return Err(Rank { rank: rank.min(triangle.rows), columns: taps });
    }
    let r = triangle.r.view((0, 0), (taps, taps)).into_owned();
    let target = triangle.r.view((0, taps), (taps, 1)).column(0).into_owned();
    let singular = Rank { rank, columns: taps };
    let coefficients = r.solve_upper_triangular(&target).ok_or(singular)?;
    let inverse = r.solve_upper_triangular(&DMatrix::identity(taps, taps)).ok_or(singular)?;
    let variance = triangle.r[(taps, taps)].powi(2) / (triangle.rows - taps) as f64;
    Ok(Fir {
        coefficients,
        covariance: &inverse * inverse.transpose() * variance,
        variance,
        rows: triangle.rows,
    })
}

/// A finite impulse response of `taps` coefficients, `None` where the input does not excite all of them (or the records are too short).
#[must_use]
pub fn fit(records: &[Record], taps: usize) -> Option<Fir> {
    estimate(records, taps).ok()
}
