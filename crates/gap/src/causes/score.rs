//! The score of a set of effects, in units of twice the negative log-likelihood; smaller is better.
//!
//! ```text
//! E(S) = Σ_o n_o ln(RSS_o / N_o + T_o)     misfit; n_o = N_o / τ_o effective samples of output o
//!      + k ln Σ_o n_o                      parameters that act (Schwarz 1978, doi:10.1214/aos/1176344136)
//!      + 2 m ln C                          choice of m effects among C candidates (Chen and Chen 2008, doi:10.1093/biomet/asn034);
//!                                         an effect that the measured values show is not chosen
//!      + Σ_j min(|Δy_j|² / G, 10⁴)         normal prior on what each effect moves alone, of the gap's own size
//!      + initial states and nuisances under their priors
//!      + Σ ((p − p₀) / (s p₀))² + ln det(I + s p₀ H s p₀)     joint recalibration of all parameters
//! ```

use deadtime_model::effect::Applied;

use super::set::CauseSet;
use super::training::{Stacked, Training};

/// Lags of the Parzen window for the residual's autocorrelation, samples.
const WINDOW: usize = 60;

/// The common terms of all scores.
#[derive(Debug, Clone)]
pub(crate) struct Score {
    /// Per output, the number of samples.
    counts: Vec<f64>,
    /// Per output, samples per independent sample.
    correlation: Vec<f64>,
    /// Per output, the squared error that is ignored.
    inexact: Vec<f64>,
    /// The number of candidates.
    candidates: usize,
    /// Keys of the effects that the measured values show without any model: they are not chosen.
    shown: Vec<String>,
}

impl Score {
    /// From the nominal model's residual; `smallest`: per output, the rounding error. The second list holds the candidates that the measured values show.
    pub(crate) fn of(
        training: &Training<'_, '_>,
        nominal: &Stacked,
        smallest: &[f64],
        [candidates, shown]: [&[Applied]; 2],
    ) -> Self {
        let (gap, part) = (training.squares(nominal), training.likelihood.criteria.inexact_gap);
        let parts = gap.iter().zip(&training.counts).zip(&training.variances).zip(smallest);
        let inexact = parts.map(|(((gap, count), variance), smallest)| {
            let gap = f64::min(gap / count.max(1.0), *variance);
            (part * part * gap).max(smallest * smallest).max(f64::MIN_POSITIVE)
        });
        Self {
            counts: training.counts.clone(),
            correlation: correlation(training, nominal),
            inexact: inexact.collect(),
            candidates: candidates.len(),
            shown: shown.iter().map(Applied::key).collect(),
        }
    }

    /// The same with the effective samples of another residual.
    pub(crate) fn under(&self, training: &Training<'_, '_>, residual: &Stacked) -> Self {
        Self { correlation: correlation(training, residual), ..self.clone() }
    }

    /// Effective samples of every output.
    fn effective(&self) -> impl Iterator<Item = f64> {
        self.counts.iter().zip(&self.correlation).map(|(n, tau)| n / tau)
    }

    /// Σ n ln(RSS/N + T).
    pub(super) fn misfit(&self, squares: &[f64]) -> f64 {
        let one = |((n, (count, inexact)), square): ((f64, (&f64, &f64)), &f64)| {
            if *count > 0.0 { n * (square / count + inexact).ln() } else { 0.0 }
        };
        self.effective().zip(self.counts.iter().zip(&self.inexact)).zip(squares).map(one).sum()
    }

    /// The derivatives of the misfit by the sums of squares.
    pub(super) fn weights(&self, squares: &[f64]) -> Vec<f64> {
        let one = |((n, (count, inexact)), square): ((f64, (&f64, &f64)), &f64)| {
            if *count > 0.0 { n / (square + count * inexact) } else { 0.0 }
        };
        self.effective().zip(self.counts.iter().zip(&self.inexact)).zip(squares).map(one).collect()
    }

    /// The price of effects with the given number of active parameters.
    pub(super) fn price(&self, parameters: usize, effects: usize) -> f64 {
        let samples: f64 = self.effective().sum();
        parameters as f64 * samples.max(2.0).ln()
            + 2.0 * effects as f64 * (self.candidates.max(1) as f64).ln()
    }

    /// The effects that were chosen among all candidates.
    pub(super) fn choices<'e>(&self, effects: impl Iterator<Item = &'e Applied>) -> usize {
        effects.filter(|a| self.shown.is_empty() || !self.shown.contains(&a.key())).count()
    }

    /// The score of a set without its price.
    pub(crate) fn explained(&self, set: &CauseSet) -> f64 {
        self.misfit(&set.squares) + set.priors
    }

    /// The score of a set.
    pub(crate) fn total(&self, set: &CauseSet) -> f64 {
        self.explained(set) + self.price(set.acting, self.choices(set.singly()))
    }
}

/// Per output, samples per independent sample: for a mean and for a variance, the larger.
fn correlation(training: &Training<'_, '_>, residual: &Stacked) -> Vec<f64> {
    let squares = training.squares(residual);
    let lagged = |output: usize, lag: usize| -> f64 {
        training
            .logs
            .iter()
            .zip(residual)
            .map(|(log, column)| {
                let rows = log.outputs().nth(output).unwrap_or_default();
                let values = &column.as_slice()[rows];
                values.iter().zip(values.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>()
            })
            .sum()
    };
    (0..squares.len())
        .map(|output| {
            if squares[output] <= 0.0 {
                return 1.0;
            }
            let (mut mean, mut variance) = (1.0, 1.0);
            for lag in 1..=WINDOW {
                let rho = lagged(output, lag) / squares[output];
                let weight = parzen(lag as f64 / WINDOW as f64);
                mean += 2.0 * weight * rho;
                variance += 2.0 * weight * rho * rho;
            }
            f64::max(mean, variance).max(1.0)
        })
        .collect()
}

/// Parzen's window (Parzen 1961, doi:10.1080/00401706.1961.10489939) at a lag over its length.
fn parzen(x: f64) -> f64 {
    if x <= 0.5 { 1.0 - 6.0 * x * x * (1.0 - x) } else { 2.0 * (1.0 - x).powi(3) }
}
