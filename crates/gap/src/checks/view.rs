//! The logs with the nominal model, in a form in which both sides are comparable at any stability of the model.
//!
//! Stable models: the measured outputs are compared with a free simulation. Other models have poles that do not decay within a log. With the predictor's fixed
//! gain their innovations are e = N·y − M·u, N and M stable, and N·y is compared with M·u. No fault is then hidden by the predictor's feedback of the
//! measurement. This is a left coprime factorisation (Vidyasagar 1985, "Control System Synthesis: A Factorization Approach", MIT Press).

use nalgebra::DMatrix;

use super::moments::{correlation, deviation, mean};
use crate::baseline::predictor::Predictor;
use crate::input::record::LogRecord;
use deadtime_model::effect::{Applied, Chance};
use deadtime_model::iterated_eigenvalues;
use deadtime_model::simulate::{Commands, Correction, Dynamics, Matrices, Measured, Plan, System};

/// The lags of the search: this many samples to either side,
const LAGS: usize = 35;
/// but at most this part of a log.
const LAGS_OF_LOG: usize = 10;
/// Samples of one log that enter a correlation; longer logs are thinned.
const SAMPLES: usize = 20_000;
/// The allowed difference of the innovations of a nonlinear model and of its linearisation, as a part of the compared signal.
const LINEAR: f64 = 0.3;
/// Sample times that differ by less are the same.
const SAME_TIME: f64 = 0.02;

/// One column per output.
pub(super) type Columns = Vec<Vec<f64>>;

/// Model and logs.
pub(super) struct View<'a> {
    pub(super) system: &'a System,
    /// The training logs that share a sample time.
    pub(super) records: Vec<&'a LogRecord>,
    /// The model, linear where it needs a predictor.
    simulator: System,
    plan: Option<Plan>,
    /// One per record; empty for a free simulation.
    gains: Vec<DMatrix<f64>>,
    /// This duration at the start of every log is left out of comparisons, seconds.
    pub(super) settling_s: f64,
    /// The model's time constants, seconds, shortest first.
    pub(super) time_constants_s: Vec<f64>,
    /// Why model and log cannot be compared, where they cannot.
    pub(super) why_not: &'static str,
}

/// How two signals go together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// The largest correlation at any lag.
    pub(super) along: f64,
    /// The smallest.
    pub(super) against: f64,
    /// Measured over modelled at the lag of `along`, as the ratio of standard deviations.
    pub(super) ratio: f64,
    /// The lag of `along`, samples.
    pub(super) lag: isize,
}

impl<'a> View<'a> {
    pub(super) fn new(
        system: &'a System,
        model_effects: &[Applied],
        records: &'a [LogRecord],
        predictor: Predictor,
    ) -> Self {
        let trained = || records.iter().enumerate().filter(|(_, r)| r.train.is_some());
        let ts =
            trained().max_by_key(|(_, r)| r.time_s.len()).map_or(0.0, |(_, r)| r.sample_time_s);
        let chosen: Vec<usize> = trained()
            .filter(|(_, r)| (r.sample_time_s - ts).abs() <= SAME_TIME * ts)
            .map(|(at, _)| at)
            .collect();
        let mut plan = Applied::plan(system, model_effects, Chance::Mean).ok();
        let mut simulator = system.clone();
        let mut time_constants_s = Vec::new();
        let record = chosen.first().map(|&at| &records[at]);
        let matrices = match (&system.dynamics, record) {
            (Dynamics::Linear(m) | Dynamics::Sampled(m, _), _) => Some(m.clone()),
            (Dynamics::Equations(equations, parameters), Some(record)) => {
                let u: Vec<f64> = record.inputs.iter().map(|u| mean(u.iter().copied())).collect();
                let at = equations.linearise(0.0, &system.initial, &u, parameters);
                Some(Matrices { a: at.a, b: at.b, c: at.c, d: at.d })
            }
            _ => None,
        };
        if let Some(matrices) = matrices.filter(|m| m.a.iter().all(|v| v.is_finite())) {
            let seconds = |re: f64, norm: f64| match &system.dynamics {
                Dynamics::Sampled(_, ts) => -ts.seconds() / norm.ln(),
                _ => -1.0 / re,
            };
            time_constants_s = iterated_eigenvalues(&matrices.a)
                .iter()
                .map(|p| seconds(p.re, p.norm()))
                .filter(|t| *t > 0.0)
                .collect();
            time_constants_s.retain(|t| t.is_finite());
            time_constants_s.sort_by(f64::total_cmp);
            if !predictor.gains.is_empty() {
                simulator.input_operating.fill(0.0);
                simulator.output_operating.fill(0.0);
                simulator.initial.fill(0.0);
                if matches!(system.dynamics, Dynamics::Equations(..)) {
                    simulator.dynamics = Dynamics::Linear(matrices);
                    plan.iter_mut().for_each(|p| p.dynamics = simulator.dynamics.clone());
                }
            }
        }
        let mut view = Self {
            system,
            gains: chosen.iter().filter_map(|&at| predictor.gains.get(at).cloned()).collect(),
            records: chosen.iter().map(|&at| &records[at]).collect(),
            simulator,
            plan,
            settling_s: predictor.settling_s,
            time_constants_s,
            why_not: "the model cannot be simulated on the log",
        };
        if (matches!(system.dynamics, Dynamics::Equations(..)) || !model_effects.is_empty())
            && view.predicts()
            && !view.is_linear_enough(model_effects)
        {
            view.why_not = "the model does not decay within a log, and what it does there is far from what its linearisation does";
            view.plan = None;
        }
        view
    }

