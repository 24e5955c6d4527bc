//! The search over sets of effects: sets are expanded by additions, removals and the joint recalibration, the best score first.
//!
//! How it can be wrong: two effects of which neither helps alone are not reached one at a time; so the search begins from every set that is given to it as well as
//! from none. A set is fitted once, from the values of the set that led to it.

use std::collections::HashMap;

use rayon::prelude::*;

use super::fit::Fit;
use super::score::Score;
use super::set::{CauseSet, SetKey, in_order, key};
use super::training::{Stacked, Training};
use crate::hypothesis::effects::Hypothesis;
use crate::likelihood::active_effects::NO_EFFECT;
use deadtime_model::effect::{Applied, Scales};

/// Additions of a set that are fitted.
const FITTED: usize = 6;
/// Effects of a set, at most.
const MOST: usize = 7;
/// Expansions without a new best set after which a search ends.
const PATIENCE: usize = 3;
/// Different sets of each size that are expanded.
const DIFFERENT: usize = 3;
/// Sets whose predictions differ by less than this part of the residual's energy are one.
const SAME: f64 = 0.02;
/// The first relative size of the parameters' errors, and the range of what is estimated.
const SIZE: f64 = 0.05;
const SIZES: (f64, f64) = (0.005, 0.3);
/// Single parameters that may take the place of the joint recalibration.
const MOST_MOVED: usize = 3;
/// A difference in score up to which a set is as good as the best.
pub(crate) const AS_GOOD: f64 = 6.0;

/// What a search found.
pub(crate) struct Found {
    /// Every set that was fitted with its score, the best first.
    pub(crate) sets: Vec<(f64, CauseSet)>,
    /// The score of the decoded sequence that the best set competes with.
    pub(crate) hidden: Option<f64>,
}

impl Found {
    /// Per effect of the best set, the effects that replace it alone in a set as good as the best.
    pub(crate) fn aliases(&self) -> Vec<Vec<Applied>> {
        let Some((least, best)) = self.sets.first() else { return Vec::new() };
        let near = || self.sets.iter().skip(1).take_while(|(score, _)| *score <= least + AS_GOOD);
        let instead = |out: &Applied, other: &CauseSet| -> Option<Applied> {
            let same = other.recalibration.is_some() == best.recalibration.is_some()
                && other.singly().count() == best.singly().count();
            let mut fresh =
                other.singly().filter(|a| best.singly().all(|own| own.key() != a.key()));
            let first = fresh.next().filter(|_| same && fresh.next().is_none())?;
            other.singly().all(|a| a.key() != out.key()).then(|| first.clone())
        };
        let of = |out: &Applied| -> Vec<Applied> {
            if best.recalibrates(out) {
                return Vec::new();
            }
            near().filter_map(|(_, other)| instead(out, other)).collect()
        };
        best.effects.iter().map(of).collect()
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
    /// `None` where the nominal model cannot be simulated.
    pub(crate) fn new(
        training: &'s Training<'l, 'a>,
        candidates: &'s [Applied],
        numbers: &'s [Applied],
        scales: &'s Scales,
        smallest: &[f64],
    ) -> Option<Self> {
        let nominal = training.residual(NO_EFFECT)?;
        let score = Score::of(training, &nominal, smallest, candidates.len());
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

    /// Searches from no effect and from these sets; `hidden`: a decoded sequence that is scored with the sets.
    pub(crate) fn from(
        mut self,
        starts: Vec<Vec<Applied>>,
        hidden: Option<&Hypothesis>,
    ) -> Option<Found> {
        let starts = starts.into_iter().map(|effects| (effects, None));
        self.fit_all(std::iter::once((Vec::new(), None)).chain(starts).collect());
        self.renew();
        let mut failures = 0;
        while failures < PATIENCE && !self.training.likelihood.is_stopped() {
            let best = self.ranked().first()?.1.key();
            let Some(next) = self.next() else { break };
            self.expand(&next);
            self.renew();
            failures = if self.ranked().first()?.1.key() == best { failures + 1 } else { 0 };
        }
        let sets = self.ranked().into_iter().map(|(score, set)| (score, set.clone())).collect();
        let hidden = hidden.and_then(|e| Some(self.score.total(&self.fit().decoded(e)?)));
        Some(Found { sets, hidden })
    }

    fn fit(&self) -> Fit<'_, 'l, 'a> {
        Fit {
            training: self.training,
            score: &self.score,
            scales: self.scales,
            nominal: &self.nominal,
        }
    }

    /// All sets by their scores.
    fn ranked(&self) -> Vec<(f64, &CauseSet)> {
        let mut ranked: Vec<(f64, &CauseSet)> =
            self.sets.values().map(|set| (self.score.total(set), set)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.key().cmp(&b.1.key())));
        ranked
    }

