//! A model known at its samples only, sampled or black-box, with hooks on its inputs, outputs and clock.
//!
//! Between the samples: an input of the plant is the mean of the signal over the sample. The direct path uses the signal at the sampling instant. An output is
//! linear from one sample to the next.

use nalgebra::{DMatrix, DVector};

use super::assembly::{Assembly, InnerDelays};
use super::black_box;
use super::error::SimulateError;
use super::history::Histories;
use super::linear::Linear;
use super::piecewise::{Piece, Piecewise};
use super::plan::{InputPath, OutputPath, Plan, SensorClock};
use super::simulator::{Port, Simulator};
use super::system::{Dynamics, System};
use super::walk::{Correction, Drive, Guide, Run, Stepper, begin_of, walk};
use crate::matrices::Matrices;
use deadtime_signal::time::SampleTime;

/// A plant of gains and integrators, through which signals pass their paths.
fn bench(
    inputs: usize,
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    d: DMatrix<f64>,
) -> System {
    let ports =
        |n: usize| (0..n).map(|_| Port { name: String::new(), unit: None }).collect::<Vec<_>>();
    let (states, outputs) = (a.nrows(), c.nrows());
    System {
        name: String::new(),
        inputs: ports(inputs),
        states: ports(states),
        outputs: ports(outputs),
        parameters: Vec::new(),
        known: Vec::new(),
        dynamics: Dynamics::Linear(Matrices { a, b, c, d }),
        input_delay_s: vec![0.0; inputs],
        initial: vec![0.0; states],
        initial_std: vec![None; states],
        input_operating: vec![0.0; inputs],
        output_operating: vec![0.0; outputs],
        candidates: None,
        restart: None,
    }
}

/// The plant's inputs: means over the samples and values at the sampling instants, each samples × inputs. The last sample lasts `last_s`.
fn arriving(
    plan: &Plan,
    signals: &[Piecewise],
    time_s: &[f64],
    last_s: f64,
) -> Result<[DMatrix<f64>; 2], SimulateError> {
    let (m, samples) = (signals.len(), time_s.len());
    let edges: Vec<f64> =
        time_s.iter().copied().chain([time_s.last().copied().unwrap_or(0.0) + last_s]).collect();
    let (mut mean, mut instant) = (DMatrix::zeros(samples, m), DMatrix::zeros(samples, m));
    for (i, (path, signal)) in plan.inputs.iter().zip(signals).enumerate() {
        let (means, values) = if path.lags_s.is_empty() {
            signal.sampled(&edges)
        } else {
            lagged(path, signal, &edges)?
        };
        mean.column_mut(i).copy_from_slice(&means);
        instant.column_mut(i).copy_from_slice(&values);
    }
    for &(a, b, share) in &plan.swaps {
        for both in [&mut mean, &mut instant] {
            let [first, second] = [a, b].map(|i| both.column(i).into_owned());
            both.set_column(a, &(&first * (1.0 - share) + &second * share));
            both.set_column(b, &(second * (1.0 - share) + first * share));
        }
    }
    Ok([mean, instant])
}

/// The same of one signal behind its lags.
fn lagged(
    path: &InputPath,
    signal: &Piecewise,
    edges_s: &[f64],
) -> Result<(Vec<f64>, Vec<f64>), SimulateError> {
    // An integrator and a direct path carry the signal.
    let zero = DMatrix::zeros(1, 1);
    let system = bench(
        1,
        zero.clone(),
        DMatrix::identity(1, 1),
        DMatrix::from_column_slice(2, 1, &[1.0, 0.0]),
        DMatrix::from_column_slice(2, 1, &[0.0, 1.0]),
    );
    let mut plan = Plan::new(&system);
    plan.inputs[0].lags_s.clone_from(&path.lags_s);
    plan.wanted.states = false;
    let signals = std::slice::from_ref(signal);
    let run = walk(
        &mut Linear::new(&first_values(&system, &plan, signals), &[], true),
        signals,
        &plan,
        edges_s,
        Guide::Free,
    )?;
    let mean = (1..edges_s.len())
        .map(|k| (run.y[(k, 0)] - run.y[(k - 1, 0)]) / (edges_s[k] - edges_s[k - 1]))
        .collect();
    Ok((mean, (1..edges_s.len()).map(|k| run.y[(k - 1, 1)]).collect()))
}

