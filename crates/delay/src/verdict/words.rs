//! The sentence of a verdict: agreeing and differing methods, those left out and why.

use std::collections::BTreeMap;

use super::answer::{FoundDelay, Said};
use crate::estimate::{DelayEstimate, Outcome};
use crate::method::Condition;

/// Largest number of methods that a sentence names.
const MOST_NAMED: usize = 3;

/// The agreeing methods, the one with the largest weight first, and those that differ.
pub(super) fn who(chosen: &str, others: &[&str], differ: &[(&FoundDelay<'_>, f64)]) -> String {
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

/// The excluded estimates, by reason. Where no method can be trusted (`nobody`), only the implausible ones are excluded.
pub(super) fn left_out(found: &[FoundDelay<'_>], nobody: bool, implausible: bool) -> String {
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

/// The delays of the first few methods.
pub(super) fn named(found: &[FoundDelay<'_>]) -> String {
    found
        .iter()
        .take(MOST_NAMED)
        .map(|f| format!("{} {:.4} s", f.method, f.delay_s))
        .collect::<Vec<_>>()
        .join("; ")
}

/// `flat: area1, area2; singular: p3d`, for the estimates selected by `which`.
pub(super) fn outcomes(answers: &[Said<'_>], which: impl Fn(&DelayEstimate) -> bool) -> String {
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

/// The excluded methods, by the conditions that they do not withstand.
fn by_reason<'a>(found: &[FoundDelay<'a>]) -> BTreeMap<Vec<Condition>, Vec<&'a str>> {
    let mut reasons: BTreeMap<Vec<Condition>, Vec<&str>> = BTreeMap::new();
    for f in found.iter().filter(|f| !f.distrust.is_empty()) {
        reasons.entry(f.distrust.clone()).or_default().push(f.method);
    }
    reasons
}
