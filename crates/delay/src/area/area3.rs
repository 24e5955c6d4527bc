//! The dead time of two equal lags from two areas of the estimated step response.
//!
//! Equation: K·e^(−Ls)/(1 + sT)²: L = A₀/K − (e²/2)·A₁/K, A₀ = ∫(K − s) dt, A₁ = ∫₀^(A₀/K) s dt, s the running sum of the impulse response by least squares.

use super::reading::{Lags, answer, by_areas, pulse_response};
use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{DelayEstimator, Search, one_pair};
use crate::experiment::Experiment;
use crate::method::{
    Basis, Class, Condition, Information, Law, Method, ReferenceExperiment, Scope, Start,
};
use deadtime_identify::Record;
use deadtime_signal::registry::entry;

/// Areas of the estimated step response, read as two equal lags.
///
/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value is the continuous L of the equation.
///
/// Assumes: a plant of dead time and two equal lags; a response that dies out within `taps` samples; white noise.
/// Resolution and cost: fractions of a sample, if the plant is as assumed; O(N·taps).
/// Fails when: the plant is of another order: with one lag T it answers 0.36·T early, with more than two late; it oscillates; the gain at frequency 0 is not told from noise (`singular`); noise puts the average
/// residence time outside the response (`singular`); or the input does not excite every coefficient (`not_rich_enough`). The interval reaches from the reading with
/// one lag to that with two, and holds no plant beyond them.
/// Source: Åström and Hägglund (1995), "PID Controllers: Theory, Design, and Tuning", 2nd ed., section 2.4 (its second three-parameter model); Björklund (2003), LiU-TEK-LIC-2003:60, class 3,
/// whose verdict on `area2` is a mean RMS error of 3.1 to 3.4 samples. What tells Björklund's `area1` to `area3` from each other
/// is not known here but for the numbers; `area3` is taken to be Åström and Hägglund's other model of three parameters K, L, T.
///
/// # Example
/// ```
/// use deadtime_delay::{Area3, DelayEstimator, Experiment, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let (p, a, mut y) = (0.8_f64, -0.8_f64.ln(), vec![0.0; 401]);
/// for t in 5..400 {
///     // Two equal lags behind a hold and four samples of delay.
///     y[t + 1] = 2.0 * p * y[t] - p * p * y[t - 1] + (1.0 - p - a * p) * u[t - 4] + p * (p - 1.0 + a) * u[t - 5];
/// }
/// y.pop();
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = Area3::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 0.4).abs() < 0.02);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Area3 {
    /// Coefficients of the impulse response; default 71, more where the search window needs them.
    pub taps: usize,
}

impl Default for Area3 {
    fn default() -> Self {
        Self { taps: 71 }
    }
}

const NAME: &str = "area3";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "area3",
        "dead time of two equal lags from areas of the estimated step response",
        Area3,
        dyn DelayEstimator
    ),
    class: Class::Area,
    scope: Scope::Pair,
    start: Start::Any,
    reference: ReferenceExperiment::Plant,
    information: Information::Poles(2),
    basis: Basis::Own,
    tolerance: 1.5,
    withstands: &[Condition::Dynamics, Condition::MissingOutputs],
    needs: "a plant of two equal lags, a response that dies out within the taps, an input that excites them all",
    blind_to: "the order of the plant, which it takes for granted; oscillation; feedback",
    exempt: &[(
        Law::Exact,
        "it reads the response as that of two equal lags, which most plants are not",
    )],
};

impl DelayEstimator for Area3 {
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

impl Area3 {
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
        let Some(readings) = by_areas(&fir, gain) else {
            return Ok(DelayEstimate::without(
                Outcome::Singular,
                "noise puts the average residence time outside the response: the areas have no solution",
            ));
        };
        Ok(answer(Lags::Two, readings, bias, max_delay, experiment))
    }
}
