//! Models of a given structure: named numbers with their intervals, and models drawn from the numbers' covariance.

use nalgebra::DMatrix;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::Serialize;

use super::IdentifyError;
use super::iv::{inverse, noise_model};
use super::polynomial::{filtered, reflected};
use super::regression::dot;
use super::subspace::{Draws, InnovationsModel, OrderChoice, Recordings, Sure};
use crate::model::{Continuous, StateSpace};

/// What a model of a given structure has beside matrices.
#[derive(Debug, Clone, PartialEq)]
pub struct Parametric {
    /// The structure, as a formula.
    pub structure: String,
    /// Its numbers.
    pub parameters: Vec<Parameter>,
    /// Whole samples by which each input acts later than in the matrices.
    pub delays: Vec<usize>,
    /// The noise e/D: d₁ … of D = 1 + d₁q⁻¹ + …
    pub noise: Vec<f64>,
    /// The continuous model that the matrices are sampled from, with its dead times; absent where the structure is a sampled one.
    pub continuous: Option<StateSpace<Continuous>>,
    /// First guesses of a model of one lag, where the data allow them.
    pub guesses: Vec<Guess>,
}

/// A number of a model and how well it is known.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// `K`, `T1`, `dead_time`, `b0` …
    pub name: String,
    /// The input that it belongs to; absent where it belongs to all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input: Option<String>,
    /// Its value.
    pub value: f64,
    /// Its unit, where it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Standard deviation; absent where it cannot be had.
    pub std: Option<f64>,
    /// The interval of 95 %.
    pub ci95: Option<[f64; 2]>,
}

/// A model K/(1 + T·s)·e^(−τ·s) read from a step response.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Guess {
    /// How: `area` or `tangent`.
    pub by: &'static str,
    /// K.
    pub gain: f64,
    /// T, s.
    pub lag_s: f64,
    /// τ, s.
    pub dead_time_s: f64,
}

/// Numbers with the covariance of their estimates.
pub(crate) struct Cloud {
    mean: Vec<f64>,
    /// A root of the covariance: the covariance is this times its transpose.
    root: DMatrix<f64>,
    seed: u64,
}

/// A model of drawn numbers with its delays, samples.
pub(crate) type Build<'a> = dyn Fn(&[f64]) -> Option<(InnovationsModel, Vec<usize>)> + Sync + 'a;

/// Size of the small draws, of a whole one.
const STEP: f64 = 1e-3;

impl Cloud {
    /// `None` where the covariance is no covariance.
    pub(crate) fn of(mean: Vec<f64>, covariance: &DMatrix<f64>, seed: u64) -> Option<Self> {
        let size: Vec<f64> = covariance.diagonal().iter().map(|v| v.max(f64::MIN_POSITIVE).sqrt()).collect();
        let n = size.len();
        let alike = DMatrix::from_fn(n, n, |i, j| covariance[(i, j)] / (size[i] * size[j]) + if i == j { 1e-10 } else { 0.0 });
        let factor = alike.cholesky()?.l();
        let root = DMatrix::from_fn(n, n, |i, j| size[i] * factor[(i, j)]);
        root.iter().all(|v| v.is_finite()).then_some(Self { mean, root, seed })
    }

    /// The numbers as the noise would have made them; `size` 1 for a whole draw.
    pub(crate) fn draw(&self, number: usize, size: f64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(number as u64);
        let normal: Vec<f64> = self.mean.iter().map(|_| StandardNormal.sample(&mut rng)).collect();
        let moved = |(i, mean): (usize, &f64)| mean + size * self.root.row(i).iter().zip(&normal).map(|(r, z)| r * z).sum::<f64>();
        self.mean.iter().enumerate().map(moved).collect()
    }

    /// Models of drawn numbers, each with its own delays.
    pub(crate) fn models(&self, count: usize, build: &Build<'_>) -> Draws {
        let all = |size: f64| -> (Vec<InnovationsModel>, Vec<Vec<usize>>) {
            (0..count)
                .into_par_iter()
                .filter_map(|i| build(&self.draw(i, size)))
                .filter(|(m, _)| m.is_finite())
                .collect::<Vec<_>>()
                .into_iter()
                .unzip()
        };
        let ((whole, whole_delays), (small, small_delays)) = (all(1.0), all(STEP));
        Draws { whole, small, step: STEP, whole_delays, small_delays }
    }
}

