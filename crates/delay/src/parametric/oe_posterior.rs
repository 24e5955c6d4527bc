//! The posterior of the delay from output-error models, averaged over their poles.
//!
//! Equation: p(nk) ∝ ∫ V(nk, F)^(−N/2)·p(F) dF, τ̂ = Ts·Σ nk·p(nk). V are the losses of [`super::oestruc::Oestruc`] with poles F, averaged over F by their
//! probability; N is the number of independent residuals.

use super::oestruc::Oestruc;
use super::profile::{OeScan, Profile, Weighing, check};
use crate::error::DelayError;
use crate::estimate::DelayEstimate;
use crate::estimator::{NoDelay, PairMethod, PairRecords};
use crate::method::{
    Basis, Condition, Information, Law, Method, Start, method_line, plant_example,
};
use crate::posterior::RESOLUTION;
use deadtime_identify::{Initial, OutputError};

/// The statistic of the posterior that gives the estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Center {
    /// The mean: the smallest mean square error.
    #[default]
    Mean,
    /// The median, a whole number of samples: the smallest mean error.
    Median,
    /// The most probable delay: the highest probability of an exact estimate.
    Mode,
}

/// Inputs: u, y on one even grid. Output: seconds, positive = y lags u; the raw value is the most probable delay.
///
/// Assumes: as [`super::oestruc::Oestruc`], and a dead time with a uniform prior over the search window. The prior dominates where the data carry little
/// information. Coloured noise reduces the number of independent residuals.
/// Resolution and cost: fractions of a sample where two delays are about equally probable, else one sample; otherwise as [`super::oestruc::Oestruc`].
/// Fails when: the window is far wider than the prior knowledge of the delay. Distant delays of small probability then pull the mean towards the middle of the
/// window. A note reports a shift of the mean by more than half a sample; nearly uniform probabilities give `flat`. Otherwise as [`super::oestruc::Oestruc`].
/// Source: the posterior with the likelihood of Gaussian noise of unknown variance and a flat prior on the delay. Björklund (2003), LiU-TEK-LIC-2003:60,
/// section 6.4, for the models and losses. No source averages in this way. Prior: one or two poles, real and complex pairs equally probable. Time constants
/// from 0.15 samples to 25 % of the record and natural frequencies are log-uniform; 5 % is left for any other poles. For other orders the best poles represent
/// all.
#[doc = plant_example!(OePosterior, 300, 0.8, 1e-9)]
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OePosterior {
    /// Numerator coefficients; default 1, as [`Oestruc`].
    pub nb: usize,
    /// Poles; default 2, as [`Oestruc`].
    pub nf: usize,
    /// The initial state of a record; default at rest.
    pub initial: Initial,
    /// Mean, median or mode; default the mean.
    pub center: Center,
    /// Longest part of a record that is used, samples; default 100 000, as [`Oestruc`].
    pub max_samples: usize,
}

impl Default for OePosterior {
    fn default() -> Self {
        let Oestruc { nb, nf, initial, max_samples, .. } = Oestruc::default();
        Self { nb, nf, initial, center: Center::Mean, max_samples }
    }
}

const NAME: &str = "oe_posterior";

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    start: Start::Rest,
    information: Information::Poles(2),
    basis: Basis::OutputError,
    // A set of 95 % may leave out a neighbour of probability 5 %, which moves the mean by 0.05 samples.
    tolerance: 0.05,
    withstands: &[Condition::ColouredNoise, Condition::Dynamics, Condition::MissingOutputs],
    needs: "as `oestruc`, and a search window no wider than the prior of the delay",
    blind_to: "as `oestruc`; it leans towards the middle of the window where the data say little",
    exempt: &[(
        Law::Exact,
        "of a plant that the model is too small for, far delays keep a few per cent of the probability, and move the mean",
    )],
    ..method_line!(
        "oe_posterior",
        "mean over all delays of output-error models, each by its probability: smaller errors than the best one alone",
        OePosterior,
        Parametric
    )
};

