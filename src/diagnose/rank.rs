//! The ranking: probabilities of all explanations, and classes that the data cannot tell apart.

use rayon::prelude::*;

use super::diagnosis::{Cause, FoundEffect, Parameter, RankedPair, RankedSingle, RankingRow};
use super::experiment::{self, experiment};
use super::explanation::{Explanation, difference};
use super::intervals::Estimate;
use super::problem::Problem;
use super::search::Found;
use super::trust::Hang;
use super::verdict::{Judged, Verdict};
use crate::effect::{Applied, EFFECTS, Scales};

/// Twice the log-likelihood by which the best of a whole catalogue must beat no effect, and the best second effect a single one: the best of 50 to 100
/// rivals reaches 10 to 25 on noise alone.
pub(super) const SEARCH_WIDE: f64 = 30.0;
/// Explanations that differ by less than this in twice the log-likelihood are as good as each other: the fewest parameters, then the first of the table lead.
const NEAR: f64 = 6.0;
/// No simulator is exact: of what an effect explains, this part of its energy (1.4 % of its amplitude) is within what a model is off anyway.
const INEXACT: f64 = 2e-4;
/// Relative standard deviation of a lattice's step: the rounding of numbers in a log.
const LATTICE: f64 = 1e-6;
/// How many pairs the ranking lists.
const PAIRS: usize = 5;

/// Twice the log of the posterior odds against no effect (Schwarz 1978, doi:10.1214/aos/1176344136).
pub(super) fn odds(explanation: &Explanation, weight: f64) -> f64 {
    let (further, effects) = (explanation.further_parameters() as f64, explanation.effects.len() as f64);
    explanation.gain - further * weight.max(2.0).ln() - effects * SEARCH_WIDE
}

/// The difference in twice the log-likelihood that tells nothing.
pub(super) fn slack(gain: f64) -> f64 {
    NEAR.max(INEXACT * gain)
}

/// The best fitted explanation; of near equals the one with the fewest parameters, of equals the first in the table.
pub(super) fn leader(explanations: &[Explanation], weight: f64) -> Option<&Explanation> {
    let fitted = || explanations.iter().filter(|e| e.fitted);
    let best =
        |among: &dyn Fn(&Explanation) -> bool| fitted().filter(|e| among(e)).map(|e| odds(e, weight)).fold(f64::NEG_INFINITY, f64::max);
    let top = best(&|_| true);
    let fewest = fitted().filter(|e| odds(e, weight) > top - NEAR).map(|e| e.free.len()).min()?;
    let top = best(&|e| e.free.len() <= fewest);
    let place =
        |e: &Explanation| e.effects.iter().filter_map(|a| EFFECTS.iter().position(|t| t.name() == a.effect.name())).collect::<Vec<_>>();
    fitted().filter(|e| e.free.len() <= fewest && odds(e, weight) > top - NEAR).min_by_key(|e| place(e))
}

/// Twice the log-odds of everything that is ranked, as the verdict sees it.
struct Scale {
    none: f64,
    best: f64,
    /// What pairs lose where a second effect does not matter.
    pairs: f64,
    weight: f64,
    /// Differences count for less by this factor.
    temper: f64,
}

impl Scale {
    fn new(judged: &Judged, found: &Found, weight: f64) -> Self {
        // 9 to 1 for the verdict where the likelihood prefers something that does not matter.
        let top = |all: &[Explanation]| all.iter().map(|e| odds(e, weight)).fold(f64::NEG_INFINITY, f64::max);
        let (single, pair) = (top(&found.singles), top(&found.pairs));
        let temper = slack(f64::max(single, pair)) / NEAR;
        let clear = 2.0 * 9.0_f64.ln() * temper;
        let size = judged.best.as_ref().map_or(0, |e| e.effects.len());
        let none = if size == 0 { f64::max(0.0, single + clear) } else { 0.0 };
        let limit = if size == 2 { f64::INFINITY } else { f64::max(single, none) - clear };
        let pairs = (pair - limit).max(0.0);
        let best = f64::max(f64::max(single, pair - pairs), none);
        Self { none, best, pairs, weight, temper }
    }

