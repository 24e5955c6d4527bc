//! The first sample from which the impulse response, in units of its uncertainty, accumulates.
//!
//! Equation: z = ĥ/σ̂, g⁺(i) = max(0, g⁺(i − 1) + z(i) − ν), g⁻ alike for −z. The alarm is at the first i where either exceeds h; the change is right after
//! that sum's last 0.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{ChiSquared, Distribution, StandardNormal};

use super::response::{
    EstimatedResponse, Prewindow, Records, ResponseKind, misfits, onset, response,
};
use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, options};
use crate::method::{Basis, Condition, Information, Law, Method, method_line, plant_example};
use crate::posterior;

/// CUSUM test on the impulse response.
///
/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: the response has died out after `taps` samples, white noise, an input that excites every tap.
/// Resolution and cost: one sample; O(N·taps), and 2000 draws of max-delay values for the alarm level.
/// Fails when: the response changes sign at once: the sum falls back, and the sample-by-sample [`super::impulse::Threshold`] is better. A slow beginning keeps
/// even the sum below the drift: the estimate is late, and the interval reaches back to the possible beginning. The published change point (the raw value) is
/// early where noise just before the response exceeds the drift: 1 of 6 records at drift 1. The estimate is the start of the ramp that best fits the samples up
/// to the alarm, within the run before it.
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.1 (idimpCusum). Page (1954), Biometrika 41, 100-115, doi:10.1093/biomet/41.1-2.100. Gustafsson
/// (2000), "Adaptive Filtering and Change Detection", section 3.3. Björklund tuned drift and level to his benchmark; these values are not used here. Noise
/// alone, with the correlation of the coefficients' errors, exceeds the level used with a given probability.
#[doc = plant_example!(Cusum, 600, 0.6, 1e-12)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Cusum {
    /// Coefficients of the impulse response; default 71, more where the search window needs them.
    pub taps: usize,
    /// Standard deviations that every sample must add on average; default 1, half of the smallest change to detect.
    pub drift: f64,
    /// Level of the alarm, standard deviations; default: by `false_alarm`.
    pub level: Option<f64>,
    /// Probability that noise alone, white, gives an alarm somewhere in the search window; default 0.01.
    pub false_alarm: f64,
    /// The combination of several records; default jointly.
    pub records: Records,
    /// The assumption on the input before a record; default auto.
    pub prewindow: Prewindow,
}

impl Default for Cusum {
    fn default() -> Self {
        Self {
            taps: 71,
            drift: 1.0,
            level: None,
            false_alarm: 0.01,
            records: Records::Joint,
            prewindow: Prewindow::Auto,
        }
    }
}

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Response,
    basis: Basis::FiniteResponse,
    withstands: &[Condition::Dynamics, Condition::MissingOutputs, Condition::InverseResponse],
    needs: "as `threshold`",
    blind_to: "responses that change sign at once; feedback",
    exempt: &[(
        Law::Exact,
        "a response that outlives the taps leaves errors in the coefficients before its start, which the sum adds up",
    )],
    ..method_line!(
        "cusum",
        "sample from which the estimated impulse response keeps adding up, by a CUSUM test",
        Cusum,
        Threshold
    )
};

impl PairMethod for Cusum {
    fn check(&self) -> Result<(), DelayError> {
        self.check_as("cusum")
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        self.change("cusum", ResponseKind::Impulse, pair)
    }
}

impl Cusum {
    /// Refuses options out of their ranges, under the name of a method that has them.
    pub(super) fn check_as(&self, name: &'static str) -> Result<(), DelayError> {
        let Self { taps, drift, level, false_alarm, .. } = *self;
        let level = level.unwrap_or(1.0);
        let rows = [
            ("taps", taps as f64, taps >= 1, "1 or more"),
            ("drift", drift, drift.is_finite() && drift >= 0.0, "0 or more"),
            ("level", level, level.is_finite() && level > 0.0, "above 0"),
            ("false_alarm", false_alarm, false_alarm > 0.0 && false_alarm < 1.0, "between 0 and 1"),
        ];
        options(name, rows)
    }

    /// The delay at which the response begins to accumulate.
    pub(super) fn change(
        &self,
        name: &'static str,
        kind: ResponseKind,
        pair: &PairRecords,
    ) -> Result<DelayEstimate, NoDelay> {
        let max_delay = pair.max_delay;
        let taps = self.taps.max(max_delay + 1);
        let response = response(name, kind, pair.records, taps, (self.records, self.prewindow))?;
        // Slow noise accumulates as a response does; a whitening test decides whether there is a response.
        pair.visible()?;
        // On noise-free data the uncertainty is rounding; a share of the largest value replaces it.
        let floor = ROUNDING * response.values.amax();
        let z: Vec<f64> = (0..=max_delay)
            .map(|i| response.values[i] / response.std[i].max(floor).max(f64::MIN_POSITIVE))
            .collect();
        let level = self
            .level
            .unwrap_or_else(|| alarm_level(&response, max_delay + 1, self.drift, self.false_alarm));
        let Some(Run { first, alarm }) = cusum(&z, self.drift, level) else {
            let note = format!(
                "the response adds up to no more than {level:.1} standard deviations above the drift up to the longest delay"
            );
            return Err(NoDelay::new(Outcome::NotVisible, note));
        };
        // Errors of coefficients are nearly independent, those of their sums are not: the coefficients give the beginning.
        let [values, std] = &response.each;
        let misfits = misfits(values, std, alarm);
        let start = (first..=alarm)
            .rev()
            .min_by(|&a, &b| misfits[a].total_cmp(&misfits[b]))
            .unwrap_or(alarm);
        let began = onset(&misfits).min(start);
        let [raw, start, began, alarm] = [first, start, began, alarm].map(|i| i as f64);
        let interval = posterior::first_coefficient(began, alarm, pair.bias);
        let std = (interval[1] - interval[0]) * posterior::RESOLUTION.sqrt();
        let estimate = pair.counted(start, std, interval).with_raw_s(pair.seconds(raw));
        Ok(estimate.noting(response.note))
    }
}

