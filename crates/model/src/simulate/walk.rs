//! The simulation through time: from edge to edge of the signals and from sample to sample of the sensors.

use std::num::NonZeroUsize;

use nalgebra::DMatrix;

use super::error::SimulateError;
use super::history::Histories;
use super::piecewise::{Piece, Piecewise, TOGETHER};
use super::plan::Plan;

/// The present piece of every signal.
#[derive(Default)]
pub(super) struct Drive {
    pub(super) pieces: Vec<Piece>,
    /// The time until which only the system itself moves its state; `None`: unknown.
    pub(super) alone_until_s: Option<f64>,
    /// Delayed quantities inside the system, which are signals as well.
    pub(super) late: Histories,
}

/// A system that can be advanced in time.
pub(super) trait Stepper {
    /// Advances the state; the signals stay on their pieces.
    fn advance(&mut self, from_s: f64, to_s: f64, drive: &Drive) -> Result<(), SimulateError>;
    /// The outputs at the sensors, before the maps of their samples.
    fn outputs(&mut self, at_s: f64, drive: &Drive, y: &mut [f64]) -> Result<(), SimulateError>;
    /// The plant's own state.
    fn plant_state(&mut self) -> &mut [f64];
    /// The same including the states of all input and output paths.
    fn whole_state(&mut self) -> &mut [f64];
    /// The past of its delayed quantities; empty without any.
    fn histories(&mut self) -> Option<&mut Histories> {
        None
    }
    /// The dynamics change to those of the plan's switch with this index, in order of time; the state remains.
    fn switch(&mut self, number: usize);
    /// Steps of the integration so far.
    fn steps(&self) -> usize {
        0
    }
}

/// Measured outputs that correct the state at every sample: x ← x + K·(measured − predicted), with one K for every hypothesis.
#[derive(Debug, Clone, Copy)]
pub struct Correction<'a> {
    /// K, states × outputs.
    pub gain: &'a DMatrix<f64>,
    /// One per output: values, and whether they are present.
    pub measured: &'a [Measured],
    /// `None`: one-step predictions. Otherwise predictions of 1 to this number of steps. Free runs start at every sample whose index is a multiple of it, from
    /// the state corrected at all samples up to it.
    pub horizon: Option<NonZeroUsize>,
}

/// The additional influence on the state.
#[derive(Debug, Clone, Copy)]
pub(super) enum Guide<'a> {
    /// Nothing.
    Free,
    /// Corrections at every sample.
    Corrected(Correction<'a>),
    /// At every `every`-th sample except the first, the state is set to that of a corrected run.
    Restarted { every: NonZeroUsize, corrected: &'a Run },
}

impl Guide<'_> {
    /// Samples between the starts of successive predictions.
    fn every(&self) -> Option<usize> {
        match self {
            Self::Free => None,
            Self::Corrected(correction) => correction.horizon.map(NonZeroUsize::get),
            Self::Restarted { every, .. } => Some(every.get()),
        }
    }
}

/// The sample with the initial state for the prediction of sample k.
pub(super) fn begin_of(k: usize, every: usize) -> usize {
    k.saturating_sub(1) / every * every
}

/// The start of predictions over a horizon: at a sample, when the last output is read. Samples of outputs with longer delays, read before that moment, still
/// belong to the earlier time, for which the corrected run is more accurate.
struct Begins {
    every: usize,
    /// The shortest delay of an output.
    delay_s: f64,
    /// The first sample of the present predictions, and the start of the next ones.
    sample: usize,
    due_s: f64,
}

impl Begins {
    fn new(every: usize, plan: &Plan, time_s: &[f64]) -> Self {
        let delay_s = plan.outputs.iter().map(|o| o.delay_s).fold(f64::INFINITY, f64::min);
        let mut begins = Self { every, delay_s, sample: 0, due_s: 0.0 };
        begins.look_ahead(plan, time_s);
        begins
    }

