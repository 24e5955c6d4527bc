//! Measured data on an even grid: the input of the estimators.

use std::borrow::Cow;

use super::error::DelayError;
use crate::events::times::{Events, check_times};
use deadtime_identify::Record;
use deadtime_log::Log;
use deadtime_model::{Continuous, Sampled, StateSpace};
use deadtime_signal::stats;
use deadtime_signal::time::SampleTime;

/// A measured channel over one record, owned or borrowed.
#[derive(Debug, Clone, PartialEq)]
pub struct Series<'a> {
    /// Samples; values of missing samples are ignored.
    pub values: Cow<'a, [f64]>,
    /// Which samples were measured; `None`: all.
    pub present: Option<Cow<'a, [bool]>>,
}

impl<'a, V: Into<Cow<'a, [f64]>>> From<V> for Series<'a> {
    fn from(values: V) -> Self {
        Self { values: values.into(), present: None }
    }
}

impl Series<'_> {
    fn has(&self, t: usize) -> bool {
        self.present.as_ref().is_none_or(|p| p[t])
    }

    fn borrowed(&self) -> Series<'_> {
        Series {
            values: Cow::Borrowed(&self.values),
            present: self.present.as_deref().map(Cow::Borrowed),
        }
    }

    /// Sets missing samples to zero: a weight of 0 does not remove a NaN.
    fn silence(&mut self) {
        for t in 0..self.values.len() {
            if !self.has(t) && self.values[t] != 0.0 {
                self.values.to_mut()[t] = 0.0;
            }
        }
    }
}

/// All channels over one stretch of time, owned or borrowed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording<'a> {
    /// One series per input.
    pub inputs: Vec<Cow<'a, [f64]>>,
    /// One series per output.
    pub outputs: Vec<Series<'a>>,
    /// One series per state of the model; empty where the states were not measured.
    pub states: Vec<Cow<'a, [f64]>>,
}

/// The plant model of an experiment.
#[derive(Debug, Clone, PartialEq)]
pub enum PlantModel {
    /// Continuous: fractional delays can be resolved exactly.
    Continuous(StateSpace<Continuous>),
    /// Sampled, at the experiment's sample time.
    Sampled(StateSpace<Sampled>),
}

/// Measured data: one or several recordings on one even grid, channel names, and the plant model where known. An experiment guarantees channels of equal
/// length, finite and not constant; its samples may be borrowed.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment<'a> {
    sample_time: SampleTime,
    inputs: Vec<String>,
    outputs: Vec<String>,
    recordings: Vec<Recording<'a>>,
    /// The plant, for methods that need A and B.
    model: Option<PlantModel>,
    /// Event times at two places, one entry per recording, for event methods. The sample time only scales their window.
    events: Vec<Events>,
}

impl<'a> Experiment<'a> {
    /// Recordings of these inputs and outputs.
    ///
    /// # Errors
    /// [`DelayError::Count`] for missing channels or unequal lengths, [`DelayError::NotFinite`], and [`DelayError::Constant`] for a constant input or
    /// output.
    pub fn new(
        sample_time: SampleTime,
        inputs: Vec<String>,
        outputs: Vec<String>,
        recordings: Vec<Recording<'a>>,
    ) -> Result<Self, DelayError> {
        Self { sample_time, inputs, outputs, recordings, model: None, events: Vec::new() }.checked()
    }

    /// One input `u`, one output `y`, one recording; vectors are moved, slices borrowed.
    ///
    /// # Errors
    /// As [`Experiment::new`].
    pub fn siso(
        sample_time: SampleTime,
        u: impl Into<Cow<'a, [f64]>>,
        y: impl Into<Cow<'a, [f64]>>,
    ) -> Result<Self, DelayError> {
        let recording = Recording {
            inputs: vec![u.into()],
            outputs: vec![y.into().into()],
            states: Vec::new(),
        };
        Self::new(sample_time, vec!["u".into()], vec!["y".into()], vec![recording])
    }

    /// Times of the same events at two named places; delays are searched up to `max_delay` sample times.
    ///
    /// # Errors
    /// [`DelayError::Count`] without a sequence, [`DelayError::NotFinite`] and [`DelayError::EventOrder`].
    pub fn of_events(
        sample_time: SampleTime,
        [first, second]: [&str; 2],
        events: Vec<Events>,
    ) -> Result<Self, DelayError> {
        if events.is_empty() {
            return Err(DelayError::Count { what: "sequences of events", needed: 1, got: 0 });
        }
        check_times(&events, [first, second])?;
        let (inputs, outputs) = (vec![first.to_owned()], vec![second.to_owned()]);
        Ok(Self { sample_time, inputs, outputs, recordings: Vec::new(), model: None, events })
    }

