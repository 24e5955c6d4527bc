//! The dead time of one lag from two moments of the estimated impulse response.
//!
//! Equation: K·e^(−Ls)/(1 + sT): L = μ − √v, μ = ∫t·h dt/K and v = ∫(t − μ)²·h dt/K the mean and the variance of the impulse response.

use super::reading::{Lags, Reading, TOLD, answer, propagated, pulse_response};
use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{DelayEstimator, Search, one_pair};
use crate::experiment::Experiment;
use crate::method::{
    Basis, Class, Condition, Information, Law, Method, ReferenceExperiment, Scope, Start,
};
use deadtime_identify::{Fir, Record};
use deadtime_signal::registry::entry;

/// Moments of the estimated impulse response, read as one lag.
///
/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value is the continuous L of the equation.
///
/// The response to a sample of held input is the impulse response smeared over one sample: with its mean and variance, L = μ − ½ − √(v + ¼) samples is exact for one
/// lag. Read as two equal lags, L = μ − ½ − √(2v + ½), within a fifth of a sample from lags of one sample on.
/// Assumes: a plant of dead time and one lag; a response that dies out within `taps` samples; white noise.
/// Resolution and cost: fractions of a sample, if the plant is as assumed; O(N·taps).
/// Fails when: the plant is of another order (with two equal lags T it answers 0.59·T late); the plant oscillates; noise hides the variance, as it often
/// does, weighed as it is with the square of time (`singular`: the equations have no real solution); the gain at frequency 0 is not told from noise (`singular`);
/// or the input does not excite every coefficient (`not_rich_enough`). The interval reaches from the reading with one lag to that with two, and holds no plant
/// beyond them.
/// Source: Åström and Hägglund (1995), "PID Controllers: Theory, Design, and Tuning", 2nd ed., section 2.4 (the method of moments); Björklund (2003),
/// LiU-TEK-LIC-2003:60, class 3, whose verdict is "not useful": more than 54 % failures. His choice of the moments and of the response's length is not known here.
///
/// # Example
/// ```
/// use deadtime_delay::{Moment, DelayEstimator, Experiment, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let mut y = vec![0.0; 401];
/// for t in 4..400 {
///     y[t + 1] = 0.8 * y[t] + 0.2 * u[t - 4];
/// }
/// y.pop();
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = Moment::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 0.4).abs() < 0.02);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Moment {
    /// Coefficients of the impulse response; default 71, more where the search window needs them.
    pub taps: usize,
}

impl Default for Moment {
    fn default() -> Self {
        Self { taps: 71 }
    }
}

const NAME: &str = "moment";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "moment",
        "dead time of one lag from mean and variance of the impulse response",
        Moment,
        dyn DelayEstimator
    ),
    class: Class::Area,
    scope: Scope::Pair,
    start: Start::Any,
    reference: ReferenceExperiment::Plant,
    information: Information::Poles(1),
    basis: Basis::Own,
    tolerance: 2.0,
    withstands: &[Condition::MissingOutputs],
    needs: "a plant of one lag, a response that dies out within the taps, an input that excites them all",
    blind_to: "the order of the plant, which it takes for granted; oscillation; feedback",
    exempt: &[
        (Law::Exact, "it reads the response as that of one lag, which most plants are not"),
        (
            Law::Shift,
            "it weighs noise with the square of time: of records with 2 % of noise and 400 samples half have no real solution",
        ),
    ],
};

impl DelayEstimator for Moment {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        one_pair(experiment, search, |records, max_delay, bias| {
            self.pair(records, max_delay, bias, experiment)
        })
    }
}

