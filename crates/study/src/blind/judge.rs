//! One verdict compared with its truth: every quantity that the scores use, decided once.

use std::f64::consts::{PI, TAU};

use serde::Serialize;

use super::label::{Group, Label, LabelEffect};
use super::load::Scored;
use deadtime_gap::{Contribution, Diagnosis, Explained, FoundEffect, RankingRow};

/// The factor over the error before from which a held-out error counts as harm: 2 %.
const HARM: f64 = 1.02;
/// The effect that is a number of the model.
const NUMBER: &str = "parameter_error";
/// The share of the gap from which a parameter of the model counts where several are wrong: less is rarely detectable.
const COUNTS: f64 = 0.01;
/// The least true value that an error is taken relative to, as a share of the effect's largest true value of the same unit.
const SMALL: f64 = 1e-3;
/// The same where there is no such value.
const SMALLEST: f64 = 1e-9;
/// The relative miss of an interval's end through rounding alone.
const ROUNDING: f64 = 1e-12;
/// The effect that a delay which moves is taken for, and the probability above which it is.
const LOST: &str = "dropped_commands:";
const PROBABLE: f64 = 0.5;
/// The number of first answers of the ranking.
const FIRST: usize = 3;

/// One case with what its scores need.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judged {
    /// The case.
    pub id: String,
    /// Its kind.
    pub group: Group,
    /// The truth: `effect:channel`, joined by ` + `, or `none`, `unknown`.
    pub truth: String,
    /// The verdict, in the same form.
    pub verdict: String,
    /// The plant.
    pub plant: String,
    /// Open, stabilised or closed loop, if the label has it.
    pub loop_kind: Option<String>,
    /// The ratio of the effect to the noise, dB.
    pub strength_db: Option<f64>,
    /// The judgement.
    #[serde(flatten)]
    pub judgement: Judgement,
}

/// The judgement; missing where it does not apply to the case.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Judgement {
    /// The verdict is the truth, or indistinguishable from it on any data (see docs/blind.md for each kind of case).
    pub right: bool,
    /// Single: effect and channel are the truth's.
    pub top1: Option<bool>,
    /// Single: the truth is among the first three.
    pub top3: Option<bool>,
    /// Single: the verdict is in the truth's alias class.
    pub top1_class: Option<bool>,
    /// Single: one of the first three is in it.
    pub top3_class: Option<bool>,
    /// Single: the verdict has effects in addition to the leading one.
    pub extra_effects: Option<bool>,
    /// Single: the truth's alias class, itself included.
    pub class_size: Option<usize>,
    /// Single: the class that the diagnosis gives its verdict, itself included.
    pub named_class_size: Option<usize>,
    /// Single: the truth is in that class.
    pub named_class_holds: Option<bool>,
    /// Pair: the effects are the truth's.
    pub pair_exact: Option<bool>,
    /// Pair: the effects are the truth's, each up to its alias class.
    pub pair_class: Option<bool>,
    /// Pair: at least one of the effects is one of the truth's.
    pub pair_any: Option<bool>,
    /// Right single: relative error of each parameter.
    pub parameter_errors: Vec<f64>,
    /// Right single: error of each parameter relative to its distance from having no effect.
    pub deviation_errors: Vec<f64>,
    /// Right single: whether each true parameter with an interval lies inside.
    pub covered: Vec<bool>,
    /// Right single: whether each true parameter has no estimate.
    pub parameter_missing: Vec<bool>,
    /// Right single: whether each true parameter has no interval.
    pub without_interval: Vec<bool>,
    /// The output with the largest share is one of the label's.
    pub where_output: Option<bool>,
    /// Time: intersection over union.
    pub where_time: Option<f64>,
    /// Band: intersection over union.
    pub where_band: Option<f64>,
    /// Mixture: what contributes most is the strongest of the truth, up to the class that it is given.
    pub strongest: Option<bool>,
    /// Mixture: the share of the true effects that is named.
    pub recall: Option<f64>,
    /// Mixture: the share of the named effects that is true.
    pub precision: Option<f64>,
    /// Mixture: by how much the share of each effect that is named rightly is off.
    pub share_errors: Vec<f64>,
    /// Mixture with two wrong parameters of the model or more: F1, the harmonic mean of recall and precision of the named parameters.
    pub numbers: Option<f64>,
    /// Mixture: an answer that claims to explain all names something that is not there.
    pub false_cause: Option<bool>,
    /// All effects reported as active, for any verdict; none is right where no effect of the catalogue acts.
    pub contributions: Vec<Claim>,
    /// Moving: the verdict is in the truth's alias class.
    pub moving_class: Option<bool>,
    /// Moving: lost commands are given a probability above 0.5.
    pub moving_lost: Option<bool>,
    /// Moving: the held-out error is larger than before.
    pub moving_worse: Option<bool>,
    /// Share of the explainable gap that was closed, over the oracle's.
    pub of_oracle: Option<f64>,
    /// The held-out error is more than 2 % worse than before.
    pub harm: Option<bool>,
    /// Probability that the ranking gave to the truth.
    pub truth_probability: Option<f64>,
    /// Probability that it gave to the verdict.
    pub verdict_probability: Option<f64>,
    /// The verdict is exactly the truth; what `verdict_probability` is about.
    pub exact: bool,
    /// Run time, s.
    pub time_s: Option<f64>,
}

