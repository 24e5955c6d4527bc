//! A small effect that is certain: it hardly changes the error, and the likelihood asks for it all the same.
//!
//! How it can be wrong: a simulator that is a little off everywhere gains likelihood by many effects, and the best of them is none of its causes; so the best
//! further effect beside it must promise little. Noise with a memory gains by chance; so the noise has the colour of the whole residual, and most blocks of
//! time must improve. What was fitted to the training logs may be theirs alone; so the gain must be there on held-out data, parameters and noise kept.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::composer::Composer;
use super::standing::{Standing, t_of};
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::penalised_gain::Penalties;
use crate::input::record::Span;
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::gaussian::Likelihood;
use crate::likelihood::residuals::residuals;
use crate::search::beside::Beside;
use crate::search::catalogue_search::SearchResult;
use deadtime_model::effect::Applied;

/// Blocks of held-out time.
const BLOCKS: usize = 10;

/// The leading single effect, where it is certain; the likelihood stands under noise of the nominal residual's colour, as does the composer.
pub(super) fn weak(
    likelihood: &Likelihood<'_>,
    found: &SearchResult,
    composer: &Composer<'_, '_>,
) -> Option<Hypothesis> {
    let (criteria, penalties) = (&likelihood.criteria, Penalties::of(likelihood));
    let plain: Vec<Hypothesis> = (found.singles.iter().filter(|e| e.fitted && !e.loses_commands()))
        .filter(|e| !e.effects.iter().any(|a| a.effect.leaves_residual()))
        .cloned()
        .collect();
    let leader = penalties.leader(&plain)?;
    // Every nominal parameter is a little off: where one explains as much, that is the simpler reason.
    let parameter = |e: &&Hypothesis| e.effects.iter().any(|a| a.effect.corrects_model());
    let most =
        plain.iter().filter(parameter).map(|e| penalties.gain(e)).fold(f64::NEG_INFINITY, f64::max);
    if parameter(&leader) || most > penalties.gain(leader) - criteria.equals {
        return None;
    }
    let nominal = likelihood.whitened(NO_EFFECT)?;
    let cost = likelihood.inner(&nominal, &nominal);
    let hypothesis = Hypothesis::refit(
        likelihood,
        leader.clone(),
        &composer.scales,
        cost,
        likelihood.budget.steps,
    )?;
    if hypothesis.gain - criteria.equals * hypothesis.further_parameters() as f64
        <= criteria.weak_gains
    {
        return None;
    }
    let nothing =
        Hypothesis { effects: Vec::new(), free: Vec::new(), gain: 0.0, fitted: false, lost: None };
    let before = Standing::of(likelihood, nothing, &composer.scales)?;
    // So are all of them together, as a gain of one part in a hundred is.
    if composer.numbers_explain(&hypothesis, &before) {
        return None;
    }
    let after = Standing::of(likelihood, hypothesis.clone(), &composer.scales)?;
    if after.better_by_t(&before) < criteria.weak_t {
        return None;
    }
    let (held_before, held_after) =
        (held_out(likelihood, &before.residuals), held_out(likelihood, &after.residuals));
    let gains: Vec<f64> = held_before.iter().zip(&held_after).map(|(b, a)| b - a).collect();
    if gains.iter().sum::<f64>() < criteria.weak_held_out || t_of(&gains) < criteria.weak_held_out_t
    {
        return None;
    }
    let beside = Beside::new(likelihood, &hypothesis, &composer.scales)?;
    let flexible = |a: &Applied| {
        a.parameters.iter().any(|p| p.role == deadtime_model::effect::Role::Frequency)
    };
    let further = (composer.candidates.par_iter())
        .filter(|a| {
            !flexible(a)
                && !a.effect.leaves_residual()
                && !a.effect.loses_commands()
                && a.key() != hypothesis.effects[0].key()
        })
        .filter_map(|a| composer.promise(likelihood, &beside, a))
        .map(|(promise, _)| promise)
        .reduce(|| 0.0, f64::max);
    let still_there = residuals(likelihood, &hypothesis)?
        .iter()
        .all(|r: &DMatrix<f64>| r.iter().all(|v| v.is_finite()));
    (further < criteria.weak_beside && still_there).then_some(hypothesis)
}

/// Squared whitened errors of blocks of held-out time.
fn held_out(likelihood: &Likelihood<'_>, residuals: &[DMatrix<f64>]) -> Vec<f64> {
    let held = likelihood.records.iter().filter(|r| r.held.is_some()).count().max(1);
    let count = BLOCKS.div_ceil(held);
    let mut blocks = Vec::new();
    for (at, record) in likelihood.records.iter().enumerate() {
        let Some(span) = record.held else { continue };
        let length = (span.to_s - span.from_s) / count as f64;
        let edge = |b: usize| if b == count { span.to_s } else { span.from_s + length * b as f64 };
        let whitened =
            likelihood.whiten_in(at, &residuals[at], Span { from_s: span.from_s, to_s: span.to_s });
        for block in 0..count {
            let inside = |k: usize| {
                record.time_s[k] >= edge(block)
                    && (record.time_s[k] < edge(block + 1) || block + 1 == count)
            };
            let rows = (0..record.time_s.len()).filter(|&k| inside(k));
            blocks.push(rows.map(|k| whitened.row(k).norm_squared()).sum());
        }
    }
    blocks
}