    fn look_ahead(&mut self, plan: &Plan, time_s: &[f64]) {
        let stamp_s = time_s.get(self.sample + self.every).filter(|_| self.delay_s.is_finite());
        self.due_s = stamp_s
            .map_or(f64::INFINITY, |&stamp_s| plan.clock.commands_time_s(stamp_s) - self.delay_s);
    }
}

/// Samples of one output.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// The values; any finite value where one is missing.
    pub values: Vec<f64>,
    /// The mask of present samples; `None`: all.
    pub present: Option<Vec<bool>>,
}

impl Measured {
    /// The sample, if present.
    #[must_use]
    pub fn get(&self, k: usize) -> Option<f64> {
        let there = self.present.as_ref().is_none_or(|p| p.get(k).copied().unwrap_or(false));
        self.values.get(k).copied().filter(|_| there)
    }
}

/// Whole states, and the past of delayed quantities.
pub(super) type Begin = (Vec<f64>, Histories);

/// The result of a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Outputs as logged, samples × outputs.
    pub y: DMatrix<f64>,
    /// The plant's states at the log's time stamps, samples × states, corrected by the measurements there; empty unless requested.
    pub x: DMatrix<f64>,
    /// Integration steps, repeated ones included; 0 where none was needed.
    pub steps: usize,
    /// Whole states at the starts of predictions over a horizon, without the first; empty without a horizon.
    pub(super) begins: Vec<Begin>,
}

impl Run {
    /// An empty result for these numbers of samples and outputs, and of samples and states.
    pub(super) fn of(samples: usize, outputs: usize, (rows, states): (usize, usize)) -> Self {
        let (y, x) = (DMatrix::zeros(samples, outputs), DMatrix::zeros(rows, states));
        Self { y, x, steps: 0, begins: Vec::new() }
    }
}

/// Outputs with common sampling instants.
struct OutputGroup {
    delay_s: f64,
    outputs: Vec<usize>,
    /// The next sample.
    next: usize,
    /// Its time on the commands' clock; infinite after the last.
    due_s: f64,
}

impl OutputGroup {
    /// Determines the time of the next sample.
    fn look_ahead(&mut self, plan: &Plan, time_s: &[f64]) {
        self.due_s = self.due_at(self.next, plan, time_s);
    }

    /// The time of a sample; infinite after the last.
    fn due_at(&self, sample: usize, plan: &Plan, time_s: &[f64]) -> f64 {
        match (time_s.get(sample), self.outputs.is_empty()) {
            (None, _) => f64::INFINITY,
            (Some(&stamp_s), true) => stamp_s,
            (Some(&stamp_s), false) => plan.clock.commands_time_s(stamp_s) - self.delay_s,
        }
    }