/// That an effect acts.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Claim {
    /// Effect and channel.
    pub name: String,
    /// The probability that it was given; missing where none was.
    pub probability: Option<f64>,
    /// The effect, or an alias that the diagnosis reports, is one of the true effects or of their classes.
    pub right: bool,
}

/// Judges one case.
#[must_use]
pub fn judge(case: &Scored) -> Judged {
    let (label, diagnosis) = (&case.label, &case.diagnosis);
    let names = Names::of(diagnosis);
    let truth: Vec<String> = match label.group {
        Group::Single | Group::Pair | Group::Mixture | Group::Moving => {
            label.effects.iter().map(|e| names.name(&e.effect, &e.channel)).collect()
        }
        Group::None => vec!["none".to_owned()],
        Group::Unknown => vec!["unknown".to_owned()],
    };
    let verdict = names.verdict(diagnosis);
    let leading = verdict.first().cloned().unwrap_or_default();
    let exact = same_set(&truth, &verdict);
    let mut j = Judgement { exact, right: exact, time_s: case.time_s, ..Judgement::default() };
    let classes = names.classes(label, &truth);
    match label.group {
        Group::Single => {
            single(&mut j, label, diagnosis, &names, &verdict);
            j.right = j.top1_class == Some(true);
        }
        Group::Moving => {
            moving(&mut j, label, diagnosis, &names, &verdict);
            j.right = j.moving_class == Some(true);
        }
        Group::Pair => {
            j.pair_exact = Some(exact);
            j.pair_class = Some(matches_classes(&verdict, &classes));
            j.pair_any = Some(verdict.iter().any(|v| truth.contains(v)));
            j.right = j.pair_class == Some(true);
        }
        Group::Mixture => {
            mixture(&mut j, label, diagnosis, &names, (&truth, &classes));
            j.right = j.strongest == Some(true);
        }
        Group::None | Group::Unknown => j.right = leading == truth[0],
    }
    place(&mut j, label, diagnosis);
    let claim = |(c, (class, _)): (&Contribution, (Vec<String>, f64))| Claim {
        name: class.first().cloned().unwrap_or_default(),
        probability: c.probability,
        right: classes.iter().any(|truth| meets(&class, truth)),
    };
    let contributions = &diagnosis.cause.contributions;
    j.contributions = contributions.iter().zip(names.contributions(diagnosis)).map(claim).collect();
    j.of_oracle = of_oracle(label, diagnosis);
    let errors = diagnosis.shrink.before.zip(diagnosis.shrink.after);
    j.harm = errors.map(|(before, after)| after > HARM * before);
    j.truth_probability = names.probability(diagnosis, &truth);
    j.verdict_probability = names.probability(diagnosis, &verdict);
    Judged {
        id: label.id.clone(),
        group: label.group,
        truth: truth.join(" + "),
        verdict: verdict.join(" + "),
        plant: label.plant.clone().unwrap_or_else(|| diagnosis.model.clone()),
        loop_kind: label.loop_kind.clone(),
        strength_db: label.strength_db,
        judgement: j,
    }
}

fn single(
    j: &mut Judgement,
    label: &Label,
    diagnosis: &Diagnosis,
    names: &Names,
    verdict: &[String],
) {
    let Some(effect) = label.effects.first() else { return };
    let truth = names.name(&effect.effect, &effect.channel);
    let class = names.class(&truth, label.alias_class.of(0));
    let leading = verdict.first().cloned().unwrap_or_default();
    let first = names.first(diagnosis, &leading);
    let top1 = leading == truth;
    j.top1 = Some(top1);
    j.top3 = Some(first.contains(&truth));
    j.top1_class = Some(class.contains(&leading));
    j.top3_class = Some(first.iter().any(|f| class.contains(f)));
    j.extra_effects = Some(verdict.len() > 1);
    j.class_size = Some(class.len());
    let named = names.named_class(diagnosis, &leading);
    j.named_class_holds = Some(named.contains(&truth));
    j.named_class_size = Some(named.len());
    if top1
        && let Some(found) =
            diagnosis.cause.effects.iter().find(|f| names.name(&f.effect, &f.channel) == truth)
    {
        parameters(j, effect, found);
    }
}

