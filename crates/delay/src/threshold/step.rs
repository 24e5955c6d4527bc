//! Threshold on the step response.
//!
//! Equation: s(i) = Σ ĥ(k) over k ≤ i, σ_s(i) its standard deviation; τ̂ = Ts·min { i : |s(i)| > h·σ_s(i) }.

use super::impulse::Threshold;
use super::response::ResponseKind;
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{NoDelay, PairMethod, PairRecords};
use crate::method::{Basis, Condition, Information, Law, Method, method_line};

/// Threshold on the step response, the running sum of the impulse response; options as [`Threshold`].
///
/// Assumes: as [`Threshold`]. The step response reveals slow responses without a significant single coefficient, at the price of accumulated noise.
/// Fails when: the noise is slow: its errors accumulate in the sum. Otherwise as [`Threshold`].
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.1.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct Step(pub Threshold);

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Response,
    basis: Basis::FiniteResponse,
    withstands: &[Condition::Dynamics, Condition::MissingOutputs, Condition::InverseResponse],
    needs: "as `threshold`",
    blind_to: "as `threshold`; slow noise, which its running sum gathers",
    exempt: &[(
        Law::Exact,
        "the running sum gathers the errors of all coefficients before it, such as those of a response that outlives the taps",
    )],
    ..method_line!(
        "threshold_step",
        "first sample of the estimated step response above its threshold",
        Step,
        Threshold
    )
};

impl PairMethod for Step {
    fn check(&self) -> Result<(), DelayError> {
        self.0.check_as("threshold_step")
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let response = self.0.response("threshold_step", ResponseKind::Step, pair)?;
        // The running sum accumulates slow noise as it accumulates a response; a whitening test decides whether there is a response.
        pair.visible()?;
        self.0.crossing(&response, false, pair)
    }
}
