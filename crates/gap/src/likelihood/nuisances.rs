//! The nuisances of one record, integrated out alike in all hypotheses. The first is the initial state with a prior N(0, P) on its deviation. The second are
//! the declared constants of the model file: a value per log, with a prior each. The third are commands that react to the noise of their own sample.
//!
//! How declared ones can be wrong:
//! - The response to a constant is linear. It is that of the nominal model, between half a standard deviation to either side of the value that fits this model
//!   best. The true response is nonlinear for a clock offset comparable to the outputs' time constants, and for a perturbation of a nonlinear model. The
//!   linearisation error at that best value is added to every hypothesis's predictions. A cause that moves the value by much leaves the remaining error.
//!   Reported values and held-out scores come from real simulations (`constants.rs`, `best_start.rs`).
//! - A constant absorbs a cause: with a wide prior a constant that is the same in all logs has almost no cost, log by log. A caveat reports values that are alike in
//!   all logs beyond chance, and estimates that the prior contradicts.
//! - A constant is an alias of the initial state: a sensor offset and the unknown initial value of an integrating state. The two share the difference by their priors; the sum is
//!   right, and the standard deviation of each is large.

use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::baseline::noise::Noise;
use crate::input::record::{LogRecord, Span};

/// The nuisances of one record.
#[derive(Debug, Clone)]
pub(super) struct Nuisances {
    raw: Arc<Responses>,
    /// W: the same whitened, as columns.
    whitened: Arc<DMatrix<f64>>,
    /// (P⁻¹ + WᵀW)⁻¹Wᵀ is applied with this factor.
    factor: Option<Cholesky<f64, Dyn>>,
}

/// How the outputs answer to nuisances, samples × outputs each.
#[derive(Debug, Clone, Default)]
pub(super) struct Responses {
    /// ∂y/∂x0, of each free state.
    pub(super) starts: Vec<DMatrix<f64>>,
    /// Per unit of the declared constants of the model file.
    pub(super) declared: Vec<DMatrix<f64>>,
    /// Standard deviations of the priors of those.
    pub(super) declared_std: Vec<f64>,
    /// The regressors of feedback without a delay, which have no prior.
    pub(super) feedback: Vec<DMatrix<f64>>,
}

impl Responses {
    /// With a prior.
    fn known(&self) -> impl Iterator<Item = &DMatrix<f64>> {
        self.starts.iter().chain(&self.declared)
    }

    pub(super) fn all(&self) -> impl Iterator<Item = &DMatrix<f64>> {
        self.known().chain(&self.feedback)
    }

    fn count(&self) -> usize {
        self.starts.len() + self.declared.len() + self.feedback.len()
    }

    /// Whitened over a span, as columns.
    pub(super) fn whitened(
        &self,
        record: &LogRecord,
        span: Option<Span>,
        noise: &Noise,
    ) -> DMatrix<f64> {
        let mut whitened =
            DMatrix::zeros(record.time_s.len() * record.measured.len(), self.count());
        for (mut column, raw) in whitened.column_iter_mut().zip(self.all()) {
            column.copy_from_slice(noise.whiten(record, span, raw).as_slice());
        }
        whitened
    }

    /// P⁻¹; regressors without a prior get next to none, so that the sum can be factored. `prior`: standard deviations of the start.
    pub(super) fn precision(&self, prior: &[f64]) -> DMatrix<f64> {
        // Several initial states have the same prior each.
        let starts = prior.iter().copied().filter(|s| *s > 0.0).cycle().take(self.starts.len());
        let known = starts.chain(self.declared_std.iter().copied()).map(|s| 1.0 / (s * s));
        let all: Vec<f64> = known.chain(std::iter::repeat_n(1e-9, self.feedback.len())).collect();
        DMatrix::from_diagonal(&DVector::from_vec(all))
    }
}

/// The projection of a whitened residual a on the nuisances: Wᵀa and (P⁻¹ + WᵀW)⁻¹Wᵀa.
pub(super) type Common = (DVector<f64>, DVector<f64>);

impl Nuisances {
    pub(super) fn new(raw: Responses, record: &LogRecord, noise: &Noise, prior: &[f64]) -> Self {
        Self { raw: Arc::new(raw), whitened: Arc::new(DMatrix::zeros(0, 0)), factor: None }
            .with_noise(record, noise, prior)
    }

    pub(super) fn with_noise(&self, record: &LogRecord, noise: &Noise, prior: &[f64]) -> Self {
        Self { whitened: Arc::new(self.raw.whitened(record, record.train, noise)), ..self.clone() }
            .with_prior(prior)
    }

    pub(super) fn with_prior(&self, prior: &[f64]) -> Self {
        let factor = (self.whitened.tr_mul(&self.whitened) + self.precision(prior)).cholesky();
        Self { factor, ..self.clone() }
    }

    /// P⁻¹.
    pub(super) fn precision(&self, prior: &[f64]) -> DMatrix<f64> {
        self.raw.precision(prior)
    }

    pub(super) fn raw(&self) -> &Responses {
        &self.raw
    }

    pub(super) fn is_empty(&self) -> bool {
        self.raw.count() == 0
    }

    /// The factor, where a whitened residual has anything in common with the nuisances.
    fn factor_for(&self, a: &DVector<f64>) -> Option<&Cholesky<f64, Dyn>> {
        self.factor.as_ref().filter(|_| !a.is_empty() && self.whitened.ncols() > 0)
    }

    /// The projection of a whitened residual on the nuisances; `None` without any.
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
        let w = self.raw.whitened(record, Some(span), noise);
        let information = w.tr_mul(&w) + self.precision(prior);
        Some(information.cholesky()?.solve(&w.tr_mul(e)))
    }

    /// Moves predictions by the deviations of the nuisances; feedback moves a residual but is no part of a prediction.
    pub(super) fn add_to(&self, y: &mut DMatrix<f64>, deviation: &DVector<f64>) {
        for (raw, by) in self.raw.known().zip(deviation.iter()) {
            *y += raw * *by;
        }
    }
}
