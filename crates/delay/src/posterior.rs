//! The probability of each delay from the losses of a scan: p(nk) ∝ V(nk)^(−N/2).

use deadtime_identify::{ArxScan, Record, arx_scan};

/// The posterior over the delays.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Posterior {
    /// The most probable delay.
    pub(super) best: usize,
    /// Delays whose losses are zero up to rounding.
    pub(super) ties: usize,
    /// Standard deviation, samples, the grid's own resolution included.
    pub(super) std: f64,
    /// First and last delay of the smallest set that holds 95 % of the probability.
    pub(super) ends: [f64; 2],
    /// Delays in that set.
    pub(super) set: usize,
    /// The probability of every delay.
    pub(super) weights: Vec<f64>,
    /// The delays, the most probable first; the first [`Self::set`] are the set.
    pub(super) order: Vec<usize>,
}

impl Posterior {
    /// The posterior is nearly uniform: e^H, the equivalent number of equal probabilities (H the entropy), exceeds 95 % of the number of delays.
    pub(super) fn is_flat(&self) -> bool {
        let entropy: f64 = self.weights.iter().filter(|w| **w > 0.0).map(|w| -w * w.ln()).sum();
        let delays = self.weights.len() as f64;
        entropy.exp() > 0.95 * delays
    }

    /// The possible positions of the response's first coefficient: [`first_coefficient`] of the set's ends.
    pub(super) fn first_coefficient(&self, bias: usize) -> [f64; 2] {
        first_coefficient(self.ends[0], self.ends[1], bias)
    }
}

/// The 95 % interval, samples, of a delay read from the first nonzero coefficient, between the first and last sample possible for it.
///
/// A dead time that ends within a sample appears in one coefficient for all its fractions. A strictly proper plant (bias 1 or more) responds at the end of that
/// sample, so the truth is up to one sample above. A direct path (bias 0) responds at its next sampling instant, so the truth is up to one sample below. The
/// half sample on the other side allows for a coefficient below the noise.
pub(super) fn first_coefficient(from: f64, to: f64, bias: usize) -> [f64; 2] {
    if bias == 0 { [from - 1.0, to + 0.5] } else { [from - 0.5, to + 1.0] }
}

/// Losses below this share of the signal's power are zero up to rounding.
pub(super) const ROUNDING: f64 = 1e-20;

/// `losses` from delay 0 on, NaN where missing; `power` is the mean square of the output; `samples` the number of independent residuals.
///
/// The flat prior over the window and p ∝ V^(−N/2) are the profile likelihood of Gaussian noise of unknown variance.
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, for the losses; the posterior is their usual Bayesian form.
pub(super) fn posterior(losses: &[f64], power: f64, samples: f64) -> Option<Posterior> {
    let floor = ROUNDING * power;
    let logs: Vec<f64> = losses.iter().map(|&v| log_weight(v, floor, samples)).collect();
    from_logs(&logs, losses.iter().filter(|&&v| v <= floor).count())
}

/// The same for a response that may begin after the first fitted coefficient: `losses[nk][m − 1]` has m coefficients from lag nk on. Each model has the weight
/// V^(−N/2)·N^(−m/2), Schwarz's approximation of its evidence, which penalises zero coefficients.
///
/// Source: Schwarz (1978), Ann. Statist. 6(2), 461-464, doi:10.1214/aos/1176344136.
pub(super) fn posterior_of_start(
    losses: &[Vec<f64>],
    power: f64,
    samples: f64,
) -> Option<Posterior> {
    let floor = ROUNDING * power;
    let evidence = |m: usize, loss: f64| {
        log_weight(loss, floor, samples) - 0.5 * (m as f64 + 1.0) * samples.ln()
    };
    let logs: Vec<f64> = losses
        .iter()
        .map(|counts| {
            log_sum(
                &counts
                    .iter()
                    .enumerate()
                    .map(|(m, &loss)| evidence(m, loss))
                    .collect::<Vec<f64>>(),
            )
        })
        .collect();
    from_logs(&logs, 1)
}

/// The same from −2·ln of each delay's marginal likelihood.
pub(super) fn posterior_of_misfits(misfits: &[f64]) -> Option<Posterior> {
    let logs: Vec<f64> =
        misfits.iter().map(|m| if m.is_finite() { -0.5 * m } else { f64::NEG_INFINITY }).collect();
    from_logs(&logs, 1)
}

