//! The report card, `deadtime/blind-score@1`.

use std::collections::BTreeMap;

use serde::Serialize;

use super::bounds::{bootstrap, wilson};
use super::judge::{Judged, judge};
use super::label::Group;
use super::load::Scored;
use super::scores::{Definition, Measure, SCORES};
use deadtime_signal::stats::{mean, quantile};

/// The key by which cases are split.
type SplitKey = fn(&Judged) -> Option<String>;

/// Bins of the probability that was given to the verdict.
const BINS: u32 = 5;

/// How a diagnoser did on withheld effects.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BlindScore {
    /// The format line.
    pub format: &'static str,
    /// Cases.
    pub cases: usize,
    /// Cases of each kind.
    pub groups: BTreeMap<&'static str, usize>,
    /// Every score over all cases.
    pub scores: Vec<Score>,
    /// The same by true effect, plant, strength and loop.
    pub by: Vec<Breakdown>,
    /// Counts of verdicts by truth.
    pub confusion: Vec<Confusion>,
    /// The frequency of exactly right verdicts by probability.
    pub reliability: Vec<Reliability>,
    /// Reliability of the probabilities of contributions: the frequency with which a contribution, or one of its aliases, acts.
    pub contributions: Vec<Reliability>,
    /// Every case.
    pub answers: Vec<Judged>,
}

/// One score.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Score {
    /// Its name.
    pub name: &'static str,
    /// Its value; missing where no case has one.
    pub value: Option<f64>,
    /// Its 95 % interval; missing where there is none.
    pub ci95: Option<[f64; 2]>,
    /// The cases, or parameters, that it is about.
    pub count: usize,
}

/// The scores of some of the cases.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Breakdown {
    /// The key of the split: `effect`, `plant`, `strength`, `loop`.
    pub key: &'static str,
    /// Its value.
    pub value: String,
    /// Cases.
    pub cases: usize,
    /// Every score over these cases.
    pub scores: Vec<Score>,
}

/// The number of times that a truth got a verdict.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Confusion {
    /// The true effect, `none`, `unknown` or `pair`.
    pub truth: String,
    /// The leading effect, `none` or `unknown`.
    pub verdict: String,
    /// Cases.
    pub cases: usize,
}

/// The claims with a probability in one bin.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reliability {
    /// The bin's lower edge.
    pub from: f64,
    /// The bin's upper edge.
    pub to: f64,
    /// Sayings.
    pub cases: usize,
    /// Their mean probability.
    pub probability: Option<f64>,
    /// Share of them that are true.
    pub exact: Option<f64>,
    /// Its 95 % interval.
    pub ci95: Option<[f64; 2]>,
}

/// Scores verdicts against labels.
#[must_use]
pub fn score(cases: &[Scored]) -> BlindScore {
    let answers: Vec<Judged> = cases.iter().map(judge).collect();
    let all: Vec<&Judged> = answers.iter().collect();
    let mut by = Vec::new();
    let keys: [(&'static str, SplitKey); 4] = [
        ("effect", |c| Some(kind(c))),
        ("plant", |c| Some(c.plant.clone())),
        ("strength", |c| c.strength_db.map(|s| strength(s).to_owned())),
        ("loop", |c| c.loop_kind.clone()),
    ];
    for (key, of) in keys {
        let mut sorted: BTreeMap<String, Vec<&Judged>> = BTreeMap::new();
        for case in &answers {
            if let Some(value) = of(case) {
                sorted.entry(value).or_default().push(case);
            }
        }
        by.extend(sorted.into_iter().map(|(value, cases)| Breakdown {
            key,
            value,
            cases: cases.len(),
            scores: measure_all(&cases),
        }));
    }
    BlindScore {
        format: "deadtime/blind-score@1",
        cases: answers.len(),
        groups: Group::ALL
            .map(|g| (g.name(), answers.iter().filter(|c| c.group == g).count()))
            .into_iter()
            .collect(),
        scores: measure_all(&all),
        by,
        confusion: confusion(&answers),
        reliability: reliability(
            &answers
                .iter()
                .filter_map(|c| Some((c.judgement.verdict_probability?, c.judgement.exact)))
                .collect::<Vec<_>>(),
        ),
        contributions: reliability(&claims(&answers)),
        answers,
    }
}

impl BlindScore {
    /// The score over all cases that is called so.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Score> {
        self.scores.iter().find(|s| s.name == name)
    }
}

