//! The delay of every input from measured states and known dynamics.
//!
//! Equation: z(k) = x(k+1) − A x(k) = Σⱼ Σᵢ γᵢⱼ Bⱼ uⱼ(k − tᵢ), γ by least squares. One γ per input is 1, at its delay.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::estimator::{DelayEstimator, Search};
use crate::experiment::{Experiment, PlantModel, Recording};
use crate::method::{Condition, Information, Law, Method, ReferenceExperiment, Scope, method_line};
use crate::posterior;
use crate::threshold::response::Prewindow;
use deadtime_identify::lag_matrix;
use deadtime_model::c2d::{Hold, transition};
use deadtime_model::exp;
use deadtime_signal::decompositions::{singular_values, symmetric_eigen};
use deadtime_signal::stats::interval95;
use deadtime_signal::time::SampleTime;

/// The estimate of the delay from the coefficients γ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Selection {
    /// The lag of the largest coefficient, refined below one sample.
    #[default]
    Largest,
    /// Σ γᵢtᵢ, the published formula, which accumulates the noise of every coefficient.
    ProductSum,
    /// max γᵢtᵢ, the thesis' algorithm 3.9: it returns rounding noise for the delay 0, and the wrong lag under noise. For comparison only. The raw delay is
    /// this value; the raw delay of the other selections is the published formula.
    LargestProduct,
}

/// Inputs: every input and every state of the model on one even grid, A and B. Output: seconds per input, positive = the state lags the input.
///
/// Assumes: A and B are those of the plant; the states are measured with little noise; the lags of the inputs are linearly independent. Unstable plants,
/// feedback, and inputs with different delays are allowed: all delays are estimated together.
/// Resolution and cost: below one sample (exactly for a continuous model behind a zero-order hold, by interpolation of B for a sampled one); O(N·inputs²·delays).
/// Fails when: inputs are correlated or excite too little (`singular`). For nearly dependent inputs the note gives the angle between their lags; a peak that is
/// not separated from the next is `flat`. With a wrong model, one delay per input explains much less than all lags together (`not_applicable`).
/// Source: Waschburger and Galvão (2013), "Time delay estimation in discrete-time state-space models", Signal Processing 93, 904-912.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StateLeastSquares {
    /// The estimate of the delay from the coefficients; default the largest one.
    pub selection: Selection,
    /// The assumption on the inputs before a record; default auto. The states need no assumption.
    pub prewindow: Prewindow,
}

const NAME: &str = "state_least_squares";

/// Below this share of the explanation by all lags, one delay per input does not describe the data.
const DESCRIBES: f64 = 0.5;

/// Standard deviations by which the best lag must exceed the next one outside its neighbours.
const SEPARATE: f64 = 3.0;
/// Angle, degrees, below which inputs count as correlated: their standard deviations are then more than ten times those of orthogonal inputs.
const TOGETHER: f64 = 5.7;

/// Its line in the list of methods.
pub(crate) const METHOD: Method = Method {
    scope: Scope::States,
    reference: ReferenceExperiment::States,
    information: Information::KnownModel,
    tolerance: 0.05,
    withstands: &[
        Condition::UnstablePlant,
        Condition::Feedback,
        Condition::Dynamics,
        Condition::InverseResponse,
        Condition::Integrating,
    ],
    needs: "the model, and a measured channel for each of its states",
    blind_to: "delays of inputs that move together; a model that does not describe the data",
    exempt: &[
        (
            Law::Shift,
            "it compares states with a model: an output that is delayed alone is not what the model says",
        ),
        (Law::Gain, "the model's B fixes the gain"),
        (Law::Sign, "the model's B fixes the sign"),
    ],
    ..method_line!(
        "state_least_squares",
        "delay of every input from measured states and known A and B",
        StateLeastSquares,
        States
    )
};

impl DelayEstimator for StateLeastSquares {
    /// The delay of the first input; all are estimated together.
    fn estimate(
        &self,
        experiment: &Experiment<'_>,
        search: &Search,
    ) -> Result<DelayEstimate, DelayError> {
        let first = self.estimate_inputs(experiment, search)?.into_iter().next();
        first.ok_or(DelayError::Count { what: "inputs", needed: 1, got: 0 })
    }

