//! Sensitivity of a verdict to the prior of the initial state.
//!
//! A wrong initial state and a constant offset at input, state or sensor are aliases over one log. The prior of the initial state decides which of them is
//! named. The leaders are therefore compared again with the initial state known ten times better and ten times worse, state by state. Where another hypothesis
//! leads, or none does, the state joins the class of indistinguishable causes. If no effect was named, the signatures of all candidates are compared, because
//! no fit contains the part that the initial state absorbed.

use rayon::prelude::*;

use crate::hypothesis::direction::{NEAR, between, difference, with};
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::penalised_gain::Penalties;
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use crate::search::catalogue_search::SearchResult;
use deadtime_model::effect::{Applied, Scales};

/// The leading hypothesis under a tighter or wider prior of an initial state.
pub(crate) struct PriorSensitivity {
    /// The state.
    pub(crate) state: String,
    /// The effects that lead then; none: no effect.
    pub(crate) instead: Vec<Applied>,
}

/// The states on whose prior the lead hangs, `best` being what leads.
pub(crate) fn prior_sensitivities(
    likelihood: &Likelihood<'_>,
    found: &SearchResult,
    best: Option<&Hypothesis>,
    catalogue: &[Applied],
    scales: &Scales,
) -> Vec<PriorSensitivity> {
    let penalties = Penalties::of(likelihood);
    // Only hypotheses of the verdict's size, and single effects where there is none.
    let rivals: Vec<Hypothesis> = match best.map_or(0, |b| b.effects.len()) {
        2 => &found.pairs,
        _ => &found.singles,
    }
    .iter()
    .filter(|e| e.fitted)
    .take(likelihood.budget.rivals)
    .cloned()
    .collect();
    let Some(nominal) = likelihood.whitened(NO_EFFECT) else { return Vec::new() };
    let residuals: Vec<Option<Whitened>> =
        rivals.par_iter().map(|e| likelihood.whitened(e)).collect();
    let prior = likelihood.prior().to_vec();
    let signatures = if best.is_none() {
        signatures(likelihood, &nominal, catalogue, scales)
    } else {
        Vec::new()
    };
    let mut sensitivities = Vec::new();
    for (state, port) in
        likelihood.system.states.iter().enumerate().filter(|(j, _)| prior[*j] > 0.0)
    {
        for factor in [likelihood.criteria.prior_factor.recip(), likelihood.criteria.prior_factor] {
            let mut other = prior.clone();
            other[state] *= factor;
            let likelihood = likelihood.with_prior(other);
            let cost = likelihood.inner(&nominal, &nominal);
            let mut again = rivals.clone();
            for (e, residual) in again.iter_mut().zip(&residuals) {
                let price = e.lost.as_ref().map_or(0.0, |l| l.price);
                e.gain = residual
                    .as_ref()
                    .map_or(f64::NEG_INFINITY, |w| cost - likelihood.inner(w, w) - price);
            }
            let lead = penalties.leader(&again).filter(|e| penalties.gain(e) > 0.0);
            let as_before = match (lead, best) {
                (_, None) => {
                    // Something that was just below the search-wide bar and now is just above it is no other verdict.
                    let promise = |s: &Whitened| {
                        likelihood.inner(s, &nominal).powi(2)
                            / likelihood.inner(s, s).max(f64::MIN_POSITIVE)
                    };
                    let most = signatures
                        .iter()
                        .map(|(a, s)| (promise(s), a))
                        .max_by(|a, b| a.0.total_cmp(&b.0));
                    if let Some((_, applied)) = most.filter(|(promise, _)| {
                        *promise
                            > likelihood.criteria.newly_visible
                                * likelihood.criteria.selection_penalty
                    }) {
                        sensitivities.push(PriorSensitivity {
                            state: port.name.clone(),
                            instead: vec![applied.clone()],
                        });
                        break;
                    }
                    true
                }
                (None, Some(_)) => false,
                (Some(lead), Some(best)) => {
                    let own = again.iter().find(|e| e.key() == best.key());
                    own.is_some_and(|own| {
                        penalties.gain(own) > penalties.gain(lead) - penalties.slack(lead.gain)
                    })
                }
            };
            if !as_before {
                sensitivities.push(PriorSensitivity {
                    state: port.name.clone(),
                    instead: lead.map(|e| e.effects.clone()).unwrap_or_default(),
                });
                break;
            }
        }
    }
    sensitivities
}

/// How every candidate of one parameter moves the residual, small.
fn signatures(
    likelihood: &Likelihood<'_>,
    nominal: &Whitened,
    catalogue: &[Applied],
    scales: &Scales,
) -> Vec<(Applied, Whitened)> {
    let one = |applied: &Applied| {
        let start = likelihood
            .first_guesses(applied, scales)
            .into_iter()
            .next()
            .filter(|s| s.len() == 1)?;
        let there = likelihood.whitened(&[with(applied, &between(applied, &start, NEAR))])?;
        Some((applied.clone(), difference(nominal, &there, 1.0)))
    };
    catalogue.par_iter().filter_map(one).collect()
}
