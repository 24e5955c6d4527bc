//! Properties of a simulator that can only be called, found by calls: repeatability, resolution and the decay time of a perturbation. Also the inputs,
//! parameters and initial states that move an output.
//!
//! How it can be wrong: all tests run on the longest training log and from the nominal initial state. A simulator may decay there and integrate elsewhere,
//! and a dead zone may hide an input whose perturbation is too small.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::record::LogRecord;
use crate::error::Result;
use crate::format::caveat::Caveat;
use crate::format::error::GapError;
use deadtime_model::simulate::{Commands, Dynamics, Plan, Remembered, System};
use deadtime_signal::remedy::Remedy;
use deadtime_signal::stats;
use deadtime_signal::stop::Stop;

/// The perturbation of an input, as a part of its standard deviation.
const PUSH: f64 = 0.1;
/// The duration of the perturbation, as 1/100 of the log, and its least number of samples.
const LASTS: (usize, usize) = (100, 3);
/// A perturbation has decayed when its response is below this part of its largest value: four time constants.
const FORGOTTEN: f64 = 0.02;
/// The part of a response in the last 10 % of the log above which the simulator integrates.
const LEFT: f64 = 0.05;
/// Growth by more than this from the first third of a log to its last 10 % is no integrator's ramp.
pub(super) const GROWS: f64 = 10.0;
/// Growth by more than this makes a free run impossible.
pub(super) const UNSTABLE: f64 = 1e3;
/// A free run that misses by more than this many times the outputs' motion has left the log. The growth may have ended at rest elsewhere.
const FAR: f64 = 3.0;
/// So far off a run need not be seen to grow: what fell within the first third of a log grows no more.
const FAR_OFF: f64 = 10.0;
/// A free run diverges from the log if no line through it explains more than this part of an output's variance. The run is then not the log's in another unit,
/// or with another sign.
const TELLS: f64 = 0.5;
/// The relative change of the inputs that shows how fine the simulator resolves.
const FINE: f64 = 1e-10;
/// A simulator that this moves by more than such a part of its motion is rough or chaotic.
const ROUGH: f64 = 1e-3;
/// One that it moves by more than this has left the log: unstable, or turned over by rounding alone.
const LOST: f64 = 0.1;
/// Two answers to one call that differ by more than this part of the output's motion are two answers.
const SAME: f64 = 1e-5;
/// A relative change by this shows whether a parameter matters: the first guess of `parameter_error`.
const TENTH: f64 = 0.1;
/// Attempts with a larger perturbation of an initial state until its response is detectable.
const LOOKS: usize = 8;

/// A system whose runs are cached, and the cache; the system as given where it is no black box.
pub(crate) fn remembering(mut system: System, stop: &Stop) -> (System, Option<Arc<Remembered>>) {
    let Dynamics::BlackBox(simulator, parameters) = &system.dynamics else { return (system, None) };
    let memory = Arc::new(Remembered::new(simulator.clone(), system.outputs.clone(), stop.clone()));
    system.dynamics = Dynamics::BlackBox(memory.clone(), parameters.clone());
    (system, Some(memory))
}

/// The measured properties of a simulator.
#[derive(Debug, Clone, Default)]
pub(crate) struct Probed {
    /// The time in which a perturbation decays, seconds, at most 10 % of the log.
    pub(crate) settling_s: f64,
    /// The reason why outputs are simulated freely, with the decay time of a perturbation.
    pub(crate) why: String,
    /// Per state, how far it must move to move an output as far as that moves in the log.
    pub(crate) states: Vec<f64>,
    /// Per output, the size of rounding errors.
    pub(crate) resolution: Vec<f64>,
    /// Inputs that move nothing.
    pub(crate) idle_inputs: Vec<String>,
    /// Parameters that move nothing.
    pub(crate) idle_parameters: Vec<String>,
    pub(crate) caveats: Vec<Caveat>,
}

/// One log, and how far its outputs move.
struct Probe<'a> {
    system: &'a System,
    plan: Plan,
    record: &'a LogRecord,
    nominal: DMatrix<f64>,
    /// Per output; where it is constant, its size, at least 1.
    spread: Vec<f64>,
    resolution: Vec<f64>,
}

/// A difference of answers, per sample the largest over the outputs in units of how far they move.
type Response = Vec<f64>;

