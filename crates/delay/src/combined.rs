//! One number and one interval of answers that agree.
//!
//! Equation: the number is the median of the mixture of the leading answers, each a normal law to either side of its value with the weight wᵢ = 1/(eᵢ·max(1, sᵢ/s))²: eᵢ the error
//! that the method had in a study, sᵢ its own standard deviation, s the median of these. So an answer that is vaguer than most weighs less, and none weighs more for being bold. The interval is between the 2.5 % and the 97.5 % point of the same mixture. An answer leads where eᵢ ≤ min e/ρ, ρ the
//! correlation of two methods' errors: beyond that ratio the best combination of the two gives the worse one no weight.
//!
//! How it can be wrong: methods that share a wrong model are one error counted often. Votes by class choose the delay that they gather around; within it one class may be most of
//! the weight. The errors are those of plants in open loop.
//!
//! Source: Bates and Granger (1969), Operational Research Quarterly 20(4), 451-468, doi:10.2307/3008764, for the combination of two forecasts and the sign of its weights; Stone
//! (1961), Ann. Math. Statist. 32(4), 1339-1342, doi:10.1214/aoms/1177704873, for the mixture of opinions.

use deadtime_signal::stats::NORMAL_95;
use statrs::distribution::{ContinuousCDF, Normal};

/// Root-mean-square errors over those of `oe_posterior` on the same records, where the method's answer counts: 70 records each of the kinds `ordinary` and `benchmark` of
/// lab/src/bin/verdict_study.rs, seeds from 100 000. Five records on which it errs by half as much again are added to each, so that few records make no method the best.
const EARNED: &[(&str, f64)] = &[
    ("p3d", 1.02),
    ("oe_posterior", 1.04),
    ("two_step", 1.07),
    ("ivstruc", 1.10),
    ("oestruc", 1.14),
    ("p2d", 1.14),
    ("armaxstruc", 1.24),
    ("arxdap", 1.36),
    ("p3dz", 1.41),
    ("impulseest", 1.42),
    ("gcc_roth", 1.49),
    ("gcc_scot", 1.49),
    ("area1", 1.50),
    ("crosscorr", 1.50),
    ("gcc_eckart", 1.50),
    ("gcc_hannan_thomson", 1.50),
    ("gcc_phat", 1.50),
    ("p1d", 1.50),
    ("phase_slope", 1.50),
    ("sampling_zero", 1.50),
    ("area2", 1.52),
    ("p2dz", 1.57),
    ("fischer", 1.60),
    ("firdap", 1.66),
    ("lagudap", 1.78),
    ("p1dz", 1.80),
    ("met1struc", 1.87),
    ("oedap", 1.93),
    ("cusum_step", 2.25),
    ("arxstruc", 2.29),
    ("threshold", 2.49),
    ("delayest", 2.63),
    ("area3", 2.68),
    ("cusum", 3.62),
    ("threshold_step", 5.08),
    ("elnaggar", 5.70),
];
/// The error of methods that did not count there, or are made for something else.
const ELSE: f64 = 3.5;
/// The mean correlation of the errors of two of the eight best methods on the same records.
const CORRELATION: f64 = 0.69;

/// Share of the mixture beyond either end.
const BEYOND: f64 = 0.025;
/// Halvings of the bracket of an end.
const HALVINGS: usize = 60;
/// Standard deviations that hold all of an answer.
const ALL: f64 = 8.0;

/// The error of a method in the study, as a ratio.
pub(super) fn earned(method: &str) -> f64 {
    EARNED.iter().find(|(name, _)| *name == method).map_or(ELSE, |(_, error)| *error)
}

/// Whether a method leads where the best one of those that agree has the error `best`.
pub(super) fn leads(method: &str, best: f64) -> bool {
    earned(method) * CORRELATION <= best
}

/// How much vaguer each answer is than the median of all, 1 at least; of an even number the larger of the two in the middle.
pub(super) fn vagueness(stds: &[f64]) -> Vec<f64> {
    let mut sorted = stds.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.get(sorted.len() / 2).copied().unwrap_or(f64::INFINITY);
    stds.iter().map(|std| (std / middle).max(1.0)).collect()
}

/// One answer of several.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    /// s.
    pub(super) delay_s: f64,
    /// Its 95 % interval, s.
    pub(super) interval_s: [f64; 2],
    /// The least standard deviation that it is taken for, s.
    pub(super) least_s: f64,
    /// Above 0.
    pub(super) weight: f64,
}

