//! One record of an output-error fit.

/// Work space for one record.
pub(super) struct Work<'a> {
    pub(super) u: &'a [f64],
    pub(super) y: &'a [f64],
    /// 1 where the output was measured, 0 elsewhere; `None`: all.
    pub(super) weight: Option<Vec<f64>>,
    pub(super) uf: Vec<f64>,
    pub(super) model: Vec<f64>,
    pub(super) wf: Vec<f64>,
    pub(super) impulse: Vec<f64>,
    pub(super) residual: Vec<f64>,
}
