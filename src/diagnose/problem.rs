//! The statistical problem that all rivals share: predictions, the initial state as a nuisance, whitened residuals.

use nalgebra::{DMatrix, DVector};

use super::data::{Record, Span};
use super::noise::Noise;
use super::prediction::Prediction;
use crate::effect::{Applied, Chance};
use crate::simulate::plan::Tolerance;
use crate::simulate::{Correction, System};

/// The initial state of one record, integrated out: a prior N(0, P) on its deviation and the same sensitivities for all rivals.
#[derive(Debug, Clone)]
struct Start {
    /// ∂y/∂x0, samples × outputs per free state.
    raw: Vec<DMatrix<f64>>,
    /// The same whitened, as columns.
    whitened: DMatrix<f64>,
    /// (P⁻¹ + WᵀW)⁻¹Wᵀ is applied with this factor.
    factor: Option<nalgebra::Cholesky<f64, nalgebra::Dyn>>,
}

/// The problem.
pub(super) struct Problem<'a> {
    pub(super) system: &'a System,
    pub(super) records: &'a [Record],
    pub(super) prediction: &'a Prediction,
    /// Effects that belong to the simulator.
    own: Vec<Applied>,
    /// Prior standard deviations of the start; 0: exactly known.
    prior: Vec<f64>,
    noise: Vec<Noise>,
    starts: Vec<Start>,
    /// Integration steps allowed, per record.
    budgets: Vec<usize>,
}

/// Far below the noise of any sensor; a rival on its way to infinity gives up early.
const TOLERANCE: Tolerance = Tolerance { relative: 1e-6, absolute: 1e-9, steps: 2000, budget: usize::MAX };
/// A rival that needs more integration steps than so many per sample and this multiple of the nominal model's is given up.
const STEPS_PER_SAMPLE: usize = 10;
const STEPS_OF_NOMINAL: usize = 4;

/// Draws from which the scatter of a random effect is taken.
const DRAWS: u64 = 16;

/// A whitened residual, one column of all samples and outputs per record.
pub(super) type Whitened = Vec<DVector<f64>>;

impl<'a> Problem<'a> {
    /// With white noise of these standard deviations and this prior.
    ///
    /// # Errors
    /// [`crate::simulate::SimulateError`] where the nominal model cannot be simulated.
    pub(super) fn new(
        system: &'a System,
        records: &'a [Record],
        prediction: &'a Prediction,
        own: Vec<Applied>,
        prior: Vec<f64>,
        noise_std: &[f64],
    ) -> crate::Result<Self> {
        let free: Vec<usize> = (0..prior.len()).filter(|&j| prior[j] > 0.0).collect();
        let plan = Applied::plan(system, &own, Chance::Mean)?;
        let mut problem = Self { system, records, prediction, own, prior, noise: Vec::new(), starts: Vec::new(), budgets: Vec::new() };
        for (at, record) in records.iter().enumerate() {
            let scale: Vec<f64> = problem.prior.iter().map(|s| if *s > 0.0 { 1e-3 * s } else { 1.0 }).collect();
            let all = system.sensitivity(&plan, record.commands(), &system.initial, &scale, problem.correction(at))?;
            let steps = system.simulate(&plan, record.commands(), &system.initial, problem.correction(at))?.steps;
            problem.budgets.push(STEPS_PER_SAMPLE * record.time_s.len() + STEPS_OF_NOMINAL * steps);
            let shape = (record.time_s.len(), system.outputs.len());
            let raw = free.iter().map(|&j| DMatrix::from_column_slice(shape.0, shape.1, all.column(j).as_slice())).collect();
            problem.starts.push(Start { raw, whitened: DMatrix::zeros(0, 0), factor: None });
        }
        problem.set_noise(vec![Noise::white(noise_std); records.len()]);
        Ok(problem)
    }

