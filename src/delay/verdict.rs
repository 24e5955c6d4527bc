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
/// The group that most methods fall into (intervals that overlap) counts. Its median, each answer weighted by 1/std, is the number; the interval is that of the
/// most trusted method that gave it.
#[must_use]
pub fn verdict(answers: &[(&str, &DelayEstimate)]) -> Verdict {
    let found: Vec<Found<'_>> = answers.iter().filter(|(_, e)| e.outcome == Outcome::Found).filter_map(|(m, e)| Found::new(m, e)).collect();
    if found.is_empty() {
        let reasons: Vec<String> = answers.iter().map(|(m, e)| format!("{m} is {}", words(e.outcome))).collect();
        let why = format!("no method found a delay to believe ({})", reasons.join(", "));
        return Verdict { delay_s: None, ci95_s: None, why };
    }
    // Ties go to the group of the most trusted method.
    let size = |i: usize| found.iter().filter(|f| f.overlaps(&found[i])).count();
    let lead = (0..found.len()).rev().max_by_key(|&i| size(i)).unwrap_or(0);
    let (agree, differ): (Vec<&Found<'_>>, Vec<&Found<'_>>) = found.iter().partition(|f| f.overlaps(&found[lead]));
    let chosen = median(&agree);
    let others: Vec<&str> = agree.iter().filter(|f| f.method != chosen.method).map(|f| f.method).collect();
    let mut why = match others.len() {
        0 => format!("{} alone", chosen.method),
        1 => format!("{} says so, and {} agrees with it", chosen.method, others[0]),
        _ => format!("{} says so, and {} agree with it", chosen.method, others.join(", ")),
    };
    for f in &differ {
        why.push_str(&format!("; {} says {:.4} s", f.method, f.delay_s));
    }
    for (method, e) in answers.iter().filter(|(_, e)| !matches!(e.outcome, Outcome::Found | Outcome::NotApplicable)) {
        why.push_str(&format!("; {method} is {}", words(e.outcome)));
    }
    if differ.len() >= agree.len() {
        why.push_str("; the methods disagree: check excitation, feedback and the search window before using the number");
    }
    Verdict { delay_s: Some(chosen.delay_s), ci95_s: Some(chosen.interval_s), why }
}

fn words(outcome: Outcome) -> String {
    outcome.name().replace('_', " ")
}

/// An answer with a delay.
struct Found<'a> {
    method: &'a str,
    delay_s: f64,
    std_s: f64,
    interval_s: [f64; 2],
}

impl<'a> Found<'a> {
    fn new(method: &'a str, estimate: &DelayEstimate) -> Option<Self> {
        let delay_s = estimate.delay_s?;
        let interval_s = estimate.ci95_s.unwrap_or([delay_s, delay_s]);
        Some(Self { method, delay_s, std_s: estimate.std_s.unwrap_or(f64::INFINITY), interval_s })
    }

    fn overlaps(&self, other: &Self) -> bool {
        self.interval_s[0] <= other.interval_s[1] && other.interval_s[0] <= self.interval_s[1]
    }
}

/// The weighted median, and of equal answers the most trusted one's.
fn median<'f, 'a>(group: &[&'f Found<'a>]) -> &'f Found<'a> {
    let mut sorted = group.to_vec();
    sorted.sort_by(|a, b| a.delay_s.total_cmp(&b.delay_s));
    let weight = |f: &Found<'_>| 1.0 / f.std_s.max(f64::MIN_POSITIVE);
    let half = 0.5 * sorted.iter().map(|f| weight(f)).sum::<f64>();
    let mut sum = 0.0;
    let at = sorted.iter().find(|f| {
        sum += weight(f);
        sum >= half
    });
    let delay_s = at.map_or(group[0].delay_s, |f| f.delay_s);
    group.iter().find(|f| f.delay_s == delay_s).unwrap_or(&group[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(delay_s: f64, std_s: f64) -> DelayEstimate {
        DelayEstimate {
            delay_s: Some(delay_s),
            std_s: Some(std_s),
            ci95_s: Some([delay_s - 2.0 * std_s, delay_s + 2.0 * std_s]),
            outcome: Outcome::Found,
            ..DelayEstimate::without(Outcome::Found, "")
        }
    }

    #[test]
    fn the_larger_group_wins_over_the_more_trusted_loner() {
        let (a, b, c) = (answer(1.0, 0.01), answer(2.0, 0.1), answer(2.1, 0.1));
        let v = verdict(&[("first", &a), ("second", &b), ("third", &c)]);
        assert_eq!(v.delay_s, Some(2.0));
        assert!(v.why.contains("first says 1.0000 s") && v.why.starts_with("second says so, and third agrees"), "{}", v.why);
    }

    #[test]
    fn a_vague_answer_does_not_move_the_median() {
        let (vague, sharp, late) = (answer(0.0, 8.0), answer(2.0, 0.5), answer(12.0, 4.0));
        let v = verdict(&[("vague", &vague), ("sharp", &sharp), ("late", &late)]);
        assert_eq!((v.delay_s, v.ci95_s), (Some(2.0), Some([1.0, 3.0])));
    }

    #[test]
    fn nothing_found_is_nothing_believed() {
        let none = DelayEstimate::without(Outcome::NotVisible, "");
        let v = verdict(&[("a", &none)]);
        assert_eq!(v.delay_s, None);
        assert!(v.why.contains("a is not visible"));
    }
}