/// A delay that moves: named up to its class, taken for lost commands, and worth writing down.
fn moving(
    j: &mut Judgement,
    label: &Label,
    diagnosis: &Diagnosis,
    names: &Names,
    verdict: &[String],
) {
    let mut named = Judgement::default();
    single(&mut named, label, diagnosis, names, verdict);
    j.moving_class = named.top1_class;
    let lost = diagnosis
        .cause
        .ranking
        .iter()
        .map(|row| names.row(row))
        .filter(|(effects, _)| effects.iter().any(|e| e.starts_with(LOST)));
    j.moving_lost = Some(lost.map(|(_, probability)| probability).sum::<f64>() > PROBABLE);
    j.moving_worse =
        diagnosis.shrink.before.zip(diagnosis.shrink.after).map(|(before, after)| after > before);
}

/// The contributions of a mixture compared with the true effects. Each contribution represents its alias class, by the diagnosis or by the label.
fn mixture(
    j: &mut Judgement,
    label: &Label,
    diagnosis: &Diagnosis,
    names: &Names,
    (truth, classes): (&[String], &[Vec<String>]),
) {
    let named = names.contributions(diagnosis);
    j.strongest = Some(
        named
            .first()
            .zip(classes.first())
            .is_some_and(|((class, _), strongest)| meets(class, strongest)),
    );
    let part = |some: f64, all: f64| (all > 0.0).then(|| some / all);
    // The parameters of a recalibration are named, too, and share its part of the gap.
    let block = diagnosis.cause.recalibration.iter().filter(|r| r.accepted);
    let numbers = block.flat_map(|r| {
        let each = r.share.learnt.unwrap_or(0.0).max(0.0) / r.parameters.len().max(1) as f64;
        r.parameters.iter().map(move |p| (vec![names.name(NUMBER, &p.name)], each))
    });
    let named: Vec<(Vec<String>, f64)> = named.into_iter().chain(numbers).collect();
    let found = |class: &[String]| named.iter().find(|(named, _)| meets(named, class));
    let rows = || classes.iter().zip(&label.shares);
    let recalled = rows().filter(|(class, _)| found(class).is_some()).map(|(_, share)| share).sum();
    j.recall = part(recalled, label.shares.iter().sum());
    let is_true = |named: &[String]| classes.iter().any(|class| meets(named, class));
    let right = named.iter().filter(|(class, _)| is_true(class)).map(|(_, share)| share).sum();
    j.precision = part(right, named.iter().map(|(_, share)| share).sum());
    j.share_errors =
        rows().filter_map(|(class, share)| Some((found(class)?.1 - share).abs())).collect();
    let is_number = |name: &str| name.split(':').next() == Some(NUMBER);
    let wrong: Vec<_> = rows()
        .zip(truth)
        .filter(|((_, share), name)| is_number(name) && **share >= COUNTS)
        .collect();
    let hits = wrong.iter().filter(|((class, _), _)| found(class).is_some()).count();
    let misses = wrong.len() - hits;
    let false_ones = named
        .iter()
        .filter(|(class, _)| class.first().is_some_and(|name| is_number(name)) && !is_true(class))
        .count();
    j.numbers =
        (wrong.len() > 1).then(|| 2.0 * hits as f64 / (2 * hits + misses + false_ones) as f64);
    let complete = diagnosis.cause.explained == Some(Explained::All);
    j.false_cause = complete.then(|| named.iter().any(|(class, _)| !is_true(class)));
}

fn parameters(j: &mut Judgement, truth: &LabelEffect, found: &FoundEffect) {
    let estimate = |name: &str| found.parameters.iter().find(|p| p.name == name);
    let unit = |name: &str| estimate(name).map(|p| p.unit.as_str());
    let acting =
        || truth.parameters.iter().filter_map(|(name, value)| Some((name.as_str(), (*value)?)));
    for (name, value) in acting() {
        let got = estimate(name).and_then(|p| p.value);
        j.parameter_missing.push(got.is_none());
        if let Some(got) = got {
            let error = distance(name, got, value);
            let largest = acting()
                .filter(|(other, _)| unit(other) == unit(name))
                .fold(0.0, |a: f64, (_, b)| a.max(b.abs()));
            j.parameter_errors.push(error / scale(name, value.abs().max(SMALL * largest)));
            if let Some(nominal) = nominal(&truth.effect, name) {
                j.deviation_errors.push(error / scale(name, (value - nominal).abs()));
            }
        }
        let interval = estimate(name).and_then(|p| p.ci95);
        j.without_interval.push(interval.is_none());
        if let Some([from, to]) = interval {
            let slack = ROUNDING * value.abs();
            let inside = |v: f64| from - slack <= v && v <= to + slack;
            let turns = if name == "phase" { [-TAU, 0.0, TAU] } else { [0.0; 3] };
            j.covered.push(turns.iter().any(|t| inside(value + t)));
        }
    }
}