    /// This experiment with the plant model; its recordings hold the states where measured.
    #[must_use]
    pub fn with_model(self, model: PlantModel) -> Self {
        Self { model: Some(model), ..self }
    }

    /// The same on another grid, in whose steps the window of events is counted.
    #[must_use]
    pub fn with_sample_time(self, sample_time: SampleTime) -> Self {
        Self { sample_time, ..self }
    }

    /// Checks lengths, finite values, and that inputs and outputs are not constant; sets missing samples to zero.
    fn checked(mut self) -> Result<Self, DelayError> {
        if self.recordings.is_empty() {
            return Err(DelayError::Count { what: "recordings", needed: 1, got: 0 });
        }
        for recording in &self.recordings {
            let samples = recording.inputs.first().map_or(0, |u| u.len());
            let counts = [
                ("inputs of a recording", self.inputs.len(), recording.inputs.len()),
                ("outputs of a recording", self.outputs.len(), recording.outputs.len()),
            ];
            for (what, needed, got) in counts {
                if needed != got || needed == 0 {
                    return Err(DelayError::Count { what, needed: needed.max(1), got });
                }
            }
            let outputs =
                recording.outputs.iter().map(|s| s.values.len()).chain(
                    recording.outputs.iter().filter_map(|s| Some(s.present.as_ref()?.len())),
                );
            let lengths =
                recording.inputs.iter().chain(&recording.states).map(|x| x.len()).chain(outputs);
            if let Some(got) = lengths.into_iter().find(|&l| l != samples) {
                return Err(DelayError::Count {
                    what: "samples of a channel",
                    needed: samples,
                    got,
                });
            }
        }
        for (i, channel) in self.inputs.iter().enumerate() {
            let samples =
                || self.recordings.iter().flat_map(move |r| r.inputs[i].iter().map(|v| (*v, true)));
            moves("input", channel, samples)?;
        }
        for (i, channel) in self.outputs.iter().enumerate() {
            let samples = || {
                self.recordings.iter().flat_map(move |r| {
                    let series = &r.outputs[i];
                    series.values.iter().enumerate().map(move |(t, v)| (*v, series.has(t)))
                })
            };
            moves("output", channel, samples)?;
        }
        // A state may be constant, but must be finite; its only name is that of the model.
        for state in self.recordings.iter().flat_map(|r| r.states.iter().enumerate()) {
            if let (number, Some(sample)) =
                (state.0 + 1, state.1.iter().position(|v| !v.is_finite()))
            {
                return Err(DelayError::NotFinite {
                    role: "state",
                    channel: format!("x{number}"),
                    sample,
                    value: state.1[sample],
                });
            }
        }
        self.recordings.iter_mut().flat_map(|r| &mut r.outputs).for_each(Series::silence);
        Ok(self)
    }

    /// The sample time.
    #[must_use]
    pub fn sample_time(&self) -> SampleTime {
        self.sample_time
    }

    /// Input names; the first is the input whose delay is estimated.
    #[must_use]
    pub fn inputs(&self) -> &[String] {
        &self.inputs
    }

    /// Output names.
    #[must_use]
    pub fn outputs(&self) -> &[String] {
        &self.outputs
    }

    /// The recordings.
    #[must_use]
    pub fn recordings(&self) -> &[Recording<'a>] {
        &self.recordings
    }

    /// The plant model, where known.
    #[must_use]
    pub fn model(&self) -> Option<&PlantModel> {
        self.model.as_ref()
    }

    /// Event times at two places.
    #[must_use]
    pub fn events(&self) -> &[Events] {
        &self.events
    }