fn first_values(system: &System, plan: &Plan, signals: &[Piecewise]) -> Assembly {
    let first: Vec<f64> = signals.iter().map(Piecewise::first).collect();
    Assembly::new(
        system,
        (plan, system.affine(&plan.dynamics).as_ref()),
        InnerDelays::Pade,
        (&system.initial, &first),
        |_| Vec::new(),
    )
}

/// The lags of an output, of unit gain and in series, with a piecewise linear input.
struct Lags {
    chain: Linear,
    drive: Drive,
}

impl Lags {
    /// `None` for an output without lags.
    fn of(path: &OutputPath) -> Option<Self> {
        if path.lags_s.is_empty() {
            return None;
        }
        let one = DMatrix::identity(1, 1);
        let system =
            bench(1, DMatrix::zeros(0, 0), DMatrix::zeros(0, 1), DMatrix::zeros(1, 0), one);
        let mut plan = Plan::new(&system);
        plan.outputs[0].lags_s.clone_from(&path.lags_s);
        let assembly = Assembly::new(
            &system,
            (&plan, system.affine(&plan.dynamics).as_ref()),
            InnerDelays::Pade,
            (&[], &[0.0]),
            |_| Vec::new(),
        );
        let piece = Piece { start_s: 0.0, value: 0.0, slope: 0.0 };
        let drive = Drive { pieces: vec![piece], alone_until_s: None, late: Histories::default() };
        Some(Self { chain: Linear::new(&assembly, &[], true), drive })
    }

    /// The states at the end of a piece that begins with these.
    fn after(&mut self, state: &[f64], piece: Piece, to_s: f64) -> Result<&[f64], SimulateError> {
        self.chain.whole_state().copy_from_slice(state);
        self.drive.pieces[0] = piece;
        self.chain.advance(piece.start_s, to_s, &self.drive)?;
        Ok(self.chain.state())
    }
}

/// One output between the samples: linear pieces through its lags.
struct Sensor<'a> {
    path: &'a OutputPath,
    time_s: &'a [f64],
    /// The output before its lags, at the samples so far.
    values: Vec<f64>,
    lags: Option<Lags>,
    /// The lags' states at the samples so far.
    lagged: Vec<Vec<f64>>,
}

impl<'a> Sensor<'a> {
    fn new(path: &'a OutputPath, time_s: &'a [f64]) -> Self {
        Self { path, time_s, values: Vec::new(), lags: Lags::of(path), lagged: Vec::new() }
    }

    /// The output with this index plus the contributions of the others.
    fn mixed(&self, output: usize, own: &[f64]) -> f64 {
        let added = self.path.mixing.iter().map(|&(from, gain)| gain * own[from]);
        own[output] + added.sum::<f64>()
    }

    /// The piece from sample k on.
    fn piece(&self, k: usize) -> Piece {
        let next = self.values.get(k + 1).zip(self.time_s.get(k + 1));
        let slope =
            next.map_or(0.0, |(value, time)| (value - self.values[k]) / (time - self.time_s[k]));
        Piece { start_s: self.time_s[k], value: self.values[k], slope }
    }

    fn push(&mut self, value: f64) -> Result<(), SimulateError> {
        self.values.push(value);
        let k = self.values.len() - 1;
        let piece = self.piece(k.saturating_sub(1));
        let Some(lags) = &mut self.lags else { return Ok(()) };
        let state = match self.lagged.last() {
            None => vec![value; self.path.lags_s.len()],
            Some(before) => lags.after(before, piece, self.time_s[k])?.to_vec(),
        };
        self.lagged.push(state);
        Ok(())
    }

    /// The output after its lags, as far as known: held before the first sample and after the last.
    fn read(&mut self, at_s: f64) -> Result<f64, SimulateError> {
        let Some(last) = self.values.len().checked_sub(1) else { return Ok(0.0) };
        // Rounding must not move a sample to the moment before it.
        let tolerance = 1e-9 * (self.time_s.get(1).copied().unwrap_or(1.0) - self.time_s[0]);
        let k = self.time_s[..=last].partition_point(|&t| t <= at_s + tolerance).saturating_sub(1);
        let at_s = if k == last { self.time_s[last] } else { at_s.max(self.time_s[0]) };
        let piece = self.piece(k);
        let (Some(state), Some(lags)) = (self.lagged.get(k), &mut self.lags) else {
            return Ok(piece.at(at_s));
        };
        if (at_s - self.time_s[k]).abs() <= tolerance {
            return Ok(state.last().copied().unwrap_or(0.0));
        }
        Ok(lags.after(state, piece, at_s)?.last().copied().unwrap_or(0.0))
    }
}

