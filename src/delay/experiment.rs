//! What was measured, on an even grid, as the estimators take it.

use super::{DelayError, Events, Record};
use crate::log::Log;
use crate::model::{Continuous, Sampled, StateSpace};
use crate::time::SampleTime;

/// A measured channel over one record.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Samples; whatever stands at a missing one is not looked at.
    pub values: Vec<f64>,
    /// Which samples were measured; `None`: all.
    pub present: Option<Vec<bool>>,
}

impl From<Vec<f64>> for Series {
    fn from(values: Vec<f64>) -> Self {
        Self { values, present: None }
    }
}

/// All channels over one stretch of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// One series per input.
    pub inputs: Vec<Vec<f64>>,
    /// One series per output.
    pub outputs: Vec<Series>,
    /// One series per state of the model; empty where they were not measured.
    pub states: Vec<Vec<f64>>,
}

/// The model that goes with an experiment.
#[derive(Debug, Clone, PartialEq)]
pub enum PlantModel {
    /// Continuous: fractional delays can be resolved exactly.
    Continuous(StateSpace<Continuous>),
    /// Sampled, at the experiment's sample time.
    Sampled(StateSpace<Sampled>),
}

/// What was measured: one or several recordings on one even grid, names, and what is known of the plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment {
    /// The sample time.
    pub sample_time: SampleTime,
    /// Input names.
    pub inputs: Vec<String>,
    /// Output names.
    pub outputs: Vec<String>,
    /// The recordings.
    pub recordings: Vec<Recording>,
    /// The plant, for methods that need A and B.
    pub model: Option<PlantModel>,
    /// Event times at two places, one entry per recording, for methods that look at events and at nothing else; the sample time only scales their window.
    pub events: Vec<Events>,
}

impl Experiment {
    /// One input, one output, one recording.
    #[must_use]
    pub fn siso(sample_time: SampleTime, u: Vec<f64>, y: Vec<f64>) -> Self {
        Self {
            sample_time,
            inputs: vec!["u".into()],
            outputs: vec!["y".into()],
            recordings: vec![Recording { inputs: vec![u], outputs: vec![y.into()], states: Vec::new() }],
            model: None,
            events: Vec::new(),
        }
    }

    /// Times of the same events at two places, `a` and `b`, s; delays are searched up to `max_delay` sample times.
    #[must_use]
    pub fn of_events(sample_time: SampleTime, first: Vec<f64>, second: Vec<f64>) -> Self {
        Self {
            sample_time,
            inputs: vec!["a".into()],
            outputs: vec!["b".into()],
            recordings: Vec::new(),
            model: None,
            events: vec![Events { first, second, units: [None, None] }],
        }
    }

    /// Checks lengths and numbers, and that inputs and outputs move.
    ///
    /// # Errors
    /// [`DelayError::Count`], [`DelayError::NotFinite`] or [`DelayError::Constant`].
    pub fn check(&self) -> Result<(), DelayError> {
        if self.recordings.is_empty() {
            return Err(DelayError::Count { what: "recordings", needed: 1, got: 0 });
        }
        for recording in &self.recordings {
            let samples = recording.inputs.first().map_or(0, Vec::len);
            let counts = [
                ("inputs of a recording", self.inputs.len(), recording.inputs.len()),
                ("outputs of a recording", self.outputs.len(), recording.outputs.len()),
            ];
            for (what, needed, got) in counts {
                if needed != got || needed == 0 {
                    return Err(DelayError::Count { what, needed: needed.max(1), got });
                }
            }
            let outputs = recording
                .outputs
                .iter()
                .map(|s| s.values.len())
                .chain(recording.outputs.iter().filter_map(|s| Some(s.present.as_ref()?.len())));
            let lengths = recording.inputs.iter().chain(&recording.states).map(Vec::len).chain(outputs);
            if let Some(got) = lengths.into_iter().find(|&l| l != samples) {
                return Err(DelayError::Count { what: "samples of a channel", needed: samples, got });
            }
        }
        for (i, channel) in self.inputs.iter().enumerate() {
            let samples = || self.recordings.iter().flat_map(move |r| r.inputs[i].iter().map(|v| (*v, true)));
            moves("input", channel, samples)?;
        }
        for (i, channel) in self.outputs.iter().enumerate() {
            let samples = || {
                self.recordings.iter().flat_map(move |r| {
                    let series = &r.outputs[i];
                    series.values.iter().enumerate().map(move |(t, v)| (*v, series.present.as_ref().is_none_or(|p| p[t])))
                })
            };
            moves("output", channel, samples)?;
        }
        // A state may rest, but it must be a number; states have no names here but those of the model.
        for state in self.recordings.iter().flat_map(|r| r.states.iter().enumerate()) {
            if let (number, Some(sample)) = (state.0 + 1, state.1.iter().position(|v| !v.is_finite())) {
                return Err(DelayError::NotFinite { role: "state", channel: format!("x{number}"), sample, value: state.1[sample] });
            }
        }
        Ok(())
    }

