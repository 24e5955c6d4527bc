//! What to believe when many methods have answered.

use std::collections::BTreeMap;

use super::combined::{Answer, earned, interval, leads, median, vagueness};
use super::estimate::{DelayEstimate, Outcome};
use super::finding::Finding;
use super::method::WHOLE;
use super::method::{Basis, Class, Condition, Method};
use super::posterior::RESOLUTION;
use deadtime_signal::stats::NORMAL_95;
use deadtime_signal::time::SampleTime;

/// A method, what it answered, and the standard deviation that was to be expected of it, s.
pub type Said<'a> = (&'a Method, &'a DelayEstimate, Option<f64>);

/// A delay to believe, or none, and a sentence that says why.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Verdict {
    /// The dead time, s; `None` where nothing is to be believed.
    pub delay_s: Option<f64>,
    /// Its 95 % interval, s.
    pub ci95_s: Option<[f64; 2]>,
    /// The reason.
    pub why: String,
    /// The method that weighs most in it.
    #[serde(skip)]
    pub method: Option<String>,
    /// Who of those that count says what.
    #[serde(skip)]
    pub grounds: Grounds,
}

impl Verdict {
    /// Nothing is to be believed.
    pub(super) fn none(why: String) -> Self {
        Self { delay_s: None, ci95_s: None, why, method: None, grounds: Grounds::default() }
    }

    /// One more reason why the number may be none to use.
    pub(super) fn doubt(&mut self, words: &str) {
        self.grounds.doubt(&mut self.why, words);
    }
}

/// What speaks for a verdict and against it, of the answers that count.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Grounds {
    /// Methods that agree on the delay, the one that weighs most first.
    pub agree: Vec<String>,
    /// The others, with the delay that each says, s.
    pub differ: Vec<(String, f64)>,
    /// Why the number may be none to use.
    pub doubts: Vec<String>,
}

impl Grounds {
    /// One more reason why the number may be none to use, and its words.
    fn doubt(&mut self, why: &mut String, words: &str) {
        why.push_str(&format!("; {words}"));
        self.doubts.push(words.to_owned());
    }
}

/// What is known of the record besides what each method says of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RecordFacts {
    /// By how much a response may look too early, because the log was put onto another grid than its own or its input was logged more seldom than its output, s.
    pub early_s: f64,
    /// The record shows that the output reacts to the input within the sample.
    pub direct: bool,
    /// The input moves once.
    pub one_step: bool,
    /// Other inputs visibly act: models of all inputs tell the fraction, and the rest see the output without what the others do.
    pub others_act: bool,
}

/// What the record shows that this answer does not withstand; empty where it may be counted. An answer from the part of the input that the output did not cause withstands
/// feedback with any method, but what disturbs the output is then all that the loop adds to it, which is never white. Where the record is of one step, and no model of more poles fits it better, the
/// plant's lag is in the model.
#[must_use]
pub fn distrust(method: &Method, estimate: &DelayEstimate, findings: &[Finding]) -> Vec<Condition> {
    let shown = findings
        .iter()
        .map(|f| f.condition)
        .filter(|c| !(estimate.open_part && *c == Condition::Feedback));
    let shown = shown.filter(|c| !(estimate.enough_poles && *c == Condition::Dynamics));
    let coloured =
        estimate.open_part && findings.iter().all(|f| f.condition != Condition::ColouredNoise);
    shown
        .chain(coloured.then_some(Condition::ColouredNoise))
        .filter(|c| !method.withstands(*c))
        .collect()
}

/// The experiment that tells a plant from the loop around it.
pub(super) const EXPERIMENT: &str = "move the set point, or add a random binary signal to the command, by as much as noise moves it at least, log that signal and estimate with it as the input";