    /// The records of one pair, borrowed.
    ///
    /// # Errors
    /// [`DelayError::Count`] for a pair that does not exist.
    pub fn pair(&self, input: usize, output: usize) -> Result<Vec<Record<'_>>, DelayError> {
        if input >= self.inputs.len() || output >= self.outputs.len() {
            let (needed, got) = if input >= self.inputs.len() {
                (input + 1, self.inputs.len())
            } else {
                (output + 1, self.outputs.len())
            };
            return Err(DelayError::Count { what: "channels", needed, got });
        }
        if self.recordings.is_empty() {
            return Err(DelayError::Count { what: "recordings", needed: 1, got: 0 });
        }
        Ok((self.recordings.iter())
            .map(|r| {
                let Series { values, present } = r.outputs[output].borrowed();
                Record { u: Cow::Borrowed(&r.inputs[input]), y: values, present }
            })
            .collect())
    }

    /// This experiment with one input and one output, borrowed.
    ///
    /// # Errors
    /// As [`Experiment::pair`].
    pub fn select(&self, input: usize, output: usize) -> Result<Experiment<'_>, DelayError> {
        let recordings = self.pair(input, output)?.into_iter();
        Ok(Experiment {
            sample_time: self.sample_time,
            inputs: vec![self.inputs[input].clone()],
            outputs: vec![self.outputs[output].clone()],
            recordings: recordings
                .map(|r| Recording {
                    inputs: vec![r.u],
                    outputs: vec![Series { values: r.y, present: r.present }],
                    states: Vec::new(),
                })
                .collect(),
            model: None,
            events: Vec::new(),
        })
    }

    /// This experiment with all inputs, this one first, and one output, borrowed.
    ///
    /// # Errors
    /// As [`Experiment::pair`].
    pub fn towards(&self, input: usize, output: usize) -> Result<Experiment<'_>, DelayError> {
        let mut together = self.select(input, output)?;
        for other in (0..self.inputs.len()).filter(|other| *other != input) {
            together.inputs.push(self.inputs[other].clone());
            for (all, recording) in together.recordings.iter_mut().zip(&self.recordings) {
                all.inputs.push(Cow::Borrowed(&recording.inputs[other]));
            }
        }
        Ok(together)
    }

    /// This experiment, borrowed.
    #[must_use]
    pub fn borrowed(&self) -> Experiment<'_> {
        let recordings = self.recordings.iter().map(|r| Recording {
            inputs: r.inputs.iter().map(|u| Cow::Borrowed(&**u)).collect(),
            outputs: r.outputs.iter().map(Series::borrowed).collect(),
            states: r.states.iter().map(|x| Cow::Borrowed(&**x)).collect(),
        });
        self.with_recordings(recordings.collect())
    }

    /// The same experiment with other recordings; the caller keeps the values finite and the lengths equal.
    pub(super) fn with_recordings<'b>(&self, recordings: Vec<Recording<'b>>) -> Experiment<'b> {
        let Self { sample_time, inputs, outputs, model, events, .. } = self.clone();
        Experiment { sample_time, inputs, outputs, recordings, model, events }
    }

    /// Samples of the longest recording.
    #[must_use]
    pub fn longest(&self) -> usize {
        self.recordings.iter().filter_map(|r| r.inputs.first()).map(|u| u.len()).max().unwrap_or(0)
    }
}

/// All values are finite and not all are equal.
fn moves<I: Iterator<Item = (f64, bool)>>(
    role: &'static str,
    channel: &str,
    samples: impl Fn() -> I,
) -> Result<(), DelayError> {
    let present =
        || samples().enumerate().filter(|(_, (_, present))| *present).map(|(t, (v, _))| (t, v));
    if let Some((sample, value)) = present().find(|(_, v)| !v.is_finite()) {
        return Err(DelayError::NotFinite { role, channel: channel.to_owned(), sample, value });
    }
    let value = present().next().map_or(0.0, |(_, v)| v);
    if present().all(|(_, v)| v == value) {
        return Err(DelayError::Constant { role, channel: channel.to_owned(), value });
    }
    Ok(())
}

/// Samples without input motion at the start of a recording that count as rest.
const REST: usize = 10;

/// The trend subtracted from each channel before estimating.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Detrend {
    /// Nothing.
    None,
    /// The mean.
    #[default]
    Mean,
    /// The straight line of least squares.
    Line,
}

impl Detrend {
    /// Subtracts the trend from the measured samples.
    fn apply(self, series: &mut Series<'_>) {
        let points: Vec<(f64, f64)> = series
            .values
            .iter()
            .enumerate()
            .filter(|(t, _)| series.has(*t))
            .map(|(t, v)| (t as f64, *v))
            .collect();
        // A constant has the residual zero, without the rounding of its mean.
        if let Some(&(_, level)) = points.first()
            && points.iter().all(|p| p.1 == level)
        {
            if self != Self::None {
                series.values.to_mut().fill(0.0);
            }
            return;
        }
        let mean_t = stats::mean(points.iter().map(|p| p.0)).unwrap_or(0.0);
        let mean = stats::mean(points.iter().map(|p| p.1)).unwrap_or(0.0);
        let slope = match self {
            Self::None => return,
            Self::Mean => 0.0,
            Self::Line => {
                let spread: f64 = points.iter().map(|p| (p.0 - mean_t).powi(2)).sum();
                if spread > 0.0 {
                    points.iter().map(|p| (p.0 - mean_t) * (p.1 - mean)).sum::<f64>() / spread
                } else {
                    0.0
                }
            }
        };
        for (t, value) in series.values.to_mut().iter_mut().enumerate() {
            *value -= mean + slope * (t as f64 - mean_t);
        }
    }
}

