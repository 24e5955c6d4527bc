//! The residuals of a hypothesis on the training logs, and their size.

use nalgebra::DMatrix;

use super::effects::Hypothesis;
use super::penalised_gain::Penalties;
use crate::likelihood::active_effects::{ActiveEffects, NO_EFFECT};
use crate::likelihood::errors::Errors;
use crate::likelihood::gaussian::Likelihood;
use crate::likelihood::residuals::residuals;
use deadtime_model::effect::Applied;

/// Residuals of one hypothesis with their sizes.
pub(crate) struct Level {
    pub(crate) hypothesis: Option<Hypothesis>,
    pub(crate) residuals: Vec<DMatrix<f64>>,
    pub(crate) train: Errors,
    /// Mean square of the whitened residuals: the error under noise of its colour.
    pub(crate) white: f64,
}

impl Level {
    pub(crate) fn of(likelihood: &Likelihood<'_>, hypothesis: Option<&Hypothesis>) -> Option<Self> {
        let residuals = residuals(likelihood, hypothesis.map_or(NO_EFFECT, ActiveEffects::from))?;
        let train = Errors::trained(likelihood.records, &residuals);
        let white = white(likelihood, &residuals);
        Some(Self { hypothesis: hypothesis.cloned(), residuals, train, white })
    }

    /// Training errors and residuals as large as they would be had no noise been followed.
    pub(crate) fn noise(&self, likelihood: &Likelihood<'_>) -> (Errors, Vec<DMatrix<f64>>) {
        let larger = self.hypothesis.as_ref().map_or(1.0, |e| e.noise_over_left(likelihood));
        (self.train.clone().times(larger), self.residuals.iter().map(|r| r * larger).collect())
    }

    pub(crate) fn gain(&self) -> f64 {
        self.hypothesis.as_ref().map_or(0.0, |e| e.gain)
    }

    pub(crate) fn penalised_gain(&self, penalties: &Penalties) -> f64 {
        self.hypothesis.as_ref().map_or(0.0, |e| penalties.gain(e))
    }

    /// Noise decides single samples: its lattice speaks for it.
    pub(crate) fn is_chance(&self) -> bool {
        self.hypothesis
            .as_ref()
            .is_some_and(|e| e.effects.iter().any(|a| a.effect.leaves_residual()))
    }

    /// Training errors without the effects whose single samples noise decides: on a lattice of values, a small change of any parameter moves many samples.
    pub(crate) fn smooth(&self, likelihood: &Likelihood<'_>) -> Option<Errors> {
        let Some(hypothesis) = self.hypothesis.as_ref().filter(|_| self.is_chance()) else {
            return Some(self.train.clone());
        };
        let effects: Vec<Applied> =
            hypothesis.effects.iter().filter(|a| !a.effect.leaves_residual()).cloned().collect();
        let active = ActiveEffects::from(hypothesis).with(&effects);
        Some(Errors::trained(likelihood.records, &residuals(likelihood, active)?))
    }

    pub(crate) fn size(&self) -> usize {
        self.hypothesis.as_ref().map_or(0, |e| e.effects.len())
    }
}

/// Mean square of the whitened training residuals.
fn white(likelihood: &Likelihood<'_>, residuals: &[DMatrix<f64>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for ((at, record), residual) in likelihood.records.iter().enumerate().zip(residuals) {
        let Some(inside) = record.train else { continue };
        sum += likelihood.whiten_in(at, residual, inside).norm_squared();
        let there = |i: usize| {
            (0..record.time_s.len())
                .filter(move |&k| record.measured_in(Some(inside), i, k).is_some())
                .count()
        };
        count += (0..record.measured.len()).map(there).sum::<usize>();
    }
    sum / count.max(1) as f64
}
