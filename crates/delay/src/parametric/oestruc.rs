//! The delay of the output-error model with the best simulation.
//!
//! Equation: τ̂ = Ts·argmin over nk of V(nk), V = Σ e²/N, y(t) = B(q)/F(q) u(t − nk) + e(t).

use super::profile::{OeScan, Profile, Weighing, check, shortened};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{NoDelay, PairMethod, PairRecords};
use crate::method::{Basis, Condition, Information, Method, Start, method_line, plant_example};
use crate::posterior;
use deadtime_identify::{Initial, OeFit, OutputError};

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u.
///
/// Assumes: a stable plant in open loop, noise uncorrelated with the input, a record that starts at rest (or `initial: estimated`).
/// Resolution and cost: one sample; about 100 filter passes over the record per delay.
/// Fails when: the plant is unstable: the predictor is kept stable, so the best one ends at the edge of stability (`not_converged`). With an impulse input and
/// an estimated initial state, many delays fit exactly (`flat`). Feedback biases the estimate.
/// Source: Björklund (2003), LiU-TEK-LIC-2003:60, section 6.4 (nb 1, nf 2, no prewhitening: the best of his comparison); MATLAB `oe`.
#[doc = plant_example!(Oestruc, 300, 0.8, 1e-12)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Oestruc {
    /// Numerator coefficients; default 1: more make the delay ambiguous (Björklund, p. 104).
    pub nb: usize,
    /// Poles; default 2.
    pub nf: usize,
    /// The initial state of a record; default at rest.
    pub initial: Initial,
    /// Longest part of a record that is used, samples; default 100 000, beyond which the loss changes little.
    pub max_samples: usize,
    /// As published: the delay of the smallest loss in the given window, without any test; default no. For comparison only.
    pub always_answers: bool,
}

impl Default for Oestruc {
    fn default() -> Self {
        Self { nb: 1, nf: 2, initial: Initial::Zero, max_samples: 100_000, always_answers: false }
    }
}

const NAME: &str = "oestruc";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    start: Start::Rest,
    information: Information::Poles(2),
    basis: Basis::OutputError,
    withstands: &[Condition::ColouredNoise, Condition::Dynamics, Condition::MissingOutputs],
    needs: "open loop, a stable plant of low order that rests at the start",
    blind_to: "fractions of a sample; what an unstable plant or feedback does",
    ..method_line!(
        "oestruc",
        "best output-error model B/F over all delays (nb 1, nf 2): the most accurate on open-loop data",
        Oestruc,
        Parametric
    )
};

impl PairMethod for Oestruc {
    fn check(&self) -> Result<(), DelayError> {
        check(NAME, &self.orders(), self.max_samples)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let scan = OeScan { name: NAME, orders: self.orders(), max_samples: self.max_samples };
        let Profile { fits, posterior, note, .. } = match scan.profile(pair, Weighing::Best) {
            Ok(profile) => profile,
            Err(NoDelay::Answer(answer)) if self.always_answers => {
                return Ok(self.anyway(answer, pair));
            }
            Err(none) => return Err(none),
        };
        // The published rule does not test whether the search for that delay's model converged.
        let best = Some(&fits)
            .filter(|_| self.always_answers)
            .and_then(|f| smallest(f))
            .unwrap_or(posterior.best);
        let interval = posterior.first_coefficient(pair.bias);
        let at_edge = best == pair.max_delay && !self.always_answers;
        Ok(pair.counted_at(best as f64, posterior.std, interval, at_edge).noting(note))
    }
}

impl Oestruc {
    fn orders(&self) -> OutputError {
        OutputError { nb: self.nb, nf: self.nf, initial: self.initial }
    }

    /// The delay of the smallest loss instead of an estimate without one; without a finite loss, the latter.
    fn anyway(&self, answer: DelayEstimate, pair: &PairRecords) -> DelayEstimate {
        let records = shortened(pair.records, self.max_samples).0;
        let fits = pair.scans.fits(&self.orders(), &records, pair.max_delay, pair.stop);
        let Some(best) = smallest(&fits) else { return answer };
        let (raw, window) = (best as f64, pair.max_delay as f64);
        // No evidence supports it: the uncertainty is that of a uniform delay over the window.
        let std = window * posterior::RESOLUTION.sqrt();
        pair.counted_at(raw, std, [0.0, window], false).noting(answer.note)
    }
}

/// The delay of the smallest loss.
fn smallest(fits: &[Option<OeFit>]) -> Option<usize> {
    let losses = fits
        .iter()
        .enumerate()
        .filter_map(|(nk, fit)| fit.as_ref().map(|f| (nk, f.loss)))
        .filter(|(_, v)| v.is_finite());
    losses.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(nk, _)| nk)
}
