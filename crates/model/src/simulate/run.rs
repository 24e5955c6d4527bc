//! A simulator with hooks on the commands of a log.

use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Gamma};

use super::assembly::{Assembly, InnerDelays};
use super::black_box::window;
use super::error::SimulateError;
use super::linear::Linear;
use super::nonlinear::Nonlinear;
use super::piecewise::Piecewise;
use super::plan::{Delays, Drops, InputPath, Late, Plan, Realisation, Term, Tolerance};
use super::sampled;
use super::system::{Affine, Dynamics, System};
use super::walk::{Correction, Guide, Run, walk};
use crate::c2d::hold::Hold;
use crate::equations::system::Equations;
use crate::simulate::ode::integrator::Integrator;

/// The commands of a log.
#[derive(Debug, Clone, Copy)]
pub struct Commands<'a> {
    /// Seconds from the log's first sample, increasing.
    pub time_s: &'a [f64],
    /// One column per input: each sample holds until the next.
    pub inputs: &'a [Vec<f64>],
}

impl System {
    /// Simulates the system under a plan, from the state `x0` at the log's first sample. The run is free, corrected by measured outputs at every sample, or
    /// free over a horizon from the corrected states.
    ///
    /// A black-box simulator gets the mean of each arriving input over each sample, at the log's stamps; its states are unknown. Linear systems and affine
    /// equations are exact (held and linear inputs, delays of any size). Nonlinear ones are integrated from edge to edge of the inputs, to the plan's
    /// tolerance. The equations' `time` counts from the log's first sample.
    ///
    /// # Errors
    /// [`SimulateError`] for shapes that do not match, a command that is not finite, time that does not increase, a diverging state. Likewise for an
    /// undefined equation (with its part), and a failed integration.
    pub fn simulate(
        &self,
        plan: &Plan,
        commands: Commands<'_>,
        x0: &[f64],
        correction: Option<Correction<'_>>,
    ) -> Result<Run, SimulateError> {
        check(self, commands, x0)?;
        let signals = arriving(plan, commands)?;
        let time_s = commands.time_s;
        match &plan.dynamics {
            Dynamics::Sampled(matrices, ts) => {
                sampled::run(self, plan, (matrices, *ts), &signals, time_s, x0, correction)
            }
            Dynamics::BlackBox(..) if correction.is_some() => Err(SimulateError::Uncorrected),
            Dynamics::BlackBox(simulator, parameters) => {
                let called = (simulator.as_ref(), parameters.as_slice());
                sampled::called(self, plan, called, &signals, time_s, x0)
            }
            Dynamics::Linear(_) | Dynamics::Equations(..) => {
                self.between_samples(plan, &signals, time_s, x0, correction)
            }
        }
    }

    /// Simulates dynamics with a state at all times.
    fn between_samples(
        &self,
        plan: &Plan,
        signals: &[Piecewise],
        time_s: &[f64],
        x0: &[f64],
        correction: Option<Correction<'_>>,
    ) -> Result<Run, SimulateError> {
        let dynamics = &plan.dynamics;
        let first: Vec<f64> = signals.iter().map(Piecewise::first).collect();
        let phases = plan.phases();
        let every = || std::iter::once(dynamics).chain(phases.iter().map(|(_, dynamics)| dynamics));
        // Affine equations need no evaluation.
        let affine: Option<Vec<Affine>> = every().map(|dynamics| self.affine(dynamics)).collect();
        let smooth = !plan.terms.iter().any(|t| {
            matches!(t, Term::Function { .. } | Term::Friction { .. } | Term::Hysteresis { .. })
        });
        let linear = affine.is_some() && smooth;
        let end_s = time_s.last().copied().unwrap_or(0.0);
        let sample_s = end_s / time_s.len().saturating_sub(1).max(1) as f64;
        let exact = !linear && sample_s > 0.0;
        let delays = if exact { InnerDelays::Exact(sample_s) } else { InnerDelays::Pade };
        let assemble = |at: usize, dynamics: &Dynamics| {
            let plant = affine.as_ref().map(|all| &all[at]);
            Assembly::new(self, (plan, plant), delays, (x0, &first), |received| {
                self.first_outputs(dynamics, x0, received)
            })
        };
        let equations_of = |dynamics| if affine.is_some() { None } else { equations_of(dynamics) };
        let (equations, assembly) = (equations_of(dynamics), assemble(0, dynamics));
        let later: Vec<Assembly> =
            phases.iter().enumerate().map(|(i, (_, dynamics))| assemble(i + 1, dynamics)).collect();
        if linear {
            let ramps = !signals.iter().all(Piecewise::is_held);
            return follow(correction, |guide| {
                walk(&mut Linear::new(&assembly, &later, ramps), signals, plan, time_s, guide)
            });
        }
        let operations = equations.map_or(0, |(e, _)| e.operations().0);
        let Tolerance { relative, absolute, steps, budget, .. } = plan.tolerance;
        follow(correction, |guide| {
            let mut integrator = Integrator::with_tolerance(assembly.states, relative, absolute);
            integrator.max_steps = steps;
            integrator.budget = budget.min(affordable(operations, assembly.states, time_s.len()));
            let later = later.iter().zip(phases.iter().map(|(_, dynamics)| equations_of(dynamics)));
            let mut stepper =
                Nonlinear::new((&assembly, equations), later, &plan.terms, integrator);
            walk(&mut stepper, signals, plan, time_s, guide)
                .map_err(|e| stepper.blame(e, &self.states))
        })
    }

