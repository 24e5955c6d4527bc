//! Runs from the best initial state with the best constants, as a user of the model simulates them.

use nalgebra::{DMatrix, DVector};

use super::active_effects::ActiveEffects;
use super::gaussian::Likelihood;
use crate::input::record::{LogRecord, Span};
use deadtime_model::simulate::Plan;
use deadtime_signal::stats;

impl Likelihood<'_> {
    /// Predicted outputs, simulated from the best initial state: a real run of the model, without the nominal model's linear response to an initial state.
    ///
    /// The best initial state minimises the squared residual in `span`, every output in units of its spread, plus the prior's cost. The constants of each log
    /// are estimated and simulated in the same way. A simulator that can only be called gets fewer iterations.
    pub(crate) fn predict_from_best_start<'e>(
        &self,
        record: usize,
        active: impl Into<ActiveEffects<'e>>,
        span: Span,
    ) -> Option<DMatrix<f64>> {
        let active = active.into();
        let free: Vec<usize> = (0..self.prior.len()).filter(|&j| self.prior[j] > 0.0).collect();
        if (free.is_empty() && self.declared.is_empty()) || self.system.is_black_box() {
            return self.predict_from_posterior(record, active, span);
        }
        Start {
            likelihood: self,
            record,
            active,
            rows: spread_rows(&self.records[record], span),
            free,
        }
        .best()
    }
}

/// The samples of a span that an output has, each with the output's spread there; constant outputs are left out.
fn spread_rows(record: &LogRecord, span: Span) -> Vec<(usize, usize, f64)> {
    let mut rows = Vec::new();
    for output in 0..record.measured.len() {
        let inside: Vec<(usize, f64)> = (0..record.time_s.len())
            .filter_map(|k| Some((k, record.measured_in(Some(span), output, k)?)))
            .collect();
        let values: Vec<f64> = inside.iter().map(|(_, y)| *y).collect();
        let spread = stats::deviation(&values).unwrap_or(0.0);
        rows.extend(inside.into_iter().filter(|_| spread > 0.0).map(|(k, _)| (k, output, spread)));
    }
    rows
}

/// A search for the start and the constants of one record; deviations are those of the free states, then those of the constants.
struct Start<'l, 'a> {
    likelihood: &'l Likelihood<'a>,
    record: usize,
    active: ActiveEffects<'l>,
    rows: Vec<(usize, usize, f64)>,
    free: Vec<usize>,
}

/// Steps of that search, and the part of the error from which another one is worth it.
const START_STEPS: usize = 8;
const START_GAIN: f64 = 1e-6;
/// The perturbation of a constant for its slope, in standard deviations of its prior.
const PUSH: f64 = 0.1;

impl Start<'_, '_> {
    /// The plan and the start of a run.
    fn at(&self, deviation: &DVector<f64>) -> Option<(Plan, Vec<f64>)> {
        let (states, constants) = deviation.as_slice().split_at(self.free.len());
        let mut start = self.likelihood.system.initial.clone();
        self.free.iter().zip(states).for_each(|(j, by)| start[*j] += by);
        let effects = self.likelihood.with_constants(self.active.effects, constants);
        Some((self.likelihood.plan_on(self.record, self.active.with(&effects), usize::MAX)?, start))
    }

    /// Prior standard deviations.
    fn prior(&self) -> impl Iterator<Item = f64> {
        self.free
            .iter()
            .map(|&j| self.likelihood.prior[j])
            .chain(self.likelihood.declared.iter().map(|n| n.std))
    }

    /// The outputs from an initial state, and the residual of each row over its output's spread.
    fn run(&self, deviation: &DVector<f64>) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let (likelihood, log) = (self.likelihood, &self.likelihood.records[self.record]);
        let (plan, start) = self.at(deviation)?;
        let run = likelihood
            .system
            .simulate(&plan, log.commands(), &start, likelihood.correction(self.record))
            .ok()?;
        let left = self.rows.iter().map(|&(k, i, spread)| {
            log.measured[i].get(k).map_or(0.0, |y| (y - run.y[(k, i)]) / spread)
        });
        let left = DVector::from_iterator(self.rows.len(), left);
        Some((run.y, left)).filter(|(_, left)| left.iter().all(|v| v.is_finite()))
    }

    /// ∂(outputs over their spreads)/∂deviation.
    fn slopes(&self, deviation: &DVector<f64>) -> Option<DMatrix<f64>> {
        let (likelihood, log) = (self.likelihood, &self.likelihood.records[self.record]);
        let scale: Vec<f64> =
            likelihood.prior.iter().map(|s| likelihood.budget.start_push * s).collect();
        let (plan, start) = self.at(deviation)?;
        let of_states = likelihood
            .system
            .sensitivity(&plan, log.commands(), &start, &scale, likelihood.correction(self.record))
            .ok()?;
        let samples = log.time_s.len();
        let mut slopes = DMatrix::zeros(self.rows.len(), deviation.len());
        for (mut column, &state) in slopes.column_iter_mut().zip(&self.free) {
            for (to, &(k, i, spread)) in column.iter_mut().zip(&self.rows) {
                *to = of_states[(i * samples + k, state)] / spread;
            }
        }
        let pushes: Vec<f64> = self.prior().map(|std| PUSH * std).collect();
        for constant in self.free.len()..deviation.len() {
            let moved = |by: f64| {
                let mut there = deviation.clone();
                there[constant] += by * pushes[constant];
                Some(self.run(&there)?.1)
            };
            slopes.set_column(constant, &((moved(-0.5)? - moved(0.5)?) / pushes[constant]));
        }
        Some(slopes)
    }

    /// The state that the log's first samples show, and constants that do nothing.
    fn of_log(&self, count: usize) -> DVector<f64> {
        let (own, log) = (&self.likelihood.system.initial, self.likelihood.start_of(self.record));
        let states = self.free.iter().map(|&j| log[j] - own[j]);
        DVector::from_iterator(count, states.chain(std::iter::repeat(0.0)).take(count))
    }

    /// Gauss-Newton steps from there.
    fn best(&self) -> Option<DMatrix<f64>> {
        let precision = DVector::from_vec(self.prior().map(|std| std.powi(-2)).collect::<Vec<_>>());
        let count = self.rows.len().max(1) as f64;
        let mut deviation = self.of_log(precision.len());
        let begun = self.run(&deviation).or_else(|| {
            deviation.fill(0.0);
            self.run(&deviation)
        });
        let (mut y, mut left) = begun?;
        for _ in 0..START_STEPS {
            let variance = left.norm_squared() / count;
            let Some(slopes) = self
                .slopes(&deviation)
                .filter(|s| variance > 0.0 && s.iter().all(|v| v.is_finite()))
            else {
                break;
            };
            let cost = |left: &DVector<f64>, at: &DVector<f64>| {
                left.norm_squared() / variance + at.component_mul(at).dot(&precision)
            };
            let towards = slopes.tr_mul(&left) / variance - deviation.component_mul(&precision);
            let information =
                slopes.tr_mul(&slopes) / variance + DMatrix::from_diagonal(&precision);
            let Some(step) = information.cholesky().map(|c| c.solve(&towards)) else { break };
            let now = cost(&left, &deviation);
            if step.dot(&towards) < START_GAIN * now {
                break;
            }
            let better = [1.0, 0.3, 0.1].into_iter().find_map(|part| {
                let there = &deviation + part * &step;
                self.run(&there)
                    .filter(|(_, left)| cost(left, &there) < now)
                    .map(|(y, left)| (there, y, left))
            });
            let Some(better) = better else { break };
            (deviation, y, left) = better;
        }
        Some(y)
    }
}
