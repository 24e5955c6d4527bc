//! Where a fit of a structured model ended.

use deadtime_signal::fit::{Fit, Normal};
use nalgebra::DMatrix;

/// One fit: where it ended and what the answer needs.
pub(super) struct Fitted {
    pub(super) z: Vec<f64>,
    pub(super) fit: Fit,
    pub(super) clusters: Vec<Normal>,
    /// λ of each unknown.
    pub(super) prior: Vec<f64>,
    pub(super) shrinkage: f64,
    pub(super) covariance: DMatrix<f64>,
    /// The information, deflated by how much the windows' errors repeat each other.
    pub(super) information: DMatrix<f64>,
    pub(super) substeps: usize,
    /// Dead times of other minima that the logs do not distinguish from this one, s: a list each, in the order of the free ones.
    pub(super) alike: Vec<Vec<f64>>,
}