/// The outputs of a plant known at its samples only.
struct Sensors<'a> {
    plan: &'a Plan,
    all: Vec<Sensor<'a>>,
    /// The position of the far side of each output's play.
    positions: Vec<f64>,
}

impl<'a> Sensors<'a> {
    fn new(plan: &'a Plan, time_s: &'a [f64]) -> Self {
        let all = plan.outputs.iter().map(|path| Sensor::new(path, time_s)).collect();
        Self { plan, all, positions: vec![f64::NAN; plan.outputs.len()] }
    }

    /// The plant's own outputs at the next sample.
    fn push(&mut self, own: &[f64]) -> Result<(), SimulateError> {
        for (i, sensor) in self.all.iter_mut().enumerate() {
            sensor.push(sensor.mixed(i, own))?;
        }
        Ok(())
    }

    /// Sets the outputs at the last sample, with the lags' states of `others`.
    fn begin_again(&mut self, others: &Self, own: &[f64]) {
        self.positions.clone_from(&others.positions);
        for (i, (sensor, other)) in self.all.iter_mut().zip(&others.all).enumerate() {
            let mixed = sensor.mixed(i, own);
            if let Some(last) = sensor.values.last_mut() {
                *last = mixed;
            }
            if let (Some(last), Some(there)) = (sensor.lagged.last_mut(), other.lagged.last()) {
                last.clone_from(there);
            }
        }
    }

    /// The logged value of an output at this stamp; stamps must increase.
    fn reading(&mut self, output: usize, stamp_s: f64) -> Result<f64, SimulateError> {
        let sensor = &mut self.all[output];
        let value = sensor.read(taken(self.plan.clock, sensor.path, stamp_s))?;
        Ok(sensor.path.shown(value, stamp_s, &mut self.positions[output]))
    }

    fn readings(&mut self, time_s: &[f64], y: &mut DMatrix<f64>) -> Result<(), SimulateError> {
        for output in 0..self.all.len() {
            for (k, &stamp_s) in time_s.iter().enumerate() {
                y[(k, output)] = self.reading(output, stamp_s)?;
            }
        }
        Ok(())
    }
}

/// The reading time of a sample of the log, in the commands' time.
fn taken(clock: SensorClock, path: &OutputPath, stamp_s: f64) -> f64 {
    clock.commands_time_s(stamp_s) - path.delay_s
}

/// Free predictions that accompany a corrected run.
struct Ahead<'a> {
    every: usize,
    x: DVector<f64>,
    sensors: Sensors<'a>,
}

/// Simulates a sampled model.
pub(super) fn run(
    system: &System,
    plan: &Plan,
    (matrices, ts): (&Matrices, SampleTime),
    signals: &[Piecewise],
    time_s: &[f64],
    x0: &[f64],
    correction: Option<Correction<'_>>,
) -> Result<Run, SimulateError> {
    let samples = time_s.len();
    let grid = grid(plan, time_s, ts, correction.is_none());
    let [mean, instant] = arriving(plan, signals, &grid, ts.seconds())?;
    // One column per sample.
    let about = |u: &DMatrix<f64>| {
        DMatrix::from_fn(u.ncols(), u.nrows(), |i, k| u[(k, i)] - system.input_operating[i])
    };
    let (direct, driven) = (&matrices.d * about(&instant), &matrices.b * about(&mean));
    let mut y = DVector::zeros(plan.outputs.len());
    let mut own = |x: &DVector<f64>, k: usize| -> Vec<f64> {
        y.gemv(1.0, &matrices.c, x, 0.0);
        let operating = system.output_operating.iter();
        operating.enumerate().map(|(i, operating)| y[i] + direct[(i, k)] + operating).collect()
    };
    let mut next = DVector::zeros(x0.len());
    let mut step = |x: &mut DVector<f64>, k: usize| {
        next.copy_from(&driven.column(k));
        next.gemv(1.0, &matrices.a, x, 1.0);
        x.copy_from(&next);
    };
    let mut sensors = Sensors::new(plan, &grid);
    let mut run = Run::of(samples, plan.outputs.len(), (samples, x0.len()));
    let mut x = DVector::from_column_slice(x0);
    let mut predicted = correction.and_then(|c| c.horizon).map(|every| {
        let (every, sensors) = (every.get(), Sensors::new(plan, &grid));
        Ahead { every, x: x.clone(), sensors }
    });
    for (k, &at_s) in grid.iter().enumerate() {
        sensors.push(&own(&x, k))?;
        if let Some(ahead) = &mut predicted {
            ahead.sensors.push(&own(&ahead.x, k))?;
        }
        if let Some(correction) = correction {
            let read = (&mut sensors, predicted.as_mut());
            correct(plan, correction, (k, time_s), read, &mut x, &mut run.y)?;
        }
        if let Some(ahead) =
            predicted.as_mut().filter(|ahead| k > 0 && k.is_multiple_of(ahead.every))
        {
            ahead.x.copy_from(&x);
            ahead.sensors.begin_again(&sensors, &own(&x, k));
        }
        if k < samples {
            run.x.row_mut(k).tr_copy_from(&x);
        }
        step(&mut x, k);
        if let Some(ahead) = &mut predicted {
            step(&mut ahead.x, k);
        }
        if x.iter().chain(predicted.iter().flat_map(|ahead| ahead.x.iter())).any(|v| !v.is_finite())
        {
            return Err(SimulateError::Explodes { time_s: at_s });
        }
    }
    if correction.is_none() {
        sensors.readings(time_s, &mut run.y)?;
    }
    Ok(run)
}