    /// Effective samples of what the best set leaves, until the best set stays.
    fn renew(&mut self) {
        for _ in 0..DIFFERENT {
            let Some(best) = self.ranked().first().map(|(_, set)| (*set).clone()) else { return };
            let left = self.training.residual(&best.effects).and_then(|r| self.fit().remainder(&r));
            let Some(left) = left else { return };
            self.score = self.score.under(self.training, &left);
            if self.ranked().first().is_some_and(|(_, set)| set.key() == best.key()) {
                return;
            }
        }
    }

    /// The next set to expand: the best one; then what it is without one of its effects; then different near-best sets of each size.
    fn next(&self) -> Option<SetKey> {
        let ranked = self.ranked();
        let open = |set: &CauseSet| !self.expanded.contains(&set.key());
        let (_, best) = ranked.first()?;
        if open(best) {
            return Some(best.key());
        }
        let without: Vec<SetKey> = dropped(best).map(|(e, b)| key(e.iter(), b.is_some())).collect();
        let found = ranked.iter().find(|(_, set)| open(set) && without.contains(&set.key()));
        if let Some((_, set)) = found {
            return Some(set.key());
        }
        let energy: f64 = best.squares.iter().zip(&self.training.variances).map(relative).sum();
        let mut different: Vec<(usize, Stacked)> = Vec::new();
        for (_, set) in &ranked {
            let size = set.singly().count();
            let of_size = different.iter().filter(|(s, _)| *s == size).count();
            if of_size >= DIFFERENT {
                continue;
            }
            let Some(residual) = self.training.residual(&set.effects) else { continue };
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

    /// Fits what a set leads to.
    fn expand(&mut self, at: &SetKey) {
        self.expanded.push(at.clone());
        let Some(set) = self.sets.get(at).cloned() else { return };
        let mut trials: Vec<(Vec<Applied>, Option<f64>)> = dropped(&set).collect();
        if set.singly().count() < MOST {
            let proposals = self.fit().proposals(&set, self.candidates);
            trials.extend(proposals.into_iter().take(FITTED).map(|proposal| {
                let effects = set.effects.iter().cloned().chain([proposal.applied]);
                (in_order(effects), set.recalibration)
            }));
        }
        match set.recalibration {
            None if self.numbers.len() > 1 => {
                let singly = set.effects.iter().filter(|a| !a.effect.corrects_model()).cloned();
                let effects = in_order(singly.chain(self.numbers.iter().cloned()));
                trials.push((effects, Some(SIZE)));
            }
            None => {}
            Some(_) => trials.extend(self.most_moved(&set)),
        }
        self.fit_all(trials);
    }

    /// The set with its one, two, three most moved parameters in the place of the joint recalibration.
    fn most_moved(&self, set: &CauseSet) -> Vec<(Vec<Applied>, Option<f64>)> {
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
                (in_order(set.singly().cloned().chain(singles)), None)
            })
            .collect()
    }

    /// Fits sets that are not known yet.
    fn fit_all(&mut self, trials: Vec<(Vec<Applied>, Option<f64>)>) {
        let mut fresh: Vec<(Vec<Applied>, Option<f64>)> = Vec::new();
        let mut keys: Vec<SetKey> = Vec::new();
        for (effects, recalibration) in trials {
            let singly =
                effects.iter().filter(|a| recalibration.is_none() || !a.effect.corrects_model());
            let key = key(singly, recalibration.is_some());
            if !self.sets.contains_key(&key) && !keys.contains(&key) {
                keys.push(key);
                fresh.push((effects, recalibration));
            }
        }
        let one = |(effects, recalibration): (Vec<Applied>, Option<f64>)| {
            let set = self.fit().of(effects, recalibration)?;
            let Some(size) = size(&set) else { return Some(set) };
            self.fit().of(set.effects.clone(), Some(size)).or(Some(set))
        };
        let fitted: Vec<CauseSet> = fresh.into_par_iter().filter_map(one).collect();
        self.sets.extend(fitted.into_iter().map(|set| (set.key(), set)));
    }
}

/// A set without each of its effects, and without its joint recalibration.
fn dropped(set: &CauseSet) -> impl Iterator<Item = (Vec<Applied>, Option<f64>)> {
    let one = |out: &Applied| {
        let kept = set.effects.iter().filter(|a| a.key() != out.key()).cloned().collect();
        (kept, set.recalibration)
    };
    let alone = set.recalibration.map(|_| (set.singly().cloned().collect(), None));
    set.singly().map(one).chain(alone)
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