    /// The records of one pair.
    ///
    /// # Errors
    /// [`DelayError::Count`] for a pair that does not exist.
    pub fn pair(&self, input: usize, output: usize) -> Result<Vec<Record>, DelayError> {
        if input >= self.inputs.len() || output >= self.outputs.len() {
            let (needed, got) = if input >= self.inputs.len() { (input + 1, self.inputs.len()) } else { (output + 1, self.outputs.len()) };
            return Err(DelayError::Count { what: "channels", needed, got });
        }
        Ok((self.recordings.iter())
            .map(|r| {
                let series = &r.outputs[output];
                let mut y = series.values.clone();
                // A weight of 0 does not silence a NaN.
                for (value, _) in y.iter_mut().zip(series.present.iter().flatten()).filter(|(_, there)| !**there) {
                    *value = 0.0;
                }
                Record { u: r.inputs[input].clone(), y, present: series.present.clone() }
            })
            .collect())
    }

    /// This experiment with one input and one output.
    ///
    /// # Errors
    /// As [`Experiment::pair`].
    pub fn select(&self, input: usize, output: usize) -> Result<Self, DelayError> {
        let recordings = self.pair(input, output)?.into_iter();
        Ok(Self {
            sample_time: self.sample_time,
            inputs: vec![self.inputs[input].clone()],
            outputs: vec![self.outputs[output].clone()],
            recordings: recordings
                .map(|r| Recording { inputs: vec![r.u], outputs: vec![Series { values: r.y, present: r.present }], states: Vec::new() })
                .collect(),
            model: None,
            events: Vec::new(),
        })
    }

    /// This experiment with all inputs, this one first, and one output.
    ///
    /// # Errors
    /// As [`Experiment::pair`].
    pub fn towards(&self, input: usize, output: usize) -> Result<Self, DelayError> {
        let mut together = self.select(input, output)?;
        for other in (0..self.inputs.len()).filter(|other| *other != input) {
            together.inputs.push(self.inputs[other].clone());
            for (all, recording) in together.recordings.iter_mut().zip(&self.recordings) {
                all.inputs.push(recording.inputs[other].clone());
            }
        }
        Ok(together)
    }

    /// Samples of the longest recording.
    #[must_use]
    pub fn longest(&self) -> usize {
        self.recordings.iter().filter_map(|r| r.inputs.first()).map(Vec::len).max().unwrap_or(0)
    }
}

/// All values are finite and not all are equal.
fn moves<I: Iterator<Item = (f64, bool)>>(role: &'static str, channel: &str, samples: impl Fn() -> I) -> Result<(), DelayError> {
    let present = || samples().enumerate().filter(|(_, (_, present))| *present).map(|(t, (v, _))| (t, v));
    if let Some((sample, value)) = present().find(|(_, v)| !v.is_finite()) {
        return Err(DelayError::NotFinite { role, channel: channel.to_owned(), sample, value });
    }
    let value = present().next().map_or(0.0, |(_, v)| v);
    if present().all(|(_, v)| v == value) {
        return Err(DelayError::Constant { role, channel: channel.to_owned(), value });
    }
    Ok(())
}

/// Samples without any motion of the inputs that make the start of a recording a rest.
const REST: usize = 10;

/// What is taken off each channel before estimating.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Detrend {
    /// Nothing.
    None,
    /// The mean.
    #[default]
    Mean,
    /// The straight line through it.
    Line,
}

