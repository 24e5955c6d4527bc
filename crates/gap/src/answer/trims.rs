//! Constants among the effects that may differ between logs: their declaration as nuisances, and the test whether they differ.
//!
//! Every log gets its own value of the constant; all other parameters stay common. One Gauss-Newton step from the common value gives the values, first under white noise.
//! A noise model fitted to the residual of a wrong common value has a long correlation length and hides the difference.
//! A second step follows under the noise model of the residual of the separate values.
//!
//! How it can be wrong: where a cause is not found, the constant absorbs the cause's effect in each log, and differs for that reason.

use nalgebra::{DMatrix, DVector};

use super::log_by_log::Common;
use crate::baseline::noise::Noise;
use crate::format::caveat::{Caveat, Constancy};
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::slopes::information;
use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::errors::Errors;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use crate::search::catalogue_search::noise_in;
use deadtime_model::effect::{Applied, Scales};
use deadtime_signal::text::plus_minus;

/// The caveats on the found constants. A simulator that can only be called gets none: it has no model file for the declaration.
pub(crate) fn constant_caveats(
    likelihood: &Likelihood<'_>,
    found: Option<&Hypothesis>,
    scales: &Scales,
    smallest: &[f64],
) -> Vec<Caveat> {
    let Some(found) = found.filter(|_| !likelihood.system.is_black_box()) else {
        return Vec::new();
    };
    let of = |(place, applied): (usize, &Applied)| {
        let (effect, channel) = (applied.effect.name().to_owned(), applied.channel.clone());
        let constancy = Trims { likelihood, found, place, scales }.constancy(smallest);
        Caveat::Constant { effect, channel, constancy }
    };
    found.effects.iter().enumerate().filter(|(_, a)| a.effect.is_constant()).map(of).collect()
}

/// A constant of a hypothesis with a value for every log.
struct Trims<'t, 'a> {
    likelihood: &'t Likelihood<'a>,
    found: &'t Hypothesis,
    /// Its place among the effects.
    place: usize,
    scales: &'t Scales,
}

impl Trims<'_, '_> {
    /// `NotKnown` of one log alone.
    fn constancy(&self, smallest: &[f64]) -> Constancy {
        let logs = self.logs();
        let compared = || {
            let (values, covariance) = self.values(&logs, smallest)?;
            let common = Common::of(&values, &covariance)?;
            let each = logs.iter().enumerate().map(|(i, &at)| {
                let value = plus_minus(values[i], covariance[(i, i)].sqrt());
                format!("{value} in {}", self.likelihood.records[at].name)
            });
            Some(match common.differs() {
                true => Constancy::Differs { values: each.collect::<Vec<_>>().join(", ") },
                false => Constancy::Alike,
            })
        };
        if logs.len() < 2 { Constancy::NotKnown } else { compared().unwrap_or(Constancy::NotKnown) }
    }

    fn logs(&self) -> Vec<usize> {
        (0..self.likelihood.records.len())
            .filter(|&at| self.likelihood.records[at].train.is_some())
            .collect()
    }

    /// The values log by log with their covariance.
    fn values(&self, logs: &[usize], smallest: &[f64]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let common = *self.found.effects[self.place].values.first()?;
        let left = self.left(&vec![common; self.likelihood.records.len()])?;
        let rms = Errors::trained(self.likelihood.records, &left).rms();
        let std: Vec<f64> = rms.iter().zip(smallest).map(|(r, s)| r.max(*s)).collect();
        let white =
            self.likelihood.with_noise(vec![Noise::white(&std); self.likelihood.records.len()]);
        let (own, _) = self.step(&white, logs)?;
        let mut everywhere = vec![common; self.likelihood.records.len()];
        logs.iter().zip(own.iter()).for_each(|(&at, value)| everywhere[at] = *value);
        let coloured = self.likelihood.with_noise(noise_in(
            self.likelihood,
            &self.left(&everywhere)?,
            1.0,
            smallest,
        ));
        self.step(&coloured, logs)
    }

    /// Residuals of all records, each with its own value.
    fn left(&self, values: &[f64]) -> Option<Vec<DMatrix<f64>>> {
        let of = |(at, value): (usize, &f64)| {
            let mut effects = self.found.effects.clone();
            effects[self.place].values.iter_mut().for_each(|v| *v = *value);
            let active = ActiveEffects::from(self.found).with(&effects);
            let span = self.likelihood.records[at].estimated_from()?;
            Some(
                self.likelihood
                    .residual(at, &self.likelihood.predict_from_posterior(at, active, span)?),
            )
        };
        values.iter().enumerate().map(of).collect()
    }

    /// One Gauss-Newton step from the common value.
    fn step(
        &self,
        likelihood: &Likelihood<'_>,
        logs: &[usize],
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let slopes = self.found.slopes(likelihood, self.scales)?;
        let own = self.found.free.iter().position(|(e, _)| *e == self.place)?;
        let common = *self.found.effects[self.place].values.first()?;
        let prior = self.found.prior(likelihood);
        let mut columns: Vec<Whitened> = (logs.iter())
            .map(|&log| {
                slopes.columns[own]
                    .iter()
                    .enumerate()
                    .map(|(at, c)| if at == log { c.clone() } else { c * 0.0 })
                    .collect()
            })
            .collect();
        let mut known = vec![(0.0, 0.0); logs.len()];
        for (at, column) in slopes.columns.into_iter().enumerate().filter(|(at, _)| *at != own) {
            columns.push(column);
            known.extend(prior.get(at));
        }
        let gradient = DVector::from_fn(columns.len(), |i, _| {
            likelihood.inner(&columns[i], &slopes.residual) + known[i].0 * known[i].1
        });
        let covariance = information(likelihood, &columns, &known).cholesky()?.inverse();
        let step = -(&covariance * gradient);
        let values = step.rows(0, logs.len()).add_scalar(common);
        values
            .iter()
            .all(|v| v.is_finite())
            .then(|| (values, covariance.view((0, 0), (logs.len(), logs.len())).into_owned()))
    }
}
