//! The walk through time: from edge to edge of the signals and from sample to sample of the sensors.

use std::num::NonZeroUsize;

use nalgebra::DMatrix;

use super::error::SimulateError;
use super::history::Histories;
use super::piecewise::{Piece, Piecewise, TOGETHER};
use super::plan::Plan;

/// The piece that every signal is on.
#[derive(Default)]
pub(super) struct Drive {
    pub(super) pieces: Vec<Piece>,
    /// Until when nothing but the system itself will move its state; `None`: not known.
    pub(super) alone_until_s: Option<f64>,
    /// Late quantities inside the system, which are signals as well.
    pub(super) late: Histories,
}

/// A system that can be moved through time.
pub(super) trait Stepper {
    /// Moves the state; the signals stay on their pieces.
    fn advance(&mut self, from_s: f64, to_s: f64, drive: &Drive) -> Result<(), SimulateError>;
    /// The outputs at the sensors, before the maps of their samples.
    fn outputs(&mut self, at_s: f64, drive: &Drive, y: &mut [f64]) -> Result<(), SimulateError>;
    /// The plant's own state.
    fn plant_state(&mut self) -> &mut [f64];
    /// The same with the states of everything on the way in and out.
    fn whole_state(&mut self) -> &mut [f64];
    /// What its late quantities were; empty where it has none.
    fn histories(&mut self) -> Option<&mut Histories> {
        None
    }
    /// The dynamics are those from the plan's switch of this number on, in order of time; the state stays.
    fn switch(&mut self, number: usize);
    /// Steps of the integration so far.
    fn steps(&self) -> usize {
        0
    }
}

/// Measured outputs that correct the state at every sample: x ← x + K·(measured − predicted), the same K for every hypothesis.
#[derive(Debug, Clone, Copy)]
pub struct Correction<'a> {
    /// K, states × outputs.
    pub gain: &'a DMatrix<f64>,
    /// One per output: value and whether it is there.
    pub measured: &'a [Measured],
    /// Predictions of one step (`None`), or of 1 to so many steps: from every sample whose number is a multiple of it the system runs freely, from the state
    /// that the corrections at all samples up to it make.
    pub horizon: Option<NonZeroUsize>,
}

/// What moves the state besides its dynamics.
#[derive(Debug, Clone, Copy)]
pub(super) enum Guide<'a> {
    /// Nothing.
    Free,
    /// Corrections at every sample.
    Corrected(Correction<'a>),
    /// At every so manieth sample but the first it is set to where a corrected run was.
    Restarted { every: NonZeroUsize, corrected: &'a Run },
}

impl Guide<'_> {
    /// Samples from one beginning of a prediction to the next.
    fn every(&self) -> Option<usize> {
        match self {
            Self::Free => None,
            Self::Corrected(correction) => correction.horizon.map(NonZeroUsize::get),
            Self::Restarted { every, .. } => Some(every.get()),
        }
    }
}

/// The sample whose state begins the prediction of sample k.
pub(super) fn begin_of(k: usize, every: usize) -> usize {
    k.saturating_sub(1) / every * every
}

/// Where predictions over a horizon begin: at a sample, when the last output takes it. Samples that outputs with longer delays take before that moment still
/// belong to the time before it, of which the corrected run knows more.
struct Begins {
    every: usize,
    /// The shortest delay of an output.
    delay_s: f64,
    /// The sample with which the present predictions began, and when the next ones begin.
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
    /// The values; anything finite where one is missing.
    pub values: Vec<f64>,
    /// Which are there; `None`: all.
    pub present: Option<Vec<bool>>,
}

impl Measured {
    /// The sample, if it is there.
    #[must_use]
    pub fn get(&self, k: usize) -> Option<f64> {
        let there = self.present.as_ref().is_none_or(|p| p.get(k).copied().unwrap_or(false));
        self.values.get(k).copied().filter(|_| there)
    }
}

/// Whole states, and what late quantities were.
pub(super) type Begin = (Vec<f64>, Histories);

/// What a simulation returns.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Outputs as the log would show them, samples × outputs.
    pub y: DMatrix<f64>,
    /// The plant's states at the log's time stamps, samples × states, corrected by what was measured there; empty unless asked for.
    pub x: DMatrix<f64>,
    /// Steps of the integration, those made again shorter included; 0 where none was needed.
    pub steps: usize,
    /// Whole states from which predictions over a horizon begin, the first one's left out; empty without a horizon.
    pub(super) begins: Vec<Begin>,
}

impl Run {
    /// One of so many samples and outputs, and of so many samples and states, to be filled in.
    pub(super) fn of(samples: usize, outputs: usize, (rows, states): (usize, usize)) -> Self {
        let (y, x) = (DMatrix::zeros(samples, outputs), DMatrix::zeros(rows, states));
        Self { y, x, steps: 0, begins: Vec::new() }
    }
}

/// Outputs that are sampled at the same instants.
struct OutputGroup {
    delay_s: f64,
    outputs: Vec<usize>,
    /// The next sample.
    next: usize,
    /// When it is taken, on the commands' clock; infinite after the last.
    due_s: f64,
}

impl OutputGroup {
    /// Takes note of when the next sample is taken.
    fn look_ahead(&mut self, plan: &Plan, time_s: &[f64]) {
        self.due_s = self.due_at(self.next, plan, time_s);
    }

    /// When a sample is taken; infinite after the last.
    fn due_at(&self, sample: usize, plan: &Plan, time_s: &[f64]) -> f64 {
        match (time_s.get(sample), self.outputs.is_empty()) {
            (None, _) => f64::INFINITY,
            (Some(&stamp_s), true) => stamp_s,
            (Some(&stamp_s), false) => plan.clock.commands_time_s(stamp_s) - self.delay_s,
        }
    }

    /// Reads sample `k`, and moves the plant's state as its guide says.
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

/// A walk on its way through the log's time.
struct Course<'a> {
    signals: &'a [Piecewise],
    plan: &'a Plan,
    time_s: &'a [f64],
    /// The stamps at which samples are wanted.
    stamps: &'a [f64],
    guide: Guide<'a>,
    begins: Option<Begins>,
    groups: Vec<OutputGroup>,
    /// The next piece of every signal.
    edges: Vec<usize>,
    /// When the plan's numbers change, in order, and how many did.
    switches_s: Vec<f64>,
    switched: usize,
    /// Edges and samples this close fall together: the edge comes first.
    together: f64,
    now: f64,
    drive: Drive,
    run: Run,
    y: Vec<f64>,
    /// Where the far side of each output's play is.
    positions: Vec<f64>,
}

/// Walks a system through the log's time, as far as samples are wanted. `time_s` counts from the log's first sample.
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
        // Samples that a clock or a delay puts before the start see the start.
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

    /// When something is sampled next, or a prediction begins; `None`: never.
    fn next_sample(&self) -> Option<f64> {
        let due = self.groups.iter().map(|group| group.due_s);
        let next = due.chain(self.begins.iter().map(|b| b.due_s)).fold(f64::INFINITY, f64::min);
        (next != f64::INFINITY).then_some(next)
    }

    /// When a signal or a number changes next.
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
                // A sample from before the start tells nothing of the state now.
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

/// Samples from one word on how far a simulation is to the next.
const TOLD: usize = 1024;

/// A signal without pieces.
const LEVEL: Piece = Piece { start_s: 0.0, value: 0.0, slope: 0.0 };
