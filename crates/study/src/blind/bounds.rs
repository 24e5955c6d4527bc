//! Intervals for shares and for medians of few cases.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use deadtime_signal::stats::{NORMAL_95_EXACT, quantile};

/// Resamples of a bootstrap.
const RESAMPLES: usize = 2000;
/// Its seed: the same verdicts and labels always give the same report.
const SEED: u64 = 1;

/// Wilson's 95 % interval of a share, `hits` of `of`; none of no cases.
///
/// Equation: (p̂ + z²/2n ± z·√(p̂(1 − p̂)/n + z²/4n²))/(1 + z²/n).
/// Source: E. B. Wilson, Probable inference, the law of succession, and statistical inference, J. Am. Stat. Assoc. 22 (1927), 209–212.
#[must_use]
pub fn wilson(hits: usize, of: usize) -> Option<[f64; 2]> {
    if of == 0 {
        return None;
    }
    let (n, p) = (of as f64, hits as f64 / of as f64);
    let centre = p + NORMAL_95_EXACT * NORMAL_95_EXACT / (2.0 * n);
    let half = NORMAL_95_EXACT
        * (p * (1.0 - p) / n + NORMAL_95_EXACT * NORMAL_95_EXACT / (4.0 * n * n)).sqrt();
    let scale = 1.0 + NORMAL_95_EXACT * NORMAL_95_EXACT / n;
    // At 0 and n the ends are exactly 0 and 1; rounding would miss them.
    let low = if hits == 0 { 0.0 } else { (centre - half) / scale };
    let high = if hits == of { 1.0 } else { (centre + half) / scale };
    Some([low, high])
}

/// The bootstrap's 95 % percentile interval of a statistic over cases, each with its values; none of fewer than two cases.
///
/// Whole cases are drawn, so values of one case stay together. Of fewer than some ten cases the interval is too narrow.
/// Source: B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap, Chapman & Hall 1993, ch. 13.
#[must_use]
pub fn bootstrap(
    cases: &[Vec<f64>],
    statistic: impl Fn(&[f64]) -> Option<f64>,
) -> Option<[f64; 2]> {
    if cases.len() < 2 {
        return None;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut drawn = Vec::new();
    let statistics: Vec<f64> = (0..RESAMPLES)
        .filter_map(|_| {
            drawn.clear();
            for _ in cases {
                drawn.extend_from_slice(&cases[rng.random_range(0..cases.len())]);
            }
            statistic(&drawn)
        })
        .collect();
    Some([quantile(&statistics, 0.025)?, quantile(&statistics, 0.975)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn median(values: &[f64]) -> Option<f64> {
        quantile(values, 0.5)
    }

    #[test]
    fn wilson_agrees_with_hand_computation() {
        // 8 of 10: p = 0.8, z² = 3.841459; (0.992073 ± 0.313617)/1.3841459, a hand calculation.
        let [low, high] = wilson(8, 10).unwrap();
        assert!(
            (low - 0.490_162_5).abs() < 1e-6 && (high - 0.943_317_8).abs() < 1e-6,
            "{low} {high}"
        );
        assert_eq!(wilson(0, 4).unwrap()[0], 0.0);
        assert_eq!(wilson(4, 4).unwrap()[1], 1.0);
        assert_eq!(wilson(0, 0), None);
    }

    #[test]
    fn bootstrap_holds_the_median_and_repeats() {
        let cases: Vec<Vec<f64>> = (0..21).map(|i| vec![f64::from(i)]).collect();
        let [low, high] = bootstrap(&cases, median).unwrap();
        assert!(low > 3.0 && low < 10.0 && high > 10.0 && high < 17.0, "{low} {high}");
        assert_eq!(bootstrap(&cases, median), Some([low, high]));
        assert_eq!(bootstrap(&cases[..1], median), None);
        assert_eq!(bootstrap(&vec![vec![2.0]; 5], median), Some([2.0, 2.0]));
    }
}
