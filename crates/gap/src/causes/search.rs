//! The search over sets of effects: sets are expanded by additions, removals and the joint recalibration, the best score first.
//!
//! How it can be wrong: two effects are missed where neither lowers the score alone. The search therefore starts from every given set and from the empty set.
//! A set is fitted once, from the parameters of its parent set.

use std::collections::HashMap;

use super::fit::Fit;
use super::found::{Found, energy};
use super::proposals::Proposal;
use super::score::Score;
use super::set::{CauseSet, SetKey, dropped, in_order};
use super::training::{Stacked, Training};
use crate::likelihood::active_effects::NO_EFFECT;
use deadtime_model::effect::{Applied, Scales, find, row};
use deadtime_model::simulate::System;
use deadtime_signal::parallel;

/// Additions of a set that are fitted.
const FITTED: usize = 6;
/// Up to twice as many are fitted where they predict this part of the best reduction: aliases tie.
const ALIKE: f64 = 0.7;
/// Effects of a set, at most.
const MOST: usize = 7;
/// Expansions without a new best set after which a search ends.
const PATIENCE: usize = 3;
/// Different sets of each size that are expanded.
const DIFFERENT: usize = 3;
/// Sets whose predictions differ by less than this part of the residual's energy are one.
const SAME: f64 = 0.02;
/// The first relative size of the parameters' errors, and the range of its estimate.
const SIZE: f64 = 0.05;
const SIZES: (f64, f64) = (0.005, 0.3);
/// Single parameters that may take the place of the joint recalibration.
const MOST_MOVED: usize = 3;

/// A search over sets.
pub(crate) struct Search<'s, 'l, 'a> {
    training: &'s Training<'l, 'a>,
    candidates: &'s [Applied],
    /// All parameters of the model.
    numbers: &'s [Applied],
    scales: &'s Scales,
    nominal: Stacked,
    score: Score,
    sets: HashMap<SetKey, CauseSet>,
    expanded: Vec<SetKey>,
}

impl<'s, 'l, 'a> Search<'s, 'l, 'a> {
    /// From candidates, all parameters of the model, and the candidates that the measured values show; `None` where the nominal model cannot be simulated.
    pub(crate) fn new(
        training: &'s Training<'l, 'a>,
        [candidates, numbers, shown]: [&'s [Applied]; 3],
        scales: &'s Scales,
        smallest: &[f64],
    ) -> Option<Self> {
        let nominal = training.residual(NO_EFFECT)?;
        let score = Score::of(training, &nominal, smallest, [candidates, shown]);
        Some(Self {
            training,
            candidates,
            numbers,
            scales,
            nominal,
            score,
            sets: HashMap::new(),
            expanded: Vec::new(),
        })
    }

    /// Searches from no effect, from these sets, and from one with given values.
    pub(crate) fn from(mut self, starts: Vec<CauseSet>, asked: Option<CauseSet>) -> Option<Found> {
        let nothing = CauseSet::begun(Vec::new(), None, None);
        self.fit_all(std::iter::once(nothing).chain(starts).collect());
        self.renew();
        if let Some(asked) = asked {
            self.begin_at(asked);
        }
        let (mut failures, mut replaced) = (0, Vec::new());
        while failures < PATIENCE && !self.training.likelihood.is_stopped() {
            let best = self.ranked().first()?.1.key();
            let Some(next) = self.next() else { break };
            self.expand(&next);
            self.renew();
            failures = if self.ranked().first()?.1.key() == best { failures + 1 } else { 0 };
            // The replacements of an effect of the best set are known only after the expansion of the set without it.
            if failures == PATIENCE && self.next_without().is_some() {
                failures -= 1;
            }
            // Once per leading set: two sets whose lead changes with the effective samples would ask for each other without end.
            let leads = self.ranked().first()?.1.key();
            if failures == PATIENCE && !replaced.contains(&leads) {
                replaced.push(leads);
                failures = if self.one_cause_for_two() { 0 } else { failures };
            }
        }
        self.under_a_sequence();
        let ranked = self.ranked().into_iter().map(|(score, set)| (score, set.clone())).collect();
        let inexact = self.training.likelihood.criteria.inexact;
        Found::of(ranked, self.score.clone(), self.training.variances.clone(), inexact)
    }

    fn fit(&self) -> Fit<'_, 'l, 'a> {
        Fit {
            training: self.training,
            score: &self.score,
            scales: self.scales,
            nominal: &self.nominal,
            least: self.sets.values().map(|s| self.score.total(s)).fold(f64::INFINITY, f64::min),
        }
    }

