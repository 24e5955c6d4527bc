//! The logs of a diagnosis: what was commanded and measured, what is trained on and what is held back.

use super::{GapError, Subject};
use crate::error::Result;
use crate::log::{Channel, Log, LogError};
use crate::model::{ModelDocument, Operating};
use crate::simulate::{Commands, Measured, Port, System};

/// A span of a log, seconds from its first sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Span {
    pub(super) from_s: f64,
    pub(super) to_s: f64,
}

impl Span {
    pub(super) fn holds(self, time_s: f64) -> bool {
        time_s >= self.from_s && time_s <= self.to_s
    }
}

/// One log as the model sees it.
#[derive(Debug, Clone)]
pub(super) struct Record {
    pub(super) name: String,
    /// From the log's first sample.
    pub(super) time_s: Vec<f64>,
    /// Mean sample time.
    pub(super) sample_time_s: f64,
    pub(super) inputs: Vec<Vec<f64>>,
    pub(super) measured: Vec<Measured>,
    /// Further columns of the log, by name; NaN where one is missing.
    pub(super) context: Vec<(String, Vec<f64>)>,
    /// What parameters are fitted to.
    pub(super) train: Option<Span>,
    /// What the shrink is measured on.
    pub(super) held: Option<Span>,
}

impl Record {
    /// A log with the model's channels.
    ///
    /// # Errors
    /// [`GapError`] for a sample time that does not fit or too few samples; [`crate::log::LogError`] for channels and units that do not fit or samples that
    /// are missing.
    pub(super) fn new(log: &Log, system: &System) -> Result<Self> {
        channels_fit(log, &system.inputs, &system.outputs)?;
        if log.len() < SHORTEST {
            return Err(GapError::Short { log: log.source().to_owned(), needed: SHORTEST, got: log.len() }.into());
        }
        if let crate::simulate::Dynamics::Sampled(_, ts) = system.dynamics {
            let found = log.even_grid()?;
            if ts.must_equal(found).is_err() {
                let log = log.source().to_owned();
                return Err(GapError::SampleTime { log, model_s: ts.seconds(), log_s: found.seconds() }.into());
            }
        }
        let start = log.time_s().first().copied().unwrap_or(0.0);
        let measured = |name: &str| -> Result<Measured> {
            let output = log.output(name)?;
            let values = (0..log.len()).map(|k| output.get(k).unwrap_or(0.0)).collect();
            let present: Vec<bool> = (0..log.len()).map(|k| output.get(k).is_some()).collect();
            Ok(Measured { values, present: present.contains(&false).then_some(present) })
        };
        let known = |name: &str| system.inputs.iter().chain(&system.outputs).any(|c| c.name == name);
        let further = |c: &Channel| {
            let samples = c.samples();
            (c.name().to_owned(), (0..log.len()).map(|k| samples.get(k).unwrap_or(f64::NAN)).collect())
        };
        let sample_time_s = log.duration_s() / (log.len() - 1) as f64;
        Ok(Self {
            name: log.source().to_owned(),
            time_s: log.time_s().iter().map(|t| t - start).collect(),
            sample_time_s,
            inputs: system.inputs.iter().map(|c| Ok(log.input(&c.name)?.to_vec())).collect::<Result<_>>()?,
            measured: system.outputs.iter().map(|c| measured(&c.name)).collect::<Result<_>>()?,
            context: log.channels().filter(|c| !known(c.name())).map(further).collect(),
            train: None,
            held: None,
        })
    }

    pub(super) fn duration_s(&self) -> f64 {
        self.time_s.last().copied().unwrap_or(0.0)
    }

    /// Samples up to the end of the training span.
    pub(super) fn trained_samples(&self) -> usize {
        self.train.map_or(0, |span| self.time_s.partition_point(|t| *t <= span.to_s))
    }

    pub(super) fn commands(&self) -> Commands<'_> {
        Commands { time_s: &self.time_s, inputs: &self.inputs }
    }

    /// The sample of an output, if it is there and inside the span.
    pub(super) fn measured_in(&self, span: Option<Span>, output: usize, k: usize) -> Option<f64> {
        span.filter(|s| s.holds(self.time_s[k])).and_then(|_| self.measured[output].get(k))
    }
}

/// Fewer samples than this tell nothing about a gap.
const SHORTEST: usize = 50;

/// That a log has the model's channels, in its units.
pub(super) fn channels_fit(log: &Log, inputs: &[Port], outputs: &[Port]) -> Result<()> {
    for channel in inputs.iter().chain(outputs) {
        match log.channel(&channel.name) {
            Err(found @ LogError::UnknownChannel { .. }) => {
                return Err(GapError::Channel { found: found.into(), channel: channel.name.clone() }.into());
            }
            other => other?,
        };
        log.check_unit(&channel.name, channel.unit.as_deref())?;
    }
    Ok(())
}

/// The simulator of a model file, its operating points `"mean"` taken over the training logs.
///
/// # Errors
/// As [`Record::new`] of channels, and [`crate::model::ModelError`].
pub(super) fn system(document: &ModelDocument, logs: &[Log]) -> Result<System> {
    let subject = Subject::from(document);
    let (inputs, outputs) = (subject.inputs(), subject.outputs());
    logs.iter().try_for_each(|log| channels_fit(log, &inputs, &outputs))?;
    let asked = document.inputs().iter().chain(document.outputs()).any(|c| matches!(c.operating, Operating::Mean(_)));
    System::new(document, |name| {
        let (mut sum, mut count) = (0.0, 0.0);
        for log in logs.iter().filter(|_| asked) {
            let output = log.output(name)?;
            for value in (0..log.len()).filter_map(|k| output.get(k)) {
                sum += value;
                count += 1.0;
            }
        }
        Ok(if count > 0.0 { sum / count } else { 0.0 })
    })
}