impl<'a> Probe<'a> {
    /// On the longest log; `None` without logs. The nominal model must run on all logs, and repeat its answer.
    fn of(
        system: &'a System,
        memory: &Remembered,
        parameters: &[f64],
        records: &'a [LogRecord],
    ) -> Result<Option<Self>> {
        let plan = Plan::new(system);
        let mut answers = nominal_answers(system, &plan, records)?;
        let Some(at) = (0..records.len()).max_by_key(|&at| records[at].time_s.len()) else {
            return Ok(None);
        };
        let record = &records[at];
        let nominal = answers.swap_remove(at);
        let moves = |i: usize| {
            let measured: Vec<f64> =
                (0..record.time_s.len()).filter_map(|k| record.measured[i].get(k)).collect();
            spread(&measured).max(f64::MIN_POSITIVE)
        };
        let spread: Vec<f64> = (0..system.outputs.len()).map(moves).collect();
        let resolution = same_twice(system, memory, record, &nominal, parameters)?;
        let mut probe = Self { system, plan, record, nominal, spread, resolution };
        probe.resolution = probe.coarser_resolution();
        Ok(Some(probe))
    }
}

impl Probe<'_> {
    fn run(&self, inputs: &[Vec<f64>], x0: &[f64], plan: &Plan) -> Option<DMatrix<f64>> {
        let commands = Commands { time_s: &self.record.time_s, inputs };
        self.system.simulate(plan, commands, x0, None).ok().map(|run| run.y)
    }

    /// A difference within rounding is 0.
    fn apart(&self, other: &DMatrix<f64>) -> Response {
        let one = |k: usize, i: usize| {
            let apart = (other[(k, i)] - self.nominal[(k, i)]).abs();
            if apart <= 3.0 * self.resolution[i] { 0.0 } else { apart / self.spread[i] }
        };
        (0..other.nrows())
            .map(|k| (0..other.ncols()).map(|i| one(k, i)).fold(0.0, f64::max))
            .collect()
    }

    /// Answers to other inputs, a start or parameters; `None` where the simulator fails.
    fn pushed(&self, inputs: &[Vec<f64>]) -> Option<Response> {
        Some(self.apart(&self.run(inputs, &self.record.start, &self.plan)?))
    }

    /// The distance of the outputs from the measurement, root mean square, over the motion of the measurement: the worst output.
    fn misses(&self) -> f64 {
        let one = |(i, m): (usize, &deadtime_model::simulate::Measured)| {
            let apart =
                (0..self.nominal.nrows()).filter_map(|k| Some(m.get(k)? - self.nominal[(k, i)]));
            stats::rms(apart).unwrap_or(0.0) / self.spread[i]
        };
        self.record.measured.iter().enumerate().map(one).fold(0.0, f64::max)
    }

    /// The output that the free run misses by far and without correlation, and the size of the miss in units of its motion.
    fn lost(&self) -> Option<(usize, f64)> {
        let one = |(i, m): (usize, &deadtime_model::simulate::Measured)| {
            let pairs: Vec<(f64, f64)> = (0..self.nominal.nrows())
                .filter_map(|k| Some((m.get(k)?, self.nominal[(k, i)])))
                .collect();
            let missed =
                stats::rms(pairs.iter().map(|(y, run)| run - y)).unwrap_or(0.0) / self.spread[i];
            (missed > FAR && explained(&pairs) < TELLS).then_some((i, missed))
        };
        self.record.measured.iter().enumerate().filter_map(one).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn started(&self, state: usize, by: f64) -> Option<Response> {
        let mut x0 = self.record.start.clone();
        x0.iter_mut().skip(state).step_by(self.system.states.len()).for_each(|x| *x += by);
        Some(self.apart(&self.run(&self.record.inputs, &x0, &self.plan)?))
    }

    fn with_parameter(&self, at: usize, share: f64) -> Option<Response> {
        let mut plan = Plan::new(self.system);
        if let Dynamics::BlackBox(_, parameters) = &mut plan.dynamics {
            let value = parameters[at];
            parameters[at] += share * if value == 0.0 { 1.0 } else { value };
        }
        Some(self.apart(&self.run(&self.record.inputs, &self.record.start, &plan)?))
    }

    /// An input with a perturbation on its first samples, or on all samples.
    fn input(&self, at: usize, samples: usize) -> Vec<Vec<f64>> {
        let mut inputs = self.record.inputs.clone();
        let spread = spread(&inputs[at]);
        inputs[at].iter_mut().take(samples).for_each(|v| *v += PUSH * spread);
        inputs
    }

    /// Per output, the larger of the resolution so far and the response to a change of the inputs that only rounding could magnify.
    fn coarser_resolution(&self) -> Vec<f64> {
        let inputs = self.record.inputs.iter();
        let finer: Vec<Vec<f64>> =
            inputs.map(|u| u.iter().map(|v| v * (1.0 + FINE)).collect()).collect();
        let fine = self.run(&finer, &self.record.start, &self.plan);
        let one = |(i, repeated): (usize, &f64)| {
            let moved =
                fine.as_ref().map_or(0.0, |y| (y.column(i) - self.nominal.column(i)).amax());
            repeated.max(moved)
        };
        self.resolution.iter().enumerate().map(one).collect()
    }

    /// The caveat on an output that rounding moves; an error where it moves as far as to leave the log.
    fn roughness(&self) -> Result<Option<Caveat>> {
        let coarse = self.resolution.iter().zip(&self.spread).map(|(r, s)| r / s).enumerate();
        let Some((i, coarse)) =
            coarse.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, coarse)| *coarse > ROUGH)
        else {
            return Ok(None);
        };
        if coarse > LOST {
            let (log, factor) = (self.record.name.clone(), coarse / FINE);
            return Err(GapError::Unstable { log, factor }.into());
        }
        let output = self.system.outputs[i].name.clone();
        Ok(Some(Caveat::Rough { output, percent: format!("{:.2}", 100.0 * coarse) }))
    }

    /// The responses to a short perturbation of every input; reports inputs that move nothing.
    fn input_responses(&self, found: &mut Probed) -> Vec<Response> {
        let samples = self.record.time_s.len();
        let mut responses = Vec::new();
        for (j, input) in self.system.inputs.iter().enumerate() {
            let short = self.pushed(&self.input(j, (samples / LASTS.0).max(LASTS.1)));
            let moved = short.as_ref().is_some_and(|r| largest(r) > 0.0);
            if !moved && self.pushed(&self.input(j, samples)).is_some_and(|r| largest(&r) == 0.0) {
                found.idle_inputs.push(input.name.clone());
                found.caveats.push(Caveat::InputMovesNothing { input: input.name.clone() });
            }
            responses.extend(short);
        }
        responses
    }

    /// The responses to a perturbation of every initial state, and the largest growth of one of them in a free run.
    fn start_responses(
        &self,
        runs_freely: bool,
        found: &mut Probed,
    ) -> Result<(Vec<Response>, Option<f64>)> {
        let mut responses = Vec::new();
        let mut grown: Option<f64> = None;
        for (j, state) in self.system.states.iter().enumerate() {
            let (size, response) = start(self, j);
            if size == 0.0 {
                found.caveats.push(Caveat::StartMovesNothing { state: state.name.clone() });
            }
            // A start that is fitted in every window may be off by as much as the state moves at all.
            let logged =
                self.record.states.get(j).and_then(Option::as_ref).map_or(0.0, |x| spread(x));
            found.states.push(if size > 0.0 { size.max(logged) } else { 0.0 });
            let factor = response.as_deref().and_then(risen).filter(|_| runs_freely);
            grown = factor.into_iter().chain(grown).reduce(f64::max);
            if let Some(factor) = factor.filter(|f| *f > UNSTABLE && self.misses() > FAR) {
                let log = self.record.name.clone();
                return Err(GapError::Unstable { log, factor }.into());
            }
            responses.extend(response);
        }
        Ok((responses, grown))
    }

    /// The caveat on a free run that leaves the log; `grown`: the largest growth of a response to an initial state.
    fn left_the_log(&self, grown: Option<f64>) -> Option<Caveat> {
        let (i, times) = self.lost()?;
        let grown = grown.filter(|g| *g > GROWS);
        (self.system.states.is_empty() || times > FAR_OFF || grown.is_some()).then(|| {
            Caveat::LeftTheLog {
                output: self.system.outputs[i].name.clone(),
                times: format!("{times:.1}"),
                grown: grown.map(|g| format!("{g:.0}")),
                states: Remedy::States.into(),
            }
        })
    }

    /// The names of the parameters that move nothing.
    fn idle_parameters(&self) -> Vec<String> {
        let still = |at: usize, share: f64| {
            self.with_parameter(at, share).is_some_and(|r| largest(&r) == 0.0)
        };
        let idle = |(at, _): &(usize, _)| still(*at, TENTH) && still(*at, -TENTH);
        let ports = self.system.parameters.iter().enumerate();
        ports.filter(idle).map(|(_, port)| port.name.clone()).collect()
    }
}

