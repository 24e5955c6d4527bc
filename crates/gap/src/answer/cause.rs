//! The section `cause`: the verdict with its effects, the ranking, and what the data cannot tell apart.

use rayon::prelude::*;

use super::acts;
use super::alternatives::classes;
use super::experiment;
use super::experiment::experiment;
use super::found_effects::found_effects;
use super::probabilities::Probabilities;
use crate::causes::conclusion::ActiveCauses;
use crate::format::diagnosis::{Cause, RankedPair, RankedSingle, RankingRow};
use crate::format::found::FoundEffect;
use crate::format::next_experiment::NextExperiment;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::penalised_gain::Penalties;
use crate::judge::prior_sensitivity::PriorSensitivity;
use crate::judge::rule::GapVerdict;
use crate::judge::verdict::Judged;
use crate::likelihood::gaussian::Likelihood;
use crate::search::catalogue_search::SearchResult;
use deadtime_model::effect::{Applied, Scales};

/// How many pairs the ranking lists.
const PAIRS: usize = 5;

/// The section `cause`, without its budget, and the experiment that it proposes; `after` gives a hypothesis's training nrmse.
pub(crate) fn cause(
    likelihood: &Likelihood<'_>,
    composed: &ActiveCauses,
    found: &SearchResult,
    scales: &Scales,
    sensitivities: &[PriorSensitivity],
    after: impl Fn(&Hypothesis) -> Option<f64> + Sync,
) -> (Cause, Option<NextExperiment>) {
    let ActiveCauses { judged, aliases, estimate, .. } = composed;
    let estimate = estimate.as_ref();
    let named = composed.named();
    let is_named = |e: &FoundEffect| {
        named
            .iter()
            .flat_map(|n| &n.effects)
            .any(|a| a.effect.name() == e.effect && a.channel == e.channel)
    };
    let effects: Vec<FoundEffect> = judged
        .found
        .iter()
        .flat_map(|e| found_effects(likelihood, e, estimate))
        .filter(is_named)
        .collect();
    let list = acts::list(named.as_ref().map_or(&[], |e| &e.effects), &effects);
    let ranking = ranking(
        judged,
        (found, named.as_ref()),
        &Probabilities::new(judged, found, Penalties::of(likelihood)),
        list,
        after,
    );
    let classes = judged
        .found
        .as_ref()
        .and(judged.best.as_ref())
        .map(|leader| classes(likelihood, leader, found, judged.inexact))
        .unwrap_or_default();
    let next_experiment = match (classes.iter().find(|class| class.len() > 1), judged.best.as_ref())
    {
        (Some(class), Some(best)) => {
            let replaced =
                |a: &Applied| if a.key() == class[0].key() { class[1].clone() } else { a.clone() };
            let rival: Vec<Applied> = best.effects.iter().map(replaced).collect();
            Some(experiment(likelihood, scales, class, &best.effects, &rival))
        }
        _ => (!sensitivities.is_empty()).then(|| experiment::of_starts(sensitivities)),
    };
    let mut indistinguishable: Vec<Vec<String>> =
        classes.iter().map(|class| class.iter().map(Applied::key).collect()).collect();
    for (effect, instead) in judged.found.iter().flat_map(|e| e.effects.iter().zip(aliases)) {
        stand_in_class(&mut indistinguishable, effect, instead);
    }
    start_classes(&mut indistinguishable, judged.found.as_ref(), sensitivities);
    let first = judged.found.as_ref().and_then(|e| e.effects.first());
    let cause = Cause {
        verdict: match judged.verdict {
            GapVerdict::None => "none".to_owned(),
            GapVerdict::Unknown => "unknown".to_owned(),
            GapVerdict::Effects => first.map(|a| a.effect.name().to_owned()).unwrap_or_default(),
        },
        channel: first.map(|a| a.channel.clone()),
        effects,
        ranking,
        indistinguishable,
        not_tried: Vec::new(),
        next_experiment: next_experiment.as_ref().map(ToString::to_string),
        explained: None,
        contributions: Vec::new(),
        recalibration: None,
        remainder: None,
    };
    (cause, next_experiment)
}