/// Weighs answers for one pair. `answers` are (method, answer, standard deviation that was to be expected of it, s), within a class the most trusted first; `findings` is what the record shows.
///
/// Nothing is believed where no method found a delay, nor where those that withstand every noise and feedback looked and saw no response. Nor where the input moves once, nobody can be
/// trusted, and many delays fit a process model.
///
/// Methods that do not withstand what the record shows are not counted, nor answers that are contradicted by what they leave over, unless no other has answered; under
/// feedback not even then. Where most say that the output reacts sooner than the plant can, and the record shows no direct path, those are not counted. Each class of methods has one vote, shared by those of its
/// methods that found a delay ([`Class::vote_weight`]), and those that read the same intermediate result ([`Basis`]) share one part of it.
///
/// The delay that most votes hold inside their intervals gathers a group; number and interval are those of the mixture of its answers whose methods led in the study, each
/// weighted by the error that its method had there and by no vote (`combined`): an answer that stands alone in its class is one of many. Answers which differ make it wide. Where other inputs
/// act, number and interval are those of the models in the group that fit all inputs together, promise a fraction of a sample, leave nothing over, and that no larger model outdoes:
/// the others see an output from which the rest was taken by such a model, and add their votes.
#[must_use]
pub fn verdict(
    answers: &[Said<'_>],
    findings: &[Finding],
    sample_time: SampleTime,
    facts: &RecordFacts,
) -> Verdict {
    let found: Vec<FoundDelay<'_>> = answers
        .iter()
        .filter_map(|answer| FoundDelay::new(answer, findings, sample_time))
        .collect();
    match Counted::of(&found, answers, findings, facts) {
        Ok(counted) => counted.verdict(&found, answers, facts),
        Err(why) => Verdict::none(why),
    }
}

/// The answers that are counted, gathered.
struct Counted<'a, 'b> {
    group: Group<'a, 'b>,
    /// None can be trusted: all are counted.
    nobody: bool,
    /// Those within the sample were left out.
    implausible: bool,
}

impl<'a, 'b> Counted<'a, 'b> {
    /// Which answers count, or why none does.
    fn of(
        found: &'b [FoundDelay<'a>],
        answers: &[Said<'_>],
        findings: &[Finding],
        facts: &RecordFacts,
    ) -> Result<Self, String> {
        let looped = findings.iter().any(|f| f.condition == Condition::Feedback);
        if found.is_empty() {
            let advice = if looped { format!("; {EXPERIMENT}") } else { String::new() };
            let outcomes = outcomes(answers, |_| true);
            return Err(format!("no method found a trusted delay ({outcomes}){advice}"));
        }
        let named = || named(found);
        if let Some(judges) = unseen(answers, findings) {
            return Err(format!(
                "{} withstand coloured noise and feedback, and find no response; the answers of the others are likely to be noise: {}",
                judges.join(", "),
                named()
            ));
        }
        let mut counted: Vec<&FoundDelay<'_>> =
            found.iter().filter(|f| f.distrust.is_empty() && !f.contradicted).collect();
        let nobody = counted.is_empty();
        let beyond = at_the_end(answers, findings);
        if beyond.len() > counted.len() && !nobody {
            return Err(format!(
                "{} methods find the longest dead time searched, {} a shorter one: search longer dead times ({})",
                beyond.len(),
                counted.len(),
                named()
            ));
        }
        if nobody && looped {
            return Err(format!(
                "no method with an answer withstands the record, feedback included ({}): {EXPERIMENT}",
                named()
            ));
        }
        if let Some(vague) = too_many_poles(answers).filter(|_| nobody && facts.one_step) {
            return Err(format!(
                "one step does not separate the poles of this plant from dead time: models of few poles do not fit, and {vague} ({}); record a step with less noise, or one with a sample more often",
                named()
            ));
        }
        if nobody {
            counted = found.iter().collect();
        }
        let mut group = Group::of(&counted);
        // A plant that needs a sample to respond does not respond within it, unless the record shows that it does.
        let implausible = !facts.direct && group.within() > 0.5;
        if implausible {
            counted.retain(|f| !f.within);
            if counted.is_empty() {
                return Err(format!(
                    "the response comes within one sample of the command, sooner than a strictly proper plant answers, and the record shows no direct path: feedback, clocks that differ, or a command logged too seldom ({}); give the relative degree 0 if there is a direct path, else {EXPERIMENT}",
                    named()
                ));
            }
            group = Group::of(&counted);
        }
        Ok(Self { group, nobody, implausible })
    }

    /// The group's answer, and everything that was said of it.
    fn verdict(
        &self,
        found: &[FoundDelay<'_>],
        answers: &[Said<'_>],
        facts: &RecordFacts,
    ) -> Verdict {
        let Group { lead, agree, differ } = &self.group;
        let of_all_inputs: Vec<(&FoundDelay<'_>, f64)> = agree
            .iter()
            .filter(|_| facts.others_act)
            .filter_map(|(f, _)| Some((*f, f.of_all_inputs_s?.powi(-2))))
            .collect();
        let best = agree.iter().map(|(f, _)| earned(f.method)).fold(f64::INFINITY, f64::min);
        let by_vote: Vec<(&FoundDelay<'_>, f64)> = agree
            .iter()
            .filter(|(f, _)| leads(f.method, best))
            .map(|(f, weight)| (*f, *weight))
            .collect();
        let leading: Vec<&FoundDelay<'_>> = by_vote.iter().map(|(f, _)| *f).collect();
        let fine = !of_all_inputs.is_empty();
        let judges =
            if of_all_inputs.is_empty() { weighted_by_error(&leading) } else { of_all_inputs };
        let (chosen, mut delay_s, mut interval_s) = together(&judges, lead, facts);
        // One class may be most of the weight, and its model wrong: the interval holds that of the mixture weighted by votes, too.
        if !fine {
            let (_, _, [from_s, to_s]) = together(&by_vote, lead, facts);
            interval_s = [interval_s[0].min(from_s), interval_s[1].max(to_s)];
        }
        let direct = facts.direct && self.group.within() > 0.5;
        if direct {
            (delay_s, interval_s[0]) = (0.0, 0.0);
        }
        let others: Vec<&str> = agree
            .iter()
            .filter(|(f, _)| f.method != chosen.method)
            .map(|(f, _)| f.method)
            .collect();
        let agreeing = std::iter::once(chosen.method).chain(others.iter().copied());
        let mut grounds = Grounds {
            agree: agreeing.map(str::to_owned).collect(),
            differ: differ.iter().map(|(f, _)| (f.method.to_owned(), f.delay_s)).collect(),
            doubts: Vec::new(),
        };
        let mut why = who(chosen.method, &others, differ);
        if self.nobody {
            grounds.doubt(
                &mut why,
                "no method is made for this record, or the data contradict its model: treat the number as a guess",
            );
        }
        if fine {
            why.push_str(
                "; number and interval are those of the models that fit all inputs together",
            );
        }
        why.push_str(&left_out(found, self.nobody, self.implausible));
        if direct {
            why.push_str("; the output reacts within the sample: a direct path, and no dead time");
        }
        let silent =
            outcomes(answers, |e| !matches!(e.outcome, Outcome::Found | Outcome::NotApplicable));
        if !silent.is_empty() {
            why.push_str(&format!("; {silent}"));
        }
        let total = |side: &[(&FoundDelay<'_>, f64)]| side.iter().map(|(_, w)| w).sum::<f64>();
        if total(differ) >= total(agree) {
            grounds.doubt(
                &mut why,
                "the methods disagree: check excitation, feedback and the search window before using the number",
            );
        }
        Verdict {
            delay_s: Some(delay_s),
            ci95_s: Some(interval_s),
            why,
            method: Some(chosen.method.to_owned()),
            grounds,
        }
    }
}

/// Answers with the weight that their methods have earned: votes say which delay is believed, not how its answers are combined. One vaguer than half of them weighs less.
fn weighted_by_error<'a, 'b>(leading: &[&'b FoundDelay<'a>]) -> Vec<(&'b FoundDelay<'a>, f64)> {
    let stds: Vec<f64> = leading.iter().map(|f| f.answer(1.0).std()).collect();
    let vague = vagueness(&stds);
    leading
        .iter()
        .zip(vague)
        .map(|(f, vague)| (*f, 1.0 / (f.square_error * vague * vague)))
        .collect()
}

/// The number and the interval of all answers, and the one that weighs most.
fn together<'a, 'b>(
    judges: &[(&'b FoundDelay<'a>, f64)],
    lead: &'b FoundDelay<'a>,
    facts: &RecordFacts,
) -> (&'b FoundDelay<'a>, f64, [f64; 2]) {
    let answers: Vec<Answer> = judges.iter().map(|(f, weight)| f.answer(*weight)).collect();
    let mut heaviest = (lead, 0.0);
    for (f, weight) in judges {
        if *weight > heaviest.1 * (1.0 + 1e-9) {
            heaviest = (f, *weight);
        }
    }
    let [from, to] = interval(&answers);
    (heaviest.0, median(&answers).max(0.0), [from.max(0.0), to + facts.early_s])
}

/// Who agrees, the one that weighs most first, and who says otherwise.
fn who(chosen: &str, others: &[&str], differ: &[(&FoundDelay<'_>, f64)]) -> String {
    let mut why = match others.len() {
        0 => format!("{chosen} alone"),
        1..=4 => format!("weighted median of {chosen}, {}", others.join(", ")),
        n => {
            format!("weighted median of {chosen}, {}, {} and {} more", others[0], others[1], n - 2)
        }
    };
    for (f, _) in differ.iter().take(MOST_NAMED) {
        why.push_str(&format!("; {} {:.4} s", f.method, f.delay_s));
    }
    if differ.len() > MOST_NAMED {
        why.push_str(&format!("; {} more differ", differ.len() - MOST_NAMED));
    }
    why
}

/// Which answers were not counted, by reason. Where `nobody` is trusted only those that are implausible are left out.
fn left_out(found: &[FoundDelay<'_>], nobody: bool, implausible: bool) -> String {
    let mut words = String::new();
    for (conditions, methods) in by_reason(found).iter().filter(|_| !nobody) {
        words.push_str(&format!(
            "; left out because of {}: {}",
            joined(conditions.iter().map(|c| c.words())),
            methods.join(", ")
        ));
    }
    let those = |which: &dyn Fn(&FoundDelay<'_>) -> bool| {
        found
            .iter()
            .filter(|f| f.distrust.is_empty() && which(f))
            .map(|f| f.method)
            .collect::<Vec<_>>()
            .join(", ")
    };
    if implausible {
        let within = those(&|f| f.within && !f.contradicted);
        words.push_str(&format!("; left out because they answer within the sample, where the record shows no direct path: {within}"));
    }
    let contradicted = those(&|f| f.contradicted);
    if !(nobody || contradicted.is_empty()) {
        words.push_str(&format!(
            "; left out because the data contradict their model: {contradicted}"
        ));
    }
    words
}

/// The answers that are counted, by whether they hold the delay that most votes hold.
struct Group<'a, 'b> {
    lead: &'b FoundDelay<'a>,
    agree: Vec<(&'b FoundDelay<'a>, f64)>,
    differ: Vec<(&'b FoundDelay<'a>, f64)>,
}

impl<'a, 'b> Group<'a, 'b> {
    /// `counted` has one answer at least.
    fn of(counted: &[&'b FoundDelay<'a>]) -> Self {
        let vote_weights = vote_weights(counted);
        let support = |at: &FoundDelay<'_>| -> f64 {
            counted
                .iter()
                .zip(&vote_weights)
                .filter(|(f, _)| f.holds(at.delay_s))
                .map(|(_, v)| v)
                .sum()
        };
        // Ties go to the most trusted method: the order is that of the list.
        let mut lead = counted[0];
        for f in &counted[1..] {
            if support(f) > support(lead) + 1e-9 {
                lead = f;
            }
        }
        let of_all = counted.iter().zip(&vote_weights).map(|(f, vote)| (*f, vote / f.square_error));
        let (agree, differ) = of_all.partition(|(f, _)| f.holds(lead.delay_s));
        Self { lead, agree, differ }
    }

    /// The share of those who agree that answers within the sample.
    fn within(&self) -> f64 {
        let all: f64 = self.agree.iter().map(|(_, w)| w).sum();
        self.agree.iter().filter(|(f, _)| f.within).map(|(_, w)| w).sum::<f64>()
            / all.max(f64::MIN_POSITIVE)
    }
}

/// What the first few say.
fn named(found: &[FoundDelay<'_>]) -> String {
    found
        .iter()
        .take(MOST_NAMED)
        .map(|f| format!("{} {:.4} s", f.method, f.delay_s))
        .collect::<Vec<_>>()
        .join("; ")
}

/// The methods that can tell a response from slow noise, resonant noise and feedback alike, if two or more of them looked and none saw one. The others test against noise that
/// is white or nearly so, and take what rings or drifts by itself for a response.
fn unseen<'a>(answers: &[Said<'a>], findings: &[Finding]) -> Option<Vec<&'a str>> {
    let any = [
        Condition::UnstablePlant,
        Condition::Feedback,
        Condition::ColouredNoise,
        Condition::Dynamics,
    ];
    // Of a plant that integrates the increments are noise to a regression.
    let integrates = findings.iter().any(|f| f.condition == Condition::Integrating);
    let judges = || {
        let all = |m: &Method| !integrates && any.iter().all(|c| m.withstands(*c));
        answers.iter().filter(move |(m, _, _)| all(m))
    };
    let blind: Vec<&str> = judges()
        .filter(|(_, e, _)| e.outcome == Outcome::NotVisible)
        .map(|(m, _, _)| m.entry.name)
        .collect();
    (blind.len() >= 2 && !judges().any(|(_, e, _)| e.outcome.has_delay())).then_some(blind)
}

/// The methods that withstand what the record shows and answer the longest delay searched.
fn at_the_end<'a>(answers: &[Said<'a>], findings: &[Finding]) -> Vec<&'a str> {
    let at_end = answers.iter().filter(|(m, e, _)| {
        e.outcome == Outcome::AtEdge && !e.contradicted && distrust(m, e, findings).is_empty()
    });
    at_end.map(|(m, _, _)| m.entry.name).collect()
}

/// What a process model says of which many delays fit alike, where there is one.
fn too_many_poles(answers: &[Said<'_>]) -> Option<String> {
    let flat =
        answers.iter().find(|(m, e, _)| m.class == Class::Process && e.outcome == Outcome::Flat);
    flat.map(|(m, e, _)| {
        format!("{} says {}", m.entry.name, e.note.as_deref().unwrap_or("that many delays fit"))
    })
}

/// What an answer without a standard deviation adds to its squared error.
const VAGUE: f64 = 1e12;

/// Methods that are named where more would make the sentence unreadable.
const MOST_NAMED: usize = 3;

/// `flat: area1, area2; singular: p3d`, for the answers that match and have no delay.
fn outcomes(answers: &[Said<'_>], which: impl Fn(&DelayEstimate) -> bool) -> String {
    let mut groups: Vec<(Outcome, Vec<&str>)> = Vec::new();
    for (m, e, _) in answers.iter().filter(|(_, e, _)| which(e)) {
        match groups.iter_mut().find(|(o, _)| *o == e.outcome) {
            Some((_, methods)) => methods.push(m.entry.name),
            None => groups.push((e.outcome, vec![m.entry.name])),
        }
    }
    let texts: Vec<String> = groups
        .iter()
        .map(|(o, methods)| format!("{}: {}", o.name().replace('_', " "), methods.join(", ")))
        .collect();
    texts.join("; ")
}

fn joined<'a>(words: impl Iterator<Item = &'a str>) -> String {
    words.collect::<Vec<_>>().join(" and ")
}

/// The methods that are not counted, by what they do not withstand.
fn by_reason<'a>(found: &[FoundDelay<'a>]) -> BTreeMap<Vec<Condition>, Vec<&'a str>> {
    let mut reasons: BTreeMap<Vec<Condition>, Vec<&str>> = BTreeMap::new();
    for f in found.iter().filter(|f| !f.distrust.is_empty()) {
        reasons.entry(f.distrust.clone()).or_default().push(f.method);
    }
    reasons
}

/// An answer with a delay.
struct FoundDelay<'a> {
    method: &'a str,
    class: Class,
    basis: Basis,
    delay_s: f64,
    /// The squared error of the method in a study, as a ratio.
    square_error: f64,
    /// The least standard deviation that it is taken for, s.
    least_s: f64,
    interval_s: [f64; 2],
    /// The same, at least as wide as a count of samples leaves it.
    open_s: [f64; 2],
    distrust: Vec<Condition>,
    contradicted: bool,
    /// It answers sooner than the plant can respond.
    within: bool,
    /// Standard deviation, s, of a model that resolves fractions of a sample, whose poles are enough: no less than it promises, nor than was to be expected.
    of_all_inputs_s: Option<f64>,
}

impl<'a> FoundDelay<'a> {
    fn new(
        (method, estimate, predicted_s): &Said<'a>,
        findings: &[Finding],
        sample_time: SampleTime,
    ) -> Option<Self> {
        let delay_s = estimate.delay_s.filter(|_| estimate.outcome == Outcome::Found)?;
        let resolution_s = sample_time.to_seconds(RESOLUTION.sqrt());
        let interval_s = estimate.ci95_s.unwrap_or([delay_s, delay_s]);
        let vague = if estimate.std_s.is_none() { VAGUE } else { 0.0 };
        let resolves = estimate.enough_poles && method.tolerance > WHOLE && method.tolerance < 1.0;
        let least_s = sample_time.to_seconds(method.tolerance).max(predicted_s.unwrap_or(0.0));
        Some(Self {
            method: method.entry.name,
            class: method.class,
            basis: method.basis,
            delay_s,
            square_error: earned(method.entry.name).powi(2) + vague,
            least_s: if method.tolerance < 1.0 {
                sample_time.to_seconds(method.tolerance)
            } else {
                resolution_s
            },
            interval_s,
            open_s: [
                interval_s[0].min(delay_s - NORMAL_95 * resolution_s),
                interval_s[1].max(delay_s + NORMAL_95 * resolution_s),
            ],
            distrust: distrust(method, estimate, findings),
            contradicted: estimate.contradicted,
            of_all_inputs_s: estimate.std_s.filter(|_| resolves).map(|std_s| std_s.max(least_s)),
            within: estimate.raw_delay_s.is_some_and(|raw| {
                raw < sample_time.to_seconds(estimate.degree_bias_samples - 0.5)
            }),
        })
    }

    fn answer(&self, weight: f64) -> Answer {
        Answer { delay_s: self.delay_s, interval_s: self.interval_s, least_s: self.least_s, weight }
    }

    /// The delay lies inside the interval.
    fn holds(&self, delay_s: f64) -> bool {
        delay_s >= self.open_s[0] && delay_s <= self.open_s[1]
    }
}

/// The vote of each class, shared by what its methods read their answers from; and the part of each such basis shared by all methods that read it, of other classes too.
fn vote_weights(found: &[&FoundDelay<'_>]) -> Vec<f64> {
    let same = |f: &FoundDelay<'_>, g: &FoundDelay<'_>| {
        if f.basis == Basis::Own { f.method == g.method } else { f.basis == g.basis }
    };
    let weight = |f: &&FoundDelay<'_>| {
        let class: Vec<&&FoundDelay<'_>> = found.iter().filter(|g| g.class == f.class).collect();
        // The first of its basis stands for all.
        let bases = class
            .iter()
            .enumerate()
            .filter(|(i, g)| class[..*i].iter().all(|h| !same(g, h)))
            .count();
        let sharing = found.iter().filter(|g| same(f, g)).count();
        f.class.vote_weight() / (bases * sharing) as f64
    };
    found.iter().map(weight).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::method;
    use approx::assert_abs_diff_eq;

    fn answer(delay_s: f64, std_s: f64) -> DelayEstimate {
        DelayEstimate {
            delay_s: Some(delay_s),
            std_s: Some(std_s),
            ci95_s: Some([delay_s - 2.0 * std_s, delay_s + 2.0 * std_s]),
            outcome: Outcome::Found,
            ..DelayEstimate::without(Outcome::Found, "")
        }
    }

    fn of(answers: &[(&str, &DelayEstimate)], findings: &[Finding]) -> Verdict {
        let answers: Vec<Said<'_>> =
            answers.iter().map(|(m, e)| (method(m).unwrap(), *e, None)).collect();
        verdict(&answers, findings, SampleTime::new(0.01).unwrap(), &RecordFacts::default())
    }

    fn shows(condition: Condition) -> Vec<Finding> {
        vec![Finding { condition, evidence: String::new().into() }]
    }

    #[test]
    fn the_delay_that_more_classes_hold_wins_over_the_more_trusted_loner() {
        let (a, b, c) = (answer(1.0, 0.01), answer(2.0, 0.1), answer(2.1, 0.1));
        let v = of(&[("oestruc", &a), ("threshold", &b), ("state_least_squares", &c)], &[]);
        // The threshold has two thirds of the weight, by 1/2.49² and 1/3.5².
        let delay_s = v.delay_s.unwrap();
        assert!(delay_s > 2.0 && delay_s < 2.05, "{delay_s}");
        assert!(
            v.why.starts_with("weighted median of threshold, state_least_squares")
                && v.why.contains("oestruc 1.0000 s"),
            "{}",
            v.why
        );
    }

    #[test]
    fn of_a_step_that_no_model_of_few_poles_fits_nothing_is_believed_where_many_delays_fit_one_of_more()
     {
        let few = answer(1.0, 0.1).contradicted(Some("p2d fits better".to_owned()));
        let many = DelayEstimate::without(
            Outcome::Flat,
            "delays from 3.2 to 24.9 samples fit equally well",
        );
        let said: Vec<Said<'_>> =
            vec![(method("p1d").unwrap(), &few, None), (method("p3d").unwrap(), &many, None)];
        let v = |one_step| {
            verdict(
                &said,
                &[],
                SampleTime::new(0.1).unwrap(),
                &RecordFacts { one_step, ..RecordFacts::default() },
            )
        };
        assert_eq!((v(true).delay_s, v(false).delay_s), (None, Some(1.0)));
        assert!(
            v(true).why.contains("p3d says delays from 3.2 to 24.9 samples"),
            "{}",
            v(true).why
        );
    }

    #[test]
    fn methods_of_one_class_share_their_vote() {
        let (sharp, early, early_too) = (answer(2.0, 0.1), answer(1.0, 0.1), answer(1.0, 0.1));
        let v =
            of(&[("oestruc", &sharp), ("threshold", &early), ("threshold_step", &early_too)], &[]);
        assert_eq!(v.delay_s, Some(2.0), "two thresholds on one response are one vote: {}", v.why);
        assert!(v.why.contains("threshold 1.0000 s; threshold_step 1.0000 s"), "{}", v.why);
    }

    #[test]
    fn methods_of_two_classes_that_read_one_model_share_their_vote() {
        let (wrong, right) = (answer(1.0, 0.1), answer(2.0, 0.1));
        // arxdap reads the polynomials of the scan that arxstruc reads the losses of: together half of the class's vote, as much as p2d has on its own is more.
        let v = of(
            &[("arxstruc", &wrong), ("delayest", &wrong), ("arxdap", &wrong), ("p2d", &right)],
            &[],
        );
        assert_eq!(v.delay_s, Some(2.0), "{}", v.why);
        let v = of(
            &[("arxstruc", &wrong), ("oestruc", &wrong), ("lagudap", &wrong), ("p2d", &right)],
            &[],
        );
        // Models of their own have votes of their own.
        assert_abs_diff_eq!(v.delay_s.unwrap(), 1.0, epsilon = 1e-9);
    }

    #[test]
    fn a_vague_answer_hardly_moves_the_median() {
        let (vague, sharp, late) = (answer(0.0, 8.0), answer(2.0, 0.5), answer(12.0, 4.0));
        let v =
            of(&[("threshold", &vague), ("oestruc", &sharp), ("state_least_squares", &late)], &[]);
        let [from, to] = v.ci95_s.unwrap();
        assert_abs_diff_eq!(v.delay_s.unwrap(), 2.0, epsilon = 0.01);
        assert!(from > 0.7 && from < 1.2 && to > 2.8 && to < 3.3, "{from} to {to}");
    }

    #[test]
    fn an_answer_more_certain_than_the_data_let_expect_does_not_decide() {
        let (bold, plain, other) = (answer(5.0, 0.01), answer(7.0, 1.2), answer(7.2, 1.2));
        let (p2d, oestruc, arxdap) =
            (method("p2d").unwrap(), method("oestruc").unwrap(), method("arxdap").unwrap());
        let weighed = |expected: Option<f64>| {
            let answers =
                [(p2d, &bold, expected), (oestruc, &plain, expected), (arxdap, &other, expected)];
            verdict(&answers, &[], SampleTime::new(0.01).unwrap(), &RecordFacts::default())
        };
        // What it claims of itself gives it no weight. It has 0.37 of the mixture, and by hand the others' laws have the rest of a half below 6.08.
        for expected in [None, Some(2.0)] {
            assert_abs_diff_eq!(weighed(expected).delay_s.unwrap(), 6.08, epsilon = 0.05);
        }
    }

    #[test]
    fn the_interval_is_that_of_the_leading_methods_of_those_that_agree() {
        let (narrow, wide, widest) = (answer(2.0, 0.1), answer(2.1, 0.3), answer(2.0, 2.0));
        let ends = |answers: &[(&str, &DelayEstimate)]| of(answers, &[]).ci95_s.unwrap();
        let two = ends(&[("oestruc", &narrow), ("p2d", &wide)]);
        // Half of the mixture each: beyond these ends the narrower one has nothing, and the wider one Φ⁻¹(0.95) = 1.6449 of its standard deviations, 0.3·2/1.96.
        let half = 1.6449 * 0.3 * 2.0 / NORMAL_95;
        assert_abs_diff_eq!(two[0], 2.1 - half, epsilon = 1e-3);
        assert_abs_diff_eq!(two[1], 2.1 + half, epsilon = 1e-3);
        // In the study it was further off than two correlated methods may be apart.
        assert_eq!(two, ends(&[("oestruc", &narrow), ("p2d", &wide), ("lagudap", &widest)]));
    }

    #[test]
    fn what_another_grid_made_early_is_inside_the_interval() {
        let (at, method) = (answer(2.0, 0.1), method("oestruc").unwrap());
        let v = verdict(
            &[(method, &at, None)],
            &[],
            SampleTime::new(0.1).unwrap(),
            &RecordFacts { early_s: 0.3, ..RecordFacts::default() },
        );
        assert_eq!((v.delay_s, v.ci95_s), (Some(2.0), Some([1.8, 2.5])));
    }

    #[test]
    fn a_method_that_does_not_withstand_the_record_is_not_counted_and_the_reason_is_said() {
        let (open, closed) = (answer(1.0, 0.1), answer(2.0, 0.1));
        let v = of(
            &[("oestruc", &open), ("threshold", &open), ("arxstruc", &closed)],
            &shows(Condition::Feedback),
        );
        assert_eq!(v.delay_s, Some(2.0));
        assert!(v.why.contains("left out because of feedback: oestruc, threshold"), "{}", v.why);
        let v = of(&[("oestruc", &open), ("threshold", &open)], &shows(Condition::Feedback));
        assert_eq!(v.delay_s, None, "a loop makes sharp answers wrong");
        assert!(v.why.contains("add a random binary signal to the command"), "{}", v.why);
        let v = of(&[("threshold", &open)], &shows(Condition::ColouredNoise));
        assert_eq!(v.delay_s, Some(1.0), "better a guess than nothing, and said");
        assert!(v.why.contains("as a guess"), "{}", v.why);
        let freed = DelayEstimate { open_part: true, ..open };
        let v = of(&[("oestruc", &freed), ("threshold", &freed)], &shows(Condition::Feedback));
        assert_eq!(v.delay_s, Some(1.0), "what the output did not cause is free of feedback");
        assert!(
            v.why.starts_with("oestruc alone")
                && v.why.contains("left out because of coloured noise: threshold"),
            "{}",
            v.why
        );
    }

    #[test]
    fn an_answer_within_the_sample_counts_where_the_record_shows_a_direct_path() {
        let within = DelayEstimate {
            raw_delay_s: Some(0.0),
            degree_bias_samples: 1.0,
            ..answer(0.0, 0.001)
        };
        let later = DelayEstimate {
            raw_delay_s: Some(0.04),
            degree_bias_samples: 1.0,
            ..answer(0.03, 0.005)
        };
        let said = [("oestruc", &within), ("arxdap", &within), ("p2d", &later)]
            .map(|(m, e)| (method(m).unwrap(), e, None));
        let v = |direct| {
            verdict(
                &said,
                &[],
                SampleTime::new(0.01).unwrap(),
                &RecordFacts { direct, ..RecordFacts::default() },
            )
        };
        assert_eq!((v(true).delay_s, v(false).delay_s), (Some(0.0), Some(0.03)));
        assert!(v(true).why.contains("a direct path, and no dead time"), "{}", v(true).why);
        assert!(
            v(false).why.contains(
                "answer within the sample, where the record shows no direct path: oestruc, arxdap"
            ),
            "{}",
            v(false).why
        );
        let alone =
            verdict(&said[..2], &[], SampleTime::new(0.01).unwrap(), &RecordFacts::default());
        assert!(
            alone.delay_s.is_none()
                && alone.why.contains("sooner than a strictly proper plant answers"),
            "{}",
            alone.why
        );
    }

    #[test]
    fn beside_other_inputs_the_models_of_all_inputs_tell_the_fraction_and_the_rest_vote() {
        let fitted = |at: f64, std: f64| DelayEstimate { enough_poles: true, ..answer(at, std) };
        let (p1d, p2d, whole, outdone) =
            (fitted(0.618, 0.001), fitted(0.616, 0.013), answer(0.6, 0.03), answer(0.64, 0.05));
        let said = [
            ("arxstruc", &whole),
            ("oestruc", &whole),
            ("p1d", &p1d),
            ("p2d", &p2d),
            ("p3d", &outdone),
        ]
        .map(|(m, e)| (method(m).unwrap(), e, None));
        let v = |others_act, said: &[Said<'_>]| {
            verdict(
                said,
                &[],
                SampleTime::new(0.1).unwrap(),
                &RecordFacts { others_act, ..RecordFacts::default() },
            )
        };
        let (beside, alone) = (v(true, &said), v(false, &said));
        // Each no better than the tolerance of its method, a tenth of a sample.
        let fine = (0.618 / 1e-4 + 0.616 / 1.69e-4) / (1e4 + 1.0 / 1.69e-4);
        assert_abs_diff_eq!(beside.delay_s.unwrap(), fine, epsilon = 5e-4);
        let [from, to] = beside.ci95_s.unwrap();
        assert!(from > 0.59 && to < 0.643, "{from} to {to}");
        let [wider, later] = alone.ci95_s.unwrap();
        assert!(wider < from && later > to, "with one input all who agree count: {}", alone.why);
        // Where most votes hold another delay, two models are not believed for being fine.
        let far = answer(0.9, 0.03);
        let most = [("arxstruc", &far), ("threshold", &far), ("arxdap", &far), ("p1d", &p1d)]
            .map(|(m, e)| (method(m).unwrap(), e, None));
        assert_abs_diff_eq!(v(true, &most).delay_s.unwrap(), 0.9, epsilon = 1e-9);
    }

    #[test]
    fn an_answer_that_its_own_leftovers_contradict_is_not_counted() {
        let (sharp, plain) = (
            answer(1.0, 0.001).contradicted(Some("the leftovers follow the input".to_owned())),
            answer(2.0, 0.1),
        );
        let v = of(&[("p2d", &sharp), ("oestruc", &plain)], &[]);
        assert_eq!(v.delay_s, Some(2.0));
        assert!(v.why.contains("the data contradict their model: p2d"), "{}", v.why);
    }

    #[test]
    fn a_response_that_the_methods_against_every_noise_do_not_see_is_not_believed() {
        let (none, found) = (DelayEstimate::without(Outcome::NotVisible, ""), answer(1.0, 0.1));
        let v = of(&[("oestruc", &found), ("arxstruc", &none), ("armaxstruc", &none)], &[]);
        assert_eq!(v.delay_s, None);
        assert!(
            v.why.starts_with("arxstruc, armaxstruc withstand")
                && v.why.ends_with("oestruc 1.0000 s"),
            "{}",
            v.why
        );
        let v = of(&[("oestruc", &found), ("arxstruc", &none), ("armaxstruc", &found)], &[]);
        assert_eq!(v.delay_s, Some(1.0), "one of them sees it");
        let v = of(&[("oestruc", &found), ("arxstruc", &none)], &[]);
        assert_eq!(v.delay_s, Some(1.0), "one alone may be of too low an order");
    }

    #[test]
    fn nothing_found_is_nothing_believed() {
        let none = DelayEstimate::without(Outcome::NotVisible, "");
        let v = of(&[("oestruc", &none), ("arxstruc", &none)], &[]);
        assert_eq!(v.delay_s, None);
        assert!(v.why.contains("not visible: oestruc, arxstruc"), "{}", v.why);
    }
}