/// The order of a model whose structure was given.
pub(crate) fn given(order: usize) -> OrderChoice {
    OrderChoice { order, sure: Sure::Given, by_schwarz: order, by_gap: order, by_akaike: order, candidates: Vec::new() }
}

/// The records of one output that are long enough, and what is said of those left out.
///
/// # Errors
/// [`IdentifyError::Outputs`] for several outputs, [`IdentifyError::TooShort`] where none is long enough.
pub(crate) fn usable(method: &'static str, recordings: &Recordings, needed: usize) -> Result<(Recordings, Option<String>), IdentifyError> {
    if recordings.outputs.len() != 1 {
        return Err(IdentifyError::Outputs { method, outputs: recordings.outputs.len() });
    }
    let stretches: Vec<_> = recordings.stretches.iter().filter(|s| s.len() >= needed).cloned().collect();
    if stretches.is_empty() {
        let got = recordings.stretches.iter().map(|s| s.len()).max().unwrap_or(0);
        return Err(IdentifyError::TooShort { method, needed, got });
    }
    let short = recordings.stretches.len() - stretches.len();
    let said = (short > 0).then(|| format!("{short} stretches between gaps, of fewer than {needed} samples, were left out"));
    Ok((Recordings { stretches, ..recordings.clone() }, said))
}

/// The covariance of numbers that were fitted by least squares under coloured noise, the noise's D and the variance of e = D·residual.
///
/// Equation: (JᵀJ)⁻¹·JᵀRJ·(JᵀJ)⁻¹ with R = σ²HHᵀ, H the filter 1/D; JᵀRJ = σ²·(HᵀJ)ᵀ(HᵀJ), Hᵀ being the filter run backwards. A column of zeros is a number that is
/// not known to move: its variance is 0.
/// Source: Ljung (1999), "System Identification", 2nd ed., section 9.4 (output-error models under coloured noise); D as in [`noise_model`].
pub(crate) fn sandwich(jacobian: &[Vec<f64>], residual: &[f64], lengths: &[usize]) -> Option<(DMatrix<f64>, Vec<f64>, f64)> {
    let mut from = 0;
    let parts: Vec<std::ops::Range<usize>> = lengths
        .iter()
        .map(|n| {
            from += n;
            from - n..from
        })
        .collect();
    let left: Vec<Vec<f64>> = parts.iter().map(|p| residual.get(p.clone()).map(<[f64]>::to_vec)).collect::<Option<_>>()?;
    let (d, variance) = noise_model(&left, NOISE)?;
    let d = reflected(&d)?;
    let moving: Vec<usize> = (0..jacobian.len()).filter(|i| jacobian[*i].iter().any(|v| *v != 0.0)).collect();
    let k = moving.len();
    let (mut gram, mut coloured) = (DMatrix::zeros(k, k), DMatrix::zeros(k, k));
    for part in parts {
        let columns: Vec<Vec<f64>> = moving.iter().map(|i| jacobian[*i].get(part.clone()).map(<[f64]>::to_vec)).collect::<Option<_>>()?;
        let backwards = |c: &Vec<f64>| filtered(&c.iter().rev().copied().collect::<Vec<f64>>(), &d);
        let through: Vec<Vec<f64>> = columns.iter().map(backwards).collect();
        for i in 0..k {
            for j in 0..k {
                gram[(i, j)] += dot(&columns[i], &columns[j]);
                coloured[(i, j)] += dot(&through[i], &through[j]);
            }
        }
    }
    let inverse = inverse(gram)?;
    let freedom = residual.len() as f64 / (residual.len() as f64 - k as f64).max(1.0);
    let each = &inverse * coloured * &inverse * (variance * freedom);
    let mut covariance = DMatrix::zeros(jacobian.len(), jacobian.len());
    for (i, row) in moving.iter().enumerate() {
        for (j, column) in moving.iter().enumerate() {
            covariance[(*row, *column)] = each[(i, j)];
        }
    }
    covariance.iter().all(|v| v.is_finite()).then_some((covariance, d, variance * freedom))
}

/// Most poles of the noise.
const NOISE: usize = 10;
