//! The delay of the all-pass part of an output-error model.
//!
//! Equation: y(t) = B(q)/F(q) u(t) + e(t). τ̂ = Σ Re (1 + xᵢ)/(1 − xᵢ) samples over the zeros |xᵢ| < 1 of Σ b̂ₖxᵏ.

use super::all_pass::all_pass;
use crate::error::{DelayError, LengthRemedy};
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{
    NoDelay, PairMethod, PairRecords, impulse_response, long_enough, noted, options,
};
use crate::method::{
    Basis, Condition, Information, Law, Method, Start, method_line, plant_example,
};
use deadtime_identify::{MAX_OE_ORDER, ManyZeros, Record};

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value includes the sample of the hold.
///
/// Assumes: a stable plant in open loop that rests at the start, and white noise. The plant has a gain at frequency 0 and no zeros outside the unit circle. No sample is
/// missing.
/// Coefficients before the plant's relative degree (`Search::bias`) are known to be zero and left out.
/// Resolution and cost: fractions of a sample, of which up to 0.5 may hide in the minimum-phase part; about ten regressions of O(N·window).
/// Fails when: the gain at frequency 0 is small compared with the noise (zeros near z = 1: excluded with a note, or `flat`). An input may not excite the
/// numerator (`not_rich_enough`). Missing outputs give `not_applicable`. Feedback biases the estimate.
/// Source: Isaksson, Horch and Dumont (2001), Proc. ACC, 3280-3285. Björklund (2003), LiU-TEK-LIC-2003:60, class 1b (`oedap`). Björklund and Ljung (2009),
/// Automatica 45(10), 2467-2470. Steiglitz and McBride (1965), doi:10.1109/TAC.1965.1098181, for the fit. The source does not give its orders. The head of
/// `all_pass` describes the guard against zeros near 1.
#[doc = plant_example!(Oedap, 400, 0.8, 0.001)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Oedap {
    /// Numerator coefficients beyond the longest delay; default 5, as `arxdap`.
    pub nb: usize,
    /// Poles; default 2, as `oestruc`.
    pub nf: usize,
    /// Longest part of a record that is used, samples; default 100 000, beyond which the fit changes little.
    pub max_samples: usize,
}

impl Default for Oedap {
    fn default() -> Self {
        Self { nb: 5, nf: 2, max_samples: 100_000 }
    }
}

const NAME: &str = "oedap";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    start: Start::Rest,
    information: Information::Poles(2),
    basis: Basis::OutputError,
    tolerance: 0.25,
    withstands: &[Condition::Dynamics],
    needs: "open loop, a stable plant of low order that rests at the start, a gain at frequency 0",
    blind_to: "zeros of the plant outside the unit circle, which it takes for delay; half a sample; feedback",
    exempt: &[(Law::Exact, "it reads a phase, which noise moves by fractions of a sample")],
    ..method_line!(
        "oedap",
        "delay of the all-pass part of an output-error model, by the zeros of its numerator",
        Oedap,
        Frequency
    )
};

impl PairMethod for Oedap {
    fn check(&self) -> Result<(), DelayError> {
        let Self { nb, nf, max_samples } = *self;
        let rows = [
            ("nb", nb as f64, nb >= 1, "1 or more"),
            ("nf", nf as f64, nf <= MAX_OE_ORDER, "at most 16"),
            ("max_samples", max_samples as f64, max_samples >= 1, "1 or more"),
        ];
        options(NAME, rows)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let &PairRecords { records, max_delay, bias, experiment, .. } = pair;
        let lags = max_delay + self.nb;
        let needed = bias + self.nf.max(lags - 1) + 2 * (self.nf + lags);
        let remedy = LengthRemedy::WindowOr("set a smaller nb or a larger max_samples");
        long_enough(NAME, needed, experiment.longest().min(self.max_samples), remedy)?;
        pair.complete("output samples are missing, and a filter cannot pass over them")?;
        let cut: Vec<Record> = records.iter().map(|r| r.head(self.max_samples)).collect();
        let ahead: Vec<Record> = cut.iter().map(|r| r.ahead(bias)).collect();
        impulse_response(&ahead, lags)?;
        pair.with(&cut).visible()?;
        let singular = |note| NoDelay::new(Outcome::Singular, note);
        let fit = ManyZeros::fit(&ahead, self.nf, lags)
            .ok_or_else(|| singular("the regression on filtered signals has no solution"))?;
        let covariances = [&fit.covariance, &fit.given_poles];
        let found = all_pass(fit.b.as_slice(), covariances, max_delay.max(1) as f64)
            .ok_or_else(|| singular("the numerator has no distinguishable zeros"))?;
        let note = (experiment.longest() > self.max_samples)
            .then(|| format!("used the first {} samples", self.max_samples));
        noted(found.behind(bias).answer(pair), note)
    }
}