impl PairMethod for OePosterior {
    fn check(&self) -> Result<(), DelayError> {
        check(NAME, &self.orders(), self.max_samples)
    }

    fn pair(&self, pair: &PairRecords) -> Result<DelayEstimate, NoDelay> {
        let scan = OeScan { name: NAME, orders: self.orders(), max_samples: self.max_samples };
        let Profile { posterior, note, .. } = scan.profile(pair, Weighing::Average)?;
        let weights = &posterior.weights;
        let answer = match self.center {
            Center::Mean => mean(weights, |_| true),
            Center::Median => median(weights),
            Center::Mode => posterior.best as f64,
        };
        let variance: f64 =
            weights.iter().enumerate().map(|(nk, w)| w * (nk as f64 - answer).powi(2)).sum();
        let [from, to] = posterior.ends;
        let [early, late] = posterior.first_coefficient(pair.bias);
        let leans = leans(weights, posterior.ends, pair.max_delay);
        // A set of one delay has no spread.
        let spread = (to > from).then(|| {
            format!(
                "samples from the shortest delay searched: mean {:.2}, median {:.0}, 95 % set {from:.0} to {to:.0}",
                mean(weights, |_| true),
                median(weights)
            )
        });
        let at_edge = posterior.best == pair.max_delay;
        let std = (variance + RESOLUTION).sqrt();
        let interval = [early.min(answer), late.max(answer)];
        Ok(pair
            .counted_at(answer, std, interval, at_edge)
            .with_raw_s(pair.seconds(posterior.best as f64))
            .noting(note)
            .noting(spread)
            .noting(leans))
    }
}

impl OePosterior {
    fn orders(&self) -> OutputError {
        OutputError { nb: self.nb, nf: self.nf, initial: self.initial }
    }
}

/// The note where nearly excluded delays move the mean.
fn leans(weights: &[f64], [from, to]: [f64; 2], max_delay: usize) -> Option<String> {
    let pulled = mean(weights, |_| true) - mean(weights, |nk| (from..=to).contains(&(nk as f64)));
    (pulled.abs() > 0.5).then(|| {
        format!("delays outside the 95 % set move the mean by {pulled:+.1} samples: it leans on the search window (0 to {max_delay})")
    })
}

/// The mean over the delays that `counts` accepts.
fn mean(weights: &[f64], counts: impl Fn(usize) -> bool) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for (nk, w) in weights.iter().enumerate().filter(|(nk, _)| counts(*nk)) {
        let nk = nk as f64;
        sum += w * nk;
        total += w;
    }
    if total > 0.0 { sum / total } else { 0.0 }
}

/// The first delay up to which half of the probability lies.
fn median(weights: &[f64]) -> f64 {
    let mut mass = 0.0;
    let at = weights.iter().position(|w| {
        mass += w;
        mass >= 0.5
    });

    at.unwrap_or(weights.len().saturating_sub(1)) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    #[test]
    fn mean_and_median_of_a_few_weights() {
        let weights = [0.1, 0.0, 0.5, 0.4];
        assert_abs_diff_eq!(mean(&weights, |_| true), 2.2, epsilon = 1e-15);
        assert_abs_diff_eq!(mean(&weights, |nk| nk > 0), 2.2 / 0.9, epsilon = 1e-15);
        assert_eq!(median(&weights), 2.0);
        assert_eq!(median(&[1.0]), 0.0);
    }

    #[test]
    fn a_mean_that_far_delays_move_says_so() {
        let mut weights = vec![0.0; 101];
        (weights[2], weights[99]) = (0.96, 0.04);
        assert!(leans(&weights, [2.0, 2.0], 100).unwrap().contains("+3.9 samples"));
        assert_eq!(leans(&weights[..60], [2.0, 2.0], 59), None);
    }
}
