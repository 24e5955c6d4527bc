//! A threshold on a regularised impulse response, with the start of largest evidence.
//!
//! Equation: y(t) = Σ hᵢ u(t − i) + e(t), h ~ N(0, c·λ^max(i, j)), c and λ by marginal likelihood. The response is visible where some |ĥᵢ| > m·ŝᵢ, ŝ the
//! posterior's standard deviation. τ̂ = Ts·argmax over k of p(y | h begins at k).

use statrs::distribution::{ContinuousCDF, Normal};

use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, options};
use crate::method::{Condition, Information, Method, method_line, plant_example};
use crate::posterior;
use deadtime_identify::Evidence;

/// Threshold on a regularised impulse response, as MATLAB's `impulseest` draws it.
///
/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: a response that dies out smoothly within `taps` samples, white noise. The input need not excite every tap: the prior regularises the others.
/// Resolution and cost: one sample; O(N·taps), and about 200 factorisations of a taps × taps matrix.
/// Fails when: the response jumps late and dies at once. The prior expects the largest values first and spreads the jump: the threshold crossing (the raw
/// value) is one or two samples early. The estimate compares responses beginning at each delay and is not affected. Slow oscillations contradict the
/// stable-spline prior, which expects short memory. Slow noise violates the assumption of white noise. False alarms: a posterior mean varies less between
/// records than its posterior covariance (shrinkage). Noise alone therefore exceeds Šidák's limit with at most the given probability. The limit does not hold
/// before the start of a true response, because the prior leaks from later coefficients to earlier ones. The estimate is therefore not the crossing.
/// Source: Chen, Ohlsson and Ljung (2012), Automatica 48(8), 1525-1535, doi:10.1016/j.automatica.2012.05.026 (TC kernel, marginal likelihood); MATLAB, System
/// Identification Toolbox, page `impulseest` (default kernel TC). Neither source reads a delay from the response: MATLAB's user looks for the first coefficient
/// outside of the confidence region. The evidence of each start is this program's.
#[doc = plant_example!(Impulseest, 400, 0.6, 1e-12)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Impulseest {
    /// Coefficients of the impulse response; default 70, as MATLAB's, more where the search window needs them.
    pub taps: usize,
    /// Largest probability that noise alone crosses the threshold anywhere; default 0.01.
    pub false_alarm: f64,
}

impl Default for Impulseest {
    fn default() -> Self {
        Self { taps: 70, false_alarm: 0.01 }
    }
}

const NAME: &str = "impulseest";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Response,
    withstands: &[Condition::Dynamics, Condition::MissingOutputs, Condition::InverseResponse],
    needs: "a response that dies out smoothly within its taps, white noise",
    blind_to: "slow noise; feedback; a response that the prior does not expect",
    ..method_line!(
        "impulseest",
        "start of a regularised impulse response: less noise than `threshold`, and for inputs that excite not every tap",
        Impulseest,
        Threshold
    )
};

/// Rows for each coefficient of the shortest record: the prior regularises the remainder.
const ROWS: usize = 20;

impl PairMethod for Impulseest {
    fn check(&self) -> Result<(), DelayError> {
        let Self { taps, false_alarm } = *self;
        let allowed = false_alarm > 0.0 && false_alarm < 1.0;
        let rows = [
            ("taps", taps as f64, taps >= 1, "1 or more"),
            ("false_alarm", false_alarm, allowed, "between 0 and 1"),
        ];
        options(NAME, rows)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let max_delay = pair.max_delay;
        let taps = self.taps.max(max_delay + 1);
        pair.at_least(NAME, taps - 1 + ROWS, LengthRemedy::WindowOr("set fewer taps"))?;
        let Some(evidence) = Evidence::new(pair.records, taps) else {
            let note = format!("the input never moves within {taps} samples of a measured output");
            return Err(NoDelay::new(Outcome::NotRichEnough, note));
        };
        pair.visible()?;
        let prior = evidence.tune(0, None);
        let Some(whole) = evidence.response(0, prior) else {
            let note = "the numbers overflow; scale the channels";
            return Err(NoDelay::new(Outcome::Singular, note));
        };
        let each = 1.0 - (1.0 - self.false_alarm).powf(1.0 / taps as f64);
        let multiple =
            Normal::new(0.0, 1.0).map_or(f64::INFINITY, |n| n.inverse_cdf(1.0 - 0.5 * each));
        let above = |i: &usize| {
            whole.coefficients[*i].abs() > multiple * whole.covariance[(*i, *i)].max(0.0).sqrt()
        };
        let Some(crossing) = (0..=max_delay).find(above) else {
            let note = format!(
                "no coefficient up to the longest delay exceeds {multiple:.2} posterior standard deviations"
            );
            return Err(NoDelay::new(Outcome::NotVisible, note));
        };
        let misfits = evidence.misfits(crossing, prior, max_delay);
        let Some(posterior) = posterior::posterior_of_misfits(&misfits) else {
            let note = "no start has a finite likelihood: scale the channels";
            return Err(NoDelay::new(Outcome::Singular, note));
        };
        let delays = max_delay + 1;
        if posterior.set > delays / 2 {
            let note = format!("{} of {delays} starts are as probable", posterior.set);
            return Err(NoDelay::new(Outcome::Flat, note));
        }
        Ok(pair.most_probable(&posterior).with_raw_s(pair.seconds(crossing as f64)))
    }
}
