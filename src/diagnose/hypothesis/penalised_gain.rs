//! How much better than no effect a hypothesis is, its parameters and the search over the whole catalogue paid for; and which of several leads.

use super::hypothesis::Hypothesis;
use crate::effect::row;

/// Twice the log-likelihood by which the best of a whole catalogue must beat no effect, and the best second effect a single one: the best of 50 to 100
/// rivals reaches 10 to 25 on noise alone.
pub(in crate::diagnose) const SELECTION_PENALTY: f64 = 30.0;
/// Hypotheses that differ by less than this in twice the log-likelihood are as good as each other: the fewest parameters, then the first of the table lead.
pub(in crate::diagnose) const NEAR: f64 = 6.0;
/// No simulator is exact: of what an effect explains, this part of its energy (1.4 % of its amplitude) is within what a model is off anyway.
const INEXACT: f64 = 2e-4;

/// Twice the log of the posterior odds against no effect (Schwarz 1978, doi:10.1214/aos/1176344136).
pub(in crate::diagnose) fn penalised_gain(hypothesis: &Hypothesis, weight: f64) -> f64 {
    let (further, effects) = (hypothesis.further_parameters() as f64, hypothesis.effects.len() as f64);
    hypothesis.gain - further * weight.max(2.0).ln() - effects * SELECTION_PENALTY
}

/// The difference in twice the log-likelihood that tells nothing.
pub(in crate::diagnose) fn slack(gain: f64) -> f64 {
    NEAR.max(INEXACT * gain)
}

/// The best fitted hypothesis; of near equals the one with the fewest parameters, of equals the first in the table.
pub(in crate::diagnose) fn leader(hypotheses: &[Hypothesis], weight: f64) -> Option<&Hypothesis> {
    let fitted = || hypotheses.iter().filter(|e| e.fitted);
    let best = |among: &dyn Fn(&Hypothesis) -> bool| {
        fitted().filter(|e| among(e)).map(|e| penalised_gain(e, weight)).fold(f64::NEG_INFINITY, f64::max)
    };
    let top = best(&|_| true);
    let fewest = fitted().filter(|e| penalised_gain(e, weight) > top - NEAR).map(|e| e.free.len()).min()?;
    let top = best(&|e| e.free.len() <= fewest);
    let place = |e: &Hypothesis| e.effects.iter().map(|a| row(a.effect)).collect::<Vec<_>>();
    fitted().filter(|e| e.free.len() <= fewest && penalised_gain(e, weight) > top - NEAR).min_by_key(|e| place(e))
}