    /// All sets by their scores.
    fn ranked(&self) -> Vec<(f64, &CauseSet)> {
        let mut ranked: Vec<(f64, &CauseSet)> =
            self.sets.values().map(|set| (self.score.total(set), set)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.key().cmp(&b.1.key())));
        ranked
    }

    /// Estimates the effective samples from the residual of the best set, until the best set is constant.
    fn renew(&mut self) {
        for _ in 0..DIFFERENT {
            let Some(best) = self.ranked().first().map(|(_, set)| (*set).clone()) else { return };
            let left = self.training.residual(&best).and_then(|r| self.fit().remainder(&r));
            let Some(left) = left else { return };
            self.score = self.score.under(self.training, &left);
            if self.ranked().first().is_some_and(|(_, set)| set.key() == best.key()) {
                return;
            }
        }
    }

    /// Uses the effective samples of a set with a decoded sequence where that set leads under its own samples. The residual of a sequence is white; that of a
    /// deterministic effect on the same data is not.
    fn under_a_sequence(&mut self) {
        let decoded: Vec<CauseSet> = self
            .ranked()
            .into_iter()
            .filter(|(_, s)| s.lost.is_some())
            .map(|(_, s)| s.clone())
            .collect();
        for set in decoded {
            let Some(left) = self.training.residual(&set).and_then(|r| self.fit().remainder(&r))
            else {
                continue;
            };
            let score = self.score.under(self.training, &left);
            let own = score.total(&set);
            if self.sets.values().all(|other| score.total(other) >= own) {
                self.score = score;
                return;
            }
        }
    }

    /// The next set to expand: the best one; then the best set without one of its effects; then different near-best sets of each size.
    fn next(&self) -> Option<SetKey> {
        let ranked = self.ranked();
        let open = |set: &CauseSet| !self.expanded.contains(&set.key());
        let (_, best) = ranked.first()?;
        if open(best) {
            return Some(best.key());
        }
        if let Some(without) = self.next_without() {
            return Some(without);
        }
        let own = energy(&best.squares, &self.training.variances);
        let mut different: Vec<(usize, Stacked)> = Vec::new();
        for (_, set) in &ranked {
            let size = set.singly().count();
            let of_size = different.iter().filter(|(s, _)| *s == size).count();
            if of_size >= DIFFERENT {
                continue;
            }
            let Some(residual) = self.training.residual(*set) else { continue };
            let apart = |other: &Stacked| -> f64 {
                let between: Stacked = residual.iter().zip(other).map(|(a, b)| a - b).collect();
                energy(&self.training.squares(&between), &self.training.variances)
            };
            if different.iter().any(|(s, other)| *s == size && apart(other) <= SAME * own) {
                continue;
            }
            different.push((size, residual));
            if open(set) {
                return Some(set.key());
            }
        }
        None
    }

    /// The best set without one of its effects that was not expanded yet.
    fn next_without(&self) -> Option<SetKey> {
        let ranked = self.ranked();
        let (_, best) = ranked.first()?;
        let without: Vec<SetKey> = dropped(best).map(|set| set.key()).collect();
        ranked
            .iter()
            .map(|(_, set)| set.key())
            .find(|key| without.contains(key) && !self.expanded.contains(key))
    }

    /// Fits the neighbours of a set.
    fn expand(&mut self, at: &SetKey) {
        self.expanded.push(at.clone());
        let Some(set) = self.sets.get(at).cloned() else { return };
        let system = self.training.likelihood.system;
        let special = specialised(&set, self.candidates, system);
        let mut trials: Vec<CauseSet> = dropped(&set).chain(special).collect();
        if set.singly().count() < MOST {
            let proposals = self.fit().proposals(&set, self.candidates);
            let alike = proposals.first().map_or(0.0, |best| ALIKE * best.reduction);
            let worth = |(at, proposal): &(usize, Proposal)| {
                *at < FITTED || (*at < 2 * FITTED && proposal.reduction >= alike)
            };
            let fitted = proposals.into_iter().enumerate().filter(worth);
            trials.extend(fitted.map(|(_, proposal)| {
                set.with(in_order(set.effects.iter().cloned().chain([proposal.applied])))
            }));
        }
        match set.recalibration {
            None if self.numbers.len() > 1 => {
                let singly = set.effects.iter().filter(|a| !a.effect.corrects_model()).cloned();
                let effects = in_order(singly.chain(self.numbers.iter().cloned()));
                trials.push(CauseSet::begun(effects, Some(SIZE), set.lost.clone()));
            }
            None => {}
            Some(_) => trials.extend(self.most_moved(&set)),
        }
        self.fit_all(trials);
        self.simplify();
    }

    /// Fits the sets that may lead with fewer parameters: without a member that the fit predicts to be superfluous, or with the special case of a general
    /// effect. A set that explains as much as the best one by other members is not expanded itself.
    fn simplify(&mut self) {
        let mut tried: Vec<SetKey> = Vec::new();
        loop {
            let ranked = self.ranked();
            let Some(least) = ranked.first().map(|(score, _)| *score) else { return };
            let mut trials = Vec::new();
            for (score, set) in ranked {
                let removed = set.removals.iter().map(|removal| {
                    let fewer = score + removal.rise - self.score.price(removal.parameters, 1);
                    (fewer, set.without_key(&removal.key))
                });
                let system = self.training.likelihood.system;
                let special = specialised(set, self.candidates, system).map(|special| {
                    let numbers = |s: &CauseSet| s.singly().map(|a| a.values.len()).sum::<usize>();
                    let saved = numbers(set).saturating_sub(numbers(&special));
                    (score - self.score.price(saved, 0), special)
                });
                for (fewer, trial) in removed.chain(special) {
                    let key = trial.key();
                    if fewer < least && !self.sets.contains_key(&key) && !tried.contains(&key) {
                        tried.push(key);
                        trials.push(trial);
                    }
                }
            }
            if trials.is_empty() {
                return;
            }
            self.fit_all(trials);
        }
    }

    /// Whether a set leads in which two other effects replace two equal effects on different channels. A cause common to several channels acts on each like an
    /// effect of its own, and no single replacement leads from one to the other.
    fn one_cause_for_two(&mut self) -> bool {
        let Some(best) = self.ranked().first().map(|(_, set)| (*set).clone()) else { return false };
        let singly: Vec<Applied> = best.singly().cloned().collect();
        for (at, one) in singly.iter().enumerate() {
            for two in singly[at + 1..].iter().filter(|two| row(two.effect) == row(one.effect)) {
                let mut set = best.without(one).without(two);
                for _ in 0..2 {
                    self.fit_all(vec![set.clone()]);
                    let Some(fitted) = self.sets.get(&set.key()).cloned() else { break };
                    let proposals = self.fit().proposals(&fitted, self.candidates);
                    let common =
                        |p: &Proposal| ![&one.channel, &two.channel].contains(&&p.applied.channel);
                    let Some(added) = proposals.into_iter().find(common) else { break };
                    let effects = fitted.effects.iter().cloned().chain([added.applied]);
                    set = fitted.with(in_order(effects));
                }
                self.fit_all(vec![set]);
            }
        }
        self.renew();
        self.ranked().first().is_some_and(|(_, set)| set.key() != best.key())
    }

    /// Fits a set, and the candidates that can be added to it at its given values. Fitted alone, a wrong sign with a dead time gives a gain of 0, which makes
    /// the dead time unobservable.
    fn begin_at(&mut self, asked: CauseSet) {
        let proposals = match self.training.residual(&asked) {
            Some(residual) => {
                let there = CauseSet { squares: self.training.squares(&residual), ..asked.clone() };
                self.fit().proposals(&there, self.candidates)
            }
            None => Vec::new(),
        };
        let added = proposals.into_iter().take(FITTED).map(|proposal| {
            asked.with(in_order(asked.effects.iter().cloned().chain([proposal.applied])))
        });
        let trials = std::iter::once(asked.clone()).chain(added).collect();
        self.fit_all(trials);
        self.renew();
    }

    /// The set with its one, two, three most moved parameters in the place of the joint recalibration.
    fn most_moved(&self, set: &CauseSet) -> Vec<CauseSet> {
        let relative = |a: &Applied| {
            let nominal = a.parameters[0].nominal;
            if nominal == 0.0 { 0.0 } else { ((a.values[0] - nominal) / nominal).abs() }
        };
        let mut moved: Vec<Applied> =
            set.effects.iter().filter(|a| set.recalibrates(a)).cloned().collect();
        moved.sort_by(|a, b| relative(b).total_cmp(&relative(a)));
        (1..=MOST_MOVED.min(moved.len()))
            .map(|count| {
                let singles = moved.iter().take(count).cloned();
                let effects = in_order(set.singly().cloned().chain(singles));
                CauseSet::begun(effects, None, set.lost.clone())
            })
            .collect()
    }

    /// Fits sets that are not known yet, and again those of which a fit ended at a worse minimum than the new values are.
    fn fit_all(&mut self, trials: Vec<CauseSet>) {
        let mut fresh: Vec<(SetKey, CauseSet)> = Vec::new();
        for trial in trials {
            let key = trial.key();
            if fresh.iter().all(|(known, _)| *known != key) {
                fresh.push((key, trial));
            }
        }
        let fit = self.fit();
        let one = |(key, trial): (SetKey, CauseSet)| {
            let known = self.sets.get(&key);
            if known.is_some_and(|known| !fit.ended_elsewhere(known, &trial)) {
                return None;
            }
            let set = fit.of(trial)?;
            let again = size(&set)
                .and_then(|size| fit.of(CauseSet { recalibration: Some(size), ..set.clone() }));
            let set = again.unwrap_or(set);
            let better = known.is_none_or(|k| self.score.total(&set) < self.score.total(k));
            better.then_some((key, set))
        };
        let fitted: Vec<(SetKey, CauseSet)> = parallel::filter_map(fresh, one);
        self.sets.extend(fitted);
    }
}