/// The growth of a response to another initial state, over its first part.
fn risen(response: &[f64]) -> Option<f64> {
    let first = largest(response.get(..LASTS.1)?);
    (first > 0.0).then(|| largest(response) / first)
}

/// The part of the variance of the first that a line through the second explains: their correlation, squared; 0 where one is constant.
fn explained(pairs: &[(f64, f64)]) -> f64 {
    let means = stats::mean(pairs.iter().map(|p| p.0)).zip(stats::mean(pairs.iter().map(|p| p.1)));
    let Some((a, b)) = means else { return 0.0 };
    let sum = |product: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(product).sum::<f64>();
    let (aa, bb, ab) =
        (sum(&|p| (p.0 - a).powi(2)), sum(&|p| (p.1 - b).powi(2)), sum(&|p| (p.0 - a) * (p.1 - b)));
    if aa > 0.0 && bb > 0.0 { ab * ab / (aa * bb) } else { 0.0 }
}

/// Standard deviation; for a constant its size, and for 0 one.
pub(super) fn spread(values: &[f64]) -> f64 {
    let std = stats::deviation(values).unwrap_or(0.0);
    let size = values.iter().map(|v| v.abs()).fold(0.0, f64::max);
    if std > 1e-12 * size {
        std
    } else if size > 0.0 {
        size
    } else {
        1.0
    }
}

