//! The nuisances of one record, integrated out alike in all rivals: the initial state with a prior N(0, P) on its deviation, and commands that react to the
//! noise of their own sample.

use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::diagnose::baseline::noise::Noise;
use crate::diagnose::input::record::{LogRecord, Span};

/// The nuisances of one record.
#[derive(Debug, Clone)]
pub(super) struct Nuisances {
    /// ∂y/∂x0, samples × outputs per free state; then the regressors of feedback without a delay.
    raw: Arc<Vec<DMatrix<f64>>>,
    /// How many of them are states; the others have no prior.
    states: usize,
    /// W: the same whitened, as columns.
    whitened: Arc<DMatrix<f64>>,
    /// (P⁻¹ + WᵀW)⁻¹Wᵀ is applied with this factor.
    factor: Option<Cholesky<f64, Dyn>>,
}

/// What a whitened residual a has in common with the nuisances: Wᵀa and (P⁻¹ + WᵀW)⁻¹Wᵀa.
pub(super) type Common = (DVector<f64>, DVector<f64>);

impl Nuisances {
    /// From the responses of the outputs, the first `states` of them to the start.
    pub(super) fn new(raw: Vec<DMatrix<f64>>, states: usize, record: &LogRecord, noise: &Noise, prior: &[f64]) -> Self {
        let raw = Arc::new(raw);
        Self { raw, states, whitened: Arc::new(DMatrix::zeros(0, 0)), factor: None }.with_noise(record, noise, prior)
    }

    pub(super) fn with_noise(&self, record: &LogRecord, noise: &Noise, prior: &[f64]) -> Self {
        let rows = record.time_s.len() * record.measured.len();
        let mut whitened = DMatrix::zeros(rows, self.raw.len());
        for (mut column, raw) in whitened.column_iter_mut().zip(self.raw.iter()) {
            column.copy_from_slice(noise.whiten(record, record.train, raw).as_slice());
        }
        Self { whitened: Arc::new(whitened), ..self.clone() }.with_prior(prior)
    }

    pub(super) fn with_prior(&self, prior: &[f64]) -> Self {
        let factor = (self.whitened.tr_mul(&self.whitened) + self.precision(prior)).cholesky();
        Self { factor, ..self.clone() }
    }

    /// W, of the training span.
    pub(super) fn whitened(&self) -> &DMatrix<f64> {
        &self.whitened
    }

    /// P⁻¹; regressors without a prior get next to none, so that the sum can be factored.
    pub(super) fn precision(&self, prior: &[f64]) -> DMatrix<f64> {
        // Of several starts each has the same prior.
        let known = prior.iter().filter(|s| **s > 0.0).map(|s| 1.0 / (s * s)).cycle().take(self.states);
        let loose = self.raw.len() - self.states;
        let all: Vec<f64> = known.chain(std::iter::repeat_n(1e-9, loose)).collect();
        DMatrix::from_diagonal(&DVector::from_vec(all))
    }

    pub(super) fn is_empty(&self) -> bool {
        self.raw.is_empty()
    }

    /// The factor, where a whitened residual has anything in common with the nuisances.
    fn factor_for(&self, a: &DVector<f64>) -> Option<&Cholesky<f64, Dyn>> {
        self.factor.as_ref().filter(|_| !a.is_empty() && self.whitened.ncols() > 0)
    }

    /// What a whitened residual has in common with the nuisances; `None` without any.
    pub(super) fn projected(&self, a: &DVector<f64>) -> Option<Common> {
        let factor = self.factor_for(a)?;
        let by_start = self.whitened.tr_mul(a);
        let solved = factor.solve(&by_start);
        Some((by_start, solved))
    }

    /// (I + W P Wᵀ)⁻¹a.
    pub(super) fn reduced(&self, a: &DVector<f64>) -> DVector<f64> {
        match self.factor_for(a) {
            Some(factor) => a - &*self.whitened * factor.solve(&self.whitened.tr_mul(a)),
            None => a.clone(),
        }
    }

    /// The posterior mean, given the whitened residual of the training span.
    pub(super) fn posterior(&self, e: &DVector<f64>) -> Option<DVector<f64>> {
        Some(self.factor.as_ref()?.solve(&self.whitened.tr_mul(e)))
    }

    /// The same, given that of another span.
    pub(super) fn posterior_in(
        &self,
        span: Span,
        e: &DVector<f64>,
        record: &LogRecord,
        noise: &Noise,
        prior: &[f64],
    ) -> Option<DVector<f64>> {
        let column = |raw: &DMatrix<f64>| DVector::from_column_slice(noise.whiten(record, Some(span), raw).as_slice());
        let w = DMatrix::from_columns(&self.raw.iter().map(column).collect::<Vec<_>>());
        let information = w.tr_mul(&w) + self.precision(prior);
        Some(information.cholesky()?.solve(&w.tr_mul(e)))
    }

    /// Moves predictions by the start's deviation; feedback moves a residual but is no part of what a model predicts.
    pub(super) fn add_starts(&self, y: &mut DMatrix<f64>, deviation: &DVector<f64>) {
        for (raw, by) in self.raw.iter().zip(deviation.iter()).take(self.states) {
            *y += raw * *by;
        }
    }
}