/// Share of the largest value below which a standard deviation is rounding.
const ROUNDING: f64 = 1e-10;

/// The samples of a sum that raised an alarm.
#[derive(Debug, PartialEq)]
struct Run {
    /// The first sample after the sum was last 0.
    first: usize,
    /// The sample that exceeded the level.
    alarm: usize,
}

/// Page's test on both signs of `z`.
fn cusum(z: &[f64], drift: f64, level: f64) -> Option<Run> {
    let (mut sums, mut firsts) = ([0.0; 2], [0; 2]);
    for (i, value) in z.iter().enumerate() {
        for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
            sums[side] = f64::max(0.0, sums[side] + sign * value - drift);
            if sums[side] == 0.0 {
                firsts[side] = i + 1;
            }
        }
        let larger = usize::from(sums[1] > sums[0]);
        if sums[larger] > level {
            return Some(Run { first: firsts[larger], alarm: i });
        }
    }
    None
}

/// Draws behind an alarm level: a level for 1 % is based on twenty of them.
const DRAWS: usize = 2000;

/// The level that noise alone exceeds with this probability, from draws with the correlation of the response's errors.
fn alarm_level(response: &EstimatedResponse, samples: usize, drift: f64, probability: f64) -> f64 {
    let mut correlation: DMatrix<f64> =
        response.correlation.view((0, 0), (samples, samples)).into_owned();
    for i in 0..samples {
        correlation[(i, i)] = 1.0 + 1e-9;
    }
    // Errors without a usable covariance (noise-free data) are drawn independent.
    let root =
        correlation.cholesky().map_or_else(|| DMatrix::identity(samples, samples), |c| c.l());
    let freedom = response.freedom.max(1) as f64;
    let scale = ChiSquared::new(freedom).ok();
    // A separate stream with a fixed seed: the same record gives the same level.
    let mut rng = ChaCha8Rng::seed_from_u64(1954);
    let mut tops: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let independent = DVector::from_fn(samples, |_, _| StandardNormal.sample(&mut rng));
            let spread: f64 = scale
                .as_ref()
                .map_or(1.0, |s| (Distribution::<f64>::sample(s, &mut rng) / freedom).sqrt());
            let z = &root * independent / spread.max(f64::MIN_POSITIVE);
            top(z.as_slice(), drift)
        })
        .collect();
    tops.sort_by(f64::total_cmp);
    let at = ((1.0 - probability) * DRAWS as f64) as usize;
    tops.get(at).or(tops.last()).copied().unwrap_or(f64::INFINITY)
}

/// The largest value of either sum.
fn top(z: &[f64], drift: f64) -> f64 {
    let (mut up, mut down, mut top) = (0.0_f64, 0.0_f64, 0.0_f64);
    for value in z {
        up = (up + value - drift).max(0.0);
        down = (down - value - drift).max(0.0);
        top = top.max(up).max(down);
    }
    top
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    #[test]
    fn the_change_is_right_after_the_sum_was_last_zero() {
        let z = [0.2, -0.5, 1.4, 0.1, 1.5, 2.5, 3.0];
        // Sums 0, 0, 0.4, 0, 0.5, 2.0, 4.0.
        assert_eq!(cusum(&z, 1.0, 1.9), Some(Run { first: 4, alarm: 5 }));
        assert_eq!(cusum(&z.map(|v| -v), 1.0, 1.9), Some(Run { first: 4, alarm: 5 }));
        assert_eq!(cusum(&z, 1.0, 4.1), None);
        assert_abs_diff_eq!(top(&z, 1.0), 4.0, epsilon = 1e-12);
    }

    /// With a drift so large that a sum never lasts, the level is the quantile of the largest of n values minus the drift.
    #[test]
    fn the_level_is_the_quantile_of_the_largest_for_a_large_drift() {
        use statrs::distribution::{ContinuousCDF, Normal};
        let n = 30;
        let none = DVector::zeros(n);
        let response = EstimatedResponse {
            values: none.clone(),
            std: none.clone(),
            each: [none.clone(), none],
            correlation: DMatrix::identity(n, n),
            freedom: 1_000_000,
            note: None,
        };
        let drift = 1.5;
        let level = alarm_level(&response, n, drift, 0.05);
        // Without memory: P(all |z| ≤ drift + level) = 0.95.
        let alone =
            Normal::new(0.0, 1.0).unwrap().inverse_cdf(0.5 + 0.5 * 0.95_f64.powf(1.0 / n as f64))
                - drift;
        assert!(level >= alone - 0.05 && level < alone + 0.6, "{level} {alone}");
        // Correlated errors accumulate further.
        let slow = DMatrix::from_fn(n, n, |i, j| 0.95_f64.powi((i as i32 - j as i32).abs()));
        assert!(
            alarm_level(&EstimatedResponse { correlation: slow, ..response }, n, drift, 0.05)
                > level + 1.0
        );
    }
}