    /// The innovations of the model itself are near those of its linearisation.
    fn is_linear_enough(&self, model_effects: &[Applied]) -> bool {
        let Some(record) = self.records.first() else { return false };
        let Ok(plan) = Applied::plan(self.system, model_effects, Chance::Mean) else {
            return false;
        };
        let correction = self.gains.first().map(|gain| Correction {
            gain,
            measured: &record.measured,
            horizon: None,
        });
        let run = self.system.simulate(&plan, record.commands(), &self.system.initial, correction);
        let linear = self.measured(0, &record.measured).zip(self.modelled(0, &record.inputs));
        let (Ok(run), Some((measured, modelled))) = (run, linear) else { return false };
        (0..self.outputs()).all(|i| {
            let samples = self.usable(0, i);
            let innovation = |k: &usize| record.measured[i].values[*k] - run.y[(*k, i)];
            let linear: Vec<f64> = samples.iter().map(|&k| measured[i][k]).collect();
            let apart: Vec<f64> = samples
                .iter()
                .map(|k| innovation(k) - (measured[i][*k] - modelled[i][*k]))
                .collect();
            deviation(&apart) <= LINEAR * deviation(&linear)
        })
    }

    pub(super) fn outputs(&self) -> usize {
        self.system.outputs.len()
    }

    /// The outputs are predicted, not simulated freely.
    pub(super) fn predicts(&self) -> bool {
        !self.gains.is_empty()
    }

    fn run(&self, at: usize, inputs: &[Vec<f64>], measured: &[Measured]) -> Option<Columns> {
        let correction =
            self.gains.get(at).map(|gain| Correction { gain, measured, horizon: None });
        let commands = Commands { time_s: &self.records[at].time_s, inputs };
        let start = if self.simulator.restart.is_some() {
            &self.records[at].start
        } else {
            &self.simulator.initial
        };
        let run = self.simulator.simulate(self.plan.as_ref()?, commands, start, correction).ok()?;
        run.y
            .iter()
            .all(|v| v.is_finite())
            .then(|| run.y.column_iter().map(|c| c.iter().copied().collect()).collect())
    }

    /// M·u: the model's response to these commands.
    pub(super) fn modelled(&self, at: usize, inputs: &[Vec<f64>]) -> Option<Columns> {
        let still = |m: &Measured| Measured {
            values: vec![0.0; m.values.len()],
            present: m.present.clone(),
        };
        self.run(at, inputs, &self.records[at].measured.iter().map(still).collect::<Vec<_>>())
    }

    /// N·y: the measured counterpart.
    pub(super) fn measured(&self, at: usize, measured: &[Measured]) -> Option<Columns> {
        if !self.predicts() {
            return Some(measured.iter().map(|m| m.values.clone()).collect());
        }
        let still: Vec<Vec<f64>> =
            self.records[at].inputs.iter().map(|u| vec![0.0; u.len()]).collect();
        let mut predicted = self.run(at, &still, measured)?;
        for (column, m) in predicted.iter_mut().zip(measured) {
            column.iter_mut().zip(&m.values).for_each(|(p, y)| *p = y - *p);
        }
        Some(predicted)
    }

    /// The samples of an output that can be compared: measured, trained on, after the model has settled.
    pub(super) fn usable(&self, at: usize, output: usize) -> Vec<usize> {
        let record = self.records[at];
        let from_s = record.train.map_or(0.0, |s| s.from_s).max(self.settling_s);
        (0..record.time_s.len())
            .filter(|&k| {
                record.time_s[k] >= from_s && record.measured_in(record.train, output, k).is_some()
            })
            .collect()
    }

    /// The largest lag of the search, to either side.
    pub(super) fn lags(&self) -> usize {
        let shortest = self.records.iter().map(|r| r.time_s.len()).min().unwrap_or(0);
        LAGS.min(shortest / LAGS_OF_LOG)
    }

    pub(super) fn sample_time_s(&self) -> f64 {
        self.records.first().map_or(0.0, |r| r.sample_time_s)
    }

    /// The time stamps are so even that a lag in samples is one in seconds.
    pub(super) fn is_even(&self) -> bool {
        let off = |r: &LogRecord| {
            let samples =
                r.time_s.iter().enumerate().map(|(k, t)| (t / r.sample_time_s - k as f64).abs());
            samples.fold(0.0, f64::max)
        };
        self.records.iter().all(|r| off(r) < 0.5)
    }

    /// The regression of an output on a modelled signal, over all records; `None` where one of them is constant.
    pub(super) fn fit(
        &self,
        output: usize,
        measured: &[Columns],
        modelled: &[Columns],
    ) -> Option<Fit> {
        let range = isize::try_from(self.lags()).ok()?;
        let usable: Vec<Vec<usize>> =
            (0..self.records.len()).map(|at| thinned(&self.usable(at, output))).collect();
        let mut best: Option<Fit> = None;
        for lag in -range..=range {
            let parts = usable.iter().zip(measured.iter().zip(modelled));
            let parts: Vec<_> = parts
                .map(|(k, (y, m))| (k.as_slice(), y[output].as_slice(), m[output].as_slice()))
                .collect();
            let (correlation, ratio) = correlation(&parts, lag)?;
            let fit = best.get_or_insert(Fit { along: -1.0, against: 1.0, ratio: 1.0, lag: 0 });
            fit.against = fit.against.min(correlation);
            if correlation > fit.along {
                (fit.along, fit.ratio, fit.lag) = (correlation, ratio, lag);
            }
        }
        best
    }
}

fn thinned(samples: &[usize]) -> Vec<usize> {
    samples.iter().copied().step_by(samples.len() / SAMPLES + 1).collect()
}
