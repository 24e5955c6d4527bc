//! MATLAB's default estimate of a delay: the best of low-order ARX models over a range of delays.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ e²/N, y(t) + a₁y(t − 1) + a₂y(t − 2) = b₁u(t − nk) + b₂u(t − nk − 1) + e(t).

use super::arxstruc::Arxstruc;
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::{Basis, Information, Method, PREDICTS, method_line};

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: a plant of two poles whose noise passes the same poles (equation error); as [`Arxstruc`] for the rest.
/// Resolution and cost: one sample; O(N·(na + nb + delays)) for all delays together.
/// Fails when: the noise is that of a sensor: two coefficients cannot whiten it, the poles are biased towards a faster plant and the delay comes out late (slow
/// plants) or anywhere; [`Arxstruc`] with its ten coefficients is the cure. The published minimum is early by one where the first of the two coefficients is zero: the
/// answer weighs one and two of them by their evidence, the raw value is the published minimum.
/// Source: MATLAB, System Identification Toolbox, page `delayest` (na = 2, nb = 2, nkmin = 0, nkmax = nkmin + 20, at most 10 000 models). The page says that ARX models of
/// different delays are compared, not by which criterion nor over which rows, nor what is done about feedback or about several inputs beyond trying all combinations; here
/// the criterion is the loss over rows that all delays share, each input on its own, and the range is that of the search (0 to `max_delay`).
///
/// # Example
/// ```
/// use deadtime_delay::{DelayEstimator, Delayest, Experiment, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(400, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let mut y = vec![0.0; 400];
/// for t in 5..400 {
///     y[t] = 0.8 * y[t - 1] + u[t - 5]; // four samples of delay and one of the hold
/// }
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = Delayest::default().estimate(&experiment, &Search { max_delay: 20, ..Search::default() })?;
/// assert!((answer.delay_s.unwrap() - 0.4).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
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