impl Detrend {
    /// Takes the trend off the samples that are there.
    fn apply(self, series: &mut Series) {
        let there = |t: usize| series.present.as_ref().is_none_or(|p| p[t]);
        let points: Vec<(f64, f64)> = series.values.iter().enumerate().filter(|(t, _)| there(*t)).map(|(t, v)| (t as f64, *v)).collect();
        // A constant leaves nothing, not the rounding of its mean.
        if let Some(&(_, level)) = points.first()
            && points.iter().all(|p| p.1 == level)
        {
            if self != Self::None {
                series.values.fill(0.0);
            }
            return;
        }
        let count = points.len().max(1) as f64;
        let (mean_t, mean) = (points.iter().map(|p| p.0).sum::<f64>() / count, points.iter().map(|p| p.1).sum::<f64>() / count);
        let slope = match self {
            Self::None => return,
            Self::Mean => 0.0,
            Self::Line => {
                let spread: f64 = points.iter().map(|p| (p.0 - mean_t).powi(2)).sum();
                if spread > 0.0 { points.iter().map(|p| (p.0 - mean_t) * (p.1 - mean)).sum::<f64>() / spread } else { 0.0 }
            }
        };
        for (t, value) in series.values.iter_mut().enumerate() {
            *value -= mean + slope * (t as f64 - mean_t);
        }
    }
}

impl Experiment {
    /// Takes the trend off every input and output; states stay as they are, as a model's equations hold for them and not for what is left of them.
    pub fn take_trend_off(&mut self, detrend: Detrend) {
        for recording in &mut self.recordings {
            for u in &mut recording.inputs {
                let mut series = Series::from(std::mem::take(u));
                detrend.apply(&mut series);
                *u = series.values;
            }
            recording.outputs.iter_mut().for_each(|y| detrend.apply(y));
        }
    }

    /// Reads channels out of logs; every log must be on an even grid, all on the same one.
    ///
    /// # Errors
    /// [`crate::log::LogError`] for an unknown channel, a missing input sample or an uneven grid; [`crate::time::TimeError::Mismatch`] for logs of different sample times.
    pub fn from_logs(logs: &[Log], inputs: &[String], outputs: &[String], detrend: Detrend) -> crate::Result<Self> {
        let mut sample_time: Option<SampleTime> = None;
        let mut recordings = Vec::with_capacity(logs.len());
        for log in logs {
            let grid = log.even_grid()?;
            sample_time.unwrap_or(grid).must_equal(grid)?;
            sample_time.get_or_insert(grid);
            let mut recording = Recording::default();
            for name in inputs {
                let mut series = Series::from(log.input(name)?.to_vec());
                detrend.apply(&mut series);
                recording.inputs.push(series.values);
            }
            for name in outputs {
                let measured = log.output(name)?;
                let mut series = Series { values: measured.values.to_vec(), present: measured.present.map(<[bool]>::to_vec) };
                detrend.apply(&mut series);
                recording.outputs.push(series);
            }
            recordings.push(recording);
        }
        let sample_time = sample_time.ok_or(DelayError::Count { what: "logs", needed: 1, got: 0 })?;
        Ok(Self { sample_time, inputs: inputs.to_vec(), outputs: outputs.to_vec(), recordings, model: None, events: Vec::new() })
    }

    /// Every recording begins with ten samples at least without any motion of the inputs.
    pub(super) fn begins_at_rest(&self) -> bool {
        let still = |u: &Vec<f64>| u.len() >= REST && u.iter().take(REST).all(|v| *v == u[0]);
        self.recordings.iter().all(|r| r.inputs.iter().all(still))
    }

    /// The same experiment measured from where it rested, if every recording begins at rest (all inputs still for at least ten samples): inputs from their first
    /// value, outputs from their mean up to the first motion. `None` where one does not.
    #[must_use]
    pub fn from_rest(&self) -> Option<Self> {
        let mut levelled = self.clone();
        for recording in &mut levelled.recordings {
            let still = |u: &Vec<f64>| u.iter().position(|v| *v != u[0]).unwrap_or(u.len());
            let rest = recording.inputs.iter().map(still).min()?;
            if rest < REST {
                return None;
            }
            for u in &mut recording.inputs {
                let level = u[0];
                u.iter_mut().for_each(|v| *v -= level);
            }
            for y in &mut recording.outputs {
                let there = |t: usize| y.present.as_ref().is_none_or(|p| p[t]);
                let before: Vec<f64> = (0..rest).filter(|&t| there(t)).map(|t| y.values[t]).collect();
                if before.is_empty() {
                    return None;
                }
                let level = before.iter().sum::<f64>() / before.len() as f64;
                y.values.iter_mut().for_each(|v| *v -= level);
            }
        }
        Some(levelled)
    }
}
