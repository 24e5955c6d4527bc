//! Steps that pass the instants of requested states, which are read from the step's curve.

/// The step that passed the end of the last call.
#[derive(Debug, Clone)]
pub(super) struct Past {
    /// The state at its start; that at its end is the integrator's `next`.
    pub(super) from: Vec<f64>,
    /// Its start and end.
    pub(super) span: Option<(f64, f64)>,
    /// The end of the last call.
    pub(super) reached: f64,
}

impl Past {
    pub(super) fn new(n: usize) -> Self {
        Self { from: vec![0.0; n], span: None, reached: f64::NAN }
    }

    pub(super) fn keep(&mut self, start: f64, end: f64) {
        self.span = Some((start, end));
    }

    pub(super) fn forget(&mut self) {
        self.span = None;
    }
}
