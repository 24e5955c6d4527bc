//! Threshold on the step response.
//!
//! Equation: s(i) = Σ ĥ(k) over k ≤ i, σ_s(i) its standard deviation; τ̂ = Ts·min { i : |s(i)| > h·σ_s(i) }.

use super::impulse::Threshold;
use super::response::Kind;
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::Experiment;
use crate::method::WHOLE;
use crate::method::{
    Basis, Class, Condition, Information, Law, Method, ReferenceExperiment, Scope, Start,
};
use deadtime_signal::registry::entry;

/// Threshold on the step response, the running sum of the impulse response; options as [`Threshold`].
///
/// Assumes: as [`Threshold`]. It sees slow responses that no single coefficient shows, at the price of the noise that the sum gathers.
/// Fails when: the noise is slow, whose errors the sum gathers; for the rest as [`Threshold`].
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.1.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct Step(pub Threshold);

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    entry: entry!(
        "threshold_step",
        "first sample of the estimated step response above its threshold",
        Step,
        dyn DelayEstimator
    ),
    class: Class::Threshold,
    scope: Scope::Pair,
    start: Start::Any,
    reference: ReferenceExperiment::Plant,
    information: Information::Response,
    basis: Basis::FiniteResponse,
    tolerance: WHOLE,
    withstands: &[Condition::Dynamics, Condition::MissingOutputs],
    needs: "as `threshold`",
    blind_to: "as `threshold`; slow noise, which its running sum gathers",
    exempt: &[(
        Law::Exact,
        "the running sum gathers the errors of all coefficients before it, such as those of a response that outlives the taps",
    )],
};

impl DelayEstimator for Step {
    fn estimate(
        &self,
        experiment: &Experiment,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        self.0.run("threshold_step", &Kind::Step, experiment, search)
    }
}
