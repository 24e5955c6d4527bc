//! Models of a given structure: named parameters with their intervals, and models drawn from the parameters' covariance.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

use super::error::IdentifyError;
use super::iv::{NoiseModel, inverse, noise_model, whitened};
use super::polynomial::is_stable;
use super::regression::dot;
use crate::subspace::innovations::InnovationsModel;
use crate::subspace::order::{OrderChoice, Sure};
use crate::subspace::recordings::Recordings;
use crate::subspace::uncertainty::Draws;
use deadtime_model::{Continuous, StateSpace};
use deadtime_signal::parallel;

/// Further properties of a model of a given structure.
#[derive(Debug, Clone, PartialEq)]
pub struct Parametric {
    /// The structure, as a formula.
    pub structure: String,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// Whole samples by which each input's delay exceeds that in the matrices.
    pub delays: Vec<usize>,
    /// The noise e/D: d₁ … of D = 1 + d₁q⁻¹ + …
    pub noise: Vec<f64>,
    /// The continuous model behind the sampled matrices, with its dead times; absent for a sampled structure.
    pub continuous: Option<StateSpace<Continuous>>,
    /// Initial guesses of a model of one lag, where the data allow them.
    pub guesses: Vec<Guess>,
}

/// A parameter of a model and its uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// `K`, `T1`, `dead_time`, `b0` …
    pub name: String,
    /// Its input; absent for a parameter of all inputs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input: Option<String>,
    /// Its value.
    pub value: f64,
    /// Its unit, where known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Standard deviation; absent where it has no value.
    pub std: Option<f64>,
    /// The interval of 95 %.
    pub ci95: Option<[f64; 2]>,
}

/// A model K/(1 + T·s)·e^(−τ·s) read from a step response.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Guess {
    /// The method: `area` or `tangent`.
    pub by: &'static str,
    /// K.
    pub gain: f64,
    /// T, s.
    pub lag_s: f64,
    /// τ, s.
    pub dead_time_s: f64,
}

/// Parameters with the covariance of their estimates.
pub struct Cloud {
    mean: Vec<f64>,
    /// A root of the covariance: the covariance is this times its transpose.
    root: DMatrix<f64>,
    seed: u64,
}

/// A model of drawn parameters with its delays, samples.
pub(crate) type Build<'a> = dyn Fn(&[f64]) -> Option<(InnovationsModel, Vec<usize>)> + Sync + 'a;

/// Size of the small draws relative to a whole one.
const STEP: f64 = 1e-3;

impl Cloud {
    /// `None` where the covariance is not positive semidefinite.
    pub fn of(mean: Vec<f64>, covariance: &DMatrix<f64>, seed: u64) -> Option<Self> {
        let size: Vec<f64> =
            covariance.diagonal().iter().map(|v| v.max(f64::MIN_POSITIVE).sqrt()).collect();
        let n = size.len();
        let alike = DMatrix::from_fn(n, n, |i, j| {
            covariance[(i, j)] / (size[i] * size[j]) + if i == j { 1e-10 } else { 0.0 }
        });
        let factor = alike.cholesky()?.l();
        let root = DMatrix::from_fn(n, n, |i, j| size[i] * factor[(i, j)]);
        root.iter().all(|v| v.is_finite()).then_some(Self { mean, root, seed })
    }

    /// The parameters plus a deviation drawn from the noise; `size` 1 for a whole draw.
    pub fn draw(&self, number: usize, size: f64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(number as u64);
        let normal: Vec<f64> = self.mean.iter().map(|_| StandardNormal.sample(&mut rng)).collect();
        let moved = |(i, mean): (usize, &f64)| {
            mean + size * self.root.row(i).iter().zip(&normal).map(|(r, z)| r * z).sum::<f64>()
        };
        self.mean.iter().enumerate().map(moved).collect()
    }