/// ln V^(−N/2), V no smaller than `floor`.
pub(super) fn log_weight(loss: f64, floor: f64, samples: f64) -> f64 {
    if loss.is_finite() {
        -0.5 * samples * loss.max(floor).max(f64::MIN_POSITIVE).ln()
    } else {
        f64::NEG_INFINITY
    }
}

/// ln Σ e^l.
pub(super) fn log_sum(logs: &[f64]) -> f64 {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest.is_finite() {
        largest + logs.iter().map(|l| (l - largest).exp()).sum::<f64>().ln()
    } else {
        largest
    }
}

/// The posterior of log-probabilities with any common factor; `ties` of the delays fit exactly.
pub(super) fn from_logs(logs: &[f64], ties: usize) -> Option<Posterior> {
    let best = (0..logs.len())
        .filter(|&nk| logs[nk] > f64::NEG_INFINITY)
        .max_by(|&a, &b| logs[a].total_cmp(&logs[b]))?;
    let weight = |nk: usize| (logs[nk] - logs[best]).exp();
    let total: f64 = (0..logs.len()).map(weight).sum();
    let weights: Vec<f64> = (0..logs.len()).map(|nk| weight(nk) / total).collect();
    let real = |nk: usize| nk as f64;
    let variance: f64 =
        weights.iter().enumerate().map(|(nk, w)| w * (real(nk) - real(best)).powi(2)).sum();
    let mut order: Vec<usize> = (0..logs.len()).collect();
    order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]));
    let mut mass = 0.0;
    let enough = order.iter().position(|&nk| {
        mass += weights[nk];
        mass >= 0.95
    });
    let set = enough.map_or(order.len(), |last| last + 1);
    let (first, last) =
        order[..set].iter().fold((best, best), |(a, b), &nk| (a.min(nk), b.max(nk)));
    Some(Posterior {
        best,
        ties,
        std: (variance + RESOLUTION).sqrt(),
        ends: [real(first), real(last)],
        set,
        weights,
        order,
    })
}

/// Variance of a delay that is uniform within a sample.
pub(super) const RESOLUTION: f64 = 1.0 / 12.0;

/// The number of independent `residuals`: N/(1 + 2Σρ), the sum up to the first correlation that is not positive.
pub(super) fn effective_samples(residuals: &[f64]) -> f64 {
    let n = residuals.len() as f64;
    let power: f64 = residuals.iter().map(|e| e * e).sum();
    if power <= 0.0 {
        return n;
    }
    let mut sum = 0.0;
    for lag in 1..(residuals.len() / 4).max(1) {
        let rho: f64 = residuals
            .iter()
            .zip(residuals.get(lag..).unwrap_or_default())
            .map(|(a, b)| a * b)
            .sum::<f64>()
            / power;
        if rho <= 0.0 {
            break;
        }
        sum += rho;
    }
    (n / (1.0 + 2.0 * sum)).max(1.0)
}

/// The number of independent samples for detecting a `signal` under such `residuals`: N/(1 + 2Σρₛρₑ), at most N. Slow noise does not hide a fast signal.
///
/// Source: Bartlett (1935), J. R. Stat. Soc. 98(3), 536-543, doi:10.2307/2342284.
pub(super) fn samples_under(signal: &[f64], residuals: &[f64]) -> f64 {
    let n = residuals.len() as f64;
    let product = |x: &[f64], lag: usize| -> f64 {
        x.iter().zip(x.get(lag..).unwrap_or_default()).map(|(a, b)| a * b).sum()
    };
    let power = product(signal, 0) * product(residuals, 0);
    if power <= 0.0 {
        return n;
    }
    let mut sum = 0.0;
    for lag in 1..(residuals.len() / 4).max(1) {
        let of_residuals = product(residuals, lag);
        if of_residuals <= 0.0 {
            break;
        }
        sum += product(signal, lag) * of_residuals / power;
    }
    (n / (1.0 + 2.0 * sum).max(1.0)).max(1.0)
}

/// Nominal false-alarm probability of a response: a third of the target of one record in 100, because the number of independent tests is only estimated.
const BY_CHANCE: f64 = 0.003;

/// The smallest significant N·ln(V₀/V) at [`BY_CHANCE`], for `parameters` free parameters searched over `delays`.
pub(super) fn visible_gain(parameters: usize, delays: usize) -> f64 {
    use statrs::distribution::{ChiSquared, ContinuousCDF};
    let (freedom, tried) = (parameters.max(1) as f64, delays.max(1) as f64);
    ChiSquared::new(freedom).map_or(f64::INFINITY, |d| d.inverse_cdf(1.0 - BY_CHANCE / tried))
}

