//! The first sample at which an estimated impulse or step response exceeds its uncertainty.
//!
//! Equation: τ̂ = Ts·min{ i : |ĥᵢ| > h_std·σ̂ᵢ }, ĥ the finite impulse response by least squares and σ̂ its standard deviations.

use super::response::{
    EstimatedResponse, Prewindow, Records, ResponseKind, misfits, onset, response,
};
use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, options};
use crate::method::{Basis, Condition, Information, Method, method_line, plant_example};
use crate::posterior;
use deadtime_signal::stats::students_t;

/// Threshold on the impulse response.
///
/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: the response has died out after `taps` samples, white noise, an input that excites every tap.
/// Resolution and cost: one sample; O(N·taps).
/// Fails when: the input does not excite all taps in the rows used (`not_rich_enough`). An impulse at the first sample, or ramps that end before the taps do,
/// need `prewindow: rest`. Without a significant coefficient the outcome is `not_visible`. A slow beginning makes the estimate late; the interval reaches back
/// to the possible beginning.
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.1 (5 standard deviations); the thesis behind this project, algorithms 3.1 to 3.3 (3 standard
/// deviations).
#[doc = plant_example!(Threshold, 600, 0.6, 1e-12)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Threshold {
    /// Coefficients of the impulse response; default 71, more where the search window needs them.
    pub taps: usize,
    /// Standard deviations that a coefficient must exceed; default 5. (3, as in the thesis, gives a false alarm in 18 % of white records.)
    pub h_std: f64,
    /// Instead of `h_std`: the probability of a false alarm over all taps together, Šidák's limit; default `None`.
    pub family_wise: Option<f64>,
    /// The combination of several records; default jointly.
    pub records: Records,
    /// The assumption on the input before a record; default auto.
    pub prewindow: Prewindow,
}

impl Default for Threshold {
    fn default() -> Self {
        Self {
            taps: 71,
            h_std: 5.0,
            family_wise: None,
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
    needs: "an input that excites every tap, a response that dies out within them",
    blind_to: "a response that begins slowly: it answers late; feedback",
    ..method_line!(
        "threshold",
        "first coefficient of the estimated impulse response above its threshold",
        Threshold,
        Threshold
    )
};

impl PairMethod for Threshold {
    fn check(&self) -> Result<(), DelayError> {
        self.check_as("threshold")
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let response = self.response("threshold", ResponseKind::Impulse, pair)?;
        self.crossing(&response, true, pair)
    }
}

impl Threshold {
    /// Refuses options out of their ranges, under the name of a method that has them.
    pub(super) fn check_as(&self, name: &'static str) -> Result<(), DelayError> {
        let Self { taps, h_std, family_wise, .. } = *self;
        let level = family_wise.unwrap_or(0.5);
        let rows = [
            ("taps", taps as f64, taps >= 1, "1 or more"),
            ("h_std", h_std, h_std.is_finite() && h_std > 0.0, "above 0"),
            ("family_wise", level, level > 0.0 && level < 1.0, "between 0 and 1"),
        ];
        options(name, rows)
    }

    /// The response for these options.
    pub(super) fn response(
        &self,
        name: &'static str,
        kind: ResponseKind,
        pair: &PairRecords,
    ) -> Result<EstimatedResponse, NoDelay> {
        let taps = self.taps.max(pair.max_delay + 1);
        response(name, kind, pair.records, taps, (self.records, self.prewindow))
    }

    /// The first sample above the threshold; a response that `settles` must have died out behind it.
    pub(super) fn crossing(
        &self,
        response: &EstimatedResponse,
        settles: bool,
        pair: &PairRecords,
    ) -> Result<DelayEstimate, NoDelay> {
        let taps = response.values.len();
        let multiple = match self.family_wise {
            None => self.h_std,
            Some(level) => {
                let each = 1.0 - (1.0 - level).powf(1.0 / taps as f64);
                students_t(1.0 - each / 2.0, response.freedom as f64).unwrap_or(self.h_std)
            }
        };
        // On noise-free data the uncertainty is rounding, and so may be the values above it.
        let floor = 1e-9 * response.values.amax();
        let threshold = response.std.map(|s| (multiple * s).max(floor));
        let above = |i: usize| response.values[i].abs() > threshold[i];
        let Some(first) = (0..=pair.max_delay).find(|&i| above(i)) else {
            let note = format!(
                "no sample of the response up to the longest delay exceeds {multiple:.2} standard deviations"
            );
            return Err(NoDelay::new(Outcome::NotVisible, note));
        };
        let began = onset(&misfits(&response.values, &response.std, first));
        let (raw, began) = (first as f64, began as f64);
        let interval = posterior::first_coefficient(began, raw, pair.bias);
        let tail = taps - taps.div_ceil(10);
        let alive = (tail..taps)
            .filter(|&i| response.values[i].abs() > (3.0 * response.std[i]).max(floor))
            .count();
        let note = (settles && 2 * alive > taps - tail).then(|| {
            format!("the impulse response has not died out after {taps} taps: set more of them")
        });
        // The true start is uniform between the ends.
        let std = (interval[1] - interval[0]) * posterior::RESOLUTION.sqrt();
        Ok(pair.counted(raw, std, interval).noting(note).noting(response.note.clone()))
    }
}
