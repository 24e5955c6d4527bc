//! A linear-quadratic regulator, and the checks of its weights.

use deadtime_signal::decompositions::symmetric_eigen;
use nalgebra::{Complex, DMatrix};

use crate::error::ModelError;
use crate::shape::check_matrix;

/// A linear-quadratic regulator.
#[derive(Debug, Clone, PartialEq)]
pub struct Lqr {
    /// The gain of u = −K x, m×n.
    pub k: DMatrix<f64>,
    /// The stabilising solution of the Riccati equation, n×n, symmetric.
    pub x: DMatrix<f64>,
    /// The poles of A − B K.
    pub poles: Vec<Complex<f64>>,
}

/// Checks the shapes A n×n, B n×m, Q n×n, R m×m and N n×m, finite entries, and symmetric weights.
pub(super) fn check_weights([a, b, q, r, n]: [&DMatrix<f64>; 5]) -> Result<(), ModelError> {
    let (order, inputs) = (a.nrows(), b.ncols());
    for (matrix, got, rows, columns) in [
        ("A", a, order, order),
        ("B", b, order, inputs),
        ("Q", q, order, order),
        ("R", r, inputs, inputs),
        ("N", n, order, inputs),
    ] {
        check_matrix(matrix, got, (rows, columns))?;
    }
    for (matrix, weight) in [("Q", q), ("R", r)] {
        let tolerance = 1e-10 * weight.norm();
        for j in 0..weight.ncols() {
            for i in 0..j {
                let difference = (weight[(i, j)] - weight[(j, i)]).abs();
                if difference > tolerance {
                    let (row, column) = (i + 1, j + 1);
                    return Err(ModelError::NotSymmetric { matrix, row, column, difference });
                }
            }
        }
    }
    Ok(())
}

/// (M + Mᵀ)/2.
pub(super) fn symmetric(m: DMatrix<f64>) -> DMatrix<f64> {
    (&m + m.transpose()) * 0.5
}

/// The smallest eigenvalue of a symmetric matrix; infinite where the decomposition fails.
pub(super) fn smallest_eigenvalue(m: &DMatrix<f64>) -> f64 {
    let found = symmetric_eigen(&symmetric(m.clone()));
    found.map_or(f64::INFINITY, |e| e.eigenvalues.iter().copied().fold(f64::INFINITY, f64::min))
}
