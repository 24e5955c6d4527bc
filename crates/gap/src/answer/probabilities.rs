//! Probabilities of all hypotheses, as the verdict sees them.

use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::penalised_gain::Penalties;
use crate::judge::verdict::Judged;
use crate::search::catalogue_search::SearchResult;

/// Twice the log-odds of everything that is ranked, as the verdict sees it.
pub(crate) struct Probabilities {
    pub(crate) none: f64,
    best: f64,
    /// What pairs lose where a second effect does not matter.
    pairs: f64,
    penalties: Penalties,
    /// Differences count for less by this factor.
    temper: f64,
}

impl Probabilities {
    pub(crate) fn new(judged: &Judged, found: &SearchResult, penalties: Penalties) -> Self {
        // 9 to 1 for the verdict where the likelihood prefers something that does not matter.
        let top = |all: &[Hypothesis]| {
            all.iter().map(|e| penalties.gain(e)).fold(f64::NEG_INFINITY, f64::max)
        };
        let several =
            judged.found.iter().filter(|e| e.effects.len() > 1).map(|e| penalties.gain(e));
        let (single, pair) = (top(&found.singles), several.fold(top(&found.pairs), f64::max));
        let temper = penalties.temper(f64::max(single, pair));
        let clear = 2.0 * 9.0_f64.ln() * temper;
        let size = judged.best.as_ref().map_or(0, |e| e.effects.len());
        let none = if size == 0 { f64::max(0.0, single + clear) } else { 0.0 };
        let limit = if size > 1 { f64::INFINITY } else { f64::max(single, none) - clear };
        let pairs = (pair - limit).max(0.0);
        let best = f64::max(f64::max(single, pair - pairs), none);
        Self { none, best, pairs, penalties, temper }
    }

    pub(crate) fn share(&self, odds: f64) -> f64 {
        if odds.is_finite() { (0.5 * (odds - self.best) / self.temper).exp() } else { 0.0 }
    }

    pub(crate) fn of(&self, hypothesis: &Hypothesis) -> f64 {
        let less = if hypothesis.effects.len() > 1 { self.pairs } else { 0.0 };
        self.share(self.penalties.gain(hypothesis) - less)
    }
}
