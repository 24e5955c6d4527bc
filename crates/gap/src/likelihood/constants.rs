//! The constants that the model file declares as unknown anew in every log: what outputs do with them, and their values in a log.

use nalgebra::{DMatrix, DVector};

use super::active_effects::{ActiveEffects, NO_EFFECT};
use super::gaussian::Likelihood;
use super::nuisances::Responses;
use deadtime_model::effect::Applied;

/// Gauss-Newton steps to the values of a log: two where all is straight, and more for a clock.
const STEPS: usize = 6;
/// A step that moves no value by more than this part of its standard deviation is the last; 1.
const SETTLED: f64 = 0.01;

/// The constants of one log, given its samples and the active effects.
pub(crate) struct Constants {
    /// From the values at which they do nothing, in the order of the declaration.
    pub(crate) deviations: DVector<f64>,
    /// The covariance of the deviations, given the active effects.
    pub(crate) covariance: DMatrix<f64>,
    /// The derivative of the deviations by the whitened residual of their samples, deviations × rows.
    pub(crate) gain: DMatrix<f64>,
}

impl Likelihood<'_> {
    /// The active effects with the constants of a log at these deviations from the values without an effect.
    pub(super) fn with_constants(&self, effects: &[Applied], deviations: &[f64]) -> Vec<Applied> {
        let own = self
            .declared
            .iter()
            .zip(deviations)
            .filter(|(_, by)| **by != 0.0)
            .map(|(nuisance, by)| nuisance.at(*by));
        effects.iter().cloned().chain(own).collect()
    }

    /// The outputs of a real run with constants at these deviations, from the model's own initial state.
    fn run_with(
        &self,
        record: usize,
        active: ActiveEffects<'_>,
        deviations: &[f64],
    ) -> Option<DMatrix<f64>> {
        let y = self.run(record, active.with(&self.with_constants(active.effects, deviations)))?;
        Some(match self.way_back(record) {
            Some(back) => y + back,
            None => y,
        })
    }

    /// The responses about the constants that fit the nominal model best, and the linearisation error of a run with those constants. `None` without constants,
    /// and where the fit fails.
    pub(super) fn about_own_constants(
        &self,
        record: usize,
    ) -> Option<(Vec<DMatrix<f64>>, DMatrix<f64>)> {
        self.declared.first()?;
        let own = self.constants_of(record, NO_EFFECT)?.deviations;
        let responses = self.declared_responses(record, NO_EFFECT, own.as_slice())?;
        let mut bend = self.run_with(record, NO_EFFECT, own.as_slice())?
            - self.run_with(record, NO_EFFECT, &[])?;
        for (response, by) in responses.iter().zip(own.iter()) {
            bend -= response * *by;
        }
        Some((responses, bend))
    }

    /// Responses of the outputs per unit of each constant, straight between half a standard deviation to either side of these deviations.
    pub(super) fn declared_responses(
        &self,
        record: usize,
        active: ActiveEffects<'_>,
        deviations: &[f64],
    ) -> Option<Vec<DMatrix<f64>>> {
        let response = |(at, std): (usize, f64)| {
            let moved = |by: f64| {
                let there: Vec<f64> = deviations
                    .iter()
                    .enumerate()
                    .map(|(i, d)| if i == at { d + by } else { *d })
                    .collect();
                self.run_with(record, active, &there)
            };
            let response = (moved(0.5 * std)? - moved(-0.5 * std)?) / std;
            response.iter().all(|v| v.is_finite()).then_some(response)
        };
        self.declared.iter().map(|n| n.std).enumerate().map(response).collect()
    }

    /// The most probable constants of a log, jointly with its initial state, by simulations with the active effects; `None` where one fails.
    pub(crate) fn constants_of<'e>(
        &self,
        record: usize,
        active: impl Into<ActiveEffects<'e>>,
    ) -> Option<Constants> {
        let active = active.into();
        let (log, noise, own) =
            (&self.records[record], &self.noise[record], self.nuisances[record].raw());
        let (span, first, count) = (log.estimated_from()?, own.starts.len(), self.declared.len());
        let mut deviations = DVector::zeros(count);
        for _ in 0..STEPS {
            let declared = self.declared_responses(record, active, deviations.as_slice())?;
            let responses = Responses { declared, ..own.clone() };
            let w = responses.whitened(log, Some(span), noise);
            let factor = (w.tr_mul(&w) + responses.precision(&self.prior)).cholesky()?;
            let left =
                self.residual(record, &self.run_with(record, active, deviations.as_slice())?);
            let left = DVector::from_column_slice(noise.whiten(log, Some(span), &left).as_slice());
            let gain = factor.solve(&w.transpose()).rows(first, count).into_owned();
            let there = &gain * (left + w.columns(first, count) * &deviations);
            let covariance = factor.inverse().view((first, first), (count, count)).into_owned();
            let moves = (0..count)
                .any(|i| (there[i] - deviations[i]).abs() > SETTLED * covariance[(i, i)].sqrt());
            deviations = there;
            if !moves {
                return Some(Constants { deviations, covariance, gain });
            }
            if deviations.iter().any(|v| !v.is_finite()) {
                return None;
            }
        }
        None
    }
}
