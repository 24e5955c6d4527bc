//! The gain of a hypothesis over no effect, less the penalties for its parameters and for the search over the catalogue. Also the leader of several hypotheses.

use super::effects::Hypothesis;
use crate::input::criteria::Criteria;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::row;

/// A difference of twice the log-evidence that is none (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572).
pub(crate) const NO_EVIDENCE: f64 = 2.0;

/// The prices of hypotheses.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Penalties {
    /// The price of every parameter beyond an effect's first, in twice the log-likelihood (Schwarz 1978, doi:10.1214/aos/1176344136).
    pub(crate) parameter: f64,
    criteria: Criteria,
}

impl Penalties {
    /// On these logs.
    pub(crate) fn of(likelihood: &Likelihood<'_>) -> Self {
        Self { parameter: likelihood.weight().max(2.0).ln(), criteria: likelihood.criteria }
    }

    /// Twice the log of the posterior odds against no effect.
    pub(crate) fn gain(&self, hypothesis: &Hypothesis) -> f64 {
        let (further, effects) =
            (hypothesis.further_parameters() as f64, hypothesis.effects.len() as f64);
        hypothesis.gain - further * self.parameter - effects * self.criteria.selection_penalty
    }

    /// The insignificant difference in twice the log-likelihood for an effect with this gain.
    pub(crate) fn slack(&self, gain: f64) -> f64 {
        self.criteria.equals.max(self.criteria.inexact * gain)
    }

    /// The best fitted hypothesis; of near equals the one with the fewest parameters, of equals the first in the table.
    pub(crate) fn leader<'h>(&self, hypotheses: &'h [Hypothesis]) -> Option<&'h Hypothesis> {
        let fitted = || hypotheses.iter().filter(|e| e.fitted);
        let best = |among: &dyn Fn(&Hypothesis) -> bool| {
            fitted().filter(|e| among(e)).map(|e| self.gain(e)).fold(f64::NEG_INFINITY, f64::max)
        };
        let near = |top: f64| move |e: &&Hypothesis| self.gain(e) > top - self.criteria.equals;
        let fewest = fitted().filter(near(best(&|_| true))).map(|e| e.free.len()).min()?;
        let few = |e: &Hypothesis| e.free.len() <= fewest;
        let place = |e: &Hypothesis| e.effects.iter().map(|a| row(a.effect)).collect::<Vec<_>>();
        fitted().filter(|e| few(e)).filter(near(best(&few))).min_by_key(|e| place(e))
    }
}
