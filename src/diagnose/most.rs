//! The effect that explains most where none is called the cause: an engineer who is told `unknown` wants to know at least that.
//!
//! How it can be wrong: what lowers the error on the logs that it was fitted to describes those logs; what the likelihood prefers may leave the error as
//! large as it was, where noise with a long memory holds most of it. So it has to beat the search over the whole catalogue, and to take some of the error on
//! both parts of the data; of those that do the likelihood decides. It is no verdict: something else is left, which may be the cause of this, too.

use super::diagnosis::FoundEffect;
use super::intervals;
use super::problem::{NOTHING, Problem};
use super::rank::{self, found_effects, odds};
use super::search::Found;
use super::shrink::{self, Errors, explained, together};
use super::verdict::{Judged, Verdict};
use crate::effect::Scales;

/// Less of the explainable than this, on the training logs or on held-out data, is not worth a sentence.
const LEAST: f64 = 0.1;

/// The single effect that explains most of a gap, where the verdict is that no effect is its cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Most {
    /// The effect, with its parameters and their intervals.
    pub effect: FoundEffect,
    /// The share of the explainable that it takes away on what was learnt from: (before² − after²)/(before² − floor²).
    pub learnt: f64,
    /// The same on held-out data.
    pub held_out: f64,
}

/// What explains most, where nothing is called the cause and something explains enough.
pub(super) fn most(problem: &Problem<'_>, judged: &Judged, found: &Found, scales: &Scales) -> Option<Most> {
    if judged.verdict == Verdict::Effects {
        return None;
    }
    let weight = problem.weight();
    let nothing = shrink::residuals(problem, NOTHING)?;
    let shares = |residuals: &[nalgebra::DMatrix<f64>]| -> Option<[f64; 2]> {
        let share = |held: bool| {
            let span = |r: &super::data::Record| if held { r.held } else { r.train };
            let (before, after) = (Errors::of(problem.records, &nothing, span), Errors::of(problem.records, residuals, span));
            explained(together(&before.nrmse())?, together(&after.nrmse())?, together(&before.relative(&judged.floor.floor))?)
        };
        Some([share(false)?, share(true)?])
    };
    let mut helping = Vec::new();
    for explanation in found.singles.iter().filter(|e| e.fitted && odds(e, weight) > 0.0) {
        let Some(taken) = shrink::residuals(problem, explanation).and_then(|residuals| shares(&residuals)) else { continue };
        if taken.iter().all(|share| *share > LEAST) {
            helping.push((explanation.clone(), taken));
        }
    }
    let explanations: Vec<_> = helping.iter().map(|(e, _)| e.clone()).collect();
    let best = rank::leader(&explanations, weight)?;
    let [learnt, held_out] = helping.iter().find(|(e, _)| e.key() == best.key())?.1;
    let estimate = intervals::estimate(problem, best, scales);
    let effect = found_effects(problem, best, estimate.as_ref()).into_iter().next()?;
    Some(Most { effect, learnt, held_out })
}