    /// Reads sample `k`, and moves the plant's state according to its guide.
    fn sample(
        &self,
        k: usize,
        system: &mut impl Stepper,
        (now, drive): (f64, &Drive),
        (plan, time_s): (&Plan, &[f64]),
        (guide, begun): (Guide<'_>, usize),
        (run, y, positions): (&mut Run, &mut [f64], &mut [f64]),
    ) -> Result<(), SimulateError> {
        if self.outputs.is_empty() {
            for (i, value) in system.plant_state().iter().enumerate() {
                run.x[(k, i)] = *value;
            }
            return Ok(());
        }
        if let Guide::Restarted { every, corrected } = guide
            && begin_of(k, every.get()) > begun
        {
            self.outputs.iter().for_each(|&i| run.y[(k, i)] = corrected.y[(k, i)]);
            return Ok(());
        }
        system.outputs(now, drive, y)?;
        for &i in &self.outputs {
            run.y[(k, i)] = plan.outputs[i].shown(y[i], time_s[k], &mut positions[i]);
        }
        let Guide::Corrected(correction) = guide else { return Ok(()) };
        for &j in &self.outputs {
            let Some(measured) = correction.measured.get(j).and_then(|m| m.get(k)) else {
                continue;
            };
            let innovation = (measured - run.y[(k, j)]) * plan.outputs[j].correction();
            for (i, x) in system.plant_state().iter_mut().enumerate() {
                *x += correction.gain[(i, j)] * innovation;
            }
        }
        Ok(())
    }
}

/// Outputs by the delay at which they are read.
fn groups(plan: &Plan, states: bool, time_s: &[f64]) -> Vec<OutputGroup> {
    let mut groups: Vec<OutputGroup> = Vec::new();
    for (i, output) in plan.outputs.iter().enumerate() {
        match groups.iter_mut().find(|g| g.delay_s == output.delay_s) {
            Some(group) => group.outputs.push(i),
            None => groups.push(OutputGroup {
                delay_s: output.delay_s,
                outputs: vec![i],
                next: 0,
                due_s: 0.0,
            }),
        }
    }
    if states {
        groups.push(OutputGroup { delay_s: 0.0, outputs: Vec::new(), next: 0, due_s: 0.0 });
    }
    groups.iter_mut().for_each(|group| group.look_ahead(plan, time_s));
    groups
}

/// The state of a simulation in the log's time.
struct Course<'a> {
    signals: &'a [Piecewise],
    plan: &'a Plan,
    time_s: &'a [f64],
    /// The stamps of the requested samples.
    stamps: &'a [f64],
    guide: Guide<'a>,
    begins: Option<Begins>,
    groups: Vec<OutputGroup>,
    /// The next piece of every signal.
    edges: Vec<usize>,
    /// The times of parameter changes, in order, and their number so far.
    switches_s: Vec<f64>,
    switched: usize,
    /// Edges and samples within this distance coincide: the edge comes first.
    together: f64,
    now: f64,
    drive: Drive,
    run: Run,
    y: Vec<f64>,
    /// The position of the far side of each output's play.
    positions: Vec<f64>,
}

/// Simulates a system through the log's time, up to the last requested sample. `time_s` starts at the log's first sample.
pub(super) fn walk(
    system: &mut impl Stepper,
    signals: &[Piecewise],
    plan: &Plan,
    time_s: &[f64],
    guide: Guide<'_>,
) -> Result<Run, SimulateError> {
    let mut course = Course::new(system, signals, plan, time_s, guide);
    let end = time_s.last().copied().unwrap_or(0.0);
    let past_samples = plan.tolerance.past_samples && matches!(guide, Guide::Free);
    let last = course.stamps.len().saturating_sub(1);
    let due = course.groups.iter().map(|group| group.due_at(last, plan, course.stamps));
    let last_s = due.fold(0.0, f64::max);
    while let Some(sample) = course.next_sample() {
        let edge = course.next_edge();
        let to = if edge <= sample + course.together {
            edge.min(sample.max(course.now))
        } else {
            sample
        };
        // Samples that a clock or a delay moves before the start read the initial state.
        let to = to.max(course.now);
        if course.groups.first().is_some_and(|group| group.next % TOLD == 0) {
            plan.far.at(course.now / end.max(f64::MIN_POSITIVE), &"simulating");
        }
        if to > course.now + course.together {
            course.drive.alone_until_s = past_samples.then(|| edge.min(last_s).max(to));
            system.advance(course.now, to, &course.drive)?;
            course.now = to;
        }
        course.pass_edges(system);
        course.take_samples(system)?;
        course.begin_predictions(system);
    }
    let run = Run { steps: system.steps(), ..course.run };
    if run.y.iter().all(|v| v.is_finite()) {
        return Ok(run);
    }
    match (0..time_s.len()).find(|&k| run.y.row(k).iter().any(|v| !v.is_finite())) {
        Some(k) => Err(SimulateError::Explodes { time_s: time_s[k] }),
        None => Ok(run),
    }
}

