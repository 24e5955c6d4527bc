//! The training logs as stacked samples: residuals of any set of effects, and the responses of the unknowns of every log.
//!
//! A held-out sample is no part of it: what fits and selects sees nothing else.

use nalgebra::{DMatrix, DVector};

use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::gaussian::Likelihood;
use deadtime_signal::parallel;

/// Samples of all training logs, one column a log: the first output's samples, then the next one's.
pub(crate) type Stacked = Vec<DVector<f64>>;

/// One training log.
pub(crate) struct TrainingLog {
    /// Its place among the records.
    record: usize,
    /// Per output, the samples that were measured inside the training span.
    samples: Vec<Vec<usize>>,
    measured: DVector<f64>,
    /// Responses to the initial state and to the declared nuisances, as columns.
    pub(super) nuisances: DMatrix<f64>,
    /// The precision of their prior.
    pub(super) precision: DMatrix<f64>,
}

impl TrainingLog {
    /// Per output its rows of a stacked column.
    pub(super) fn outputs(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        self.samples.iter().scan(0, |from, samples| {
            let range = *from..*from + samples.len();
            *from = range.end;
            Some(range)
        })
    }

    fn stacked(&self, outputs: &DMatrix<f64>) -> DVector<f64> {
        let picked = self
            .samples
            .iter()
            .enumerate()
            .flat_map(|(i, samples)| samples.iter().map(move |&k| outputs[(k, i)]));
        DVector::from_iterator(self.measured.len(), picked)
    }
}

/// The training logs of a likelihood.
pub(crate) struct Training<'l, 'a> {
    pub(super) likelihood: &'l Likelihood<'a>,
    pub(super) logs: Vec<TrainingLog>,
    /// Per output, the number of samples.
    pub(super) counts: Vec<f64>,
    /// Per output, the variance of the measurement.
    pub(super) variances: Vec<f64>,
}

impl<'l, 'a> Training<'l, 'a> {
    /// From the logs of a likelihood; its noise is not used.
    pub(crate) fn of(likelihood: &'l Likelihood<'a>) -> Self {
        let outputs = likelihood.system.outputs.len();
        let one = |at: usize| {
            let record = &likelihood.records[at];
            record.train?;
            let samples: Vec<Vec<usize>> = (0..outputs)
                .map(|i| {
                    (0..record.time_s.len())
                        .filter(|&k| record.measured_in(record.train, i, k).is_some())
                        .collect()
                })
                .collect();
            let values = samples.iter().enumerate().flat_map(|(i, samples)| {
                samples.iter().filter_map(move |&k| record.measured[i].get(k))
            });
            let measured = DVector::from_vec(values.collect());
            let mut log = TrainingLog {
                record: at,
                samples,
                nuisances: DMatrix::zeros(measured.len(), 0),
                measured,
                precision: likelihood.precision_of(at),
            };
            let columns: Vec<DVector<f64>> =
                likelihood.responses_of(at).map(|response| log.stacked(response)).collect();
            if !columns.is_empty() {
                log.nuisances = DMatrix::from_columns(&columns);
            }
            Some(log)
        };
        let logs: Vec<TrainingLog> = (0..likelihood.records.len()).filter_map(one).collect();
        let per_output = |of: &dyn Fn(&[f64]) -> f64| -> Vec<f64> {
            let ranges = |log: &TrainingLog| log.outputs().collect::<Vec<_>>();
            (0..outputs)
                .map(|i| {
                    logs.iter()
                        .map(|log| of(&log.measured.as_slice()[ranges(log)[i].clone()]))
                        .sum()
                })
                .collect()
        };
        let counts = per_output(&|values| values.len() as f64);
        let squares = per_output(&|values| {
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            values.iter().map(|v| (v - mean).powi(2)).sum()
        });
        let variances = squares.iter().zip(&counts).map(|(s, n)| s / n.max(1.0)).collect();
        Self { likelihood, logs, counts, variances }
    }

    /// Measured minus predicted from the nominal initial state; `None` where a simulation fails.
    pub(crate) fn residual<'e>(&self, active: impl Into<ActiveEffects<'e>>) -> Option<Stacked> {
        let active = active.into();
        let one = |log: &TrainingLog| {
            let inputs = &self.likelihood.records[log.record].inputs;
            let predicted = self.likelihood.predict_trained(log.record, active, inputs)?;
            let residual = &log.measured - log.stacked(&predicted);
            residual.iter().all(|v| v.is_finite()).then_some(residual)
        };
        parallel::try_map(&self.logs, one)
    }

    /// Per output, the sum of squares of a stacked column.
    pub(crate) fn squares(&self, column: &Stacked) -> Vec<f64> {
        let mut squares = vec![0.0; self.counts.len()];
        for (log, column) in self.logs.iter().zip(column) {
            for (sum, rows) in squares.iter_mut().zip(log.outputs()) {
                *sum += column.as_slice()[rows].iter().map(|v| v * v).sum::<f64>();
            }
        }
        squares
    }
}