/// The true effect without its channel, or the kind of case.
fn kind(case: &Judged) -> String {
    match case.group {
        Group::Single | Group::Moving => first_word(&case.truth),
        Group::None | Group::Unknown | Group::Pair | Group::Mixture => case.group.name().to_owned(),
    }
}

/// The leading effect of a list, without its channel.
fn first_word(list: &str) -> String {
    list.split([':', ' ']).next().unwrap_or_default().to_owned()
}

/// Names that sort from weak to strong.
fn strength(db: f64) -> &'static str {
    match db {
        s if s < 10.0 => "below 10 dB",
        s if s < 20.0 => "from 10 to 20 dB (weak)",
        s if s <= 30.0 => "from 20 to 30 dB (medium)",
        _ => "over 30 dB (strong)",
    }
}

fn measure_all(cases: &[&Judged]) -> Vec<Score> {
    SCORES.iter().map(|d| measure(d, cases)).collect()
}

fn measure(definition: &Definition, cases: &[&Judged]) -> Score {
    let share = |flags: Vec<bool>| {
        let hits = flags.iter().filter(|f| **f).count();
        let value = (!flags.is_empty()).then(|| hits as f64 / flags.len() as f64);
        (value, wilson(hits, flags.len()), flags.len())
    };
    // Undefined numbers (an error over 0, for example) are left out, as everywhere.
    let numbers = |of: fn(&Judged) -> Vec<f64>| -> Vec<Vec<f64>> {
        let finite =
            |c: &&Judged| of(c).into_iter().filter(|v| v.is_finite()).collect::<Vec<f64>>();
        cases.iter().map(finite).filter(|v| !v.is_empty()).collect()
    };
    let statistic = |of: fn(&Judged) -> Vec<f64>, f: &dyn Fn(&[f64]) -> Option<f64>| {
        let by_case = numbers(of);
        let all = by_case.concat();
        (f(&all), bootstrap(&by_case, f), all.len())
    };
    let (value, ci95, count) = match definition.measure {
        Measure::Share(of) => share(cases.iter().filter_map(|c| of(c)).collect()),
        Measure::Shares(of) => share(cases.iter().flat_map(|c| of(c)).copied().collect()),
        Measure::Quantile(q, of) => statistic(of, &|v| quantile(v, q)),
        Measure::Mean(of) => statistic(of, &|v| mean(v.iter().copied())),
        Measure::Max(of) => {
            let all = numbers(of).concat();
            (all.iter().copied().reduce(f64::max), None, all.len())
        }
    };
    Score { name: definition.name, value, ci95, count }
}

fn confusion(answers: &[Judged]) -> Vec<Confusion> {
    let mut counts: BTreeMap<(String, String), usize> = BTreeMap::new();
    for case in answers {
        *counts.entry((kind(case), first_word(&case.verdict))).or_default() += 1;
    }
    let mut rows: Vec<Confusion> = counts
        .into_iter()
        .map(|((truth, verdict), cases)| Confusion { truth, verdict, cases })
        .collect();
    // By truth, the commonest verdict first.
    rows.sort_by(|a, b| {
        a.truth.cmp(&b.truth).then(b.cases.cmp(&a.cases)).then_with(|| a.verdict.cmp(&b.verdict))
    });
    rows
}

fn claims(answers: &[Judged]) -> Vec<(f64, bool)> {
    answers
        .iter()
        .flat_map(|c| &c.judgement.contributions)
        .filter_map(|c| Some((c.probability?, c.right)))
        .collect()
}

/// From claims with their probability and their truth.
fn reliability(said: &[(f64, bool)]) -> Vec<Reliability> {
    (0..BINS)
        .map(|bin| {
            let (from, to) =
                (f64::from(bin) / f64::from(BINS), f64::from(bin + 1) / f64::from(BINS));
            let inside: Vec<(f64, bool)> = said
                .iter()
                .copied()
                .filter(|(p, _)| *p >= from && (*p < to || bin + 1 == BINS))
                .collect();
            let hits = inside.iter().filter(|(_, exact)| *exact).count();
            Reliability {
                from,
                to,
                cases: inside.len(),
                probability: mean(inside.iter().map(|(p, _)| *p)),
                exact: (!inside.is_empty()).then(|| hits as f64 / inside.len() as f64),
                ci95: wilson(hits, inside.len()),
            }
        })
        .collect()
}
