//! Steady-state Kalman filters, as regulators of transposed plants.

use nalgebra::{Complex, DMatrix};

use super::continuous::lqr;
use super::discrete::dlqr;
use super::regulator::Lqr;
use crate::error::ModelError;

/// A steady-state Kalman filter.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter {
    /// The predictor's gain, n×p: x̂⁺ = A x̂ + L (y − C x̂), or the corresponding one for the derivative.
    pub gain: DMatrix<f64>,
    /// The covariance of the prediction's error, n×n.
    pub covariance: DMatrix<f64>,
    /// The poles of A − L C.
    pub poles: Vec<Complex<f64>>,
}

impl Filter {
    fn of(dual: Lqr) -> Self {
        Self { gain: dual.k.transpose(), covariance: dual.x, poles: dual.poles }
    }
}

/// The Kalman filter of x(k+1) = A x(k) + w, y = C x + v. Covariances: Q of w (n×n), R of v (p×p), N between the two (n×p; `None`: 0). MATLAB: `dlqe` and
/// `kalman`; the predictor's gain is A times that of the update.
///
/// # Errors
/// As [`dlqr`], for the transposed plant.
pub fn dlqe(
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<Filter, ModelError> {
    dlqr(&a.transpose(), &c.transpose(), q, r, n).map(Filter::of)
}

/// The Kalman filter of ẋ = A x + w, y = C x + v, as MATLAB's `lqe`. Intensities: Q of w (n×n), R of v (p×p), N between the two (n×p; `None`: 0).
///
/// # Errors
/// As [`lqr`], for the transposed plant.
pub fn lqe(
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<Filter, ModelError> {
    lqr(&a.transpose(), &c.transpose(), q, r, n).map(Filter::of)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All parameters 1, by hand: P² = 2P + 1 in continuous time, P = P/(1 + P) + 1 in sampled time.
    #[test]
    fn the_scalar_filters_have_the_silver_and_the_golden_ratio_as_covariances() {
        let one = DMatrix::identity(1, 1);
        let silver = 1.0 + 2f64.sqrt();
        let filter = lqe(&one, &one, &one, &one, None).unwrap();
        assert!((filter.gain[(0, 0)] - silver).abs() < 1e-15);
        // P = P/(1 + P) + 1: the golden ratio, and the predictor's gain P/(1 + P).
        let filter = dlqe(&one, &one, &one, &one, None).unwrap();
        let golden = (1.0 + 5f64.sqrt()) / 2.0;
        assert!((filter.covariance[(0, 0)] - golden).abs() < 1e-15);
        assert!((filter.gain[(0, 0)] - golden / (1.0 + golden)).abs() < 1e-15);
    }
}
