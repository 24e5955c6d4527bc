//! The section `cause`: the verdict with its effects, the ranking, and the classes of indistinguishable effects.

use super::experiment;
use super::experiment::experiment;
use super::found_effects::found_effects;
use crate::causes::class::EffectClass;
use crate::causes::conclusion::ActiveCauses;
use crate::format::class::CauseClass;
use crate::format::diagnosis::{Cause, RankedPair, RankedSingle, RankingRow};
use crate::format::found::FoundEffect;
use crate::format::next_experiment::NextExperiment;
use crate::hypothesis::effects::Hypothesis;
use crate::judge::prior_sensitivity::PriorSensitivity;
use crate::judge::rule::GapVerdict;
use crate::judge::verdict::Judged;
use crate::likelihood::gaussian::Likelihood;
use crate::search::catalogue_search::SearchResult;
use deadtime_model::effect::{Applied, Scales};
use deadtime_signal::parallel;

/// The number of pairs in the ranking.
const PAIRS: usize = 5;

/// The section `cause`, without its budget, and the experiment that it proposes; `after` gives a hypothesis's training nrmse.
pub(crate) fn cause(
    likelihood: &Likelihood<'_>,
    (composed, classes): (&ActiveCauses, Vec<CauseClass>),
    found: &SearchResult,
    scales: &Scales,
    sensitivities: &[PriorSensitivity],
    after: impl Fn(&Hypothesis) -> Option<f64> + Sync,
) -> (Cause, Option<NextExperiment>) {
    let ActiveCauses { judged, estimate, .. } = composed;
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
        .flat_map(|e| found_effects(likelihood, e, estimate.as_ref()))
        .filter(is_named)
        .collect();
    let ranking = ranking(composed, (found, named.as_ref()), &classes, after);
    let alike = alias_classes(composed);
    let next_experiment = match (alike.first(), judged.best.as_ref()) {
        (Some(class), Some(best)) => Some(separating(likelihood, scales, class, best)),
        _ => (!sensitivities.is_empty()).then(|| experiment::of_starts(sensitivities)),
    };
    let keys = |class: &&EffectClass| {
        std::iter::once(&class.effect).chain(class.aliases()).map(Applied::key).collect()
    };
    let mut indistinguishable: Vec<Vec<String>> = alike.iter().map(keys).collect();
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
        classes,
        order: Vec::new(),
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

/// The classes with aliases among the effects of the verdict that have a share of their own.
fn alias_classes(composed: &ActiveCauses) -> Vec<&EffectClass> {
    let singly: Vec<String> = composed
        .singly()
        .into_iter()
        .filter_map(|at| Some(composed.hypothesis.as_ref()?.effects[at].key()))
        .collect();
    composed
        .classes
        .iter()
        .filter(|class| composed.judged.found.is_some() && class.aliases().next().is_some())
        .filter(|class| singly.contains(&class.effect.key()))
        .collect()
}

/// The experiment that separates an effect of the best hypothesis from its first alias.
fn separating(
    likelihood: &Likelihood<'_>,
    scales: &Scales,
    class: &EffectClass,
    best: &Hypothesis,
) -> NextExperiment {
    let members: Vec<Applied> =
        std::iter::once(&class.effect).chain(class.aliases()).cloned().collect();
    let replaced =
        |a: &Applied| if a.key() == members[0].key() { members[1].clone() } else { a.clone() };
    let rival: Vec<Applied> = best.effects.iter().map(replaced).collect();
    experiment(likelihood, scales, &members, &best.effects, &rival)
}

/// The shares of the probability of the rows of the ranking.
struct Odds<'o> {
    none: f64,
    unknown: f64,
    /// The probability of the reported list of causes as a whole.
    list: f64,
    /// The effects that share that of a single effect, and its keys.
    alike: Vec<String>,
    named: Option<&'o Hypothesis>,
}

impl<'o> Odds<'o> {
    /// A list is correct where each of its classes is; any other list belongs to no row, and its probability goes to unknown.
    fn of(composed: &ActiveCauses, named: Option<&'o Hypothesis>, classes: &[CauseClass]) -> Self {
        let Judged { verdict, unknown, .. } = &composed.judged;
        let all: f64 = classes.iter().map(|class| class.probability).product();
        let (none, unknown, list) = match verdict {
            GapVerdict::None => (1.0 - unknown, *unknown, 0.0),
            GapVerdict::Unknown => (0.0, *unknown, 1.0 - unknown),
            GapVerdict::Effects => (0.0, 1.0 - all, all),
        };
        let alike = match named.map(|e| e.effects.as_slice()) {
            Some([one]) => {
                let key = one.key();
                std::iter::once(key.clone()).chain(composed.aliases(&key)).collect()
            }
            _ => Vec::new(),
        };
        Self { none, unknown, list, alike, named }
    }

    fn given(&self, row: &Hypothesis) -> f64 {
        match row.effects.as_slice() {
            [one] if self.alike.contains(&one.key()) => self.list / self.alike.len() as f64,
            _ if self.leads(row) => self.list / self.alike.len().max(1) as f64,
            _ => 0.0,
        }
    }

    fn leads(&self, row: &Hypothesis) -> bool {
        self.named.is_some_and(|named| named.key() == row.key())
    }
}

/// Every effect and the best pairs, with `none` and `unknown`, by probability, then by the error that they leave. `after` gives a hypothesis's training nrmse.
fn ranking(
    composed: &ActiveCauses,
    (found, named): (&SearchResult, Option<&Hypothesis>),
    classes: &[CauseClass],
    after: impl Fn(&Hypothesis) -> Option<f64> + Sync,
) -> Vec<RankingRow> {
    let named = named.or(composed.judged.best.as_ref());
    let listed = || found.singles.iter().chain(found.pairs.iter().take(PAIRS));
    let missing = named.filter(|named| listed().all(|e| e.key() != named.key()));
    let listed: Vec<&Hypothesis> = listed().chain(missing).collect();
    let mut odds = Odds::of(composed, named, classes);
    let sum: f64 = listed.iter().map(|e| odds.given(e)).sum();
    odds.unknown += (odds.list - sum).max(0.0);
    let mut rows: Vec<(f64, bool, RankingRow)> = parallel::map(listed.iter(), |e| {
        (odds.given(e), odds.leads(e), row(e, odds.given(e), after(e)))
    });
    let plain = |effect: &str, probability: f64| {
        RankingRow::Single(RankedSingle {
            effect: effect.to_owned(),
            channel: None,
            probability,
            after: None,
        })
    };
    let verdict = composed.judged.verdict;
    rows.iter_mut().for_each(|row| row.1 &= verdict == GapVerdict::Effects);
    rows.push((odds.none, verdict == GapVerdict::None, plain("none", odds.none)));
    rows.push((odds.unknown, verdict == GapVerdict::Unknown, plain("unknown", odds.unknown)));
    let error = |row: &RankingRow| match row {
        RankingRow::Single(r) => r.after,
        RankingRow::Pair(r) => r.after,
    };
    // The verdict leads its equals.
    rows.sort_by(|a, b| {
        let errors = [a, b].map(|row| error(&row.2).unwrap_or(f64::INFINITY));
        b.1.cmp(&a.1).then(b.0.total_cmp(&a.0)).then(errors[0].total_cmp(&errors[1]))
    });
    rows.into_iter().map(|r| r.2).collect()
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