    /// The outputs of equations at the start; 0 for linear dynamics.
    fn first_outputs(&self, dynamics: &Dynamics, x0: &[f64], received: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; self.outputs.len()];
        if let Some((equations, parameters)) = equations_of(dynamics) {
            y.resize(equations.output_variables().len(), 0.0);
            let mut workspace = equations.workspace();
            equations.outputs(0.0, x0, received, parameters, &mut workspace, &mut y);
        }
        y
    }
}

/// The signal of every input at the end of its path.
fn arriving(plan: &Plan, commands: Commands<'_>) -> Result<Vec<Piecewise>, SimulateError> {
    let joined = plan.hold == Hold::Linear
        && !matches!(plan.dynamics, Dynamics::Sampled(..) | Dynamics::BlackBox(..));
    let arriving = |(input, (path, values)): (usize, (&InputPath, &Vec<f64>))| {
        if joined {
            arrive_joined(input, path, commands.time_s, values)
        } else {
            arrive(path, commands.time_s, values)
        }
    };
    plan.inputs.iter().zip(commands.inputs).enumerate().map(arriving).collect()
}

/// The equations and their parameters; `None` for linear dynamics.
fn equations_of(dynamics: &Dynamics) -> Option<(&Equations, &[f64])> {
    match dynamics {
        Dynamics::Equations(equations, parameters) => {
            Some((equations.as_ref(), parameters.as_slice()))
        }
        Dynamics::Linear(_) | Dynamics::Sampled(..) | Dynamics::BlackBox(..) => None,
    }
}

