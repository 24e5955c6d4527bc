//! Value and interval of a verdict, from the agreeing estimates.
//!
//! Equation: two mixtures of the leading estimates ([`super::earned`]). In the first, an estimate has the weight 1/(eᵢ·max(1, sᵢ/s))². eᵢ is the method's error
//! in the study, sᵢ its own standard deviation and s the median of these. In the second, the weight is its vote over eᵢ². The value is the median of
//! the first mixture. The interval is the hull of both mixtures' 95 % intervals.
//!
//! An estimate with a standard deviation above the median has a lower weight in the first mixture; a small standard deviation does not raise it. One class may
//! have most of that weight; the second mixture then widens the interval to the estimates of the other classes.
//!
//! Where other inputs have effects and some models fit all inputs together, value and interval come from one mixture: these models, weighted by 1/sᵢ². Such a
//! model resolves fractions of a sample, and no larger model fits better. The other methods use the output without the effect of the other inputs, and only
//! vote.
//!
//! How it can be wrong: methods that share a wrong model agree, and lead together; the hull contains no estimate outside the group.

use super::answer::FoundDelay;
use super::conclusion::RecordFacts;
use super::mixture::{Answer, interval, median, vagueness};
use super::votes::Group;

/// Estimates with their weights in a mixture.
type Weighted<'a, 'b> = Vec<(&'b FoundDelay<'a>, f64)>;

/// The value of a verdict.
pub(super) struct Number<'a, 'b> {
    /// The estimate with the largest weight.
    pub(super) chosen: &'b FoundDelay<'a>,
    pub(super) delay_s: f64,
    /// 95 %, s.
    pub(super) interval_s: [f64; 2],
    /// Value and interval come from models of all inputs.
    pub(super) of_all_inputs: bool,
    /// The output reacts within the sample: a direct path.
    pub(super) direct: bool,
}

impl<'a, 'b> Number<'a, 'b> {
    pub(super) fn of(group: &Group<'a, 'b>, facts: &RecordFacts) -> Self {
        let Group { lead, agree, .. } = group;
        let models: Weighted<'a, 'b> = agree
            .iter()
            .filter(|_| facts.others_act)
            .filter_map(|(f, _)| Some((*f, f.of_all_inputs_s?.powi(-2))))
            .collect();
        let of_all_inputs = !models.is_empty();
        let (chosen, mut delay_s, mut interval_s) = if of_all_inputs {
            together(&models, lead, facts)
        } else {
            let best = agree.iter().map(|(f, _)| f.error()).fold(f64::INFINITY, f64::min);
            let leading = agree.iter().filter(|(f, _)| f.study.leads(f.method, best));
            let by_vote: Weighted<'a, 'b> = leading.map(|(f, weight)| (*f, *weight)).collect();
            let by_error = weighted_by_error(&by_vote);
            let (chosen, delay_s, [from_s, to_s]) = together(&by_error, lead, facts);
            let (_, _, [from_too_s, to_too_s]) = together(&by_vote, lead, facts);
            (chosen, delay_s, [from_s.min(from_too_s), to_s.max(to_too_s)])
        };
        let direct = facts.direct && group.within() > 0.5;
        if direct {
            (delay_s, interval_s[0]) = (0.0, 0.0);
        }
        Self { chosen, delay_s, interval_s, of_all_inputs, direct }
    }
}

/// Estimates weighted by the error of their methods in the study. A standard deviation above the median of all lowers the weight.
fn weighted_by_error<'a, 'b>(leading: &[(&'b FoundDelay<'a>, f64)]) -> Weighted<'a, 'b> {
    let stds: Vec<f64> = leading.iter().map(|(f, _)| f.answer(1.0).std()).collect();
    let vague = vagueness(&stds);
    leading
        .iter()
        .zip(vague)
        .map(|((f, _), vague)| (*f, 1.0 / (f.square_error * vague * vague)))
        .collect()
}

/// The estimate with the largest weight, and the value and the interval of the mixture, s.
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
