//! MATLAB's default estimate of a delay: the best of low-order ARX models over a range of delays.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ e²/N. The model is y(t) + a₁y(t − 1) + a₂y(t − 2) = b₁u(t − nk) + b₂u(t − nk − 1) + e(t).

use super::arxstruc::Arxstruc;
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::{Basis, Information, Method, PREDICTS, method_line, plant_example};

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: a plant of two poles whose noise passes the same poles (equation error). Otherwise as [`Arxstruc`].
/// Resolution and cost: one sample; O(N·(na + nb + delays)) for all delays together.
/// Fails when: the noise is that of a sensor: two coefficients cannot whiten it, and the poles are biased towards a faster plant. The delay is then late (slow
/// plants) or arbitrary; use [`Arxstruc`] with its ten coefficients. The published minimum is early by one sample where the first of the two coefficients is
/// zero. The estimate weights one and two coefficients by their evidence; the raw value is the published minimum.
/// Source: MATLAB, System Identification Toolbox, page `delayest` (na = nb = 2, nkmin = 0, nkmax = nkmin + 20, at most 10 000 models). The page states that ARX
/// models of different delays are compared. The page gives neither the criterion nor the rows, nor the treatment of feedback. For several inputs it says only
/// that all combinations are tried. Here the criterion is the loss over the rows common to all delays, each input on its own. The range is that of the search
/// (0 to `max_delay`).
#[doc = plant_example!(Delayest, 400, 0.8, 1e-12)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Delayest {
    /// Past outputs; default 2, MATLAB's.
    pub na: usize,
    /// Input coefficients; default 2, MATLAB's.
    pub nb: usize,
}

impl Default for Delayest {
    fn default() -> Self {
        Self { na: 2, nb: 2 }
    }
}

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Poles(2),
    basis: Basis::Arx,
    withstands: PREDICTS,
    needs: "a plant of two poles with little noise at the sensor",
    blind_to: "fractions of a sample; noise at the sensor makes it late",
    ..method_line!(
        "delayest",
        "best ARX model of order 2 over all delays, as MATLAB's function of this name",
        Delayest,
        Parametric
    )
};

impl DelayEstimator for Delayest {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        Arxstruc { na: self.na, nb: self.nb, ..Arxstruc::default() }
            .run("delayest", experiment, search)
    }
}
