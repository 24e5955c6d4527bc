//! What could be added to a hypothesis: which candidates promise something beside it, and joint fits of those that promise most.
//!
//! How it can be wrong: a promise is that of a small step, or of a guess with all else as it is; a candidate that helps only once the others have moved promises too
//! little. And a joint fit that begins at a guess may lead the others away from where they were fitted.

use rayon::prelude::*;

use super::composer::{Composer, to_be_fitted};
use crate::hypothesis::direction::{NEAR, between, difference, has_limit, with};
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::slopes::Still;
use crate::likelihood::gaussian::Likelihood;
use crate::search::beside::Beside;
use deadtime_model::effect::Applied;

impl Composer<'_, '_> {
    /// Candidates that promise something beside a hypothesis, each with how much and with its best guess; those that promise most first. An elaborate form that promises
    /// hardly more than its plain one waits until that is in.
    pub(super) fn promising(
        &self,
        likelihood: &Likelihood<'_>,
        present: &Hypothesis,
        candidates: &[&Applied],
    ) -> Vec<(f64, Applied)> {
        let Some(beside) = Beside::new(likelihood, present, &self.scales) else {
            return Vec::new();
        };
        let keys: Vec<String> = present.effects.iter().map(Applied::key).collect();
        let mut promising: Vec<(f64, Applied)> = candidates
            .par_iter()
            .filter(|a| !keys.contains(&a.key()))
            .filter_map(|candidate| self.promise(likelihood, &beside, candidate))
            .filter(|(promise, _)| *promise > self.gate.criteria.added_falls * beside.cost)
            .collect();
        promising.sort_by(|a, b| b.0.total_cmp(&a.0));
        let plain: Vec<(String, f64)> =
            promising.iter().map(|(promise, a)| (a.key(), *promise)).collect();
        promising.retain(|(promise, a)| {
            let as_plain = |name: &str| format!("{name}:{}", a.channel);
            let own = a
                .effect
                .elaborates()
                .and_then(|name| plain.iter().find(|(key, _)| *key == as_plain(name)));
            own.is_none_or(|(_, plain)| *plain < self.gate.criteria.promises_as_much * promise)
        });
        promising
    }

    /// Joint fits of a hypothesis with each of the candidates that promise most beside it.
    pub(super) fn additions(
        &self,
        likelihood: &Likelihood<'_>,
        from: &Hypothesis,
        mut promising: Vec<(f64, Applied)>,
        counts: [usize; 2],
    ) -> Vec<Hypothesis> {
        promising.truncate(counts[0]);
        let cost = self.cost(likelihood);
        let paired = self.as_paired(from);
        let there = likelihood.whitened(from).map_or(f64::INFINITY, |w| likelihood.inner(&w, &w));
        let near = promising
            .par_iter()
            .filter_map(|(_, candidate)| from_nearly_nothing(likelihood, (from, there), candidate))
            .collect::<Vec<_>>();
        let begun = promising.into_iter().map(|(_, candidate)| candidate).chain(near);
        let trials = begun
            .map(|candidate| to_be_fitted(from, Some(candidate), None))
            .chain(paired)
            .collect();
        let limited = |e: Hypothesis| {
            e.with_missing_limits(likelihood, &self.scales, cost, likelihood.budget.steps)
        };
        self.most_gainful(likelihood, from, trials, counts[1])
            .into_par_iter()
            .map(limited)
            .collect()
    }

    /// Hypotheses near one that is fitted: those that gain most in a few steps, fitted to the end.
    pub(super) fn most_gainful(
        &self,
        likelihood: &Likelihood<'_>,
        near: &Hypothesis,
        trials: Vec<Hypothesis>,
        count: usize,
    ) -> Vec<Hypothesis> {
        let cost = self.cost(likelihood);
        let Some(still) = Still::of(near, likelihood, &self.scales) else { return Vec::new() };
        let fits = |hypotheses: Vec<Hypothesis>, steps: (usize, &Still)| -> Vec<Hypothesis> {
            let refit =
                |e: Hypothesis| Hypothesis::refit_beside(likelihood, e, &self.scales, cost, steps);
            let mut fitted: Vec<Hypothesis> =
                hypotheses.into_par_iter().filter_map(refit).collect();
            fitted.sort_by(|a, b| b.gain.total_cmp(&a.gain));
            let mut known = Vec::new();
            fitted.retain(|e| {
                !known.contains(&e.key()) && {
                    known.push(e.key());
                    true
                }
            });
            fitted
        };
        let mut fitted = fits(trials, (self.budget().trial_steps, &still));
        fitted.truncate(count);
        fits(fitted, (likelihood.budget.steps, &Still::NONE))
    }

