//! The logs of a diagnosis: commands and measurements, the training spans and the held-out spans.

use crate::error::Result;
use crate::format::error::GapError;
use deadtime_log::{Channel, Log, LogError};
use deadtime_model::simulate::{Commands, Measured, Port, System};

/// A span of a log, seconds from its first sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Span {
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
}

impl Span {
    pub(crate) fn holds(self, time_s: f64) -> bool {
        time_s >= self.from_s && time_s <= self.to_s
    }
}

/// One log as the model sees it.
#[derive(Debug, Clone)]
pub(crate) struct LogRecord {
    pub(crate) name: String,
    /// From the log's first sample.
    pub(crate) time_s: Vec<f64>,
    /// Mean sample time.
    pub(crate) sample_time_s: f64,
    pub(crate) inputs: Vec<Vec<f64>>,
    pub(crate) measured: Vec<Measured>,
    /// Where the simulator starts: its initial state, or a state for every window of the log.
    pub(crate) start: Vec<f64>,
    /// Per state of a restarted simulator, its logged value at every sample.
    pub(crate) states: Vec<Option<Vec<f64>>>,
    /// Further columns of the log, by name; NaN where one is missing.
    pub(crate) context: Vec<(String, Vec<f64>)>,
    /// The span of the fits.
    pub(crate) train: Option<Span>,
    /// For a held-out log, the span for the estimates of its initial state and nuisances.
    pub(crate) anew: Option<Span>,
}

impl LogRecord {
    /// A log with the model's channels.
    ///
    /// # Errors
    /// [`GapError`] for a wrong sample time or too few samples; [`deadtime_log::LogError`] for wrong channels and units or missing samples.
    pub(crate) fn new(log: &Log, system: &System) -> Result<Self> {
        channels_fit(log, &system.inputs, &system.outputs)?;
        if log.len() < SHORTEST {
            return Err(GapError::Short {
                log: log.source().to_owned(),
                needed: SHORTEST,
                got: log.len(),
            }
            .into());
        }
        if let deadtime_model::simulate::Dynamics::Sampled(_, ts) = system.dynamics {
            let found = log.even_grid()?;
            if ts.must_equal(found).is_err() {
                let log = log.source().to_owned();
                return Err(GapError::SampleTime {
                    log,
                    model_s: ts.seconds(),
                    log_s: found.seconds(),
                }
                .into());
            }
        }
        let start = log.time_s().first().copied().unwrap_or(0.0);
        let measured = |name: &str| -> Result<Measured> {
            let output = log.output(name)?;
            let values = (0..log.len()).map(|k| output.get(k).unwrap_or(0.0)).collect();
            let present: Vec<bool> = (0..log.len()).map(|k| output.get(k).is_some()).collect();
            Ok(Measured { values, present: present.contains(&false).then_some(present) })
        };
        let known =
            |name: &str| system.inputs.iter().chain(&system.outputs).any(|c| c.name == name);
        let further = |c: &Channel| {
            let samples = c.samples();
            (
                c.name().to_owned(),
                (0..log.len()).map(|k| samples.get(k).unwrap_or(f64::NAN)).collect(),
            )
        };
        let sample_time_s = log.duration_s() / (log.len() - 1) as f64;
        Ok(Self {
            name: log.source().to_owned(),
            time_s: log.time_s().iter().map(|t| t - start).collect(),
            sample_time_s,
            inputs: system
                .inputs
                .iter()
                .map(|c| Ok(log.input(&c.name)?.to_vec()))
                .collect::<Result<_>>()?,
            measured: system.outputs.iter().map(|c| measured(&c.name)).collect::<Result<_>>()?,
            start: system.initial.clone(),
            states: logged_states(log, system)?,
            context: log.channels().filter(|c| !known(c.name())).map(further).collect(),
            train: None,
            anew: None,
        })
    }