    fn estimate_inputs(
        &self,
        experiment: &Experiment<'_>,
        search: &Search,
    ) -> Result<Vec<DelayEstimate>, DelayError> {
        let mut estimates = self.window(experiment, search.max_delay)?;
        if estimates.iter().any(|e| e.outcome == Outcome::AtEdge)
            && let Ok(wider) = self.window(experiment, 2 * search.max_delay)
        {
            estimates = wider;
        }
        Ok(estimates)
    }
}

/// A recording in the form of this method.
struct Rows<'a> {
    /// z(k) = x(k+1) − A x(k), states × samples.
    z: DMatrix<f64>,
    u: Vec<&'a [f64]>,
}

/// The sampled plant. A fraction f of a sample splits an input's effect between u(k − d) and u(k − d − 1).
struct Plant {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    /// A and B in continuous time, and the sample time, where known.
    continuous: Option<(DMatrix<f64>, DMatrix<f64>, f64)>,
}

impl Plant {
    fn new(experiment: &Experiment) -> Result<Self, DelayError> {
        let ts = experiment.sample_time().seconds();
        let plant = match experiment.model() {
            None => return Err(DelayError::NoStates { method: NAME }),
            Some(PlantModel::Sampled(sys)) => {
                Self { a: sys.a().clone(), b: sys.b().clone(), continuous: None }
            }
            Some(PlantModel::Continuous(sys)) => {
                let (a, b, _) = transition(sys.a(), sys.b(), ts, Hold::Zero);
                Self { a, b, continuous: Some((sys.a().clone(), sys.b().clone(), ts)) }
            }
        };
        let (n, m) = plant.b.shape();
        if experiment.recordings().iter().any(|r| r.states.len() != n || n == 0) {
            return Err(DelayError::NoStates { method: NAME });
        }
        if m != experiment.inputs().len() {
            return Err(DelayError::Count {
                what: "inputs (the method needs all of the model's)",
                needed: m,
                got: experiment.inputs().len(),
            });
        }
        Ok(plant)
    }

    /// Γ₀, Γ₁ and dΓ₁/df = −dΓ₀/df of one input.
    fn split(&self, input: usize, f: f64) -> [DVector<f64>; 3] {
        let whole = self.b.column(input).into_owned();
        match &self.continuous {
            None => [&whole * (1.0 - f), &whole * f, whole],
            Some((a, b, ts)) => {
                let column = b.columns(input, 1).into_owned();
                let early =
                    transition(a, &column, ts * (1.0 - f), Hold::Zero).1.column(0).into_owned();
                let slope = (exp(&(a * (ts * (1.0 - f)))) * column * *ts).column(0).into_owned();
                [early.clone(), whole - early, slope]
            }
        }
    }
}

/// The coefficients γ of every lag of every input.
#[derive(Debug, Clone, PartialEq)]
pub struct Coefficients {
    /// γ, inputs × (`max_delay` + 1).
    pub gamma: DMatrix<f64>,
    /// Covariance of γ in row-major order, for white equation errors.
    pub covariance: DMatrix<f64>,
    /// For every input the smallest canonical angle, degrees, between the effects of its own lags and of all others' lags on the states. 90: orthogonal; 0: a
    /// combination of the others' lags is an alias. White inputs of N samples have a cosine of about √(lags·inputs/N) by chance.
    pub angle_deg: Vec<f64>,
    /// Σ of squared residuals over all states and samples.
    pub residual: f64,
    /// Equations: states times samples.
    pub rows: usize,
}

/// The normal equations of γ, and Σ z².
struct Equations {
    gram: DMatrix<f64>,
    right: DVector<f64>,
    power: f64,
}