    /// The fall of the cost that a candidate promises, and the guess that gave it.
    pub(super) fn promise(
        &self,
        likelihood: &Likelihood<'_>,
        beside: &Beside,
        candidate: &Applied,
    ) -> Option<(f64, Applied)> {
        // A single number that only says how much has the same signature wherever it is taken.
        let one_signature =
            matches!(&candidate.parameters[..], [p] if !p.role.is_shape()) && !has_limit(candidate);
        let mut best: Option<(f64, Applied)> = None;
        for (at, guess) in self.guesses(likelihood, candidate).into_iter().enumerate() {
            let near = !has_limit(candidate) && (at == 0 || !one_signature);
            for share in [NEAR, 1.0].into_iter().filter(|share| near || *share > NEAR) {
                let there = with(candidate, &between(candidate, &guess, share));
                let effects: Vec<Applied> =
                    beside.first.effects.iter().cloned().chain([there]).collect();
                let Some(moved) = likelihood.whitened(&effects) else { continue };
                let along = beside.promise(likelihood, &difference(&beside.residual, &moved, 1.0));
                let promise = along.max(beside.cost - likelihood.inner(&moved, &moved));
                if promise.is_finite() && best.as_ref().is_none_or(|(most, _)| promise > *most) {
                    best = Some((promise, with(candidate, &guess)));
                }
            }
        }
        best
    }

    /// First guesses beside what is found already: what the candidate was fitted to alone, then its own.
    fn guesses(&self, likelihood: &Likelihood<'_>, candidate: &Applied) -> Vec<Vec<f64>> {
        let alone = self
            .singles
            .iter()
            .find(|s| s.fitted && s.effects.len() == 1 && s.effects[0].key() == candidate.key());
        let own = likelihood.first_guesses(candidate, &self.scales);
        let every = own.len().div_ceil(self.budget().guesses).max(1);
        alone
            .map(|s| s.effects[0].values.clone())
            .into_iter()
            .chain(own.into_iter().step_by(every))
            .collect()
    }
}

/// A candidate that hardly does anything yet, where its guess costs more than a hypothesis without it: from there the others would leave what they were fitted to (the
/// rate of a clock has many minima), and from here the cost can only fall.
fn from_nearly_nothing(
    likelihood: &Likelihood<'_>,
    (from, cost): (&Hypothesis, f64),
    candidate: &Applied,
) -> Option<Applied> {
    let guessed = likelihood.whitened(&to_be_fitted(from, Some(candidate.clone()), None));
    let falls = guessed.is_some_and(|w| likelihood.inner(&w, &w) <= cost);
    (!falls && !has_limit(candidate))
        .then(|| with(candidate, &between(candidate, &candidate.values, NEAR)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::gate::Gate;
    use crate::likelihood::servo::{beside, nominal};
    use crate::search::catalogue::catalogue;
    use deadtime_model::effect::Scales;

    fn composer<'c, 'a>(likelihood: &'c Likelihood<'a>, scales: &Scales) -> Composer<'c, 'a> {
        Composer {
            likelihood,
            candidates: catalogue(likelihood.system, &[], None, scales).candidates,
            singles: &[],
            pairs: &[],
            scales: scales.clone(),
            smallest: &[0.0, 0.0],
            gate: Gate { criteria: likelihood.criteria },
            noise: 0.0,
            most: 5,
            white: true,
            shrinkage: None,
            shortlist: Vec::new(),
        }
    }

    /// The rate of a clock has many minima: fits that begin far from the others' values lead it out of its own.
    #[test]
    fn one_effect_more_never_costs_more() {
        let truth: [(&str, &str, &[f64]); 3] = [
            ("clock_skew", "*", &[1.006]),
            ("sensor_gain", "angle", &[1.9]),
            ("coulomb_friction", "v", &[1.0]),
        ];
        beside(&truth, |likelihood, scales| {
            let composer = composer(likelihood, scales);
            let clock = with(&nominal(likelihood.system, "clock_skew", "*"), &[1.006]);
            let friction = with(&nominal(likelihood.system, "coulomb_friction", "v"), &[1.0]);
            let nothing = Hypothesis {
                effects: Vec::new(),
                free: Vec::new(),
                gain: 0.0,
                fitted: false,
                lost: None,
            };
            let both = Hypothesis { effects: vec![friction, clock], ..nothing };
            let present = Hypothesis::refit(
                likelihood,
                both,
                scales,
                composer.cost(likelihood),
                likelihood.budget.steps,
            )
            .unwrap();
            let all: Vec<&Applied> = composer.candidates.iter().filter(|a| !has_limit(a)).collect();
            let promising = composer.promising(likelihood, &present, &all);
            assert!(promising.len() > 5, "{promising:?}");
            let fitted = composer.additions(likelihood, &present, promising, [usize::MAX; 2]);
            for more in &fitted {
                assert!(
                    more.gain >= present.gain * (1.0 - 1e-6),
                    "{} {} {}",
                    more.key(),
                    more.gain,
                    present.gain
                );
            }
        });
    }
}
