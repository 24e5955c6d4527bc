//! CUSUM test on the step response.
//!
//! Equation: z = s/σ_s, s(i) = Σ ĥ(k) over k ≤ i; g⁺(i) = max(0, g⁺(i − 1) + z(i) − ν), g⁻ alike for −z; alarm at the first i where either exceeds h.

use super::cusum::Cusum;
use super::response::ResponseKind;
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{NoDelay, PairMethod, PairRecords};
use crate::method::{Basis, Condition, Information, Law, Method, method_line};

/// CUSUM test on the step response, the running sum of the impulse response; options, output and cost as [`Cusum`].
///
/// Assumes: as [`Cusum`]. It sees slow responses that no single coefficient shows; the errors of a running sum are far from independent, which the alarm level allows for.
/// Fails when: the noise is slow: the level is for white noise, whose errors the sum gathers less. For the rest as [`Cusum`].
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.1 (idstepCusum); what it leaves open is said at [`Cusum`].
///
/// # Example
/// ```
/// use deadtime_delay::{CusumStep, DelayEstimator, Experiment, Search};
/// use deadtime_signal::{Excitation, excitation::Rbs};
/// use deadtime_signal::time::SampleTime;
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let u = Rbs::default().generate(600, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let mut y = vec![0.0; 600];
/// for t in 5..600 {
///     y[t] = 0.6 * y[t - 1] + u[t - 5]; // four samples of delay and one of the hold
/// }
/// let experiment = Experiment::siso(SampleTime::new(0.1)?, &u, &y)?;
/// let answer = CusumStep::default().estimate(&experiment, &Search::default())?;
/// assert!((answer.delay_s.unwrap() - 0.4).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct CusumStep(pub Cusum);

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Response,
    basis: Basis::FiniteResponse,
    withstands: &[Condition::Dynamics, Condition::MissingOutputs],
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