    /// Models of drawn parameters, each with its own delays.
    pub fn models(&self, count: usize, build: &Build<'_>) -> Draws {
        let all = |size: f64| -> (Vec<InnovationsModel>, Vec<Vec<usize>>) {
            let built = parallel::filter_map(0..count, |i| build(&self.draw(i, size)));
            built.into_iter().filter(|(m, _)| m.is_finite()).unzip()
        };
        let ((whole, whole_delays), (small, small_delays)) = (all(1.0), all(STEP));
        Draws { whole, small, step: STEP, whole_delays, small_delays }
    }
}

/// The order of a model with a given structure.
pub fn given(order: usize) -> OrderChoice {
    OrderChoice {
        order,
        sure: Sure::Given,
        by_schwarz: order,
        by_gap: order,
        by_akaike: order,
        by_free_run: None,
        candidates: Vec::new(),
    }
}

/// The sufficiently long records of one output, and notes on those left out.
///
/// # Errors
/// [`IdentifyError::Outputs`] for several outputs, [`IdentifyError::TooShort`] where no record is long enough.
pub fn usable(
    method: &'static str,
    recordings: &Recordings,
    needed: usize,
) -> Result<(Recordings, Option<String>), IdentifyError> {
    if recordings.outputs.len() != 1 {
        return Err(IdentifyError::Outputs { method, outputs: recordings.outputs.len() });
    }
    let stretches: Vec<_> =
        recordings.stretches.iter().filter(|s| s.len() >= needed).cloned().collect();
    if stretches.is_empty() {
        let got = recordings.stretches.iter().map(|s| s.len()).max().unwrap_or(0);
        return Err(IdentifyError::TooShort { method, needed, got });
    }
    let short = recordings.stretches.len() - stretches.len();
    let said = (short > 0).then(|| {
        format!("{short} stretches between gaps, of fewer than {needed} samples, were left out")
    });
    Ok((Recordings { stretches, ..recordings.clone() }, said))
}

/// The result of a generalised least-squares step under coloured noise.
pub struct Coloured {
    /// The change of the parameters.
    pub change: Vec<f64>,
    /// The covariance of the changed parameters.
    pub covariance: DMatrix<f64>,
    /// d₁ … of the noise e/D.
    pub d: Vec<f64>,
    /// The variance of e.
    pub variance: f64,
    /// The residual, minus the change's effect and the offsets.
    pub residual: Vec<f64>,
}

/// One step from least squares to the estimate weighted by the noise's own autoregression. The covariance σ²(JᵀDᵀDJ)⁻¹ is averaged over the uncertainty of D.
/// With `levels` an offset of each record is fitted with it. A zero column is a parameter treated as fixed.
///
/// How it can be wrong: a step beyond the range of the linearisation, which the caller decides.
/// Source: Ljung (1999), "System Identification", 2nd ed., sections 9.3 and 10.2. A Gauss-Newton step from a consistent estimate is as good as the minimum.
pub fn coloured(
    jacobian: &[Vec<f64>],
    residual: &[f64],
    lengths: &[usize],
    levels: bool,
) -> Option<Coloured> {
    let mut from = 0;
    let parts: Vec<std::ops::Range<usize>> = lengths
        .iter()
        .map(|n| {
            from += n;
            from - n..from
        })
        .collect();
    let moving: Vec<usize> =
        (0..jacobian.len()).filter(|i| jacobian[*i].iter().any(|v| *v != 0.0)).collect();
    let mut columns: Vec<Vec<f64>> = moving.iter().map(|i| jacobian[*i].clone()).collect();
    columns.extend(
        parts
            .iter()
            .filter(|_| levels)
            .map(|p| (0..residual.len()).map(|t| f64::from(u8::from(p.contains(&t)))).collect()),
    );
    let system = WhitenedSystem { columns, parts, residual };
    let (change, NoiseModel { d, variance, covariance }, left) = system.step()?;
    let freedom = residual.len() as f64 / (residual.len() as f64 - change.len() as f64).max(1.0);
    let variance = variance * freedom;
    // Averages over the uncertainty of the noise: slow columns are compared with its slow part, which few samples determine.
    let cloud = Cloud::of(d.clone(), &covariance, 1)?;
    let usable = |d: &Vec<f64>| is_stable(d) && 1.0 + d.iter().sum::<f64>() > SLOWEST;
    let each: Vec<DMatrix<f64>> = parallel::filter_map(0..NOISES, |i| {
        Some(cloud.draw(i, 1.0)).filter(usable).and_then(|d| system.inverse_under(&d))
    });
    let mean = if each.is_empty() {
        system.inverse_under(&d)?
    } else {
        each.iter().sum::<DMatrix<f64>>() / each.len() as f64
    };
    let mut all = Coloured {
        change: vec![0.0; jacobian.len()],
        covariance: DMatrix::zeros(jacobian.len(), jacobian.len()),
        d,
        variance,
        residual: left,
    };
    for (i, row) in moving.iter().enumerate() {
        all.change[*row] = change[i];
        for (j, column) in moving.iter().enumerate() {
            all.covariance[(*row, *column)] = mean[(i, j)] * variance;
        }
    }
    let finite = all.change.iter().chain(all.covariance.iter()).all(|v| v.is_finite());
    finite.then_some(all)
}

