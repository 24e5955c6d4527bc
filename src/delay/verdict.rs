//! What to believe when several methods have answered.

use super::{DelayEstimate, Outcome};

/// A delay to believe, or none, and a sentence that says why.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Verdict {
    /// The dead time, s; `None` where nothing is to be believed.
    pub delay_s: Option<f64>,
    /// Its 95 % interval, s.
    pub ci95_s: Option<[f64; 2]>,
    /// The reason.
    pub why: String,
}

/// Weighs answers for one pair. `answers` are (method, answer), the most trusted method first.
///
/// The answer of the group that most methods fall into (intervals that overlap) counts; its most trusted member gives the number, and the interval spans
/// what the group's best two say.
#[must_use]
pub fn verdict(answers: &[(&str, &DelayEstimate)]) -> Verdict {
    struct Found<'a> {
        method: &'a str,
        delay_s: f64,
        interval_s: [f64; 2],
    }
    let found: Vec<Found<'_>> = answers
        .iter()
        .filter(|(_, e)| e.outcome == Outcome::Found)
        .filter_map(|(method, e)| {
            let delay_s = e.delay_s?;
            Some(Found { method, delay_s, interval_s: e.ci95_s.unwrap_or([delay_s, delay_s]) })
        })
        .collect();
    if found.is_empty() {
        let mut reasons: Vec<String> = answers.iter().map(|(m, e)| format!("{m}: {}", e.outcome.name().replace('_', " "))).collect();
        reasons.dedup();
        let why = format!("no method found a delay to believe ({})", reasons.join(", "));
        return Verdict { delay_s: None, ci95_s: None, why };
    }
    let overlap = |a: &Found<'_>, b: &Found<'_>| a.interval_s[0] <= b.interval_s[1] && b.interval_s[0] <= a.interval_s[1];
    // Ties go to the group of the most trusted method.
    let size = |i: usize| found.iter().filter(|f| overlap(&found[i], f)).count();
    let lead = (0..found.len()).rev().max_by_key(|&i| size(i)).unwrap_or(0);
    let (agree, differ): (Vec<&Found<'_>>, Vec<&Found<'_>>) = found.iter().partition(|f| overlap(&found[lead], f));
    let leader = agree[0];
    let hull = agree.iter().take(2).fold(leader.interval_s, |hull, f| [hull[0].min(f.interval_s[0]), hull[1].max(f.interval_s[1])]);
    let names = |group: &[&Found<'_>]| group.iter().map(|f| f.method).collect::<Vec<_>>().join(", ");
    let others = &agree[1..];
    let mut why =
        if others.is_empty() { format!("{} alone", leader.method) } else { format!("{} and {} agree", leader.method, names(others)) };
    if !differ.is_empty() {
        let said: Vec<String> = differ.iter().map(|f| format!("{} says {:.4} s", f.method, f.delay_s)).collect();
        why.push_str(&format!("; {}", said.join(", ")));
    }
    let silent: Vec<String> = (answers.iter())
        .filter(|(_, e)| !matches!(e.outcome, Outcome::Found | Outcome::NotApplicable))
        .map(|(m, e)| format!("{m} is {}", e.outcome.name().replace('_', " ")))
        .collect();
    if !silent.is_empty() {
        why.push_str(&format!("; {}", silent.join(", ")));
    }
    if differ.len() > others.len() + 1 || (others.is_empty() && !differ.is_empty()) {
        why.push_str("; the methods disagree: check excitation, feedback and the search window before using the number");
    }
    Verdict { delay_s: Some(leader.delay_s), ci95_s: Some(hull), why }
}