impl<'a> Course<'a> {
    fn new(
        system: &mut impl Stepper,
        signals: &'a [Piecewise],
        plan: &'a Plan,
        time_s: &'a [f64],
        guide: Guide<'a>,
    ) -> Self {
        let (samples, outputs, states) = (time_s.len(), plan.outputs.len(), plan.wanted.states);
        let rows = if states { samples } else { 0 };
        let stamps = &time_s[..samples.min(plan.wanted.samples)];
        let end = time_s.last().copied().unwrap_or(0.0);
        let pieces = signals.iter().map(|s| s.pieces().first().copied().unwrap_or(LEVEL)).collect();
        let mut switches_s: Vec<f64> = plan.switches.iter().map(|s| s.time_s).collect();
        switches_s.sort_by(f64::total_cmp);
        Self {
            signals,
            plan,
            time_s,
            stamps,
            guide,
            begins: guide.every().map(|every| Begins::new(every, plan, stamps)),
            groups: groups(plan, states, stamps),
            edges: vec![1; signals.len()],
            switches_s,
            switched: 0,
            together: TOGETHER * if samples > 1 { end / (samples - 1) as f64 } else { 1.0 },
            now: 0.0,
            drive: Drive { pieces, alone_until_s: None, late: Histories::default() },
            run: Run::of(samples, outputs, (rows, system.plant_state().len())),
            y: vec![0.0; outputs],
            positions: vec![f64::NAN; outputs],
        }
    }

    /// The time of the next sample or start of a prediction; `None`: never.
    fn next_sample(&self) -> Option<f64> {
        let due = self.groups.iter().map(|group| group.due_s);
        let next = due.chain(self.begins.iter().map(|b| b.due_s)).fold(f64::INFINITY, f64::min);
        (next != f64::INFINITY).then_some(next)
    }

    /// The time of the next change of a signal or a parameter.
    fn next_edge(&self) -> f64 {
        let switch = self.switches_s.get(self.switched).copied().unwrap_or(f64::INFINITY);
        let pieces = self.signals.iter().zip(&self.edges);
        pieces
            .filter_map(|(signal, &at)| Some(signal.pieces().get(at)?.start_s))
            .fold(switch, f64::min)
    }

    fn pass_edges(&mut self, system: &mut impl Stepper) {
        let until = self.now + self.together;
        for ((signal, at), piece) in
            self.signals.iter().zip(&mut self.edges).zip(&mut self.drive.pieces)
        {
            while let Some(next) = signal.pieces().get(*at).filter(|p| p.start_s <= until) {
                *piece = *next;
                *at += 1;
            }
        }
        while self.switches_s.get(self.switched).is_some_and(|at_s| *at_s <= until) {
            system.switch(self.switched);
            self.switched += 1;
        }
    }

    fn take_samples(&mut self, system: &mut impl Stepper) -> Result<(), SimulateError> {
        for group in &mut self.groups {
            while group.due_s <= self.now + self.together {
                let k = group.next;
                let before_start = group.due_s < -self.together;
                group.next += 1;
                group.look_ahead(self.plan, self.stamps);
                // A sample from before the start is uninformative on the present state.
                let guide = if before_start { Guide::Free } else { self.guide };
                let begun = self.begins.as_ref().map_or(0, |b| b.sample);
                group.sample(
                    k,
                    system,
                    (self.now, &self.drive),
                    (self.plan, self.time_s),
                    (guide, begun),
                    (&mut self.run, &mut self.y, &mut self.positions),
                )?;
            }
        }
        Ok(())
    }

    fn begin_predictions(&mut self, system: &mut impl Stepper) {
        let until = self.now + self.together;
        while let Some(begins) = self.begins.as_mut().filter(|b| b.due_s <= until) {
            match self.guide {
                Guide::Restarted { corrected, .. } => {
                    let there = corrected.begins.get(begins.sample / begins.every);
                    if let Some((there, late)) = there {
                        system.whole_state().copy_from_slice(there);
                        system.histories().into_iter().for_each(|own| own.clone_from(late));
                    }
                }
                Guide::Free | Guide::Corrected(_) => {
                    let late = system.histories().cloned().unwrap_or_default();
                    self.run.begins.push((system.whole_state().to_vec(), late));
                }
            }
            begins.sample += begins.every;
            begins.look_ahead(self.plan, self.stamps);
        }
    }
}

/// Samples between two progress reports.
const TOLD: usize = 1024;

/// A signal without pieces.
const LEVEL: Piece = Piece { start_s: 0.0, value: 0.0, slope: 0.0 };