    fn share(&self, odds: f64) -> f64 {
        if odds.is_finite() { (0.5 * (odds - self.best) / self.temper).exp() } else { 0.0 }
    }

    fn of(&self, explanation: &Explanation) -> f64 {
        let less = if explanation.effects.len() > 1 { self.pairs } else { 0.0 };
        self.share(odds(explanation, self.weight) - less)
    }
}

/// The section `cause`; `after` gives an explanation's training nrmse, `estimate` belongs to what was found.
pub(super) fn cause(
    problem: &Problem<'_>,
    judged: &Judged,
    found: &Found,
    estimate: Option<&Estimate>,
    scales: &Scales,
    hangs: &[Hang],
    after: impl Fn(&Explanation) -> Option<f64> + Sync,
) -> Cause {
    let scale = Scale::new(judged, found, problem.weight());
    let listed: Vec<&Explanation> = found.singles.iter().chain(found.pairs.iter().take(PAIRS)).collect();
    let sum: f64 = listed.iter().map(|e| scale.of(e)).sum::<f64>() + scale.share(scale.none);
    let rest = 1.0 - judged.unknown;
    let mut rows: Vec<(f64, bool, RankingRow)> = listed
        .par_iter()
        .map(|e| {
            let probability = rest * scale.of(e) / sum;
            let leads = judged.found.as_ref().is_some_and(|f| f.key() == e.key());
            (probability, leads, row(e, probability, after(e)))
        })
        .collect();
    let plain = |effect: &str, probability: f64| {
        RankingRow::Single(RankedSingle { effect: effect.to_owned(), channel: None, probability, after: None })
    };
    let none = rest * scale.share(scale.none) / sum;
    rows.push((none, judged.verdict == Verdict::None, plain("none", none)));
    rows.push((judged.unknown, judged.verdict == Verdict::Unknown, plain("unknown", judged.unknown)));
    // The verdict leads its equals.
    rows.sort_by(|a, b| b.1.cmp(&a.1).then(b.0.total_cmp(&a.0)));
    let classes =
        judged.found.as_ref().and(judged.best.as_ref()).map(|leader| classes(problem, leader, found, judged.inexact)).unwrap_or_default();
    let next_experiment = match (classes.iter().find(|class| class.len() > 1), judged.best.as_ref()) {
        (Some(class), Some(best)) => {
            let replaced = |a: &Applied| if a.key() == class[0].key() { class[1].clone() } else { a.clone() };
            let rival: Vec<Applied> = best.effects.iter().map(replaced).collect();
            Some(experiment(problem, scales, class, &best.effects, &rival))
        }
        _ => (!hangs.is_empty()).then(|| experiment::of_starts(hangs)),
    };
    let mut indistinguishable: Vec<Vec<String>> = classes.iter().map(|class| class.iter().map(Applied::key).collect()).collect();
    start_classes(&mut indistinguishable, judged.found.as_ref(), hangs);
    let first = judged.found.as_ref().and_then(|e| e.effects.first());
    Cause {
        verdict: match judged.verdict {
            Verdict::None => "none".to_owned(),
            Verdict::Unknown => "unknown".to_owned(),
            Verdict::Effects => first.map(|a| a.effect.name().to_owned()).unwrap_or_default(),
        },
        channel: first.map(|a| a.channel.clone()),
        effects: judged.found.iter().flat_map(|e| found_effects(problem, e, estimate)).collect(),
        ranking: rows.into_iter().map(|r| r.2).collect(),
        indistinguishable,
        not_tried: Vec::new(),
        next_experiment,
    }
}