/// A set with the special case of each general effect in turn, at the general form's values. The special case must be a candidate.
fn specialised(
    set: &CauseSet,
    candidates: &[Applied],
    system: &System,
) -> impl Iterator<Item = CauseSet> {
    let among =
        |list: &[Applied], special: &Applied| list.iter().any(|own| own.key() == special.key());
    let special = move |general: &Applied| {
        let effect = find(general.effect.elaborates()?).ok()?;
        // A single output has its effects under the name of all outputs.
        let on = |channel: &str| Applied::nominal(system, effect, channel).ok();
        let mut special = [general.channel.as_str(), "*"]
            .into_iter()
            .filter_map(on)
            .find(|special| among(candidates, special))?;
        special.values.iter_mut().zip(&general.values).for_each(|(to, value)| *to = *value);
        let others = set.without(general).effects;
        (!among(&others, &special)).then(|| set.with(in_order(others.into_iter().chain([special]))))
    };
    set.singly().filter_map(special)
}

/// The relative size of the parameters' errors as the fitted ones have it.
fn size(set: &CauseSet) -> Option<f64> {
    set.recalibration?;
    let relative: Vec<f64> = set
        .effects
        .iter()
        .filter(|a| set.recalibrates(a) && a.parameters[0].nominal != 0.0)
        .map(|a| (a.values[0] / a.parameters[0].nominal - 1.0).powi(2))
        .collect();
    let rms = (relative.iter().sum::<f64>() / relative.len().max(1) as f64).sqrt();
    Some(rms.clamp(SIZES.0, SIZES.1))
}
