//! The model that is handed over, linearised along its own run: the outputs' response to a perturbation of a state's derivative.
//!
//! How it can be wrong: between two linearisations a fast nonlinear model changes its response. Lags, delays and limits of sensors, and the memory of an
//! actuator, are left out. Sticking friction is treated as sliding.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use nalgebra::DMatrix;

use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Chance};
use deadtime_model::simulate::plan::Term;
use deadtime_model::simulate::{Dynamics, Plan, Source, Wanted};
use deadtime_model::{Linearisation, exp};

/// Points of a log at which a nonlinear model is linearised.
const POINTS: usize = 400;
/// Sample times that differ by at most this part of their mean are equal.
const SAME_STEP: f64 = 0.02;

/// One step of the linearised model: exp(A·dt), its integral, and C.
struct Step {
    transition: DMatrix<f64>,
    integral: DMatrix<f64>,
    outputs: DMatrix<f64>,
}

/// A log's run.
pub(crate) struct Run {
    /// States, then commands as they arrive at the plant: samples × variables.
    variables: DMatrix<f64>,
    steps: Vec<Step>,
    /// Which step leads from each sample to the next.
    step_at: Vec<usize>,
    /// The observer's gain, where measured outputs correct the state.
    gain: Option<DMatrix<f64>>,
    states: usize,
    /// The slope of every sensor.
    slopes: Vec<f64>,
}

/// The runs of all logs; `None` where the model has no differential equations, has an effect on an internal quantity, or cannot be simulated.
pub(crate) fn runs(likelihood: &Likelihood<'_>, effects: &[Applied]) -> Option<Vec<Run>> {
    (0..likelihood.records.len()).map(|at| Run::of(likelihood, effects, at)).collect()
}

impl Run {
    /// The run of one log; `None` as for all.
    pub(super) fn of(likelihood: &Likelihood<'_>, effects: &[Applied], at: usize) -> Option<Self> {
        let (system, record) = (likelihood.system, &likelihood.records[at]);
        let mut plan = likelihood.plan(effects, Chance::Mean)?;
        if matches!(plan.dynamics, Dynamics::Sampled(..) | Dynamics::BlackBox(..)) {
            return None;
        }
        // The feedback through an internal quantity with an effect is no part of the equations.
        let size = (system.states.len(), system.inputs.len());
        if matches!(&plan.dynamics, Dynamics::Equations(equations, _) if equations.size() != size) {
            return None;
        }
        plan.wanted = Wanted::default();
        let correction = likelihood.correction(at);
        let gain = correction.map(|c| c.gain.clone());
        let x = system.simulate(&plan, record.commands(), &system.initial, correction).ok()?.x;
        let (samples, states) = (record.time_s.len(), system.states.len());
        let command = |j: usize, k: usize| {
            let sent = record
                .time_s
                .partition_point(|t| *t <= record.time_s[k] - plan.inputs[j].delay_s)
                .saturating_sub(1);
            record.inputs[j][sent] - system.input_operating.get(j).copied().unwrap_or(0.0)
        };
        let variables = DMatrix::from_fn(samples, states + system.inputs.len(), |k, v| {
            if v < states { x[(k, v)] } else { command(v - states, k) }
        });
        let renewed = match plan.dynamics {
            Dynamics::Equations(..) => samples.div_ceil(POINTS).max(1),
            _ => usize::MAX,
        };
        let (mut steps, mut step_at): (Vec<Step>, Vec<usize>) =
            (Vec::new(), Vec::with_capacity(samples));
        let mut known: BTreeMap<(usize, i64), usize> = BTreeMap::new();
        for k in 0..samples {
            let dt = record
                .time_s
                .get(k + 1)
                .map_or(record.sample_time_s, |next| next - record.time_s[k]);
            let at = match known
                .entry((k / renewed, (dt / (SAME_STEP * record.sample_time_s)).round() as i64))
            {
                Entry::Occupied(there) => *there.get(),
                Entry::Vacant(new) => {
                    let row: Vec<f64> = variables.row(k).iter().copied().collect();
                    steps.push(step(&plan, record.time_s[k], row.split_at(states), dt)?);
                    *new.insert(steps.len() - 1)
                }
            };
            step_at.push(at);
        }
        let slopes = plan.outputs.iter().map(|o| o.slope).collect();
        Some(Self { variables, steps, step_at, gain, states, slopes })
    }