/// Adds the starts on which the verdict hangs to the class of its first effect, with what would lead instead.
fn start_classes(classes: &mut Vec<Vec<String>>, found: Option<&Explanation>, hangs: &[Hang]) {
    if hangs.is_empty() {
        return;
    }
    let own: Vec<String> = found.iter().flat_map(|e| e.effects.first()).map(Applied::key).collect();
    let at = classes.iter().position(|class| class.first() == own.first()).unwrap_or_else(|| {
        classes.insert(0, own.clone());
        0
    });
    for hang in hangs {
        let names = std::iter::once(format!("initial_state:{}", hang.state)).chain(hang.instead.iter().map(Applied::key));
        for name in names {
            if !classes[at].contains(&name) {
                classes[at].push(name);
            }
        }
    }
}

fn row(explanation: &Explanation, probability: f64, after: Option<f64>) -> RankingRow {
    let named = |a: &Applied| [a.effect.name().to_owned(), a.channel.clone()];
    match explanation.effects.as_slice() {
        [one] => RankingRow::Single(RankedSingle {
            effect: one.effect.name().to_owned(),
            channel: Some(one.channel.clone()),
            probability,
            after,
        }),
        several => RankingRow::Pair(RankedPair { effects: several.iter().map(named).collect(), probability, after }),
    }
}

pub(super) fn found_effects(problem: &Problem<'_>, explanation: &Explanation, estimate: Option<&Estimate>) -> Vec<FoundEffect> {
    let parameter = |e: usize, i: usize| {
        let applied = &explanation.effects[e];
        let place = explanation.free.iter().position(|&at| at == (e, i));
        let std = match (&explanation.lost, place) {
            (Some(lost), None) if applied.effect.loses_commands() => {
                problem.system.inputs.iter().position(|p| p.name == applied.channel).and_then(|input| lost.std[input])
            }
            (_, None) if applied.effect.leaves_residual() => Some(LATTICE * applied.values[i]),
            _ => estimate.zip(place).and_then(|(estimate, at)| estimate.std[at]),
        };
        let value = applied.values[i];
        Parameter {
            name: applied.parameters[i].name.to_owned(),
            unit: applied.parameters[i].unit.clone(),
            value: value.is_finite().then_some(value),
            std,
            ci95: std.map(|s| [value - 1.96 * s, value + 1.96 * s]),
        }
    };
    (explanation.effects.iter().enumerate())
        .map(|(e, applied)| FoundEffect {
            effect: applied.effect.name().to_owned(),
            channel: applied.channel.clone(),
            parameters: (0..applied.values.len()).map(|i| parameter(e, i)).collect(),
        })
        .collect()
}

/// For every effect of the leader: itself and all that could stand in its place with a likelihood and trajectories as good; classes of one are left out.
/// `inexact` is what the simulator is seen to be off by beside the leader: smaller differences say nothing.
fn classes(problem: &Problem<'_>, leader: &Explanation, found: &Found, inexact: f64) -> Vec<Vec<Applied>> {
    let Some(own) = problem.whitened(leader) else { return Vec::new() };
    let mut classes: Vec<Vec<Applied>> = leader.effects.iter().map(|a| vec![a.clone()]).collect();
    let same_size = if leader.effects.len() == 1 { &found.singles } else { &found.pairs };
    let slack = slack(leader.gain).max(inexact);
    for rival in same_size.iter().filter(|r| r.fitted && (r.gain - leader.gain).abs() < slack) {
        let missing = |of: &Explanation, from: &Explanation| {
            let keys: Vec<String> = from.effects.iter().map(Applied::key).collect();
            (0..of.effects.len()).filter(|&i| !keys.contains(&of.effects[i].key())).collect::<Vec<_>>()
        };
        let (&[place], &[other]) = (missing(leader, rival).as_slice(), missing(rival, leader).as_slice()) else { continue };
        let Some(theirs) = problem.whitened(rival) else { continue };
        let apart = difference(&own, &theirs, 1.0);
        if problem.inner(&apart, &apart) < 2.0 * slack {
            classes[place].push(rival.effects[other].clone());
        }
    }
    classes.retain(|class| class.len() > 1);
    classes
}
