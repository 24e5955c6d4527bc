//! The search over sets of effects: sets are expanded by additions, removals and the joint recalibration, the best score first.
//!
//! How it can be wrong: two effects are missed where neither lowers the score alone. The search therefore starts from every given set and from the empty set.
//! A set is fitted once, from the parameters of its parent set.

use std::collections::HashMap;

use rayon::prelude::*;

use super::class::EffectClass;
use super::fit::Fit;
use super::proposals::Proposal;
use super::score::Score;
use super::set::{CauseSet, SetKey, in_order, key};
use super::training::{Stacked, Training};
use crate::hypothesis::penalised_gain::NO_EVIDENCE;
use crate::likelihood::active_effects::NO_EFFECT;
use deadtime_model::effect::{Applied, Scales, find, row};
use deadtime_model::simulate::System;

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
/// What takes a smaller part of the gap's energy is not named: a weak effect, or the part of a general effect beyond its special case.
pub(crate) const NAMED: f64 = 0.01;
/// The difference in score up to which a set is as good as the best (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572).
const AS_GOOD: f64 = 6.0;

/// The result of a search.
pub(crate) struct Found {
    /// Every fitted set with its score, the best first. The leader is the set with the fewest parameters, then the first in the table of effects. It is chosen
    /// among the sets that no evidence separates from the best and that differ in one effect.
    pub(crate) sets: Vec<(f64, CauseSet)>,
    score: Score,
    /// Per output, the variance of the measurement.
    variances: Vec<f64>,
    /// The part of the energy that an effect explains within which every simulator is inexact.
    inexact: f64,
}

impl Found {
    /// Per effect of the leader, its class. Sets about the set of the lowest score were visited; where the leader has another effect in a class, that one represents it.
    pub(crate) fn classes(&self) -> Vec<EffectClass> {
        let Some((_, leader)) = self.sets.first() else { return Vec::new() };
        let lowest = self.sets.iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let has = |applied: &Applied| leader.effects.iter().any(|a| a.key() == applied.key());
        let led = |class: EffectClass| -> Option<EffectClass> {
            if has(&class.effect) {
                return Some(class);
            }
            let at = class.instead.iter().position(|m| m.len() == 1 && m.iter().all(has))?;
            let EffectClass { effect, mut instead, evidence } = class;
            let represents = std::mem::replace(&mut instead[at], vec![effect]).pop()?;
            Some(EffectClass { effect: represents, instead, evidence })
        };
        let mut classes: Vec<EffectClass> = lowest
            .map_or_else(Vec::new, |(_, set)| self.classes_of(set))
            .into_iter()
            .filter_map(led)
            .collect();
        // Two members of the leader may differ from those of the set of the lowest score.
        for own in self.classes_of(leader) {
            if classes.iter().all(|class| class.effect.key() != own.effect.key()) {
                classes.push(own);
            }
        }
        classes
    }

    /// Per effect of a set, its class. Members replace the effect in a set as good as the best, or in one whose additional misfit is within the inexactness of
    /// any simulator. The joint recalibration is one effect.
    fn classes_of(&self, best: &CauseSet) -> Vec<EffectClass> {
        let own = self.sets.iter().find(|(_, set)| set.key() == best.key());
        let score = own.map_or(f64::INFINITY, |(score, _)| *score);
        let least = self.sets.iter().map(|(score, _)| *score).fold(f64::INFINITY, f64::min);
        let block = best.effects.iter().find(|a| best.recalibrates(a));
        let evidence_without = |lacks: &dyn Fn(&CauseSet) -> bool| {
            let lacking = self.sets.iter().filter(|(_, set)| lacks(set)).map(|(score, _)| *score);
            (lacking.fold(f64::INFINITY, f64::min) - score).max(0.0)
        };
        let of = |out: &Applied| {
            let instead = self.replacing(best, out, least);
            let holds = |set: &CauseSet, members: &[Applied]| {
                members.iter().all(|m| set.singly().any(|a| a.key() == m.key()))
            };
            let lacks = |set: &CauseSet| {
                !holds(set, std::slice::from_ref(out)) && !instead.iter().any(|m| holds(set, m))
            };
            let evidence = evidence_without(&lacks);
            EffectClass { effect: out.clone(), instead, evidence }
        };
        let recalibrated = block.map(|first| {
            let instead = self.replacing_recalibration(best, least);
            let lacks = |set: &CauseSet| {
                set.recalibration.is_none()
                    && set.effects.iter().all(|a| !a.effect.corrects_model())
                    && instead
                        .iter()
                        .all(|member| set.effects.iter().all(|a| a.key() != member.key()))
            };
            let evidence = evidence_without(&lacks);
            let instead = instead.into_iter().map(|member| vec![member]).collect();
            EffectClass { effect: first.clone(), instead, evidence }
        });
        best.singly().map(of).chain(recalibrated).collect()
    }