impl Moment {
    fn pair(
        &self,
        records: &[Record],
        max_delay: usize,
        bias: usize,
        experiment: &Experiment,
    ) -> Result<DelayEstimate, DelayError> {
        let (fir, gain) = match pulse_response(NAME, self.taps, records, max_delay, experiment)? {
            Ok(found) => found,
            Err(none) => return Ok(none),
        };
        let Some(readings) = by_moments(&fir, gain) else {
            return Ok(DelayEstimate::without(
                Outcome::Singular,
                "the variance of the impulse response is negative or not told from noise: the moments have no real solution",
            ));
        };
        Ok(answer(Lags::One, readings, bias, max_delay, experiment))
    }
}

/// What one lag behind a hold lacks in variance: a pulse response (1 − p)·pⁱ has the mean 1/(1 − p) = ½ + √(v + ¼) beyond the delay.
const HOLD: f64 = 0.25;

/// Both readings of mean and variance; `None` where the variance is not told from noise, or negative.
fn by_moments(fir: &Fir, gain: f64) -> Option<[Reading; 2]> {
    let about = |from: f64, power: i32| {
        fir.coefficients
            .iter()
            .enumerate()
            .map(|(j, h)| (j as f64 - from).powi(power) * h)
            .sum::<f64>()
            / gain
    };
    let mean = about(0.0, 1);
    let variance = about(mean, 2);
    let spread: Vec<f64> = (0..fir.coefficients.len())
        .map(|j| ((j as f64 - mean).powi(2) - variance) / gain)
        .collect();
    let told = variance + HOLD > TOLD * propagated(&spread, &fir.covariance);
    if !told {
        return None;
    }
    let width = (variance + HOLD).sqrt();
    let reading = |times: f64| {
        let gradient: Vec<f64> = (0..fir.coefficients.len())
            .map(|j| j as f64 - mean)
            .map(|t| (t - 0.5 * times * (t * t - variance) / width) / gain)
            .collect();
        Reading { delay: mean - 0.5 - times * width, std: propagated(&gradient, &fir.covariance) }
    };
    let readings = [reading(1.0), reading(std::f64::consts::SQRT_2)];
    readings.iter().all(|r| r.delay.is_finite() && r.std.is_finite()).then_some(readings)
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    fn fir(h: Vec<f64>) -> Fir {
        let n = h.len();
        Fir {
            coefficients: DVector::from_vec(h),
            covariance: DMatrix::identity(n, n) * 1e-24,
            variance: 1e-24,
            rows: 1000,
        }
    }

    #[test]
    fn one_lag_behind_a_hold_is_read_exactly() {
        for (delay, lag) in [(4, 5.0_f64), (9, 10.0), (0, 2.0)] {
            let p = (-1.0 / lag).exp();
            let h = (0..400)
                .map(|i| if i > delay { (1.0 - p) * p.powi(i - delay - 1) } else { 0.0 })
                .collect();
            let found = by_moments(&fir(h), 1.0).unwrap()[0].delay;
            assert!((found - f64::from(delay)).abs() < 1e-9, "{delay} {lag}: {found}");
        }
    }

    #[test]
    fn the_standard_deviation_is_that_of_the_difference_quotients() {
        let at =
            fir((0..40).map(|i| if i > 5 { 0.2 * 0.8_f64.powi(i - 6) } else { 0.0 }).collect());
        let readings = |fir: &Fir| by_moments(fir, fir.coefficients.sum()).unwrap();
        for k in 0..2 {
            let moved = |j: usize, h: f64| {
                let mut other = at.clone();
                other.coefficients[j] += h;
                readings(&other)[k].delay
            };
            let squares: f64 =
                (0..40).map(|j| ((moved(j, 1e-6) - moved(j, -1e-6)) / 2e-6).powi(2)).sum();
            let std = readings(&at)[k].std;
            assert!((std / (1e-12 * squares.sqrt()) - 1.0).abs() < 1e-3, "{std}");
        }
    }

    #[test]
    fn a_negative_variance_has_no_reading() {
        assert!(by_moments(&fir(vec![-0.1, 0.0, 1.2, 0.0, -0.1]), 1.0).is_none());
    }
}