/// The stamps at which the model is simulated. A fast sensor clock reads outputs after the log's last sample: the model then continues with the last command.
fn grid(plan: &Plan, time_s: &[f64], ts: SampleTime, free: bool) -> Vec<f64> {
    let last = time_s.last().copied().unwrap_or(0.0);
    let ahead =
        plan.outputs.iter().map(|path| taken(plan.clock, path, last) - last).fold(0.0, f64::max)
            / ts.seconds();
    let beyond = if free { (ahead.ceil() as usize).min(time_s.len()) } else { 0 };
    let more = (1..=beyond).map(|k| last + ts.to_seconds(k as f64));
    time_s.iter().copied().chain(more).collect()
}

/// Reads every output at sample `k`, and corrects the state by the measurement.
fn correct(
    plan: &Plan,
    correction: Correction<'_>,
    (k, time_s): (usize, &[f64]),
    (sensors, mut predicted): (&mut Sensors<'_>, Option<&mut Ahead<'_>>),
    x: &mut DVector<f64>,
    y: &mut DMatrix<f64>,
) -> Result<(), SimulateError> {
    for (j, path) in plan.outputs.iter().enumerate() {
        let value = sensors.reading(j, time_s[k])?;
        // Samples from before the start of the prediction belong to the corrected run.
        let own = |ahead: &&mut &mut Ahead<'_>| {
            k == 0 || taken(plan.clock, path, time_s[k]) > time_s[begin_of(k, ahead.every)]
        };
        y[(k, j)] = match predicted.as_mut().filter(own) {
            Some(ahead) => ahead.sensors.reading(j, time_s[k])?,
            None => value,
        };
        let measured = correction.measured.get(j).and_then(|m| m.get(k));
        let innovation = measured.map_or(0.0, |measured| (measured - value) * path.correction());
        *x += correction.gain.column(j) * innovation;
    }
    Ok(())
}

/// Simulates a black box at the log's stamps: once, or window by window if `x0` holds several concatenated initial states. Readings after the last stamp return
/// the last sample.
pub(super) fn called(
    system: &System,
    plan: &Plan,
    (simulator, parameters): (&dyn Simulator, &[f64]),
    signals: &[Piecewise],
    time_s: &[f64],
    x0: &[f64],
) -> Result<Run, SimulateError> {
    let last_s = time_s.windows(2).last().map_or(1.0, |w| w[1] - w[0]);
    let [u, _] = arriving(plan, signals, time_s, last_s)?;
    let mut own = DMatrix::zeros(time_s.len(), system.outputs.len());
    black_box::windows(&u, time_s, x0, system.states.len(), |rows, u, time_s, x0| {
        let answer =
            simulator.simulate(u, time_s, x0, parameters).map_err(SimulateError::Called)?;
        black_box::check(&answer, &system.outputs, time_s)?;
        own.rows_mut(rows.start, rows.len()).copy_from(&answer);
        Ok::<(), SimulateError>(())
    })?;
    let mut sensors = Sensors::new(plan, time_s);
    for row in own.row_iter() {
        sensors.push(&row.iter().copied().collect::<Vec<_>>())?;
    }
    let mut run = Run::of(time_s.len(), plan.outputs.len(), (0, 0));
    sensors.readings(time_s, &mut run.y)?;
    Ok(run)
}
