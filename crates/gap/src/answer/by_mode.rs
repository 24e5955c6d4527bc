//! Held-out errors one step ahead, over horizons and in free run, for any mode of the diagnosis.
//!
//! How it can be wrong: the observer is that of the nominal model. A poor model therefore starts every horizon with an error; both columns contain it.

use std::num::NonZeroUsize;

use nalgebra::DMatrix;

use super::held_out::HeldOut;
use crate::baseline::predictor::Predictor;
use crate::format::diagnosis::Mode;
use crate::format::errors_by_mode::{BeforeAfter, ErrorsByMode, OverHorizon};
use crate::input::inputs::Inputs;
use crate::likelihood::active_effects::{ActiveEffects, NO_EFFECT};
use crate::likelihood::errors::overall;
use crate::likelihood::gaussian::Likelihood;
use crate::likelihood::residuals::simulated;
use deadtime_model::effect::Applied;

/// A model settles within so many of its slowest time constants (to 2 %).
const SETTLES: f64 = 4.0;
/// A free run whose error is so many standard deviations of the outputs has left all bounds.
const BOUNDED: f64 = 1e3;
/// A log holds so many horizons at least.
const HORIZONS: usize = 4;

/// The inputs of the error calculation.
pub(crate) struct ByMode<'m, 'a> {
    pub(crate) likelihood: &'m Likelihood<'a>,
    pub(crate) inputs: &'m Inputs,
    pub(crate) held: &'m HeldOut,
    /// The effects of the model that is written.
    pub(crate) written: &'m [Applied],
    /// Standard deviations of the noise, per output.
    pub(crate) floor: &'m [f64],
}

impl ByMode<'_, '_> {
    /// All modes; `own`: residuals of both models in the mode of the diagnosis.
    pub(crate) fn errors(&self, own: [&[DMatrix<f64>]; 2]) -> ErrorsByMode {
        let mode = self.likelihood.predictor.mode;
        let of_mode = |wanted: Mode| match wanted == mode {
            true => self.nrmse(own),
            false => self.under(&self.predictor(wanted)),
        };
        let called = self.likelihood.system.is_black_box();
        let bounded = |e: &BeforeAfter| e.before.max(e.after) < BOUNDED;
        let held = self.held.errors(self.likelihood.records, own[0]);
        ErrorsByMode {
            one_step: (!called).then(|| of_mode(Mode::Predictor)).flatten(),
            horizons: if called { Vec::new() } else { self.horizons() },
            free_run: of_mode(Mode::Simulation).filter(bounded),
            floor: overall(&held.relative(self.floor)),
        }
    }

    fn predictor(&self, mode: Mode) -> Predictor {
        let Likelihood { system, records, criteria, .. } = self.likelihood;
        let probed = self.inputs.probed.as_ref();
        Predictor::of(system, records, &self.inputs.poles, probed, Some(mode), criteria)
    }

    /// The slowest time constant and a tenth of it, if the logs hold several of them.
    fn horizons(&self) -> Vec<OverHorizon> {
        let records = self.likelihood.records;
        let sample_s = records.iter().map(|r| r.sample_time_s).fold(f64::INFINITY, f64::min);
        let samples = records.iter().map(|r| r.time_s.len()).min().unwrap_or(0);
        let slowest = self.inputs.poles.settling_s / SETTLES / sample_s;
        let mut steps: Vec<usize> = [0.1, 1.0].map(|part| (part * slowest).round() as usize).into();
        steps.dedup();
        let fits = |steps: &usize| *steps > 1 && *steps <= samples / HORIZONS;
        steps.into_iter().filter(fits).filter_map(|steps| self.over(steps)).collect()
    }

    fn over(&self, steps: usize) -> Option<OverHorizon> {
        let Likelihood { system, records, criteria, .. } = self.likelihood;
        let (own, poles) = (&self.inputs.model_effects, &self.inputs.poles);
        let horizon = NonZeroUsize::new(steps)?;
        let predictor = Predictor::over(horizon, system, own, records, poles, criteria).ok()?;
        let BeforeAfter { before, after } = self.under(&predictor)?;
        Some(OverHorizon { steps, before, after })
    }

    fn under(&self, predictor: &Predictor) -> Option<BeforeAfter> {
        let likelihood = self.likelihood.predicting(predictor, self.floor).ok()?;
        let written = ActiveEffects::from(self.written);
        let after = if self.written.is_empty() { NO_EFFECT } else { written };
        self.nrmse([&simulated(&likelihood, NO_EFFECT)?, &simulated(&likelihood, after)?])
    }

    fn nrmse(&self, residuals: [&[DMatrix<f64>]; 2]) -> Option<BeforeAfter> {
        let records = self.likelihood.records;
        let [before, after] = residuals.map(|r| overall(&self.held.errors(records, r).nrmse()));
        let finite = |v: &f64| v.is_finite();
        Some(BeforeAfter { before: before.filter(finite)?, after: after.filter(finite)? })
    }
}