/// The delay of the smallest finite loss.
pub(super) fn smallest(losses: &[f64]) -> Option<usize> {
    (0..losses.len())
        .filter(|&nk| losses[nk].is_finite())
        .min_by(|&a, &b| losses[a].total_cmp(&losses[b]))
}

/// Why the output does not visibly follow the input; `None`: it does. ARX models with the input are compared with past outputs alone.
pub(super) fn unseen_by(scan: &ArxScan, nb: usize) -> Option<String> {
    let rows = scan.rows as f64;
    let smallest = scan.loss[smallest(&scan.loss)?];
    let gain = rows * (scan.loss_without_input / smallest.max(f64::MIN_POSITIVE)).ln();
    unseen_at(gain, nb, scan.loss.len())
}

/// The same from the gain of `parameters` free parameters, searched over `delays`.
pub(super) fn unseen_at(gain: f64, parameters: usize, delays: usize) -> Option<String> {
    (gain < visible_gain(parameters, delays))
        .then(|| format!("past outputs alone predict as well (gain {gain:.1}): the output does not visibly follow the input"))
}

/// Past outputs and input coefficients of an ARX model that fits most plants: the best in Björklund's study.
pub(super) const ARX_ORDERS: [usize; 2] = [10, 5];

/// The same for methods without a test of their own, with [`ARX_ORDERS`], fewer for short records.
pub(super) fn unseen(records: &[Record], max_delay: usize) -> Option<String> {
    let longest = records.iter().map(Record::len).max().unwrap_or(0);
    let [na, nb] = ARX_ORDERS;
    let na = na.min(longest.saturating_sub(max_delay + nb) / 4);
    let scan = arx_scan(records, na, nb, max_delay);
    if scan.rows <= 2 * (na + nb) || scan.input_rank.iter().all(|&r| r == 0) {
        return Some("past outputs explain every lag of the input: it is almost constant where the output can answer".to_owned());
    }
    unseen_by(&scan, nb)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    #[test]
    fn a_sharp_minimum_is_certain_to_half_a_sample() {
        let p = posterior(&[3.0, 2.0, 1.0, 2.0], 10.0, 500.0).unwrap();
        assert_eq!((p.best, p.set, p.ends, p.is_flat()), (2, 1, [2.0, 2.0], false));
        assert_abs_diff_eq!(p.std, RESOLUTION.sqrt(), epsilon = 1e-12);
    }

    #[test]
    fn delays_that_fit_exactly_are_counted() {
        assert_eq!(posterior(&[1e-30, 3e-31, 2e-30, 1.0], 1.0, 500.0).unwrap().ties, 3);
    }

    #[test]
    fn leading_zeros_are_not_paid_for() {
        // Three coefficients from lag 0 on fit as well as two from lag 1 and one from lag 2.
        let losses =
            [vec![9.0, 4.0, 1.0], vec![4.0, 1.0, 1.0], vec![1.0, 1.0, 1.0], vec![9.0, 9.0, 9.0]];
        let p = posterior_of_start(&losses, 10.0, 500.0).unwrap();
        assert_eq!((p.best, p.ends), (2, [2.0, 2.0]));
    }

    #[test]
    fn equal_losses_leave_every_delay_open() {
        let p = posterior(&[1.0; 20], 10.0, 500.0).unwrap();
        assert!(p.set >= 19 && p.std > 5.0 && p.is_flat());
        assert!(posterior(&[f64::NAN], 1.0, 10.0).is_none());
    }

    #[test]
    fn coloured_residuals_count_less() {
        let mut e = vec![0.0; 4000];
        let mut state = 1_u64;
        for t in 1..4000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            e[t] = 0.8 * e[t - 1] + ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5);
        }
        // AR(1) with ρ = 0.8: N·(1 − ρ)/(1 + ρ).
        let expected = 4000.0 / 9.0;
        let got = effective_samples(&e);
        assert!((got / expected - 1.0).abs() < 0.4, "{got}");
        // A signal of the same colour: 1 + 2Σρ²ᵏ = 4.56; an alternating signal is not hidden.
        let slow = samples_under(&e, &e);
        assert!((slow * 4.56 / 4000.0 - 1.0).abs() < 0.2, "{slow}");
        let fast: Vec<f64> = (0..4000).map(|t| if t % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert_eq!(samples_under(&fast, &e), 4000.0);
    }
}
