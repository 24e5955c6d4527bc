//! The four matrices of a linear model.

use nalgebra::DMatrix;

/// The matrices of ẋ = A x + B u or x(k+1) = A x(k) + B u(k), y = C x + D u.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrices {
    /// n×n.
    pub a: DMatrix<f64>,
    /// n×m.
    pub b: DMatrix<f64>,
    /// p×n.
    pub c: DMatrix<f64>,
    /// p×m.
    pub d: DMatrix<f64>,
}
