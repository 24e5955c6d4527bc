//! The nuisances of the model file in every log, and what speaks against calling them that.
//!
//! How it can be wrong: a value is the most probable one given the reported effects, so a wrong cause moves it.
//! The standard deviation includes the uncertainty of the cause's parameters, not of its law.
//! A prior that is too wide lets a nuisance absorb a cause. The values are then alike in all logs, and a caveat reports that.

use nalgebra::{DMatrix, DVector};

use super::log_by_log::{APART, Common};
use crate::format::caveat::Caveat;
use crate::format::nuisance::NuisanceEstimate;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::shared_time::put;
use crate::hypothesis::slopes::information;
use crate::input::nuisance::Nuisance;
use crate::likelihood::active_effects::{ActiveEffects, NO_EFFECT};
use crate::likelihood::constants::Constants;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Scales};
use deadtime_signal::text::plus_minus;

/// Every nuisance in every log, given the reported effects; empty without nuisances, and where a simulation fails.
pub(crate) fn nuisance_estimates(
    likelihood: &Likelihood<'_>,
    found: Option<&Hypothesis>,
    scales: &Scales,
) -> Vec<NuisanceEstimate> {
    if likelihood.declared.is_empty() {
        return Vec::new();
    }
    let active = found.map_or(NO_EFFECT, ActiveEffects::from);
    let numbers = found.and_then(|found| Numbers::of(likelihood, found, scales));
    let logs: Vec<(usize, Constants)> = (0..likelihood.records.len())
        .filter_map(|at| Some((at, likelihood.constants_of(at, active)?)))
        .collect();
    let mut estimates = Vec::new();
    for (place, nuisance) in likelihood.declared.iter().enumerate() {
        for (at, constants) in &logs {
            let more = numbers
                .as_ref()
                .and_then(|n| n.variance(likelihood, *at, active, constants))
                .map_or(0.0, |v| v[place]);
            let applied = nuisance.at(constants.deviations[place]);
            let Some((parameter, value)) = applied.parameters.first().zip(applied.values.first())
            else {
                continue;
            };
            estimates.push(NuisanceEstimate {
                effect: applied.effect.name().to_owned(),
                channel: applied.channel.clone(),
                log: likelihood.records[*at].name.clone(),
                parameter: parameter.name.to_string(),
                unit: parameter.unit.clone(),
                value: *value,
                std: (constants.covariance[(place, place)] + more).sqrt(),
                prior_std: nuisance.std,
            });
        }
    }
    estimates.retain(|e| e.value.is_finite() && e.std.is_finite());
    estimates
}

/// The free parameters of the found effects.
struct Numbers {
    /// The same effects with one number moved a little, and by how much.
    moved: Vec<(Vec<Applied>, f64)>,
    covariance: DMatrix<f64>,
}

impl Numbers {
    fn of(likelihood: &Likelihood<'_>, found: &Hypothesis, scales: &Scales) -> Option<Self> {
        let slopes = found.slopes(likelihood, scales)?;
        let covariance = information(likelihood, &slopes.columns, &found.prior(likelihood))
            .cholesky()?
            .inverse();
        let moved = |&(e, i): &(usize, usize)| {
            let mut effects = found.effects.clone();
            let step = effects[e].parameters[i].derivative_step(effects[e].values[i], scales);
            put(&mut effects, (e, i), found.effects[e].values[i] + step);
            (effects, step)
        };
        Some(Self { moved: found.free.iter().map(moved).collect(), covariance })
    }

    /// Their contribution to the variances of a log's constants.
    fn variance(
        &self,
        likelihood: &Likelihood<'_>,
        at: usize,
        active: ActiveEffects<'_>,
        constants: &Constants,
    ) -> Option<DVector<f64>> {
        let span = likelihood.records[at].estimated_from()?;
        let here = likelihood.predict(at, active)?;
        let column = |(effects, step): &(Vec<Applied>, f64)| {
            let change = (&here - likelihood.predict(at, active.with(effects))?) / *step;
            Some(
                &constants.gain
                    * DVector::from_column_slice(
                        likelihood.whiten_in(at, &change, span).as_slice(),
                    ),
            )
        };
        let columns = self.moved.iter().map(column).collect::<Option<Vec<_>>>()?;
        let moves = if columns.is_empty() {
            DMatrix::zeros(constants.deviations.len(), 0)
        } else {
            DMatrix::from_columns(&columns)
        };
        Some((&moves * &self.covariance * moves.transpose()).diagonal())
    }
}

/// A value that its prior contradicts, and a nuisance that is alike in all logs.
pub(crate) fn nuisance_caveats(
    likelihood: &Likelihood<'_>,
    estimates: &[NuisanceEstimate],
) -> Vec<Caveat> {
    let of = |nuisance: &Nuisance| {
        let nominal = nuisance.at(0.0);
        let key = nominal.key();
        let own: Vec<&NuisanceEstimate> = estimates
            .iter()
            .filter(|e| e.effect == nominal.effect.name() && e.channel == nominal.channel)
            .collect();
        let about = nominal.values.first().copied().unwrap_or_default();
        let beyond = own.iter().filter(|e| (e.value - about).abs() > APART * e.prior_std);
        let worst =
            beyond.max_by(|a, b| (a.value - about).abs().total_cmp(&(b.value - about).abs()));
        let beyond = worst.map(|e| Caveat::NuisanceBeyondPrior {
            nuisance: key.clone(),
            value: plus_minus(e.value, e.std),
            log: e.log.clone(),
            std: e.prior_std.to_string(),
        });
        let values = DVector::from_iterator(own.len(), own.iter().map(|e| e.value - about));
        let variances = DVector::from_iterator(own.len(), own.iter().map(|e| e.std * e.std));
        let width = own.iter().map(|e| e.prior_std / e.std).fold(f64::INFINITY, f64::min);
        let alike = Common::of(&values, &DMatrix::from_diagonal(&variances))
            .filter(|common| common.value.abs() > APART * common.std && common.alike(width))
            .map(|common| Caveat::NuisanceAlike {
                nuisance: key,
                value: plus_minus(about + common.value, common.std),
            });
        [beyond, alike].into_iter().flatten().collect::<Vec<_>>()
    };
    likelihood.declared.iter().filter(|n| n.declared).flat_map(of).collect()
}