impl Answer {
    /// Standard deviations below and above, s.
    fn stds(&self) -> [f64; 2] {
        let [from, to] = self.interval_s;
        [self.delay_s - from, to - self.delay_s]
            .map(|side| (side / NORMAL_95).max(self.least_s).max(f64::MIN_POSITIVE))
    }

    /// Its standard deviation, the mean of both sides, s.
    pub(super) fn std(&self) -> f64 {
        let [below, above] = self.stds();
        0.5 * (below + above)
    }

    fn below(&self, at: f64, normal: &Normal) -> f64 {
        let off = at - self.delay_s;
        let [below, above] = self.stds();
        normal.cdf(off / if off < 0.0 { below } else { above })
    }
}

/// The median of the mixture: answers that stand alone do not pull it.
pub(super) fn median(answers: &[Answer]) -> f64 {
    let first = answers.first().map_or(0.0, |a| a.delay_s);
    // Equal answers have their own value.
    let same = answers.iter().all(|a| (a.delay_s - first).abs() <= f64::EPSILON * first.abs());
    if same { first } else { quantile(answers, 0.5) }
}

/// The interval of all answers together; that of one answer is its own.
pub(super) fn interval(answers: &[Answer]) -> [f64; 2] {
    if let [only] = answers {
        return only.interval_s;
    }
    [quantile(answers, BEYOND), quantile(answers, 1.0 - BEYOND)]
}

/// The delay below which a share of the mixture lies.
fn quantile(answers: &[Answer], share: f64) -> f64 {
    let normal = Normal::standard();
    let all: f64 = answers.iter().map(|a| a.weight).sum();
    let start = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut low, mut high) = answers.iter().fold(start, |(low, high), a| {
        let [below, above] = a.stds();
        (low.min(a.delay_s - ALL * below), high.max(a.delay_s + ALL * above))
    });
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        let below: f64 = answers.iter().map(|a| a.weight * a.below(middle, &normal)).sum();
        if below < share * all {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::method::Scope;
    use crate::methods::METHODS;
    use approx::assert_abs_diff_eq;

    fn answer(delay_s: f64, std_s: f64, weight: f64) -> Answer {
        let half = NORMAL_95 * std_s;
        Answer { delay_s, interval_s: [delay_s - half, delay_s + half], least_s: 0.0, weight }
    }

    #[test]
    fn equal_answers_have_their_value_and_their_interval() {
        let same = [answer(2.0, 0.3, 1.0), answer(2.0, 0.3, 5.0)];
        assert_abs_diff_eq!(median(&same), 2.0, epsilon = 1e-12);
        let [from, to] = interval(&same);
        // Φ⁻¹(0.975) = 1.95996 standard deviations to either side.
        assert_abs_diff_eq!(from, 2.0 - 1.95996 * 0.3, epsilon = 1e-4);
        assert_abs_diff_eq!(to, 2.0 + 1.95996 * 0.3, epsilon = 1e-4);
    }

    #[test]
    fn one_answer_keeps_its_interval_and_one_that_stands_alone_hardly_moves_the_median() {
        assert_eq!(interval(&[answer(2.0, 0.3, 1.0)]), answer(2.0, 0.3, 1.0).interval_s);
        let most = [answer(2.0, 0.1, 9.0), answer(1.0, 0.001, 1.0)];
        let middle = median(&most);
        assert!(middle > 1.95 && middle < 2.0, "{middle}");
        let [from, to] = interval(&most);
        assert!(from > 1.0 - 1e-2 && from < 1.9 && to > 2.0, "{from} to {to}");
    }

    #[test]
    fn an_answer_vaguer_than_most_is_vague_and_a_bold_one_is_not_rewarded() {
        assert_eq!(vagueness(&[1.0, 3.0, 0.01]), [1.0, 3.0, 1.0]);
        assert_eq!(vagueness(&[1.0, 4.0]), [1.0, 1.0]);
        assert!(vagueness(&[]).is_empty());
    }

    #[test]
    fn every_error_of_the_study_is_that_of_a_method() {
        for (name, error) in EARNED {
            let known = METHODS.iter().find(|m| m.entry.name == *name);
            assert!(known.is_some_and(|m| m.scope == Scope::Pair) && *error > 0.0, "{name}");
        }
        assert_eq!(earned("oestruc"), 1.14);
        assert_eq!(earned("moment"), ELSE);
        assert!(leads("armaxstruc", earned("p3d")) && !leads("met1struc", earned("p3d")));
    }
}