fn largest(response: &[f64]) -> f64 {
    response.iter().copied().fold(0.0, f64::max)
}

/// Measures the properties; `None` for a simulator that is no black box. For a restarted simulator, the period in seconds and the reason.
///
/// # Errors
/// [`GapError`]: a call with the nominal model fails, two calls differ, or the response to a perturbation grows without bounds.
pub(crate) fn probe(
    system: &System,
    memory: Option<&Arc<Remembered>>,
    records: &[LogRecord],
    restarted: Option<(f64, String)>,
) -> Result<Option<Probed>> {
    let (Some(memory), Dynamics::BlackBox(_, parameters)) = (memory, &system.dynamics) else {
        return Ok(None);
    };
    let Some(probe) = Probe::of(system, memory, parameters, records)? else {
        return Ok(None);
    };
    let mut found = Probed::default();
    found.caveats.extend(probe.roughness()?);
    let mut responses = probe.input_responses(&mut found);
    let (more, grown) = probe.start_responses(restarted.is_none(), &mut found)?;
    responses.extend(more);
    if system.states.is_empty() {
        found.caveats.push(Caveat::NoStart);
    }
    if restarted.is_none() {
        found.caveats.extend(probe.left_the_log(grown));
    }
    found.idle_parameters = probe.idle_parameters();
    let idle = found.idle_parameters.iter().cloned();
    found.caveats.extend(idle.map(|parameter| Caveat::ParameterMovesNothing { parameter }));
    match restarted {
        Some((every_s, why)) => {
            found.settling_s = every_s.min(0.1 * probe.record.duration_s());
            found.why = why;
        }
        None => forgetting(probe.record, &responses, &mut found)?,
    }
    found.resolution = probe.resolution;
    Ok(Some(found))
}

/// The outputs of the nominal model on all logs.
fn nominal_answers(
    system: &System,
    plan: &Plan,
    records: &[LogRecord],
) -> Result<Vec<DMatrix<f64>>> {
    let mut answers = Vec::new();
    for record in records {
        let run = system.simulate(plan, record.commands(), &record.start, None);
        answers.push(
            run.map_err(|e| GapError::Nominal { log: record.name.clone(), why: e.to_string() })?.y,
        );
    }
    Ok(answers)
}