/// Every effect and the best pairs by probability, with `none` and `unknown`; `list`: how often what is found is the whole list of the causes, where it fits so
/// well. `after` gives a hypothesis's training nrmse.
fn ranking(
    judged: &Judged,
    (found, named): (&SearchResult, Option<&Hypothesis>),
    scale: &Probabilities,
    list: f64,
    after: impl Fn(&Hypothesis) -> Option<f64> + Sync,
) -> Vec<RankingRow> {
    let several = named.into_iter().filter(|e| {
        e.effects.len() > 1 && found.pairs.iter().take(PAIRS).all(|p| p.key() != e.key())
    });
    let listed: Vec<&Hypothesis> =
        found.singles.iter().chain(found.pairs.iter().take(PAIRS)).chain(several).collect();
    let sum: f64 = listed.iter().map(|e| scale.of(e)).sum::<f64>() + scale.share(scale.none);
    let rest = 1.0 - judged.unknown;
    let leading = named.map(Hypothesis::key);
    let leads = |e: &Hypothesis| leading.as_ref().is_some_and(|key| *key == e.key());
    let given = |e: &Hypothesis| rest * scale.of(e) / sum * if leads(e) { list } else { 1.0 };
    // What a list may lack or have too much is another list, and that is none of the rows.
    let unknown = judged.unknown
        + listed.iter().filter(|e| leads(e)).map(|e| given(e) / list - given(e)).sum::<f64>();
    let mut rows: Vec<(f64, bool, RankingRow)> =
        listed.par_iter().map(|e| (given(e), leads(e), row(e, given(e), after(e)))).collect();
    let plain = |effect: &str, probability: f64| {
        RankingRow::Single(RankedSingle {
            effect: effect.to_owned(),
            channel: None,
            probability,
            after: None,
        })
    };
    let none = rest * scale.share(scale.none) / sum;
    rows.push((none, judged.verdict == GapVerdict::None, plain("none", none)));
    rows.push((unknown, judged.verdict == GapVerdict::Unknown, plain("unknown", unknown)));
    // The verdict leads its equals.
    rows.sort_by(|a, b| b.1.cmp(&a.1).then(b.0.total_cmp(&a.0)));
    rows.into_iter().map(|r| r.2).collect()
}

/// Adds what could stand in an effect's place to the effect's class.
fn stand_in_class(classes: &mut Vec<Vec<String>>, effect: &Applied, instead: &[Applied]) {
    if instead.is_empty() {
        return;
    }
    let own = effect.key();
    let at = classes.iter().position(|class| class.contains(&own)).unwrap_or_else(|| {
        classes.push(vec![own]);
        classes.len() - 1
    });
    for name in instead.iter().map(Applied::key) {
        if !classes[at].contains(&name) {
            classes[at].push(name);
        }
    }
}

/// Adds the starts on which the verdict hangs to the class of its first effect, with what would lead instead.
fn start_classes(
    classes: &mut Vec<Vec<String>>,
    found: Option<&Hypothesis>,
    sensitivities: &[PriorSensitivity],
) {
    if sensitivities.is_empty() {
        return;
    }
    let own: Vec<String> = found.iter().flat_map(|e| e.effects.first()).map(Applied::key).collect();
    let at = classes.iter().position(|class| class.first() == own.first()).unwrap_or_else(|| {
        classes.insert(0, own.clone());
        0
    });
    for sensitivity in sensitivities {
        let names = std::iter::once(format!("initial_state:{}", sensitivity.state))
            .chain(sensitivity.instead.iter().map(Applied::key));
        for name in names {
            if !classes[at].contains(&name) {
                classes[at].push(name);
            }
        }
    }
}

fn row(hypothesis: &Hypothesis, probability: f64, after: Option<f64>) -> RankingRow {
    let named = |a: &Applied| [a.effect.name().to_owned(), a.channel.clone()];
    match hypothesis.effects.as_slice() {
        [one] => RankingRow::Single(RankedSingle {
            effect: one.effect.name().to_owned(),
            channel: Some(one.channel.clone()),
            probability,
            after,
        }),
        several => RankingRow::Pair(RankedPair {
            effects: several.iter().map(named).collect(),
            probability,
            after,
        }),
    }
}