/// A free run; one with corrections; or free runs over a horizon from the states of a corrected run.
fn follow(
    correction: Option<Correction<'_>>,
    walk: impl Fn(Guide<'_>) -> Result<Run, SimulateError>,
) -> Result<Run, SimulateError> {
    let Some(correction) = correction else { return walk(Guide::Free) };
    let corrected = walk(Guide::Corrected(correction))?;
    let Some(every) = correction.horizon else { return Ok(corrected) };
    let run = walk(Guide::Restarted { every, corrected: &corrected })?;
    Ok(Run { steps: run.steps + corrected.steps, ..run })
}

/// Step budget of a whole run for a right-hand side with this number of operations: about [`WORK`] operations in all, about one minute. A step takes seven
/// evaluations, or as many as there are states where its Jacobian is needed. The overhead of an evaluation equals 100 operations. A long log has
/// [`STEPS_A_SAMPLE`] for every sample, at any cost, because its length requires them.
fn affordable(operations: usize, states: usize, samples: usize) -> usize {
    let steps = (WORK / ((operations + 100) as f64 * (7 + states) as f64)) as usize;
    steps.max(STEPS_A_SAMPLE.saturating_mul(samples))
}

/// Largest number of operations of a run; one takes 2 to 4 ns.
const WORK: f64 = 2e10;

/// Steps per sample that are always allowed: ten times the need of a log with the model's own sample time.
const STEPS_A_SAMPLE: usize = 16;

fn check(system: &System, commands: Commands<'_>, x0: &[f64]) -> Result<(), SimulateError> {
    if commands.inputs.len() != system.inputs.len() {
        return Err(SimulateError::Inputs {
            needed: system.inputs.len(),
            got: commands.inputs.len(),
        });
    }
    let starts = if system.restart.is_some() { x0.len() / system.states.len().max(1) } else { 1 };
    if x0.len() != starts * system.states.len() || x0.len() < system.states.len() {
        return Err(SimulateError::InitialState { needed: system.states.len(), got: x0.len() });
    }
    for (input, values) in commands.inputs.iter().enumerate() {
        if values.len() != commands.time_s.len() {
            return Err(SimulateError::Samples {
                time: commands.time_s.len(),
                input: values.len(),
            });
        }
        if let Some(sample) = values.iter().position(|v| !v.is_finite()) {
            return Err(SimulateError::NotFinite { input, sample, value: values[sample] });
        }
    }
    match commands
        .time_s
        .windows(2)
        .position(|w| w[1].partial_cmp(&w[0]) != Some(std::cmp::Ordering::Greater))
    {
        Some(k) => Err(SimulateError::Time {
            sample: k + 1,
            before_s: commands.time_s[k],
            after_s: commands.time_s[k + 1],
        }),
        None => Ok(()),
    }
}

/// The signal at the end of an input's path, before its lags and modes.
fn arrive(path: &InputPath, time_s: &[f64], values: &[f64]) -> Result<Piecewise, SimulateError> {
    let passed = path.drops.as_ref().map(|drops| passed_on(drops, values)).transpose()?;
    let values = passed.as_deref().unwrap_or(values);
    let mut signal = match &path.late {
        Some(late) => arrive_late(late, time_s, values)?,
        None => Piecewise::held(time_s, values.iter().copied()),
    };
    if let Some((period_s, phase_s)) = path.passing {
        signal = signal.passed_at(period_s, phase_s);
    }
    signal = signal.delayed(path.delay_s);
    if let Some(curve) = path.curve {
        signal =
            signal.map(|p| (curve.gain * p.value + curve.quadratic * p.value * p.value.abs(), 0.0));
    }
    Ok(path.maps.iter().fold(signal, |signal, map| map(signal)))
}

/// The same for linearly interpolated commands.
fn arrive_joined(
    input: usize,
    path: &InputPath,
    time_s: &[f64],
    values: &[f64],
) -> Result<Piecewise, SimulateError> {
    let held = path.drops.is_some() || path.late.is_some() || path.passing.is_some();
    if held || path.curve.is_some() || !path.maps.is_empty() {
        return Err(SimulateError::Joined { input });
    }
    Ok(Piecewise::joined(time_s, values).delayed(path.delay_s))
}

/// Commands in order of arrival, each with its own delay.
fn arrive_late(late: &Late, time_s: &[f64], values: &[f64]) -> Result<Piecewise, SimulateError> {
    let mean = late.delay_s;
    let drawn = match &late.delays {
        Delays::Known(delays) if delays.len() != values.len() => {
            return Err(SimulateError::Drops { needed: values.len(), got: delays.len() });
        }
        Delays::Known(delays) => Some(delays.clone()),
        Delays::Seed(seed) => late.distribution().map(|delays| {
            let mut rng = ChaCha8Rng::seed_from_u64(*seed);
            // The first command draws none.
            let rest = (1..values.len()).map(|_| delays.sample(&mut rng));
            std::iter::once(0.0).chain(rest).collect()
        }),
        Delays::Mean => None,
    };
    let Some(drawn) = drawn else {
        return Ok(Piecewise::held(time_s, values.iter().copied()).delayed(mean));
    };
    let mut latest_s = f64::NEG_INFINITY;
    let arrival = |(k, (&sent_s, &value)): (usize, (&f64, &f64))| {
        // The first command holds from the start.
        let delay_s = if k == 0 { 0.0 } else { drawn[k] };
        latest_s = if late.ordered { latest_s.max(sent_s + delay_s) } else { sent_s + delay_s };
        (latest_s, value)
    };
    let mut arrivals: Vec<(f64, f64)> =
        time_s.iter().zip(values).enumerate().map(arrival).collect();
    // Stable: of commands with one arrival time the last one sent acts.
    arrivals.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(Piecewise::arriving(&arrivals))
}

impl Late {
    /// The distribution of the delays; `None` without spread.
    #[must_use]
    pub fn distribution(&self) -> Option<Gamma<f64>> {
        let (mean, spread) = (self.delay_s, self.spread_s);
        // Shape and scale of a gamma distribution with this mean and standard deviation.
        (mean > 0.0 && spread > 0.0)
            .then(|| Gamma::new((mean / spread).powi(2), spread * spread / mean).ok())
            .flatten()
    }
}

/// The commands that arrive.
fn passed_on(drops: &Drops, values: &[f64]) -> Result<Vec<f64>, SimulateError> {
    let first = values.first().copied().unwrap_or(0.0);
    // The last command that arrived; the first one always does.
    let held = |lost: &mut dyn FnMut(usize) -> bool| {
        let mut last = first;
        let pass = |(k, &value): (usize, &f64)| {
            if !lost(k) || k == 0 {
                last = value;
            }
            last
        };
        values.iter().enumerate().map(pass).collect()
    };
    let losses = drops.losses;
    let [begins, goes_on] = losses.begins_and_goes_on();
    match &drops.lost {
        Realisation::Known(lost) if lost.len() != values.len() => {
            Err(SimulateError::Drops { needed: values.len(), got: lost.len() })
        }
        Realisation::Known(lost) => Ok(held(&mut |k| lost[k])),
        Realisation::Seed(seed) => {
            let mut rng = ChaCha8Rng::seed_from_u64(*seed);
            let mut lost = false;
            Ok(held(&mut |k| {
                // The first command arrives for any draw.
                let probability = if lost { goes_on } else { begins };
                lost = rng.random::<f64>() < probability && k > 0;
                lost
            }))
        }
        // During a loss, w(k) = E[held | lost at k] = (1 − c)·u(k − 1) + c·w(k − 1). c is the probability that the loss continues. The held value is the one
        // before the loss. E[passed on at k] = (1 − p)·u(k) + p·w(k).
        Realisation::Mean => {
            let p = losses.probability;
            let (mut held, mut before) = (first, first);
            let pass = |value: &f64| {
                held = (1.0 - goes_on) * before + goes_on * held;
                before = *value;
                (1.0 - p) * value + p * held
            };
            Ok(values.iter().map(pass).collect())
        }
    }
}

impl System {
    /// ∂y/∂x0 under a plan, by central differences of one `scale` per state (0: the column is 0). Samples × outputs are stacked by output, one column per
    /// state.
    ///
    /// # Errors
    /// As [`System::simulate`].
    pub fn sensitivity(
        &self,
        plan: &Plan,
        commands: Commands<'_>,
        x0: &[f64],
        scale: &[f64],
        correction: Option<Correction<'_>>,
    ) -> Result<DMatrix<f64>, SimulateError> {
        let samples = commands.time_s.len();
        let states = self.states.len();
        if states > 0 && x0.len() > states {
            return self.sensitivity_of_windows(plan, commands, x0, scale);
        }
        let mut z = DMatrix::zeros(samples * self.outputs.len(), x0.len());
        for j in (0..x0.len()).filter(|&j| scale[j] != 0.0) {
            let moved = |by: f64| {
                let mut x = x0.to_vec();
                x[j] += by * scale[j];
                self.simulate(plan, commands, &x, correction)
            };
            let (up, down) = (moved(0.5)?.y, moved(-0.5)?.y);
            for (to, (up, down)) in z.column_mut(j).iter_mut().zip(up.iter().zip(down.iter())) {
                *to = (up - down) / scale[j];
            }
        }
        Ok(z)
    }
}

impl System {
    /// The same for a simulator with repeated restarts: a state is moved in all windows at once, because windows are independent. Columns are window by window;
    /// `scale` is per state.
    fn sensitivity_of_windows(
        &self,
        plan: &Plan,
        commands: Commands<'_>,
        x0: &[f64],
        scale: &[f64],
    ) -> Result<DMatrix<f64>, SimulateError> {
        let (samples, states) = (commands.time_s.len(), self.states.len());
        let windows = x0.len() / states;
        let mut z = DMatrix::zeros(samples * self.outputs.len(), x0.len());
        for j in (0..states).filter(|&j| scale[j] != 0.0) {
            let moved = |by: f64| {
                let mut x = x0.to_vec();
                x.iter_mut().skip(j).step_by(states).for_each(|x| *x += by * scale[j]);
                self.simulate(plan, commands, &x, None)
            };
            let apart = (moved(0.5)?.y - moved(-0.5)?.y) / scale[j];
            for w in 0..windows {
                for k in window(w, windows, samples) {
                    for i in 0..self.outputs.len() {
                        z[(i * samples + k, w * states + j)] = apart[(k, i)];
                    }
                }
            }
        }
        Ok(z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Commands so widely spaced that none overtakes another: their edges are their delays.
    #[test]
    fn random_delays_have_the_mean_and_the_standard_deviation_that_are_asked_for() {
        let count = 20_000;
        let time_s: Vec<f64> = (0..count).map(|k| 10.0 * f64::from(k)).collect();
        let values: Vec<f64> = (0..count).map(f64::from).collect();
        let late = Late { delay_s: 0.3, spread_s: 0.12, ordered: false, delays: Delays::Seed(4) };
        let heard = arrive_late(&late, &time_s, &values).unwrap();
        let delays: Vec<f64> = heard.pieces().iter().map(|p| p.start_s - 10.0 * p.value).collect();
        assert!(
            delays.len() == count as usize
                && delays[0] == 0.0
                && delays[1..].iter().all(|d| *d > 0.0)
        );
        let size = (delays.len() - 1) as f64;
        let mean = delays[1..].iter().sum::<f64>() / size;
        let std = (delays[1..].iter().map(|d| (d - mean).powi(2)).sum::<f64>() / size).sqrt();
        // Four standard deviations of either estimate.
        assert!(
            (mean - 0.3).abs() < 4.0 * 0.12 / size.sqrt()
                && (std - 0.12).abs() < 4.0 * 0.12 / size.sqrt(),
            "{mean} ± {std}"
        );
    }
}