/// The distance of an estimate from the truth; a phase is periodic.
fn distance(parameter: &str, got: f64, truth: f64) -> f64 {
    let error = (got - truth).abs();
    if parameter == "phase" {
        let around = error.rem_euclid(TAU);
        return around.min(TAU - around);
    }
    error
}

/// The scale of an error; a phase's scale is π.
fn scale(parameter: &str, size: f64) -> f64 {
    if parameter == "phase" { PI } else { size.max(SMALLEST) }
}

/// The value at which a parameter has no effect; none where the model decides it or where several parameters do together.
fn nominal(effect: &str, parameter: &str) -> Option<f64> {
    match (effect, parameter) {
        ("input_gain" | "sensor_gain", "gain") | ("clock_skew", "ratio") => Some(1.0),
        ("parameter_error", _)
        | (_, "lower" | "upper" | "frequency" | "damping" | "phase")
        | ("rate_limit", _) => None,
        _ => Some(0.0),
    }
}

fn place(j: &mut Judgement, label: &Label, diagnosis: &Diagnosis) {
    let inside = |output: &String| label.outputs.is_empty() || label.outputs.contains(output);
    if !label.outputs.is_empty() {
        let top = diagnosis
            .place
            .outputs
            .iter()
            .reduce(|best, o| if o.share > best.share { o } else { best });
        j.where_output = Some(top.is_some_and(|o| label.outputs.contains(&o.name)));
    }
    if let Some(truth) = label.from_s.zip(label.to_s) {
        let spans = diagnosis
            .place
            .times
            .iter()
            .filter(|t| inside(&t.output))
            .map(|t| (t.from_s, t.to_s))
            .collect();
        j.where_time = overlap(truth, spans);
    }
    if let Some(truth) = label.from_hz.zip(label.to_hz) {
        let spans = diagnosis
            .place
            .bands
            .iter()
            .filter(|b| inside(&b.output))
            .map(|b| (b.from_hz, b.to_hz))
            .collect();
        j.where_band = overlap(truth, spans);
    }
}

/// Length of the intersection of a span with the union of others, over the length of the union of all. `None` for a span without length.
fn overlap(truth: (f64, f64), mut spans: Vec<(f64, f64)>) -> Option<f64> {
    let length = truth.1 - truth.0;
    if length <= 0.0 || !length.is_finite() {
        return None;
    }
    spans.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut union, mut common, mut reached) = (0.0, 0.0, f64::NEG_INFINITY);
    for (from, to) in spans {
        let from = from.max(reached);
        if to > from {
            union += to - from;
            common += (to.min(truth.1) - from.max(truth.0)).max(0.0);
            reached = to;
        }
    }
    Some(common / (union + length - common))
}

/// (1 − (after/before)²)/(1 − (oracle_after/before)²), numerator from the diagnosis, denominator from the label, each with its own `before`. The two may have
/// different prediction modes, and only ratios within one mode have a meaning.
fn of_oracle(label: &Label, diagnosis: &Diagnosis) -> Option<f64> {
    if !matches!(label.group, Group::Single | Group::Pair | Group::Mixture) {
        return None;
    }
    let closed = |before: f64, after: f64| 1.0 - (after / before).powi(2);
    let oracle = closed(label.before?, label.oracle_after?);
    let own = closed(diagnosis.shrink.before?, diagnosis.shrink.after?);
    (oracle > 0.0 && own.is_finite()).then(|| own / oracle)
}

/// Effects by name, `effect:channel`; the only output of a model is also called `*`.
struct Names {
    only_output: Option<String>,
}

impl Names {
    /// The alias class of every true effect.
    fn classes(&self, label: &Label, truth: &[String]) -> Vec<Vec<String>> {
        let class = |(i, name): (usize, &String)| self.class(name, label.alias_class.of(i));
        truth.iter().enumerate().map(class).collect()
    }

    fn of(diagnosis: &Diagnosis) -> Self {
        match diagnosis.gap.outputs.as_slice() {
            [only] => Self { only_output: Some(only.name.clone()) },
            _ => Self { only_output: None },
        }
    }

