//! The result of a search over sets: the leading set, the class of each of its effects, and the spread of values over the sets that are as good.
//!
//! How it can be wrong: only visited sets count. An alias that no trial has put in the place of its effect is in no class.

use super::class::EffectClass;
use super::score::Score;
use super::set::{CauseSet, SetKey, dropped, key};
use crate::hypothesis::penalised_gain::NO_EVIDENCE;
use deadtime_model::effect::{Applied, row};

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
    /// From the fitted sets, the best score first; `None` without any.
    pub(super) fn of(
        mut sets: Vec<(f64, CauseSet)>,
        score: Score,
        variances: Vec<f64>,
        inexact: f64,
    ) -> Option<Self> {
        let leader = leader(&sets)?;
        sets[..=leader].rotate_right(1);
        let mut found = Self { sets, score, variances, inexact };
        while let Some(special) = found.special_case_of_leader() {
            found.sets[..=special].rotate_right(1);
        }
        Some(found)
    }

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
        energy(&set.squares, &self.variances)
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

/// Squared errors per output, each over its variance.
pub(super) fn energy(squares: &[f64], variances: &[f64]) -> f64 {
    let relative =
        |(square, variance): (&f64, &f64)| if *variance > 0.0 { square / variance } else { 0.0 };
    squares.iter().zip(variances).map(relative).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::causes::set::in_order;
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