impl<'a> Experiment<'a> {
    /// Without the trend of every input and output. States and model are dropped: a model's equations hold for the channels and not for their residuals.
    ///
    /// # Errors
    /// [`DelayError::Constant`] for a channel whose residual is zero.
    pub fn detrended(&self, detrend: Detrend) -> Result<Experiment<'_>, DelayError> {
        let recordings = self.recordings.iter().map(|recording| {
            let inputs = recording.inputs.iter().map(|u| {
                let mut series = Series::from(&**u);
                detrend.apply(&mut series);
                series.values
            });
            let outputs = recording.outputs.iter().map(|y| {
                let mut series = y.borrowed();
                detrend.apply(&mut series);
                series
            });
            Recording { inputs: inputs.collect(), outputs: outputs.collect(), states: Vec::new() }
        });
        Experiment { model: None, ..self.with_recordings(recordings.collect()) }.checked()
    }

    /// Channels of logs, borrowed; every log must be on an even grid, all on the same one.
    ///
    /// # Errors
    /// [`deadtime_log::LogError`] for an unknown channel, a missing input sample or an uneven grid; [`deadtime_signal::time::TimeError::Mismatch`] for
    /// logs of different sample times; as [`Experiment::new`].
    pub fn from_logs(
        logs: &'a [Log],
        inputs: &[String],
        outputs: &[String],
    ) -> super::error::Result<Self> {
        let (sample_time, recordings) = recordings(logs, inputs, outputs)?;
        Ok(Self::new(sample_time, inputs.to_vec(), outputs.to_vec(), recordings)?)
    }

    /// Every recording begins with at least ten samples without input motion.
    pub(super) fn begins_at_rest(&self) -> bool {
        let still = |u: &Cow<'_, [f64]>| u.len() >= REST && u.iter().take(REST).all(|v| *v == u[0]);
        self.recordings.iter().all(|r| r.inputs.iter().all(still))
    }

    /// The same experiment measured from its rest: inputs from their first value, outputs from their mean up to the first input motion. `None` unless every
    /// recording begins at rest (all inputs constant for at least ten samples).
    #[must_use]
    pub fn from_rest(&self) -> Option<Self> {
        let mut levelled = self.clone();
        for recording in &mut levelled.recordings {
            let still = |u: &Cow<'_, [f64]>| u.iter().position(|v| *v != u[0]).unwrap_or(u.len());
            let rest = recording.inputs.iter().map(still).min()?;
            if rest < REST {
                return None;
            }
            for u in &mut recording.inputs {
                let level = u[0];
                u.to_mut().iter_mut().for_each(|v| *v -= level);
            }
            for y in &mut recording.outputs {
                let before: Vec<f64> =
                    (0..rest).filter(|&t| y.has(t)).map(|t| y.values[t]).collect();
                let level = stats::mean(before)?;
                y.values.to_mut().iter_mut().for_each(|v| *v -= level);
                y.silence();
            }
        }
        Some(levelled)
    }
}

/// The channels as logged, unchecked, and their sample time.
pub(super) fn recordings<'a>(
    logs: &'a [Log],
    inputs: &[String],
    outputs: &[String],
) -> super::error::Result<(SampleTime, Vec<Recording<'a>>)> {
    let mut sample_time: Option<SampleTime> = None;
    let mut recordings = Vec::with_capacity(logs.len());
    for log in logs {
        let grid = log.even_grid()?;
        sample_time.unwrap_or(grid).must_equal(grid)?;
        sample_time.get_or_insert(grid);
        let mut recording = Recording::default();
        for name in inputs {
            recording.inputs.push(Cow::Borrowed(log.input(name)?));
        }
        for name in outputs {
            let measured = log.output(name)?;
            recording.outputs.push(Series {
                values: Cow::Borrowed(measured.values),
                present: measured.present.map(Cow::Borrowed),
            });
        }
        recordings.push(recording);
    }
    let sample_time = sample_time.ok_or(DelayError::Count { what: "logs", needed: 1, got: 0 })?;
    Ok((sample_time, recordings))
}