/// By lag products, over the samples from `first` on.
fn equations(plant: &Plant, recordings: &[Rows<'_>], first: usize, lags: usize) -> Equations {
    let m = plant.b.ncols();
    let parameters = m * lags;
    let (mut gram, mut right, mut power) =
        (DMatrix::zeros(parameters, parameters), DVector::zeros(parameters), 0.0);
    for r in recordings {
        power += r.z.columns(first, r.z.ncols() - first).norm_squared();
        for j in 0..m {
            let bz: Vec<f64> = r.z.column_iter().map(|z| z.dot(&plant.b.column(j))).collect();
            let products = lag_matrix(&bz, Some(r.u[j]), first, (1, lags));
            for i in 0..lags {
                right[j * lags + i] += products[(0, i)];
            }
            for l in j..m {
                let weight = plant.b.column(j).dot(&plant.b.column(l));
                let block = lag_matrix(
                    r.u[j],
                    if l == j { None } else { Some(r.u[l]) },
                    first,
                    (lags, lags),
                ) * weight;
                let mut at = gram.view_mut((j * lags, l * lags), (lags, lags));
                at += &block;
                if l != j {
                    let mut at = gram.view_mut((l * lags, j * lags), (lags, lags));
                    at += block.transpose();
                }
            }
        }
    }
    Equations { gram, right, power }
}

impl StateLeastSquares {
    /// The least-squares solution without refinement for the lags 0 … `max_delay` of every input together, over the samples that need no input before the
    /// record.
    ///
    /// # Errors
    /// As the estimation; [`DelayError::Dependent`] where the lags of the inputs are linearly dependent.
    pub fn coefficients(
        &self,
        experiment: &Experiment,
        max_delay: usize,
    ) -> Result<Coefficients, DelayError> {
        let plant = Plant::new(experiment)?;
        let (n, m) = plant.b.shape();
        let lags = max_delay + 1;
        let recordings = usable(experiment, &plant, max_delay);
        let samples = samples(&recordings, max_delay);
        enough(experiment, &plant, samples, max_delay, lags)?;
        let Equations { gram, right, power: _ } = equations(&plant, &recordings, max_delay, lags);
        let (gamma, inverse) =
            solve(&gram, &right).ok_or(DelayError::Dependent { method: NAME })?;
        let mut residual = 0.0;
        for r in &recordings {
            for k in max_delay..r.z.ncols() {
                let mut rest = r.z.column(k).into_owned();
                for j in 0..m {
                    let share: f64 = (0..lags).map(|l| gamma[j * lags + l] * r.u[j][k - l]).sum();
                    rest.axpy(-share, &plant.b.column(j), 1.0);
                }
                residual += rest.norm_squared();
            }
        }
        let freedom = real((n * samples).saturating_sub(m * lags).max(1));
        Ok(Coefficients {
            gamma: DMatrix::from_row_slice(m, lags, gamma.as_slice()),
            covariance: inverse * (residual / freedom),
            angle_deg: angles(&gram, m),
            residual,
            rows: n * samples,
        })
    }

    fn window(
        &self,
        experiment: &Experiment,
        max_delay: usize,
    ) -> Result<Vec<DelayEstimate>, DelayError> {
        if self.prewindow != Prewindow::Rest {
            let answers = self.within(experiment, max_delay)?;
            let singular = answers.iter().any(|a| a.outcome == Outcome::Singular);
            if self.prewindow == Prewindow::None || !singular || !experiment.begins_at_rest() {
                return Ok(answers);
            }
        }
        self.within(&behind_rest(experiment, max_delay + 1), max_delay)
    }

    /// The same over the samples that need no input before the record.
    fn within(
        &self,
        experiment: &Experiment,
        max_delay: usize,
    ) -> Result<Vec<DelayEstimate>, DelayError> {
        let plant = Plant::new(experiment)?;
        let (n, m) = plant.b.shape();
        let lags = max_delay + 1;
        let parameters = m * lags;
        // One row is kept ahead of the window for the sub-sample split.
        let first = max_delay + 1;
        let recordings = usable(experiment, &plant, first);
        let samples = samples(&recordings, first);
        enough(experiment, &plant, samples, first, lags)?;
        let Equations { gram, right, power } = equations(&plant, &recordings, first, lags);
        let angles = angles(&gram, m);
        let Some((gamma, inverse)) = solve(&gram, &right) else {
            return Ok(angles.iter().map(|a| dependent(*a)).collect());
        };
        let explained_by_all = (gamma.dot(&right) / power.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let freedom = (samples * n).saturating_sub(parameters).max(1) as f64;
        let noise = power * (1.0 - explained_by_all) / freedom;
        // Start of the refinement: the largest coefficient and its larger neighbour share one delay.
        let start: Vec<f64> = gamma
            .as_slice()
            .chunks_exact(lags)
            .map(|coefficients| interpolated(coefficients, largest(coefficients)))
            .collect();
        let refined = refine(&plant, &recordings, first, &start, max_delay);
        let explained = (1.0 - refined.residual / power.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let gain = freedom * -(1.0 - explained_by_all).max(1e-300).ln();
        let visible = gain >= posterior::visible_gain(parameters, 1);
        let found = OfAllInputs {
            lags,
            gamma,
            inverse,
            noise,
            angles,
            refined,
            explained,
            explained_by_all,
            visible,
        };
        Ok((0..m)
            .map(|j| {
                found
                    .refusal(j)
                    .unwrap_or_else(|| found.estimate(j, self.selection, experiment.sample_time()))
            })
            .collect())
    }
}

/// The outcome for an input whose lags depend linearly on the others'.
fn dependent(angle: f64) -> DelayEstimate {
    let together = if angle < TOGETHER {
        format!(": this input moves with the others (angle {angle:.2}°)")
    } else {
        String::new()
    };
    let note = format!(
        "the lags of the inputs are combinations of each other: they do not move enough, or move together{together}"
    );
    DelayEstimate::without(Outcome::Singular, note)
}

/// The lag of the largest coefficient.
fn largest(coefficients: &[f64]) -> usize {
    (0..coefficients.len())
        .max_by(|&a, &b| coefficients[a].total_cmp(&coefficients[b]))
        .unwrap_or(0)
}

/// The joint solution for all inputs.
struct OfAllInputs {
    lags: usize,
    /// Coefficients in the order of inputs, then lags, and the inverse of their Gram matrix.
    gamma: DVector<f64>,
    inverse: DMatrix<f64>,
    /// Variance of the equations' noise.
    noise: f64,
    /// Smallest angle between each input's lags and the others', degrees.
    angles: Vec<f64>,
    refined: Refined,
    /// The share of the state's motion explained by one delay per input, over that by all lags together.
    explained: f64,
    explained_by_all: f64,
    /// All lags together are significant.
    visible: bool,
}

impl OfAllInputs {
    fn coefficients(&self, j: usize) -> &[f64] {
        &self.gamma.as_slice()[j * self.lags..(j + 1) * self.lags]
    }

    /// The best lag outside the peak and its neighbours, which share a fractional delay. Also its distance below the peak, in standard deviations.
    fn runner_up(&self, j: usize) -> Option<(usize, f64)> {
        let (coefficients, first) = (self.coefficients(j), j * self.lags);
        let peak = largest(coefficients);
        let other = (0..self.lags)
            .filter(|i| i.abs_diff(peak) > 1)
            .max_by(|&a, &b| coefficients[a].total_cmp(&coefficients[b]))?;
        let (at, i) = (first + peak, first + other);
        let variance = self.inverse[(at, at)] + self.inverse[(i, i)] - 2.0 * self.inverse[(at, i)];
        Some((
            other,
            (self.gamma[at] - self.gamma[i])
                / (self.noise * variance).max(f64::MIN_POSITIVE).sqrt(),
        ))
    }

    /// Why the delay of one input is not trusted.
    fn refusal(&self, j: usize) -> Option<DelayEstimate> {
        let peak = largest(self.coefficients(j));
        let (coefficient, at) = (self.coefficients(j)[peak], j * self.lags + peak);
        let strength =
            coefficient / (self.noise * self.inverse[(at, at)]).max(f64::MIN_POSITIVE).sqrt();
        if !self.visible || (strength < 3.0 && coefficient < 0.5) {
            let note = format!(
                "no lag of this input stands out (largest coefficient {coefficient:.3}, {strength:.1} standard deviations)"
            );
            return Some(DelayEstimate::without(Outcome::NotVisible, note));
        }
        if let Some((runner_up, gap)) = self.runner_up(j).filter(|(_, gap)| *gap < SEPARATE) {
            let note = format!(
                "lag {peak} is only {gap:.1} standard deviations above lag {runner_up} (angle to the other inputs {:.1}°)",
                self.angles[j]
            );
            return Some(DelayEstimate::without(Outcome::Flat, note));
        }
        (self.explained < DESCRIBES * self.explained_by_all).then(|| {
            let note = format!(
                "one delay per input explains {:.0} % of the state's motion, all lags together {:.0} %: A and B do not describe this plant",
                100.0 * self.explained,
                100.0 * self.explained_by_all
            );
            DelayEstimate::without(Outcome::NotApplicable, note)
        })
    }

    /// The delay of one input.
    fn estimate(&self, j: usize, selection: Selection, ts: SampleTime) -> DelayEstimate {
        let (lags, coefficients, refined) = (self.lags, self.coefficients(j), &self.refined);
        let peak = largest(coefficients);
        let products = || coefficients.iter().enumerate().map(|(i, gamma)| gamma * real(i));
        let (sum, product) =
            (products().sum::<f64>(), products().fold(f64::NEG_INFINITY, f64::max));
        let (delay, std) = match selection {
            Selection::Largest => (refined.delays[j], refined.std[j]),
            Selection::ProductSum => {
                let weights = DVector::from_fn(self.gamma.len(), |i, _| {
                    if i / lags == j { real(i % lags) } else { 0.0 }
                });
                (sum, (self.noise * weights.dot(&(&self.inverse * &weights))).max(0.0).sqrt())
            }
            Selection::LargestProduct => (product, f64::NAN),
        };
        let note = format!(
            "largest coefficient {:.3} at lag {peak} (1 if A and B are exact); one delay per input explains {:.1} % of the state's motion",
            coefficients[peak],
            100.0 * self.explained
        );
        let apart = self.runner_up(j).map(|(runner_up, gap)| {
            format!("the runner-up, lag {runner_up}, is {gap:.1} standard deviations below it")
        });
        let angle = self.angles[j];
        let together = (angle < TOGETHER).then(|| {
            format!(
                "this input moves nearly with the others (smallest angle between their lags {angle:.2}°): the noise decides between them"
            )
        });
        let finite = std.is_finite();
        let raw = if selection == Selection::LargestProduct { product } else { sum };
        let outcome = if peak + 1 == lags { Outcome::AtEdge } else { Outcome::Found };
        DelayEstimate {
            delay_s: Some(ts.to_seconds(delay)),
            std_s: finite.then(|| ts.to_seconds(std)),
            ci95_s: finite.then(|| interval95(delay, std).map(|d| ts.to_seconds(d.max(0.0)))),
            raw_delay_s: Some(ts.to_seconds(raw)),
            note: Some(note.into()),
            ..DelayEstimate::bare(outcome)
        }
        .noting(apart)
        .noting(together)
    }
}

fn real(i: usize) -> f64 {
    i as f64
}

fn rows<'a>(recording: &'a Recording<'_>, a: &DMatrix<f64>) -> Rows<'a> {
    let samples = recording.inputs[0].len();
    let x = DMatrix::from_fn(recording.states.len(), samples, |i, k| recording.states[i][k]);
    let z = x.columns(1, samples - 1) - a * x.columns(0, samples - 1);
    Rows { z, u: recording.inputs.iter().map(|u| &u[..samples - 1]).collect() }
}

/// Every recording behind `samples` of rest: inputs at their first value where the record begins at rest, else at zero. The states of those samples enter no
/// equation.
fn behind_rest<'b>(experiment: &Experiment<'_>, samples: usize) -> Experiment<'b> {
    let rests = experiment.begins_at_rest();
    let behind = |level: f64, x: &[f64]| -> Cow<'b, [f64]> {
        std::iter::repeat_n(level, samples).chain(x.iter().copied()).collect()
    };
    let recordings = (experiment.recordings().iter())
        .map(|r| Recording {
            inputs: r
                .inputs
                .iter()
                .map(|u| behind(u.first().copied().filter(|_| rests).unwrap_or(0.0), u))
                .collect(),
            outputs: Vec::new(),
            states: r.states.iter().map(|x| behind(0.0, x)).collect(),
        })
        .collect();
    experiment.with_recordings(recordings)
}

