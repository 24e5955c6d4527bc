//! The effect that explains most where none is called the cause: an engineer who is told `unknown` wants to know at least that.
//!
//! How it can be wrong: what lowers the error on the logs that it was fitted to describes those logs; what the likelihood prefers may leave the error as
//! large as it was, where noise with a long memory holds most of it. So it has to beat the search over the whole catalogue, and to take some of the error on
//! both parts of the data; of those that do the likelihood decides. It is no verdict: something else is left, which may be the cause of this, too.

use super::found_effects::found_effects;
use crate::diagnose::format::diagnosis::FoundEffect;
use crate::diagnose::hypothesis::penalised_gain::Penalties;
use crate::diagnose::input::record::LogRecord;
use crate::diagnose::judge::intervals;
use crate::diagnose::judge::rule::GapVerdict;
use crate::diagnose::judge::verdict::Judged;
use crate::diagnose::likelihood::active_effects::NO_EFFECT;
use crate::diagnose::likelihood::errors::{Errors, explained, overall};
use crate::diagnose::likelihood::gaussian::Likelihood;
use crate::diagnose::likelihood::residuals::residuals;
use crate::diagnose::search::catalogue_search::SearchResult;
use crate::effect::Scales;

/// Less of the explainable than this, on the training logs or on held-out data, is not worth a sentence.
const LEAST: f64 = 0.1;

/// The single effect that explains most of a gap, where the verdict is that no effect is its cause.
#[derive(Debug, Clone, PartialEq)]
pub struct LargestContributor {
    /// The effect, with its parameters and their intervals.
    pub effect: FoundEffect,
    /// The share of the explainable that it takes away on what was learnt from: (before² − after²)/(before² − floor²).
    pub learnt: f64,
    /// The same on held-out data.
    pub held_out: f64,
}

/// What explains most, where nothing is called the cause and something explains enough.
pub(in crate::diagnose) fn largest_contributor(
    likelihood: &Likelihood<'_>,
    judged: &Judged,
    found: &SearchResult,
    scales: &Scales,
) -> Option<LargestContributor> {
    if judged.verdict == GapVerdict::Effects {
        return None;
    }
    let penalties = Penalties::of(likelihood);
    let nothing = residuals(likelihood, NO_EFFECT)?;
    let shares = |residuals: &[nalgebra::DMatrix<f64>]| -> Option<[f64; 2]> {
        let share = |held: bool| {
            let span = |r: &LogRecord| if held { r.held } else { r.train };
            let (before, after) = (Errors::of(likelihood.records, &nothing, span), Errors::of(likelihood.records, residuals, span));
            explained(overall(&before.nrmse())?, overall(&after.nrmse())?, overall(&before.relative(&judged.floor.floor))?)
        };
        Some([share(false)?, share(true)?])
    };
    let mut helping = Vec::new();
    for hypothesis in found.singles.iter().filter(|e| e.fitted && penalties.gain(e) > 0.0) {
        let Some(taken) = residuals(likelihood, hypothesis).and_then(|left| shares(&left)) else { continue };
        if taken.iter().all(|share| *share > LEAST) {
            helping.push((hypothesis.clone(), taken));
        }
    }
    let hypotheses: Vec<_> = helping.iter().map(|(e, _)| e.clone()).collect();
    let best = penalties.leader(&hypotheses)?;
    let [learnt, held_out] = helping.iter().find(|(e, _)| e.key() == best.key())?.1;
    let estimate = intervals::estimate(likelihood, best, scales);
    let effect = found_effects(likelihood, best, estimate.as_ref()).into_iter().next()?;
    Some(LargestContributor { effect, learnt, held_out })
}
