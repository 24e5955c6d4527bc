//! The end of a fit of a structured model.

use deadtime_signal::fit::{Fit, Normal};
use nalgebra::DMatrix;

/// One fit: its end, and the data of the result.
pub(super) struct Fitted {
    pub(super) z: Vec<f64>,
    pub(super) fit: Fit,
    pub(super) clusters: Vec<Normal>,
    /// λ of each unknown.
    pub(super) prior: Vec<f64>,
    pub(super) shrinkage: f64,
    pub(super) covariance: DMatrix<f64>,
    /// The information, divided by the redundancy of the windows' errors.
    pub(super) information: DMatrix<f64>,
    pub(super) substeps: usize,
    /// Dead times of other minima that are indistinguishable from this one, s: a list each, in the order of the free ones.
    pub(super) alike: Vec<Vec<f64>>,
}