    /// The log as training sees it: an output outside the training span is missing.
    pub(super) fn for_training(&self) -> Self {
        let inside = |k: usize| self.train.is_some_and(|span| span.to_s >= self.time_s[k]);
        let known = |output: &Measured| {
            let present: Vec<bool> =
                (0..self.time_s.len()).map(|k| inside(k) && output.get(k).is_some()).collect();
            let values =
                output.values.iter().zip(&present).map(|(v, there)| if *there { *v } else { 0.0 });
            Measured {
                values: values.collect(),
                present: present.contains(&false).then_some(present),
            }
        };
        Self { measured: self.measured.iter().map(known).collect(), ..self.clone() }
    }

    /// Restarts the simulator after this many samples at most, from the logged states there.
    pub(crate) fn restart_after(&mut self, samples: usize, system: &System) {
        let count = self.time_s.len().div_ceil(samples.max(1)).max(1);
        let at = |w: usize| w * self.time_s.len() / count;
        let state =
            |w: usize, j: usize| self.states[j].as_ref().map_or(system.initial[j], |x| x[at(w)]);
        self.start = (0..count)
            .flat_map(|w| (0..self.states.len()).map(move |j| (w, j)))
            .map(|(w, j)| state(w, j))
            .collect();
    }

    pub(crate) fn duration_s(&self) -> f64 {
        self.time_s.last().copied().unwrap_or(0.0)
    }

    /// The span for the estimates of its initial state and nuisances.
    pub(crate) fn estimated_from(&self) -> Option<Span> {
        self.train.or(self.anew)
    }

    /// Samples up to the end of the training span.
    pub(crate) fn trained_samples(&self) -> usize {
        self.train.map_or(0, |span| self.time_s.partition_point(|t| *t <= span.to_s))
    }

    pub(crate) fn commands(&self) -> Commands<'_> {
        Commands { time_s: &self.time_s, inputs: &self.inputs }
    }

    /// The sample of an output, if it is there and inside the span.
    pub(crate) fn measured_in(&self, span: Option<Span>, output: usize, k: usize) -> Option<f64> {
        span.filter(|s| s.holds(self.time_s[k])).and_then(|_| self.measured[output].get(k))
    }
}

/// The logged states of a restarted simulator; interpolated linearly where a sample is missing.
fn logged_states(log: &Log, system: &System) -> Result<Vec<Option<Vec<f64>>>> {
    let Some(restart) = &system.restart else { return Ok(Vec::new()) };
    let one = |name: &String| -> Result<Vec<f64>> {
        let unknown =
            |found: LogError| GapError::Channel { found: found.into(), channel: name.clone() };
        let samples = log.output(name).map_err(unknown)?;
        let time_s = log.time_s();
        let there: Vec<(f64, f64)> =
            (0..log.len()).filter_map(|k| Some((time_s[k], samples.get(k)?))).collect();
        if there.is_empty() {
            return Err(
                GapError::NoState { log: log.source().to_owned(), channel: name.clone() }.into()
            );
        }
        let at = |t: &f64| {
            let after = there.partition_point(|(s, _)| s <= t).min(there.len() - 1);
            let (before, after) = (there[after.saturating_sub(1)], there[after]);
            let share = if after.0 > before.0 {
                ((t - before.0) / (after.0 - before.0)).clamp(0.0, 1.0)
            } else {
                0.0
            };
            before.1 + share * (after.1 - before.1)
        };
        Ok(time_s.iter().map(at).collect())
    };
    restart.channels.iter().map(|name| name.as_ref().map(one).transpose()).collect()
}

/// Fewer samples than this tell nothing about a gap.
pub(super) const SHORTEST: usize = 50;

/// That a log has the model's channels, in its units.
pub(crate) fn channels_fit(log: &Log, inputs: &[Port], outputs: &[Port]) -> Result<()> {
    for channel in inputs.iter().chain(outputs) {
        match log.channel(&channel.name) {
            Err(found @ LogError::UnknownChannel { .. }) => {
                return Err(GapError::Channel {
                    found: found.into(),
                    channel: channel.name.clone(),
                }
                .into());
            }
            other => other?,
        };
        log.check_unit(&channel.name, channel.unit.as_deref())?;
    }
    Ok(())
}
