//! CUSUM test on the step response.
//!
//! Equation: z = s/σ_s, s(i) = Σ ĥ(k) over k ≤ i. The sums are g⁺(i) = max(0, g⁺(i − 1) + z(i) − ν), g⁻ alike for −z. The alarm is at the first i where either
//! exceeds h.

use super::cusum::Cusum;
use super::response::ResponseKind;
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{NoDelay, PairMethod, PairRecords};
use crate::method::{Basis, Condition, Information, Law, Method, method_line, plant_example};

/// CUSUM test on the step response, the running sum of the impulse response; options, output and cost as [`Cusum`].
///
/// Assumes: as [`Cusum`]. The step response reveals slow responses without a significant single coefficient; the alarm level allows for the correlated errors
/// of a running sum.
/// Fails when: the noise is slow: the level is for white noise, whose errors accumulate less. Otherwise as [`Cusum`].
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.1 (idstepCusum); its open points are those of [`Cusum`].
#[doc = plant_example!(CusumStep, 600, 0.6, 1e-12)]
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct CusumStep(pub Cusum);

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Response,
    basis: Basis::FiniteResponse,
    withstands: &[Condition::Dynamics, Condition::MissingOutputs, Condition::InverseResponse],
    needs: "as `threshold`",
    blind_to: "as `cusum`; slow noise, which its running sum gathers",
    exempt: &[(
        Law::Exact,
        "the running sum gathers the errors of all coefficients before it, such as those of a response that outlives the taps",
    )],
    ..method_line!(
        "cusum_step",
        "sample from which the estimated step response keeps adding up, by a CUSUM test",
        CusumStep,
        Threshold
    )
};

impl PairMethod for CusumStep {
    fn check(&self) -> Result<(), DelayError> {
        self.0.check_as("cusum_step")
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        self.0.change("cusum_step", ResponseKind::Step, pair)
    }
}
