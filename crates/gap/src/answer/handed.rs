//! The written model: the effects in the form that improves a simulation.
//!
//! The latent sequence of lost or late commands is decoded from the outputs. A future run has another, unknown sequence. A random draw of the sequence is as
//! far from the truth as the truth is from the mean. A fixed delay or a lag that fits best on average therefore replaces a latent sequence. The sequence is
//! dropped where neither lowers the error. An effect set that raises the held-out error is not written, at any share on the training logs. A delay that jumped
//! once need not jump again at the same time.
//!
//! How it can be wrong: the held-out data selects here, so a true reduction near 0 is overestimated; the reported reduction is never negative.

use super::held_out::HeldOut;
use crate::format::caveat::Caveat;
use crate::hypothesis::direction::with;
use crate::hypothesis::effects::Hypothesis;
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::errors::{Errors, overall};
use crate::likelihood::gaussian::Likelihood;
use crate::likelihood::residuals::simulated;
use deadtime_model::effect::{Applied, Lateness, Scales, row};
use deadtime_signal::parallel;

/// An alias of a latent sequence must lower the training error to this part of the nominal error; 1.
const HELPS: f64 = 0.98;
/// Aliases of a latent sequence.
const INSTEAD: [Lateness; 2] = [Lateness::Fixed, Lateness::Lag];

/// Effects as they are handed over.
pub(crate) struct HandedOver {
    pub(crate) effects: Vec<Applied>,
    /// The caveat where the written effects differ from the found ones.
    pub(crate) caveat: Option<Caveat>,
}

/// Training and held-out errors of simulations with effects, nothing decoded; `None` where the simulation fails.
fn errors(likelihood: &Likelihood<'_>, held: &HeldOut, effects: &[Applied]) -> Option<[f64; 2]> {
    let residuals = if effects.is_empty() {
        simulated(likelihood, NO_EFFECT)?
    } else {
        simulated(likelihood, effects)?
    };
    let learnt = Errors::trained(likelihood.records, &residuals);
    let held = held.errors(likelihood.records, &residuals);
    Some([learnt, held].map(|errors| overall(&errors.nrmse()).unwrap_or(0.0)))
}

/// The form of the found effects that improves a simulation.
pub(crate) fn in_a_form_that_helps(
    likelihood: &Likelihood<'_>,
    held_out: &HeldOut,
    found: Option<&Hypothesis>,
    scales: &Scales,
) -> HandedOver {
    let as_found = |effects: Vec<Applied>| HandedOver { effects, caveat: None };
    let Some(found) = found.filter(|e| !e.effects.is_empty()) else { return as_found(Vec::new()) };
    let Some([nominal, nominal_held]) = errors(likelihood, held_out, &[]) else {
        return as_found(found.effects.clone());
    };
    let names =
        |effects: &[Applied]| effects.iter().map(Applied::key).collect::<Vec<_>>().join(" and ");
    if !found.loses_commands() {
        let worse = errors(likelihood, held_out, &found.effects)
            .is_none_or(|[_, held]| held > nominal_held);
        return match worse {
            true => HandedOver {
                effects: Vec::new(),
                caveat: Some(Caveat::LeftOut { effects: names(&found.effects) }),
            },
            false => as_found(found.effects.clone()),
        };
    }
    let (hidden, plain): (Vec<Applied>, Vec<Applied>) =
        found.effects.iter().cloned().partition(|a| a.effect.loses_commands());
    let mut forms: Vec<(f64, Vec<Applied>)> = aliases(likelihood, &hidden, &plain, scales);
    forms.push((1.0, plain));
    let known: Vec<([f64; 2], Vec<Applied>)> = (forms.into_iter())
        .filter_map(|(factor, effects)| {
            let [learnt, held] = errors(likelihood, held_out, &effects)?;
            // The removal of a sequence needs no gain; an alias must lower the error by its factor.
            (held <= nominal_held).then_some(([learnt / factor, held], effects))
        })
        .filter(|([learnt, _], effects)| effects.is_empty() || *learnt <= nominal)
        .collect();
    let effects = known
        .into_iter()
        .min_by(|a, b| a.0[0].total_cmp(&b.0[0]))
        .map(|(_, effects)| effects)
        .unwrap_or_default();
    let instead: Vec<Applied> =
        effects.iter().filter(|a| hidden.iter().any(|h| h.channel == a.channel)).cloned().collect();
    let caveat = match instead
        .iter()
        .find(|a| a.effect.lateness().is_some_and(|late| INSTEAD.contains(&late)))
    {
        Some(a) => Caveat::HandedOver {
            effects: names(&hidden),
            instead: format!(
                "{} of {:.3} s",
                a.key(),
                a.values.first().copied().unwrap_or_default()
            ),
        },
        None => Caveat::LeftOut { effects: names(&hidden) },
    };
    HandedOver { effects, caveat: Some(caveat) }
}

/// Effect sets in which each alias replaces the latent sequences, fitted jointly with the other effects. Each set has the factor to which the training error
/// must fall.
fn aliases(
    likelihood: &Likelihood<'_>,
    hidden: &[Applied],
    plain: &[Applied],
    scales: &Scales,
) -> Vec<(f64, Vec<Applied>)> {
    let Some(cost) = likelihood.whitened(NO_EFFECT).map(|w| likelihood.inner(&w, &w)) else {
        return Vec::new();
    };
    let fitted = |late: &Lateness| {
        let mut begin = plain.to_vec();
        for one in hidden {
            let nominal =
                Applied::nominal(likelihood.system, late.effect().ok()?, &one.channel).ok()?;
            // The first guess with the lowest cost, given the other effects.
            let better = |start: &Vec<f64>| {
                let there: Vec<Applied> =
                    begin.iter().cloned().chain([with(&nominal, start)]).collect();
                likelihood.whitened(&there).map_or(f64::INFINITY, |w| likelihood.inner(&w, &w))
            };
            let guesses = likelihood.first_guesses(&nominal, scales);
            let costs: Vec<f64> = guesses.iter().map(better).collect();
            let best = (0..guesses.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b]))?;
            begin.push(with(&nominal, &guesses[best]));
        }
        begin.sort_by_key(|a| row(a.effect));
        let fitted = Hypothesis::fit(likelihood, &begin, scales, cost, likelihood.budget.steps)?;
        Some((HELPS, fitted.effects))
    };
    if likelihood.system.is_black_box() {
        INSTEAD.iter().filter_map(fitted).collect()
    } else {
        parallel::filter_map(INSTEAD.iter(), fitted)
    }
}