    fn name(&self, effect: &str, channel: &str) -> String {
        let channel = if self.only_output.as_deref() == Some(channel) { "*" } else { channel };
        format!("{effect}:{channel}")
    }

    /// The same for an `effect:channel`; `none` and `unknown` are unchanged.
    fn listed(&self, text: &str) -> String {
        text.split_once(':')
            .map_or_else(|| text.to_owned(), |(effect, channel)| self.name(effect, channel))
    }

    fn class(&self, truth: &str, listed: &[String]) -> Vec<String> {
        let mut class = vec![truth.to_owned()];
        for name in listed.iter().map(|l| self.listed(l)) {
            if !class.contains(&name) {
                class.push(name);
            }
        }
        class
    }

    /// The leading effect, then the others; or `none`, `unknown`.
    fn verdict(&self, diagnosis: &Diagnosis) -> Vec<String> {
        let cause = &diagnosis.cause;
        let leading = cause
            .channel
            .as_ref()
            .map_or_else(|| cause.verdict.clone(), |c| self.name(&cause.verdict, c));
        let mut all = vec![leading];
        for name in cause.effects.iter().map(|e| self.name(&e.effect, &e.channel)) {
            if !all.contains(&name) {
                all.push(name);
            }
        }
        all
    }

    fn row(&self, row: &RankingRow) -> (Vec<String>, f64) {
        match row {
            RankingRow::Single(s) => (
                vec![
                    s.channel
                        .as_ref()
                        .map_or_else(|| s.effect.clone(), |c| self.name(&s.effect, c)),
                ],
                s.probability,
            ),
            RankingRow::Pair(p) => (
                p.effects.iter().map(|[effect, channel]| self.name(effect, channel)).collect(),
                p.probability,
            ),
        }
    }

    /// The first answers: the verdict, then the ranking's rows by probability, each by its leading effect and each once.
    fn first(&self, diagnosis: &Diagnosis, leading: &str) -> Vec<String> {
        let mut rows: Vec<(Vec<String>, f64)> =
            diagnosis.cause.ranking.iter().map(|r| self.row(r)).collect();
        rows.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut first = vec![leading.to_owned()];
        for name in rows.into_iter().filter_map(|(names, _)| names.into_iter().next()) {
            if first.len() < FIRST && !first.contains(&name) {
                first.push(name);
            }
        }
        first
    }

    /// All aliases of the verdict by the diagnosis, the verdict first.
    fn named_class(&self, diagnosis: &Diagnosis, leading: &str) -> Vec<String> {
        let mut class = vec![leading.to_owned()];
        for list in &diagnosis.cause.indistinguishable {
            let names: Vec<String> = list.iter().map(|l| self.listed(l)).collect();
            if names.iter().any(|n| n == leading) {
                for name in names {
                    if !class.contains(&name) {
                        class.push(name);
                    }
                }
            }
        }
        class
    }

    /// Every contribution as its alias class, itself first, and its share.
    fn contributions(&self, diagnosis: &Diagnosis) -> Vec<(Vec<String>, f64)> {
        let one = |c: &Contribution| {
            let mut class = self.named_class(diagnosis, &self.name(&c.effect, &c.channel));
            class.extend(c.class.iter().map(|l| self.listed(l)));
            (class, c.share.learnt.unwrap_or(0.0).max(0.0))
        };
        diagnosis.cause.contributions.iter().map(one).collect()
    }

    /// The probability of these effects together in the ranking; 0 where it has rows but none for them, none where it has no rows.
    fn probability(&self, diagnosis: &Diagnosis, effects: &[String]) -> Option<f64> {
        let rows: Vec<(Vec<String>, f64)> =
            diagnosis.cause.ranking.iter().map(|r| self.row(r)).collect();
        let sum = rows.iter().filter(|(names, _)| same_set(names, effects)).map(|(_, p)| p).sum();
        (!rows.is_empty()).then_some(sum)
    }
}

/// The named effect or one of its aliases belongs to the truth's class.
fn meets(named: &[String], truth: &[String]) -> bool {
    named.iter().any(|name| truth.contains(name))
}

fn same_set(a: &[String], b: &[String]) -> bool {
    a.len() == b.len() && a.iter().all(|x| b.contains(x))
}

/// Whether the answers can be given one each to the classes.
fn matches_classes(answers: &[String], classes: &[Vec<String>]) -> bool {
    let Some((first, rest)) = classes.split_first() else { return answers.is_empty() };
    answers.len() == classes.len()
        && (0..answers.len()).any(|i| {
            let mut others = answers.to_vec();
            first.contains(&others.remove(i)) && matches_classes(&others, rest)
        })
}