    pub(crate) fn samples(&self) -> usize {
        self.step_at.len()
    }

    /// A state or a command at a sample.
    pub(crate) fn value(&self, variable: usize, sample: usize) -> f64 {
        self.variables[(sample, variable)]
    }

    /// The response of every output to a force on a state's derivative: kept samples × outputs.
    pub(crate) fn response(
        &self,
        state: usize,
        force: impl Fn(usize) -> f64,
        every: usize,
    ) -> DMatrix<f64> {
        let mut moved = DMatrix::zeros(self.states, 1);
        let pushed = |k: usize, step: &Step, moved: &mut DMatrix<f64>| {
            let mean = 0.5 * (force(k) + force((k + 1).min(self.samples() - 1)));
            moved.column_mut(0).axpy(mean, &step.integral.column(state), 1.0);
        };
        self.walked(0, &mut moved, every, pushed).swap_remove(0)
    }

    /// The response of every output to a displacement of one state by 1 at a sample: one matrix, samples × outputs, per state.
    pub(crate) fn starts(&self, from: usize) -> Vec<DMatrix<f64>> {
        self.walked(from, &mut DMatrix::identity(self.states, self.states), 1, |_, _, _| ())
    }

    /// Deviations of the state on their way, one column each, as outputs show them: kept samples × outputs per column.
    fn walked(
        &self,
        from: usize,
        moved: &mut DMatrix<f64>,
        every: usize,
        pushed: impl Fn(usize, &Step, &mut DMatrix<f64>),
    ) -> Vec<DMatrix<f64>> {
        let mut shown =
            vec![DMatrix::zeros(self.samples().div_ceil(every), self.slopes.len()); moved.ncols()];
        let (mut seen, mut next) =
            (DMatrix::zeros(self.slopes.len(), moved.ncols()), moved.clone());
        for k in from..self.samples() {
            let step = &self.steps[self.step_at[k]];
            step.outputs.mul_to(moved, &mut seen);
            if k % every == 0 {
                for (column, shown) in shown.iter_mut().enumerate() {
                    for (output, slope) in self.slopes.iter().enumerate() {
                        shown[(k / every, output)] = slope * seen[(output, column)];
                    }
                }
            }
            if let Some(gain) = &self.gain {
                moved.gemm(-1.0, gain, &seen, 1.0);
            }
            step.transition.mul_to(moved, &mut next);
            std::mem::swap(moved, &mut next);
            pushed(k, step, moved);
        }
        shown
    }
}

/// The step of a length from one point; `None` where a number is not finite.
fn step(plan: &Plan, time_s: f64, (x, u): (&[f64], &[f64]), dt: f64) -> Option<Step> {
    let (mut a, outputs) = match &plan.dynamics {
        Dynamics::Linear(matrices) => (matrices.a.clone(), matrices.c.clone()),
        Dynamics::Equations(equations, parameters) => {
            let Linearisation { a, c, .. } = equations.linearise(time_s, x, u, parameters);
            (a, c)
        }
        Dynamics::Sampled(..) | Dynamics::BlackBox(..) => return None,
    };
    for term in &plan.terms {
        match term {
            Term::Linear { to, from: Source::State(from), gain } => a[(*to, *from)] += gain,
            Term::Function { to, from, f } => {
                let h = 1e-5 * x[*from].abs().max(1e-5);
                a[(*to, *from)] += (f(x[*from] + h) - f(x[*from] - h)) / (2.0 * h);
            }
            _ => {}
        }
    }
    let n = a.nrows();
    let mut both = DMatrix::zeros(2 * n, 2 * n);
    both.view_mut((0, 0), (n, n)).copy_from(&(a * dt));
    both.view_mut((0, n), (n, n)).copy_from(&(DMatrix::identity(n, n) * dt));
    if !both.iter().chain(outputs.iter()).all(|v| v.is_finite()) {
        return None;
    }
    let exponential = exp(&both);
    let part = |column: usize| exponential.view((0, column), (n, n)).into_owned();
    exponential.iter().all(|v| v.is_finite()).then(|| Step {
        transition: part(0),
        integral: part(n),
        outputs,
    })
}