    /// The visited set without one effect of a set.
    pub(crate) fn without(&self, best: &CauseSet, out: &Applied) -> Option<&CauseSet> {
        self.visited(&best.without(out).key())
    }

    /// The visited set without the joint recalibration of a set.
    pub(crate) fn without_recalibration(&self, best: &CauseSet) -> Option<&CauseSet> {
        best.recalibration.and_then(|_| self.visited(&key(best.singly(), false)))
    }

    fn visited(&self, key: &str) -> Option<&CauseSet> {
        self.sets.iter().find(|(_, set)| set.key() == key).map(|(_, set)| set)
    }

    /// Per parameter of a set, the variance of its value about its value in this set. The weights are exp(−E/2) over the visited sets that are as good as the
    /// best and have its effect. Source: Hoeting, Madigan, Raftery and Volinsky 1999, doi:10.1214/ss/1009212519. An alias that replaces another effect changes
    /// the values of the remaining effects. A set with an effect and its alias divides one value between two, which is no other estimate of it.
    pub(crate) fn between(&self, best: &CauseSet, key: &str, parameter: usize) -> f64 {
        let value = |set: &CauseSet| {
            let applied = set.effects.iter().find(|a| a.key() == key)?;
            applied.values.get(parameter).copied().filter(|v| v.is_finite())
        };
        let least = self.sets.iter().map(|(score, _)| *score).fold(f64::INFINITY, f64::min);
        let Some(own) = value(best) else { return 0.0 };
        let effect = best.effects.iter().find(|a| a.key() == key);
        let aliases: Vec<String> = effect
            .map_or_else(Vec::new, |effect| self.replacing(best, effect, least))
            .into_iter()
            .filter_map(|members| (members.len() == 1).then(|| members[0].key()))
            .collect();
        let divided = |set: &CauseSet| set.effects.iter().any(|a| aliases.contains(&a.key()));
        let good =
            self.sets.iter().filter(|(score, set)| *score <= least + AS_GOOD && !divided(set));
        let (weights, squares) = good
            .filter_map(|(score, set)| Some(((least - score) / 2.0, (value(set)? - own).powi(2))))
            .map(|(log, square)| (log.exp(), log.exp() * square))
            .fold((0.0, 0.0), |(a, b), (w, s)| (a + w, b + s));
        if weights > 0.0 { squares / weights } else { 0.0 }
    }

    /// The squared error of a set, every output over its variance.
    fn energy(&self, set: &CauseSet) -> f64 {
        set.squares.iter().zip(&self.variances).map(relative).sum()
    }

    /// Whether a set takes the special case of a general effect, and the general effect explains no more than it by a part that is named.
    fn takes_special_case(&self, special: &CauseSet, set: &CauseSet, general: &Applied) -> bool {
        let Some([instead]) =
            replaces(set, general, special, 1).map(<[Applied; 1]>::try_from).and_then(Result::ok)
        else {
            return false;
        };
        let nominal = self.sets.iter().find(|(_, set)| set.effects.is_empty());
        let gap = nominal.map_or(0.0, |(_, nominal)| self.energy(nominal));
        general.effect.elaborates() == Some(instead.effect.name())
            && [general.channel.as_str(), "*"].contains(&instead.channel.as_str())
            && self.energy(special) - self.energy(set) <= NAMED * gap
    }

    /// The set that takes the special case of a general effect of the leader, where there is one.
    fn special_case_of_leader(&self) -> Option<usize> {
        let (_, leader) = self.sets.first()?;
        let taken =
            |set: &CauseSet| leader.singly().any(|a| self.takes_special_case(set, leader, a));
        self.sets.iter().position(|(_, set)| taken(set))
    }

    /// The price of one effect with the given number of parameters.
    pub(crate) fn price(&self, parameters: usize, applied: &Applied) -> f64 {
        self.score.price(parameters, self.score.choices([applied].into_iter()))
    }

    /// The effects that alone replace the joint recalibration of the best set.
    fn replacing_recalibration(&self, best: &CauseSet, least: f64) -> Vec<Applied> {
        let Some(without) = self.without_recalibration(best) else { return Vec::new() };
        let own = self.energy(without) - self.energy(best);
        let replacement = |(score, other): &(f64, CauseSet)| {
            let alike = *score <= least + AS_GOOD
                || self.energy(other) - self.energy(best) <= self.inexact * own;
            let one = one_in_place_of_recalibration(best, other)?;
            alike.then(|| one.clone())
        };
        self.sets.iter().filter_map(replacement).collect()
    }