    /// Takes another noise model; one per record.
    pub(super) fn set_noise(&mut self, noise: Vec<Noise>) {
        self.noise = noise;
        let precision: Vec<f64> = self.prior.iter().filter(|s| **s > 0.0).map(|s| 1.0 / (s * s)).collect();
        for ((start, record), noise) in self.starts.iter_mut().zip(self.records).zip(&self.noise) {
            let rows = record.time_s.len() * record.measured.len();
            let mut whitened = DMatrix::zeros(rows, start.raw.len());
            for (mut column, raw) in whitened.column_iter_mut().zip(&start.raw) {
                column.copy_from_slice(noise.whiten(record, raw).as_slice());
            }
            let information = whitened.tr_mul(&whitened) + DMatrix::from_diagonal(&DVector::from_column_slice(&precision));
            (start.whitened, start.factor) = (whitened, information.cholesky());
        }
    }

    fn correction(&self, record: usize) -> Option<Correction<'_>> {
        self.prediction.gains.get(record).map(|gain| Correction { gain, measured: &self.records[record].measured })
    }

    /// Predicted outputs of one record from the nominal start, samples × outputs.
    pub(super) fn predict(&self, record: usize, effects: &[Applied]) -> Option<DMatrix<f64>> {
        self.predict_by(record, effects, Chance::Mean)
    }

    fn predict_by(&self, record: usize, effects: &[Applied], chance: Chance) -> Option<DMatrix<f64>> {
        let mut plan = Applied::plan(self.system, self.own.iter().chain(effects), chance).ok()?;
        plan.tolerance = Tolerance { budget: self.budgets.get(record).copied().unwrap_or(usize::MAX), ..TOLERANCE };
        let run = self.system.simulate(&plan, self.records[record].commands(), &self.system.initial, self.correction(record)).ok()?;
        Some(run.y)
    }

    /// measured − predicted, 0 where there is no measurement.
    pub(super) fn residual(&self, record: usize, predicted: &DMatrix<f64>) -> DMatrix<f64> {
        let measured = &self.records[record].measured;
        DMatrix::from_fn(predicted.nrows(), predicted.ncols(), |k, i| measured[i].get(k).map_or(0.0, |y| y - predicted[(k, i)]))
    }

    /// measured − residual, where there is a measurement; per record.
    pub(super) fn predictions(&self, residuals: &[DMatrix<f64>]) -> Vec<DMatrix<f64>> {
        let predicted = |(record, residual): (&Record, &DMatrix<f64>)| {
            DMatrix::from_fn(residual.nrows(), residual.ncols(), |k, i| record.measured[i].get(k).map_or(0.0, |y| y - residual[(k, i)]))
        };
        self.records.iter().zip(residuals).map(predicted).collect()
    }

    /// Whitened residuals of all training records; `None` where a simulation fails.
    pub(super) fn whitened(&self, effects: &[Applied]) -> Option<Whitened> {
        (0..self.records.len())
            .map(|at| {
                if self.records[at].train.is_none() {
                    return Some(DVector::zeros(0));
                }
                let residual = self.residual(at, &self.predict(at, effects)?);
                let e = self.noise[at].whiten(&self.records[at], &residual);
                e.iter().all(|v| v.is_finite()).then(|| DVector::from_column_slice(e.as_slice()))
            })
            .collect()
    }

    /// How much better the residuals of a random effect are explained by its scatter as well as its mean: twice a log-likelihood, 0 for effects without chance.
    ///
    /// Each whitened sample has the variance c + v, v the mean square over draws of the whitened deviation from the mean and c what noise is left beside it:
    /// Σ e² − e²/(c + v) − ln(c + v) at the best c. A lag that is mistaken for lost commands has no scatter, and pays.
    pub(super) fn scatter(&self, effects: &[Applied], residuals: &Whitened) -> f64 {
        let plan = Applied::plan(self.system, effects, Chance::Mean);
        if plan.is_ok_and(|plan| plan.inputs.iter().all(|path| path.drops.is_none())) {
            return 0.0;
        }
        let mut samples: Vec<(f64, f64)> = Vec::new();
        for (at, record) in self.records.iter().enumerate().filter(|(_, r)| r.train.is_some()) {
            let Some(mean) = self.predict(at, effects) else { return f64::NEG_INFINITY };
            let mut squares: DVector<f64> = DVector::zeros(residuals[at].len());
            for seed in 0..DRAWS {
                let Some(draw) = self.predict_by(at, effects, Chance::Seed(seed)) else { return f64::NEG_INFINITY };
                let deviation = self.noise[at].whiten(record, &(draw - &mean));
                squares += DVector::from_column_slice(deviation.as_slice()).map(|d| d * d);
            }
            #[allow(clippy::cast_precision_loss)]
            samples.extend(squares.iter().zip(residuals[at].iter()).filter(|(_, e)| **e != 0.0).map(|(s, e)| (s / DRAWS as f64, e * e)));
        }
        let likelihood = |c: f64| samples.iter().map(|(v, e)| e - e / (c + v) - (c + v).ln()).sum::<f64>();
        [1.0, 0.7, 0.5, 0.3, 0.2, 0.1, 0.05, 0.02, 0.01].into_iter().map(likelihood).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The inner product of whitened residuals with the start integrated out: aᵀ(I + W P Wᵀ)⁻¹b over the training records.
    pub(super) fn inner(&self, a: &Whitened, b: &Whitened) -> f64 {
        let mut sum = 0.0;
        for ((a, b), start) in a.iter().zip(b).zip(&self.starts) {
            if a.is_empty() {
                continue;
            }
            sum += a.dot(b);
            if let Some(factor) = start.factor.as_ref().filter(|_| start.whitened.ncols() > 0) {
                sum -= start.whitened.tr_mul(a).dot(&factor.solve(&start.whitened.tr_mul(b)));
            }
        }
        sum
    }

    /// (I + W P Wᵀ)⁻¹a, record by record: [`Self::inner`] is its scalar product with the other vector.
    pub(super) fn reduced(&self, a: &Whitened) -> Whitened {
        let reduce = |(a, start): (&DVector<f64>, &Start)| match start.factor.as_ref().filter(|_| start.whitened.ncols() > 0 && !a.is_empty()) {
            Some(factor) => a - &start.whitened * factor.solve(&start.whitened.tr_mul(a)),
            None => a.clone(),
        };
        a.iter().zip(&self.starts).map(reduce).collect()
    }

    /// Predicted outputs from the posterior mean of the start, given the samples in `span` of each record.
    pub(super) fn predict_from_posterior(&self, record: usize, effects: &[Applied], span: Span) -> Option<DMatrix<f64>> {
        let mut y = self.predict(record, effects)?;
        let residual = self.residual(record, &y);
        let mut whole = self.records[record].clone();
        whole.train = Some(span);
        let start = &self.starts[record];
        let noise = &self.noise[record];
        let columns: Vec<DVector<f64>> =
            start.raw.iter().map(|raw| DVector::from_column_slice(noise.whiten(&whole, raw).as_slice())).collect();
        if !columns.is_empty() {
            let w = DMatrix::from_columns(&columns);
            let e = DVector::from_column_slice(noise.whiten(&whole, &residual).as_slice());
            let precision: Vec<f64> = self.prior.iter().filter(|s| **s > 0.0).map(|s| 1.0 / (s * s)).collect();
            let information = w.tr_mul(&w) + DMatrix::from_diagonal(&DVector::from_vec(precision));
            let deviation = information.cholesky()?.solve(&w.tr_mul(&e));
            for (raw, by) in start.raw.iter().zip(deviation.iter()) {
                y += raw * *by;
            }
        }
        Some(y)
    }

    /// Samples with weight.
    pub(super) fn weight(&self) -> f64 {
        let here = |record: &Record| {
            let inside = (0..record.time_s.len()).flat_map(|k| (0..record.measured.len()).map(move |i| (i, k)));
            inside.filter(|&(i, k)| record.measured_in(record.train, i, k).is_some()).count()
        };
        #[allow(clippy::cast_precision_loss)]
        let weight = self.records.iter().map(here).sum::<usize>() as f64;
        weight
    }
}