/// Columns and residuals, and the position of the records in them.
struct WhitenedSystem<'a> {
    columns: Vec<Vec<f64>>,
    parts: Vec<std::ops::Range<usize>>,
    residual: &'a [f64],
}

impl WhitenedSystem<'_> {
    /// A signal through the noise's filter; the first samples of each record lack the filter's earlier inputs.
    fn white(&self, x: &[f64], d: &[f64]) -> Vec<f64> {
        let part =
            |p: &std::ops::Range<usize>| whitened(&x[p.clone()], d).into_iter().skip(d.len());
        self.parts.iter().flat_map(part).collect()
    }

    /// The columns through the noise's filter.
    fn through(&self, d: &[f64]) -> Vec<Vec<f64>> {
        self.columns.iter().map(|c| self.white(c, d)).collect()
    }

    /// (JᵀDᵀDJ)⁻¹.
    fn inverse_under(&self, d: &[f64]) -> Option<DMatrix<f64>> {
        inverse(gram(&self.through(d)))
    }

    /// The change of the parameters under the noise of their residual, that noise, and the remaining residual.
    fn step(&self) -> Option<(DVector<f64>, NoiseModel, Vec<f64>)> {
        let (columns, residual) = (&self.columns, self.residual);
        let mut left = residual.to_vec();
        let mut found = None;
        for _ in 0..ROUNDS {
            let own: Vec<Vec<f64>> = self
                .parts
                .iter()
                .map(|p| left.get(p.clone()).map(<[f64]>::to_vec))
                .collect::<Option<_>>()?;
            let noise = noise_model(&own, NOISE)?;
            let (through, target) = (self.through(&noise.d), self.white(residual, &noise.d));
            let right = DVector::from_fn(columns.len(), |i, _| dot(&through[i], &target));
            let change = inverse(gram(&through))? * right;
            let moved =
                |t: usize| columns.iter().zip(change.iter()).map(|(c, w)| w * c[t]).sum::<f64>();
            left = (0..residual.len()).map(|t| residual[t] - moved(t)).collect();
            found = Some((change, noise));
        }
        found.map(|(change, noise)| (change, noise, left))
    }
}

fn gram(columns: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(columns.len(), columns.len(), |i, j| dot(&columns[i], &columns[j]))
}

/// Autoregressions drawn from the residuals' uncertainty.
const NOISES: usize = 40;
/// Noise with a smaller 1 + Σ d is nearly integrated and has no constant mean.
const SLOWEST: f64 = 0.02;
/// Alternating rounds of noise and step.
const ROUNDS: usize = 4;
/// Largest number of noise poles.
const NOISE: usize = 10;