/// The recordings with samples behind the first one.
fn usable<'a>(experiment: &'a Experiment<'_>, plant: &Plant, first: usize) -> Vec<Rows<'a>> {
    experiment
        .recordings()
        .iter()
        .filter(|r| r.inputs[0].len() > first + 1)
        .map(|r| rows(r, &plant.a))
        .collect()
}

fn samples(recordings: &[Rows<'_>], first: usize) -> usize {
    recordings.iter().map(|r| r.z.ncols() - first).sum()
}

/// More equations than coefficients.
fn enough(
    experiment: &Experiment,
    plant: &Plant,
    samples: usize,
    first: usize,
    lags: usize,
) -> Result<(), DelayError> {
    let (n, m) = plant.b.shape();
    let needed_rows = (m * lags).div_ceil(n) + 1;
    if samples >= needed_rows {
        return Ok(());
    }
    Err(DelayError::TooShort {
        method: NAME,
        needed: first + 1 + needed_rows,
        got: experiment.longest(),
        remedy: crate::error::LengthRemedy::Window,
    })
}

/// Coefficients and inverse Gram matrix; `None` where it is singular.
fn solve(gram: &DMatrix<f64>, right: &DVector<f64>) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let scale = gram.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    if scale.iter().any(|&s| s == 0.0) {
        return None;
    }
    let scaled =
        DMatrix::from_fn(gram.nrows(), gram.ncols(), |i, j| gram[(i, j)] * scale[i] * scale[j]);
    let factor = scaled.cholesky()?;
    let pivots = factor.l_dirty().diagonal();
    // Beyond this the coefficients have fewer than four digits.
    if pivots.min() < 1e-6 * pivots.max() {
        return None;
    }
    let inverse = factor.inverse();
    let inverse =
        DMatrix::from_fn(gram.nrows(), gram.ncols(), |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    Some((&inverse * right, inverse))
}

/// For every input the smallest canonical angle, degrees, between its block of the Gram matrix and all others together.
///
/// Source: Björck and Golub (1973), "Numerical methods for computing angles between linear subspaces", Math. Comp. 27(123), 579-594, doi:10.2307/2005662.
fn angles(gram: &DMatrix<f64>, inputs: usize) -> Vec<f64> {
    let lags = gram.nrows() / inputs.max(1);
    let each = |j: usize| {
        let own: Vec<usize> = (j * lags..(j + 1) * lags).collect();
        let rest: Vec<usize> = (0..gram.nrows()).filter(|i| i / lags != j).collect();
        let block =
            |rows: &[usize], columns: &[usize]| gram.select_rows(rows).select_columns(columns);
        let (Some(left), Some(right)) = (basis(&block(&own, &own)), basis(&block(&rest, &rest)))
        else {
            return 90.0;
        };
        let shared = left.tr_mul(&block(&own, &rest)) * right;
        let cosine = singular_values(&shared).map_or(0.0, |s| s.max());
        cosine.clamp(0.0, 1.0).acos().to_degrees()
    };
    (0..inputs).map(each).collect()
}

/// An orthonormal basis of the columns behind a Gram matrix; `None` for an empty span.
fn basis(gram: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let eigen = symmetric_eigen(gram)?;
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    // A Gram matrix keeps half of the digits of its columns.
    let kept: Vec<usize> =
        (0..eigen.eigenvalues.len()).filter(|&i| eigen.eigenvalues[i] > 1e-10 * largest).collect();
    let scale =
        DVector::from_iterator(kept.len(), kept.iter().map(|&i| 1.0 / eigen.eigenvalues[i].sqrt()));
    (!kept.is_empty())
        .then(|| eigen.eigenvectors.select_columns(&kept) * DMatrix::from_diagonal(&scale))
}

/// The fractional delay between a coefficient and its larger neighbour.
fn interpolated(gamma: &[f64], peak: usize) -> f64 {
    let at = |i: Option<usize>| i.and_then(|i| gamma.get(i)).copied().unwrap_or(0.0).max(0.0);
    let (before, here, after) = (at(peak.checked_sub(1)), at(Some(peak)), at(Some(peak + 1)));
    let (from, low, high) =
        if after >= before { (peak, here, after) } else { (peak - 1, before, here) };
    real(from) + if low + high > 0.0 { high / (low + high) } else { 0.0 }
}

struct Refined {
    /// Samples, one per input.
    delays: Vec<f64>,
    std: Vec<f64>,
    /// Σ of squared residuals.
    residual: f64,
}

/// One continuous delay per input by Gauss-Newton on z, and its sandwich standard deviation: the noise of z is correlated over neighbouring samples.
fn refine(
    plant: &Plant,
    recordings: &[Rows<'_>],
    first: usize,
    start: &[f64],
    max_delay: usize,
) -> Refined {
    let m = start.len();
    let mut delays = start.to_vec();
    let mut best: Option<Refined> = None;
    for _ in 0..30 {
        let evaluated = evaluate(plant, recordings, first, &delays);
        let improved = best.as_ref().is_none_or(|b| evaluated.residual < b.residual);
        let Some(step) =
            evaluated.information.clone().cholesky().map(|c| c.solve(&evaluated.gradient))
        else {
            break;
        };
        if improved {
            let std = sandwich(&evaluated);
            best = Some(Refined { delays: delays.clone(), std, residual: evaluated.residual });
        }
        let from = best.as_ref().map_or(&delays, |b| &b.delays).clone();
        // After a step that increased the residual: halfway back to the best point.
        let next: Vec<f64> = if improved {
            (0..m)
                .map(|j| (delays[j] - step[j].clamp(-0.5, 0.5)).clamp(0.0, real(max_delay)))
                .collect()
        } else {
            (0..m).map(|j| 0.5 * (delays[j] + from[j])).collect()
        };
        let change = (0..m).map(|j| (next[j] - delays[j]).abs()).fold(0.0, f64::max);
        delays = next;
        if change < 1e-12 {
            break;
        }
    }
    best.unwrap_or_else(|| Refined {
        delays: start.to_vec(),
        std: vec![f64::NAN; m],
        residual: f64::INFINITY,
    })
}

struct Evaluated {
    residual: f64,
    gradient: DVector<f64>,
    information: DMatrix<f64>,
    /// Scores Jᵀr, one column per row of the regression; the records are concatenated.
    scores: DMatrix<f64>,
}

fn evaluate(plant: &Plant, recordings: &[Rows<'_>], first: usize, delays: &[f64]) -> Evaluated {
    let m = delays.len();
    let parts: Vec<(usize, [DVector<f64>; 3])> = (delays.iter().enumerate())
        .map(|(j, &d)| {
            let whole = d.floor() as usize;
            (whole, plant.split(j, d - d.floor()))
        })
        .collect();
    let total: usize = recordings.iter().map(|r| r.z.ncols() - first).sum();
    let mut evaluated = Evaluated {
        residual: 0.0,
        gradient: DVector::zeros(m),
        information: DMatrix::zeros(m, m),
        scores: DMatrix::zeros(m, total),
    };
    let slopes = DMatrix::from_fn(m, m, |i, j| parts[i].1[2].dot(&parts[j].1[2]));
    let mut column = 0;
    for r in recordings {
        for k in first..r.z.ncols() {
            let mut residual = r.z.column(k).into_owned();
            let mut moved = DVector::zeros(m);
            for (j, (whole, [now, before, _])) in parts.iter().enumerate() {
                let (u0, u1) = (r.u[j][k - whole], r.u[j][k - whole - 1]);
                residual.axpy(-u0, now, 1.0);
                residual.axpy(-u1, before, 1.0);
                // d(residual)/df = slope·(u0 − u1)
                moved[j] = u0 - u1;
            }
            evaluated.residual += residual.norm_squared();
            for j in 0..m {
                let score = moved[j] * parts[j].1[2].dot(&residual);
                evaluated.gradient[j] += score;
                evaluated.scores[(j, column)] = score;
                for l in 0..m {
                    evaluated.information[(j, l)] += moved[j] * moved[l] * slopes[(j, l)];
                }
            }
            column += 1;
        }
    }
    evaluated
}

/// Standard deviations from scores correlated between neighbouring samples (lags up to 2, Bartlett's weights).
fn sandwich(evaluated: &Evaluated) -> Vec<f64> {
    let m = evaluated.gradient.len();
    let Some(bread) = evaluated.information.clone().cholesky().map(|c| c.inverse()) else {
        return vec![f64::NAN; m];
    };
    let s = &evaluated.scores;
    let mut meat = s * s.transpose();
    for lag in 1..=2_usize {
        let columns = s.ncols().saturating_sub(lag);
        let shifted =
            s.columns(lag, columns) * s.columns(0, columns).transpose() * (1.0 - real(lag) / 3.0);
        meat += &shifted + shifted.transpose();
    }
    let covariance = &bread * meat * &bread;
    (0..m).map(|j| covariance[(j, j)].max(0.0).sqrt()).collect()
}
