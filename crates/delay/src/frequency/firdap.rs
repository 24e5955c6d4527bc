//! The delay of the all-pass part of a finite impulse response.
//!
//! Equation: y(t) = Σ hₖ u(t − k) + e(t). τ̂ = Σ Re (1 + xᵢ)/(1 − xᵢ) samples over the zeros |xᵢ| < 1 of Σ ĥₖxᵏ.

use super::all_pass::all_pass;
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, impulse_response, options};
use crate::method::{Basis, Condition, Information, Law, Method, method_line, plant_example};
use deadtime_identify::Record;

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value includes the sample of the hold.
///
/// Assumes: an input that excites every coefficient, a response that dies out within them, white noise and a gain at frequency 0. The plant has no zeros of its
/// own outside the unit circle: they add delay, 2T for a zero at s = 1/T. Coefficients before the plant's relative degree (`Search::bias`) are known to be zero
/// and left out.
/// Resolution and cost: fractions of a sample, of which up to 0.5 may hide in the minimum-phase part (included in the interval). O(N·taps), and O(taps²) for
/// the zeros.
/// Fails when: the gain at frequency 0 is small compared with the noise (zeros near z = 1: excluded with a note, or `flat`). A response longer than the taps
/// biases the delay. An input may not excite all taps (`not_rich_enough`). The zeros of a noisy response scatter along the unit circle, where they add little.
/// The error grows with the delay, that is with the number of coefficients before the response.
/// Source: Isaksson, Horch and Dumont (2001), Proc. ACC, 3280-3285. Björklund (2003), LiU-TEK-LIC-2003:60, class 1b (`firdap`). Björklund and Ljung (2009),
/// Automatica 45(10), 2467-2470. The source does not give its number of coefficients; 71 is that of its thresholds. The head of `all_pass` describes the guard
/// against zeros near 1.
#[doc = plant_example!(Firdap, 400, 0.8, 0.001)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Firdap {
    /// Coefficients of the impulse response; default 71, more where the search window needs them.
    pub taps: usize,
}

impl Default for Firdap {
    fn default() -> Self {
        Self { taps: 71 }
    }
}

const NAME: &str = "firdap";

/// Coefficients beyond the longest delay, for the response itself.
const BEYOND: usize = 36;

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Response,
    basis: Basis::FiniteResponse,
    tolerance: 0.25,
    withstands: &[Condition::Dynamics, Condition::MissingOutputs],
    needs: "an input that excites every coefficient, a response that dies out within them, a gain at frequency 0",
    blind_to: "zeros of the plant outside the unit circle, which it takes for delay; half a sample; feedback",
    exempt: &[(
        Law::Exact,
        "it reads a phase, which noise and the cut of the response move by fractions of a sample",
    )],
    ..method_line!(
        "firdap",
        "delay of the all-pass part of a finite impulse response, by its zeros",
        Firdap,
        Frequency
    )
};

impl PairMethod for Firdap {
    fn check(&self) -> Result<(), DelayError> {
        options(NAME, [("taps", self.taps as f64, self.taps >= 1, "1 or more")])
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let &PairRecords { records, max_delay, bias, .. } = pair;
        let taps = self.taps.max(max_delay + BEYOND);
        pair.at_least(NAME, bias + 2 * taps + 1, LengthRemedy::WindowOr("set fewer taps"))?;
        let ahead: Vec<Record> = records.iter().map(|r| r.ahead(bias)).collect();
        let fir = impulse_response(&ahead, taps)?;
        pair.visible()?;
        let Some(found) =
            all_pass(fir.coefficients.as_slice(), [&fir.covariance; 2], max_delay.max(1) as f64)
        else {
            let note = "the impulse response has no distinguishable zeros";
            return Err(NoDelay::new(Outcome::Singular, note));
        };
        found.behind(bias).answer(pair)
    }
}
