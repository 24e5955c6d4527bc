//! Reasons for a verdict without a dead time.

use super::answer::{FoundDelay, Said, distrust};
use super::words::{named, outcomes};
use crate::estimate::Outcome;
use crate::finding::Finding;
use crate::method::{Class, Condition, Method};

/// The experiment that distinguishes a plant from the loop around it.
pub(crate) const EXPERIMENT: &str = "move the set point, or add a random binary signal to the command, by as much as noise moves it at least, log that signal and estimate with it as the input";

/// The reason for no verdict before any estimate is weighted, where one exists. `trusted` is the number of trusted estimates in `found`.
pub(super) fn refused(
    (found, trusted): (&[FoundDelay<'_>], usize),
    answers: &[Said<'_>],
    findings: &[Finding],
    one_step: bool,
) -> Option<String> {
    let looped = findings.iter().any(|f| f.condition == Condition::Feedback);
    if found.is_empty() {
        let advice = if looped { format!("; {EXPERIMENT}") } else { String::new() };
        let outcomes = outcomes(answers, |_| true);
        return Some(format!("no method found a trusted delay ({outcomes}){advice}"));
    }
    if let Some(judges) = unseen(answers, findings) {
        return Some(format!(
            "{} withstand coloured noise and feedback, and find no response; the answers of the others are likely to be noise: {}",
            judges.join(", "),
            named(found)
        ));
    }
    let beyond = at_the_end(answers, findings);
    if trusted > 0 {
        return (beyond.len() > trusted).then(|| format!(
            "{} methods find the longest dead time searched, {trusted} a shorter one: search longer dead times ({})",
            beyond.len(),
            named(found)
        ));
    }
    if looped {
        return Some(format!(
            "no method with an answer withstands the record, feedback included ({}): {EXPERIMENT}",
            named(found)
        ));
    }
    too_many_poles(answers).filter(|_| one_step).map(|vague| format!(
        "one step does not separate the poles of this plant from dead time: models of few poles do not fit, and {vague} ({}); record a step with less noise, or one with a sample more often",
        named(found)
    ))
}

/// The reason for no verdict where every estimate lies within one sample.
pub(super) fn too_soon(found: &[FoundDelay<'_>]) -> String {
    format!(
        "the response comes within one sample of the command, sooner than a strictly proper plant answers, and the record shows no direct path: feedback, clocks that differ, or a command logged too seldom ({}); give the relative degree 0 if there is a direct path, else {EXPERIMENT}",
        named(found)
    )
}

/// The methods that distinguish a response from slow noise, resonant noise and feedback, if at least two of them ran and none detected a response. The others
/// test against white or nearly white noise, and mistake resonant or slow noise for a response.
fn unseen<'a>(answers: &[Said<'a>], findings: &[Finding]) -> Option<Vec<&'a str>> {
    let any = [
        Condition::UnstablePlant,
        Condition::Feedback,
        Condition::ColouredNoise,
        Condition::Dynamics,
    ];
    // For an integrating plant, the increments are noise to a regression.
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

/// The methods that withstand the record's conditions and estimate the longest delay searched.
fn at_the_end<'a>(answers: &[Said<'a>], findings: &[Finding]) -> Vec<&'a str> {
    let at_end = answers.iter().filter(|(m, e, _)| {
        e.outcome == Outcome::AtEdge && !e.contradicted && distrust(m, e, findings).is_empty()
    });
    at_end.map(|(m, _, _)| m.entry.name).collect()
}

/// The note of a process model on many equally fitting delays, where there is one.
fn too_many_poles(answers: &[Said<'_>]) -> Option<String> {
    let flat =
        answers.iter().find(|(m, e, _)| m.class == Class::Process && e.outcome == Outcome::Flat);
    flat.map(|(m, e, _)| {
        format!("{} says {}", m.entry.name, e.note.as_deref().unwrap_or("that many delays fit"))
    })
}
