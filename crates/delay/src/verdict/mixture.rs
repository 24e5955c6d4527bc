//! The mixture of agreeing estimates: its median, and the ends of its 95 % interval.
//!
//! Equation: the mixture Σ wᵢ·Fᵢ/Σ wᵢ. Fᵢ is normal on either side of the estimate, with the standard deviation of that side of its interval. The value is the
//! median of the mixture; the interval reaches from its 2.5 % to its 97.5 % quantile.
//!
//! How it can be wrong: methods that share a wrong model make one error, which the mixture weights once for each of them.
//!
//! Source: Stone (1961), Ann. Math. Statist. 32(4), 1339-1342, doi:10.1214/aoms/1177704873, for the mixture of opinions.

use deadtime_signal::stats::NORMAL_95;
use statrs::distribution::{ContinuousCDF, Normal};

/// Share of the mixture beyond either end.
const BEYOND: f64 = 0.025;
/// Bisections for an end.
const HALVINGS: usize = 60;
/// Standard deviations beyond which an estimate has no mass.
const ALL: f64 = 8.0;

/// Each standard deviation over their median, at least 1; for an even number the median is the larger of the two in the middle.
pub(super) fn vagueness(stds: &[f64]) -> Vec<f64> {
    let mut sorted = stds.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.get(sorted.len() / 2).copied().unwrap_or(f64::INFINITY);
    stds.iter().map(|std| (std / middle).max(1.0)).collect()
}

/// One estimate of several.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    /// s.
    pub(super) delay_s: f64,
    /// Its 95 % interval, s.
    pub(super) interval_s: [f64; 2],
    /// Lower bound on its standard deviation, s.
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

/// The median of the mixture; a single distant estimate moves it little.
pub(super) fn median(answers: &[Answer]) -> f64 {
    let first = answers.first().map_or(0.0, |a| a.delay_s);
    // Equal estimates return their common value.
    let same = answers.iter().all(|a| (a.delay_s - first).abs() <= f64::EPSILON * first.abs());
    if same { first } else { quantile(answers, 0.5) }
}

/// The interval of all estimates together; for a single estimate its own.
pub(super) fn interval(answers: &[Answer]) -> [f64; 2] {
    if let [only] = answers {
        return only.interval_s;
    }
    [quantile(answers, BEYOND), quantile(answers, 1.0 - BEYOND)]
}

/// The quantile of the mixture at a share.
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
    fn one_answer_keeps_its_interval_and_one_that_stands_alone_moves_the_median_little() {
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
}