    /// Whether the measured values show an effect without any model.
    pub(crate) fn is_shown(&self, applied: &Applied) -> bool {
        self.score.choices([applied].into_iter()) == 0
    }

    /// The replacements of an effect of the best set: one effect, or two where no set with one of them alone does.
    fn replacing(&self, best: &CauseSet, out: &Applied, least: f64) -> Vec<Vec<Applied>> {
        let energy = |set: &CauseSet| self.energy(set);
        let key = best.without(out).key();
        let without = self.sets.iter().find(|(_, set)| set.key() == key);
        let own = without.map_or(0.0, |(_, set)| energy(set) - energy(best));
        let alike = |score: f64, other: &CauseSet| {
            score <= least + AS_GOOD
                || energy(other) - energy(best) <= self.inexact * own
                || self.takes_special_case(other, best, out)
        };
        let mut found: Vec<Vec<Applied>> = Vec::new();
        for count in 1..=2 {
            let own_cost = self.score.explained(best);
            for (_, other) in self.sets.iter().filter(|(s, set)| count == 2 || alike(*s, set)) {
                let Some(members) = replaces(best, out, other, count) else { continue };
                let known = found
                    .iter()
                    .any(|f| f.iter().all(|m| members.iter().any(|own| own.key() == m.key())));
                // Two effects that explain as much replace one, though they cost more.
                let explains = || self.score.explained(other) <= own_cost + AS_GOOD;
                if !known && (count == 1 || explains()) {
                    found.push(members);
                }
            }
        }
        found
    }
}

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
        let mut sets: Vec<(f64, CauseSet)> =
            self.ranked().into_iter().map(|(score, set)| (score, set.clone())).collect();
        let leader = leader(&sets)?;
        sets[..=leader].rotate_right(1);
        let mut found = Found {
            sets,
            score: self.score.clone(),
            variances: self.training.variances.clone(),
            inexact: self.training.likelihood.criteria.inexact,
        };
        while let Some(special) = found.special_case_of_leader() {
            found.sets[..=special].rotate_right(1);
        }
        Some(found)
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
        let energy: f64 = best.squares.iter().zip(&self.training.variances).map(relative).sum();
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
                let squares = self.training.squares(&between);
                squares.iter().zip(&self.training.variances).map(relative).sum()
            };
            if different.iter().any(|(s, other)| *s == size && apart(other) <= SAME * energy) {
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
        let fitted: Vec<(SetKey, CauseSet)> = fresh.into_par_iter().filter_map(one).collect();
        self.sets.extend(fitted);
    }
}

/// A set without each of its effects, and without its joint recalibration.
fn dropped(set: &CauseSet) -> impl Iterator<Item = CauseSet> {
    let alone = set
        .recalibration
        .map(|_| CauseSet::begun(set.singly().cloned().collect(), None, set.lost.clone()));
    set.singly().map(|out| set.without(out)).chain(alone)
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

/// The leader among the best set, the sets that lack one of its members and the sets that replace one, if no evidence separates them. The set with the fewest
/// parameters leads, then the first in the table of effects.
fn leader(sets: &[(f64, CauseSet)]) -> Option<usize> {
    let (least, best) = sets.first()?;
    let near = sets.iter().enumerate().take_while(|(_, (score, _))| *score <= least + NO_EVIDENCE);
    let lacking: Vec<SetKey> = dropped(best).map(|set| set.key()).collect();
    let alike = near.filter(|(_, (_, set))| {
        set.key() == best.key()
            || lacking.contains(&set.key())
            || best.singly().any(|out| replaces(best, out, set, 1).is_some())
            || one_in_place_of_recalibration(best, set).is_some()
    });
    let rows = |set: &CauseSet| set.singly().map(|a| row(a.effect)).collect::<Vec<_>>();
    let block = |set: &CauseSet| set.effects.iter().filter(|a| set.recalibrates(a)).count();
    alike.min_by_key(|(_, (_, set))| (set.acting + block(set), rows(set))).map(|(at, _)| at)
}

/// The effects, so many, by which another set replaces one of a set's, all others being the same.
fn replaces(set: &CauseSet, out: &Applied, other: &CauseSet, count: usize) -> Option<Vec<Applied>> {
    let same = other.recalibration.is_some() == set.recalibration.is_some()
        && other.singly().count() + 1 == set.singly().count() + count
        && other.singly().all(|a| a.key() != out.key());
    let is_new = |a: &&Applied| set.singly().all(|own| own.key() != a.key());
    let fresh: Vec<Applied> = other.singly().filter(is_new).cloned().collect();
    (same && fresh.len() == count).then_some(fresh)
}

/// The effect by which another set replaces the joint recalibration of a set, all others being the same.
fn one_in_place_of_recalibration<'o>(set: &CauseSet, other: &'o CauseSet) -> Option<&'o Applied> {
    let is_own = |a: &&Applied| set.singly().any(|own| own.key() == a.key());
    let mut fresh = other.singly().filter(|a| !is_own(a));
    let one = fresh.next()?;
    let replaces = set.recalibration.is_some()
        && other.recalibration.is_none()
        && fresh.next().is_none()
        && other.singly().filter(is_own).count() == set.singly().count();
    replaces.then_some(one)
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

