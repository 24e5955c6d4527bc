//! N4SID and MOESP: states from the projection of future outputs on the past, for data without feedback.

use faer::Mat;
use nalgebra::DMatrix;

use super::innovations::column_norms;
use super::recordings::{Factor, Layout};
use super::single::solve;

/// The directions of the past in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Weight {
    /// All of the past: N4SID.
    Past,
    /// The part of the past orthogonal to future inputs: MOESP with past inputs and outputs as instruments.
    PastBesideInputs,
}

/// The part of `horizon` = past future outputs explained by the past given the future inputs: (past·l) × past window. Also the right factor of its weight.
///
/// From the factor of twice the past. For the row at t, the instant t − past has lags past+1 … 2·past as its past and 1 … past as its future.
pub(super) fn oblique(double: &Factor, weight: Weight) -> (DMatrix<f64>, DMatrix<f64>) {
    let Layout { m, l, past } = double.layout;
    let (width, s) = (m + l, past / 2);
    let past_columns: Vec<usize> = (s * width..2 * s * width).collect();
    // Lags s … 1 of the outputs: the instant itself first.
    let outputs: Vec<usize> =
        (0..s).rev().flat_map(|lag| (0..l).map(move |i| lag * width + m + i)).collect();
    let inputs: Vec<usize> =
        (0..s).rev().flat_map(|lag| (0..m).map(move |i| lag * width + i)).collect();
    // Inputs, past, outputs; one triangular factor of the three.
    let ordered: Vec<usize> = inputs.iter().chain(&past_columns).chain(&outputs).copied().collect();
    let chosen = double.r.select_columns(&ordered);
    let qr = Mat::from_fn(chosen.nrows(), chosen.ncols(), |i, j| chosen[(i, j)]).qr();
    let r = qr.R();
    let (mi, w) = (inputs.len(), past_columns.len());
    let block = |from: usize, rows: usize, column: usize, columns: usize| {
        DMatrix::from_fn(rows, columns, |i, j| {
            if from + i <= column + j && from + i < r.nrows() {
                r[(from + i, column + j)]
            } else {
                0.0
            }
        })
    };
    // Behind the inputs: past and outputs with the inputs projected out.
    let (own, seen) = (block(mi, w, mi, w), block(mi, w, mi + w, outputs.len()));
    let (coefficients, _) = solve(&own, &seen, &column_norms(&block(0, mi + w, mi, w)));
    let right = match weight {
        Weight::Past => block(0, mi + w, mi, w),
        Weight::PastBesideInputs => own,
    };
    (coefficients.transpose(), right)
}
