//! The shape of matrices.

use nalgebra::DMatrix;

use super::error::ModelError;

/// Checks a matrix for this shape and finite entries.
pub(super) fn check_matrix(
    matrix: &'static str,
    got: &DMatrix<f64>,
    (rows, columns): (usize, usize),
) -> Result<(), ModelError> {
    let (got_rows, got_columns) = got.shape();
    if (got_rows, got_columns) != (rows, columns) {
        return Err(ModelError::Shape { matrix, rows, columns, got_rows, got_columns });
    }
    match got.iter().enumerate().find(|(_, v)| !v.is_finite()) {
        Some((at, &value)) => {
            let (row, column) = (at % rows + 1, at / rows + 1);
            Err(ModelError::NotFinite { matrix, row, column, value })
        }
        None => Ok(()),
    }
}
