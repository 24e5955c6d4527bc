//! One number and one interval of answers that agree.
//!
//! Equation: the number is the median of the mixture of all answers, each a normal law to either side of its value with the weight wᵢ = vᵢ/(eᵢ² + σᵢ²): vᵢ the share of the
//! vote, eᵢ the error that the method had in a study, σᵢ what it says itself. The interval is between quantiles of the same mixture: what answers share is not averaged away, and one that stands alone
//! moves an end by its weight only.
//!
//! How it can be wrong: methods that share a wrong model are one error counted often; the votes bound that. A mixture of honest laws is wider than it need be.
//!
//! Source: DerSimonian and Laird (1986), Controlled Clinical Trials 7(3), 177-188, doi:10.1016/0197-2456(86)90046-2, for weights of two variances; Stone (1961), Ann. Math.
//! Statist. 32(4), 1339-1342, doi:10.1214/aoms/1177704873, for the mixture of opinions.

use deadtime_signal::stats::NORMAL_95;
use statrs::distribution::{ContinuousCDF, Normal};

/// Root-mean-square errors, samples, in Björklund's benchmark in open loop (docs/results/studies/bjorklund.md, delays estimated from the input).
const EARNED: &[(&str, f64)] = &[
    ("oe_posterior", 0.663),
    ("oestruc", 0.883),
    ("armaxstruc", 0.963),
    ("met1struc", 1.22),
    ("arxdap", 1.45),
    ("arxstruc", 1.47),
    ("p2d", 1.56),
    ("oedap", 1.61),
    ("two_step", 1.78),
    ("ivstruc", 1.82),
    ("p1d", 1.84),
    ("p3d", 1.84),
    ("p2dz", 1.90),
    ("p3dz", 1.92),
    ("sampling_zero", 1.92),
    ("firdap", 1.95),
    ("impulseest", 2.05),
    ("delayest", 2.13),
    ("fischer", 2.19),
    ("lagudap", 2.21),
    ("cusum_step", 2.26),
    ("p1dz", 2.44),
    ("cusum", 2.70),
];
/// The error of methods that are further off there, or are made for something else.
const ELSE: f64 = 3.5;

/// Share of the mixture beyond either end. Answers share a wrong model, so ends at 0.025 hold the truth in 89 % of 96 drawn records (tests/it/verdicts.rs).
const BEYOND: f64 = 0.0125;
/// Halvings of the bracket of an end.
const HALVINGS: usize = 60;
/// Standard deviations that hold all of an answer.
const ALL: f64 = 8.0;

/// The error of a method in the study, samples.
pub(super) fn earned(method: &str) -> f64 {
    EARNED.iter().find(|(name, _)| *name == method).map_or(ELSE, |(_, error)| *error)
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
        // Φ⁻¹(0.9875) = 2.2414 standard deviations to either side.
        assert_abs_diff_eq!(from, 2.0 - 2.2414 * 0.3, epsilon = 1e-4);
        assert_abs_diff_eq!(to, 2.0 + 2.2414 * 0.3, epsilon = 1e-4);
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
    fn every_error_of_the_study_is_that_of_a_method() {
        for (name, error) in EARNED {
            let known = METHODS.iter().find(|m| m.entry.name == *name);
            assert!(known.is_some_and(|m| m.scope == Scope::Pair) && *error > 0.0, "{name}");
        }
        assert_eq!(earned("oestruc"), 0.883);
        assert_eq!(earned("moment"), ELSE);
    }
}
