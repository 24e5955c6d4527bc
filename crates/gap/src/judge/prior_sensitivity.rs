//! Sensitivity of a verdict to the prior of the initial state.
//!
//! A wrong initial state and a constant offset at input, state or sensor are aliases over one log. The prior of the initial state decides which of them is
//! named. The leaders are therefore compared again with the initial state known ten times better and ten times worse, state by state. Where another hypothesis
//! leads, or none does, the state joins the class of indistinguishable causes. If no effect was named, the signatures of all candidates are compared, because
//! no fit contains the part that the initial state absorbed.

use crate::hypothesis::direction::{NEAR, between, difference, with};
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::penalised_gain::Penalties;
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use crate::search::catalogue_search::SearchResult;
use deadtime_model::effect::{Applied, Scales};
use deadtime_model::simulate::Port;
use deadtime_signal::parallel;

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
    let residuals: Vec<Option<Whitened>> = parallel::map(rivals.iter(), |e| likelihood.whitened(e));
    let signatures = if best.is_none() {
        signatures(likelihood, &nominal, catalogue, scales)
    } else {
        Vec::new()
    };
    let comparison = Comparison {
        penalties: Penalties::of(likelihood),
        nominal,
        rivals,
        residuals,
        signatures,
        best,
    };
    let prior = likelihood.prior();
    let states = likelihood.system.states.iter().enumerate().filter(|(j, _)| prior[*j] > 0.0);
    let factors = [likelihood.criteria.prior_factor.recip(), likelihood.criteria.prior_factor];
    let sensitivity = |(state, port): (usize, &Port)| {
        let instead = factors.iter().find_map(|factor| {
            let mut other = prior.to_vec();
            other[state] *= factor;
            comparison.instead(&likelihood.with_prior(other))
        })?;
        Some(PriorSensitivity { state: port.name.clone(), instead })
    };
    states.filter_map(sensitivity).collect()
}

/// The competing hypotheses, compared again under other priors.
struct Comparison<'b> {
    penalties: Penalties,
    nominal: Whitened,
    rivals: Vec<Hypothesis>,
    /// Per competing hypothesis; `None`: cannot be simulated.
    residuals: Vec<Option<Whitened>>,
    /// Of all candidates, where no effect leads.
    signatures: Vec<(Applied, Whitened)>,
    best: Option<&'b Hypothesis>,
}

impl Comparison<'_> {
    /// The effects that lead under this prior in place of the verdict's; `None` where the verdict stays.
    fn instead(&self, likelihood: &Likelihood<'_>) -> Option<Vec<Applied>> {
        let Some(best) = self.best else {
            return self.newly_visible(likelihood).map(|applied| vec![applied.clone()]);
        };
        let penalties = &self.penalties;
        let again = self.rescored(likelihood);
        let lead = penalties.leader(&again).filter(|e| penalties.gain(e) > 0.0);
        let as_before = lead.is_some_and(|lead| {
            let own = again.iter().find(|e| e.key() == best.key());
            own.is_some_and(|own| {
                penalties.gain(own) > penalties.gain(lead) - penalties.slack(lead.gain)
            })
        });
        (!as_before).then(|| lead.map(|e| e.effects.clone()).unwrap_or_default())
    }

    /// The candidate with the largest predicted cost reduction, where that exceeds the search-wide bar by a margin.
    fn newly_visible(&self, likelihood: &Likelihood<'_>) -> Option<&Applied> {
        // Something that was just below the search-wide bar and now is just above it is no other verdict.
        let promise = |s: &Whitened| {
            likelihood.inner(s, &self.nominal).powi(2)
                / likelihood.inner(s, s).max(f64::MIN_POSITIVE)
        };
        let most =
            self.signatures.iter().map(|(a, s)| (promise(s), a)).max_by(|a, b| a.0.total_cmp(&b.0));
        most.filter(|(promise, _)| {
            *promise > likelihood.criteria.newly_visible * likelihood.criteria.selection_penalty
        })
        .map(|(_, applied)| applied)
    }

    /// The competing hypotheses with their gains under this prior, without a refit.
    fn rescored(&self, likelihood: &Likelihood<'_>) -> Vec<Hypothesis> {
        let cost = likelihood.inner(&self.nominal, &self.nominal);
        let mut again = self.rivals.clone();
        for (e, residual) in again.iter_mut().zip(&self.residuals) {
            let price = e.lost.as_ref().map_or(0.0, |l| l.price);
            e.gain = residual
                .as_ref()
                .map_or(f64::NEG_INFINITY, |w| cost - likelihood.inner(w, w) - price);
        }
        again
    }
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
    parallel::filter_map(catalogue.iter(), one)
}