fn relative((square, variance): (&f64, &f64)) -> f64 {
    if *variance > 0.0 { square / variance } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_model::effect::find;

    fn applied(effect: &str) -> Applied {
        let parameters = Vec::new();
        Applied {
            effect: find(effect).unwrap(),
            channel: "u".to_owned(),
            parameters,
            values: Vec::new(),
        }
    }

    /// A fitted set with so many parameters that act.
    fn set(effects: &[&str], acting: usize) -> CauseSet {
        let effects = in_order(effects.iter().map(|e| applied(e)));
        CauseSet { acting, ..CauseSet::begun(effects, None, None) }
    }

    fn led(sets: Vec<(f64, CauseSet)>) -> String {
        let at = leader(&sets).unwrap();
        sets[at].1.key()
    }

    #[test]
    fn of_sets_that_no_evidence_separates_the_plainest_leads() {
        let best = || (0.0, set(&["deadband", "delay_drift"], 3));
        // A replacement with fewer parameters leads within 2 of the best, and not beyond.
        assert_eq!(
            led(vec![best(), (1.9, set(&["deadband", "input_delay"], 2))]),
            "deadband:u + input_delay:u"
        );
        assert_eq!(
            led(vec![best(), (2.1, set(&["deadband", "input_delay"], 2))]),
            "deadband:u + delay_drift:u"
        );
        // So does the best set without a member that has no evidence.
        assert_eq!(led(vec![best(), (1.5, set(&["deadband"], 1))]), "deadband:u");
        // A set that shares no effect with the best is another answer, even with fewer parameters.
        assert_eq!(
            led(vec![best(), (0.5, set(&["input_gain", "rate_limit"], 2))]),
            "deadband:u + delay_drift:u"
        );
    }

    #[test]
    fn one_effect_in_place_of_a_recalibration_has_its_others_and_no_more() {
        let effects = |names: &[&str]| in_order(names.iter().map(|e| applied(e)));
        let best = CauseSet::begun(effects(&["deadband", "parameter_error"]), Some(0.05), None);
        let by = |names: &[&str]| {
            one_in_place_of_recalibration(&best, &CauseSet::begun(effects(names), None, None))
                .map(Applied::key)
        };
        assert_eq!(by(&["deadband", "sensor_gain"]).unwrap(), "sensor_gain:u");
        assert_eq!(by(&["deadband", "parameter_error"]).unwrap(), "parameter_error:u");
        assert_eq!(by(&["sensor_gain"]), None);
        assert_eq!(by(&["deadband"]), None);
        assert_eq!(by(&["deadband", "sensor_gain", "input_delay"]), None);
        let still = CauseSet::begun(effects(&["deadband", "sensor_gain"]), Some(0.05), None);
        assert!(one_in_place_of_recalibration(&best, &still).is_none());
    }

    #[test]
    fn one_effect_is_replaced_by_one_or_by_two_with_all_others_the_same() {
        let best = set(&["deadband", "delay_drift"], 3);
        let out = applied("delay_drift");
        let by = |effects: &[&str], count| {
            let members = replaces(&best, &out, &set(effects, 0), count)?;
            Some(members.iter().map(Applied::key).collect::<Vec<_>>())
        };
        assert_eq!(by(&["deadband", "input_delay"], 1).unwrap(), ["input_delay:u"]);
        assert_eq!(by(&["deadband", "input_delay", "input_gain"], 2).unwrap().len(), 2);
        assert_eq!(by(&["deadband", "input_delay", "input_gain"], 1), None);
        assert_eq!(by(&["input_gain", "input_delay"], 1), None);
        assert_eq!(by(&["deadband", "delay_drift", "input_gain"], 2), None);
    }
}
