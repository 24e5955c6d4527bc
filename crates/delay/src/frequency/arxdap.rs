//! The delay of the all-pass part of an ARX model.
//!
//! Equation: A(q) y(t) = B(q) u(t) + e(t). τ̂ = Σ Re (1 + xᵢ)/(1 − xᵢ) samples over the zeros |xᵢ| < 1 of Σ b̂ₖxᵏ.

use super::all_pass::all_pass;
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{NoDelay, PairMethod, PairRecords, impulse_response, options};
use crate::method::{Basis, Information, Law, Method, PREDICTS, method_line, plant_example};
use deadtime_identify::{Record, Regression};

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value includes the sample of the hold.
///
/// Assumes: noise that an AR(na) filter describes, a plant without zeros of its own outside the unit circle, a gain at frequency 0. The plant's poles have no
/// influence, so unstable plants and feedback are allowed. Coefficients before the plant's relative degree (`Search::bias`) are known to be zero and left out.
/// Under feedback within one sample the first of them would contain the controller.
/// Resolution and cost: fractions of a sample, of which up to 0.5 may hide in the minimum-phase part. O(N·(na + window)), and O(window²) for the zeros.
/// Fails when: the gain at frequency 0 is small compared with the noise (zeros near z = 1: excluded with a note, or `flat`). An input may not excite the
/// numerator (`not_rich_enough`). On noise-free data the fit omits linearly dependent columns.
/// Source: Isaksson, Horch and Dumont (2001), Proc. ACC, 3280-3285. Björklund (2003), LiU-TEK-LIC-2003:60, class 1b (`arxdap`). Björklund and Ljung (2009),
/// Automatica 45(10), 2467-2470. Björklund's orders are not known here; the numerator reaches beyond the search window, which represents any delay inside it.
/// The head of `all_pass` describes the guard against zeros near 1.
#[doc = plant_example!(Arxdap, 400, 0.8, 0.001)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Arxdap {
    /// Past outputs; default 10, as `arxstruc`.
    pub na: usize,
    /// Input coefficients beyond the longest delay; default 5, as `arxstruc`.
    pub nb: usize,
}

impl Default for Arxdap {
    fn default() -> Self {
        Self { na: 10, nb: 5 }
    }
}

const NAME: &str = "arxdap";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    information: Information::Poles(2),
    basis: Basis::Arx,
    tolerance: 0.25,
    withstands: PREDICTS,
    needs: "noise that an AR filter of its order whitens, a gain at frequency 0",
    blind_to: "zeros of the plant outside the unit circle, which it takes for delay; half a sample",
    exempt: &[(Law::Exact, "it reads a phase, which noise moves by fractions of a sample")],
    ..method_line!(
        "arxdap",
        "delay of the all-pass part of an ARX model, by the zeros of its numerator",
        Arxdap,
        Frequency
    )
};

impl PairMethod for Arxdap {
    fn check(&self) -> Result<(), DelayError> {
        options(NAME, [("nb", self.nb as f64, self.nb >= 1, "1 or more")])
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let &PairRecords { records, max_delay, bias, .. } = pair;
        let lags = max_delay + self.nb;
        let regression = Regression { na: self.na, lags };
        let needed = bias + regression.first_row() + 2 * regression.columns();
        pair.at_least(NAME, needed, LengthRemedy::WindowOr("set smaller na and nb"))?;
        let ahead: Vec<Record> = records.iter().map(|r| r.ahead(bias)).collect();
        let Some(solution) = regression.factor(&ahead).solve() else {
            let note =
                "the input is almost constant in the rows used, or too many outputs are missing";
            return Err(NoDelay::new(Outcome::NotRichEnough, note));
        };
        // Columns that repeat past outputs are allowed; columns that repeat each other are the input's fault.
        if solution.rank < regression.columns() {
            impulse_response(&ahead, lags)?;
        }
        pair.visible()?;
        let b = solution.coefficients.rows(self.na, lags).into_owned();
        let covariance =
            solution.inverse.view((self.na, self.na), (lags, lags)) * solution.variance;
        let Some(found) = all_pass(b.as_slice(), [&covariance; 2], max_delay.max(1) as f64) else {
            let note = "the numerator has no distinguishable zeros";
            return Err(NoDelay::new(Outcome::Singular, note));
        };
        found.behind(bias).answer(pair)
    }
}