/// Per output, the difference of two answers to the same call.
fn same_twice(
    system: &System,
    memory: &Remembered,
    record: &LogRecord,
    first: &DMatrix<f64>,
    parameters: &[f64],
) -> Result<Vec<f64>> {
    let u = DMatrix::from_fn(record.time_s.len(), record.inputs.len(), |k, j| record.inputs[j][k]);
    let mut second = DMatrix::zeros(first.nrows(), first.ncols());
    deadtime_model::simulate::windows(
        &u,
        &record.time_s,
        &record.start,
        system.states.len(),
        |rows, u, time_s, x0| {
            let again = memory.call(u, time_s, x0, parameters);
            let again = again.map_err(|why| GapError::Nominal {
                log: record.name.clone(),
                why: format!("called again it failed: {why}"),
            })?;
            second.rows_mut(rows.start, rows.len()).copy_from(&again);
            Ok::<(), GapError>(())
        },
    )?;
    let mut apart = Vec::new();
    for (i, output) in system.outputs.iter().enumerate() {
        let column: Vec<f64> = first.column(i).iter().copied().collect();
        let worst = (0..column.len()).max_by(|&a, &b| {
            let off = |k: usize| (second[(k, i)] - column[k]).abs();
            off(a).total_cmp(&off(b))
        });
        let Some(sample) = worst else { continue };
        let off = (second[(sample, i)] - column[sample]).abs();
        if off > SAME * spread(&column) {
            return Err(GapError::NotRepeatable {
                log: record.name.clone(),
                output: output.name.clone(),
                sample,
                first: column[sample],
                second: second[(sample, i)],
            }
            .into());
        }
        apart.push(off);
    }
    Ok(apart)
}

/// The perturbation of an initial state that moves an output as far as that output moves in the log, and its response. 0 where no output moves.
fn start(probe: &Probe<'_>, state: usize) -> (f64, Option<Response>) {
    let known = probe.system.initial_std[state].filter(|s| *s > 0.0);
    let mut by = known.unwrap_or_else(|| 1e-2 * probe.system.initial[state].abs().max(0.1));
    let mut last = None;
    for _ in 0..LOOKS {
        let Some(response) = probe.started(state, by) else { break };
        let moved = largest(&response);
        if moved > 0.0 {
            last = Some((by, moved, response));
        }
        // Large enough to be no rounding, small enough to be straight.
        match moved {
            m if m > 1.0 => by /= 3.0 * m,
            m if m < 1e-3 => by *= if m > 0.0 { (0.1 / m).min(100.0) } else { 10.0 },
            _ => break,
        }
    }
    last.map_or((0.0, None), |(by, moved, response)| (by / moved, Some(response)))
}

/// The decay time of the responses to perturbations, with the caveats on slow and growing ones.
fn forgetting(record: &LogRecord, responses: &[Response], found: &mut Probed) -> Result<()> {
    let samples = record.time_s.len();
    let (mut settling_s, mut left, mut growth): (f64, f64, f64) = (0.0, 0.0, 0.0);
    for response in responses {
        let peak = largest(response);
        if peak <= 0.0 {
            continue;
        }
        let end = largest(&response[samples - samples / 10..]);
        left = left.max(end / peak);
        let early = largest(&response[..samples / 3]);
        growth = growth.max(if early > 0.0 { end / early } else { 0.0 });
        if let Some(k) = (0..samples).rev().find(|&k| response[k] > FORGOTTEN * peak) {
            settling_s = settling_s.max(record.time_s[k]);
        }
    }
    if growth > UNSTABLE {
        return Err(GapError::Unstable { log: record.name.clone(), factor: growth }.into());
    }
    found.settling_s = settling_s.min(0.1 * record.duration_s());
    let can = "a simulator that is only called can only be simulated freely";
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    found.why = if growth > GROWS {
        found.caveats.push(Caveat::Grows { factor: format!("{growth:.0}") });
        format!(
            "{can}; a perturbation of the initial state grows {growth:.0}-fold over {}",
            record.name
        )
    } else if left > LEFT {
        found
            .caveats
            .push(Caveat::NeverForgets { left: percent(left), started: !found.states.is_empty() });
        format!(
            "{can}; of a perturbation of the initial state {} is left at the end of {}",
            percent(left),
            record.name
        )
    } else if responses.iter().all(|r| largest(r) == 0.0) {
        format!("{can}; no perturbation moves it")
    } else {
        format!("{can}; a perturbation decays within {settling_s:.3} s")
    };
    Ok(())
}
