//! The inputs of every diagnosis: the simulator, its logs, and their training and held-out spans.

use std::num::NonZeroUsize;
use std::sync::Arc;

use super::black_box::{Probed, probe, remembering};
use super::nuisance::{Nuisance, nuisances};
use super::options::GapOptions;
use super::poles::Poles;
use super::record::LogRecord;
use super::restart::restart;
use super::spans::{Divide, longest_delay};
use super::subject::Subject;
use crate::answer::held_out::HeldOut;
use crate::error::Result;
use crate::format::diagnosis::Mode;
use crate::format::error::GapError;
use deadtime_log::Log;
use deadtime_model::effect::Applied;
use deadtime_model::simulate::{Remembered, System};
use deadtime_signal::stop::Stop;

/// The simulator under diagnosis. The runs of a simulator that can only be called are cached.
pub(crate) struct Simulator {
    pub(crate) system: System,
    pub(crate) memory: Option<Arc<Remembered>>,
}

impl Simulator {
    /// From a subject, its operating points `"mean"` taken over the training logs.
    ///
    /// # Errors
    /// Those of the model, and of channels that do not fit.
    pub(crate) fn of(subject: Subject<'_>, logs: &[Log], stop: &Stop) -> Result<Self> {
        let (system, memory) = remembering(subject.system(logs)?, stop);
        Ok(Self { system, memory })
    }
}

/// The logs as the simulator sees them.
pub(crate) struct Inputs {
    /// Effects that belong to the simulator.
    pub(crate) model_effects: Vec<Applied>,
    /// The constants with a separate value in every log.
    pub(crate) nuisances: Vec<Nuisance>,
    /// The training logs; held-out samples of their outputs are missing.
    pub(crate) training: Vec<LogRecord>,
    /// All logs with their held-out spans, which only the report can read.
    pub(crate) held_out: HeldOut,
    /// The measured properties of a simulator that can only be called.
    pub(crate) probed: Option<Probed>,
    pub(crate) poles: Poles,
    pub(crate) longest_delay_s: f64,
    /// The exclusive upper limit of delays in the search.
    pub(crate) limit_s: f64,
    /// Samples that are predicted from one state, where predictions have a horizon.
    pub(crate) horizon: Option<NonZeroUsize>,
}

impl Inputs {
    /// Reads the logs through the simulator's channels and divides them.
    ///
    /// # Errors
    /// [`GapError`] where logs, options and simulator do not fit, and the errors of logs and effects.
    pub(crate) fn new(
        subject: Subject<'_>,
        simulator: &Simulator,
        logs: &[Log],
        holdout: &[Log],
        options: &GapOptions,
    ) -> Result<Self> {
        Self::divided(subject, simulator, [logs, holdout], options, !holdout.is_empty())
    }

    /// The same where all logs are training logs to their end.
    ///
    /// # Errors
    /// As [`Inputs::new`].
    pub(crate) fn of_whole_logs(
        subject: Subject<'_>,
        simulator: &Simulator,
        logs: &[Log],
        options: &GapOptions,
    ) -> Result<Self> {
        Self::divided(subject, simulator, [logs, &[]], options, true)
    }

    fn divided(
        subject: Subject<'_>,
        simulator: &Simulator,
        [logs, holdout]: [&[Log]; 2],
        options: &GapOptions,
        whole: bool,
    ) -> Result<Self> {
        let system = &simulator.system;
        if logs.is_empty() {
            return Err(GapError::NoLogs.into());
        }
        if system.is_black_box()
            && (options.horizon.is_some()
                || options.prediction.is_some_and(|mode| mode != Mode::Simulation))
        {
            return Err(GapError::NoPredictor.into());
        }
        let model_effects = model_effects(subject, system)?;
        let nuisances = nuisances(subject, system, logs)?;
        let mut records = logs
            .iter()
            .chain(holdout)
            .map(|log| LogRecord::new(log, system))
            .collect::<Result<Vec<_>>>()?;
        let horizon = horizon(options, &records)?;
        let restarted = restart(system, &mut records)?;
        let first = &records[..logs.len()];
        let probed = probe(system, simulator.memory.as_ref(), first, restarted)?;
        let poles = probed.as_ref().map_or_else(|| Poles::of(system, first), Poles::probed);
        let longest_delay_s =
            options.longest_delay_s.unwrap_or_else(|| longest_delay(first, poles.settling_s));
        let limit_s = first.iter().map(|r| 0.5 * r.duration_s()).fold(f64::INFINITY, f64::min);
        if !(0.0..limit_s).contains(&longest_delay_s) {
            return Err(GapError::LongestDelay { given_s: longest_delay_s, limit_s }.into());
        }
        let divide = Divide {
            held_out: whole,
            anew: !nuisances.is_empty(),
            start_s: longest_delay_s,
            settling_s: poles.settling_s,
            black_box: system.is_black_box(),
        };
        let spans = divide.set_spans(&mut records, logs.len());
        Ok(Self {
            model_effects,
            nuisances,
            training: records[..logs.len()].iter().map(LogRecord::for_training).collect(),
            held_out: HeldOut::new(records, spans),
            probed,
            poles,
            longest_delay_s,
            limit_s,
            horizon,
        })
    }
}

/// A shortest log has so many horizons at least: below, the first, which begins with the model's own start, is much of it.
const HORIZONS: usize = 4;

/// The requested horizon.
///
/// # Errors
/// [`GapError::Horizon`].
fn horizon(options: &GapOptions, records: &[LogRecord]) -> Result<Option<NonZeroUsize>> {
    let most = records.iter().map(|r| r.time_s.len() / HORIZONS).min().unwrap_or(0);
    let asked = options.prediction == Some(Mode::Horizon);
    let Some(given) = options.horizon.or(asked.then_some(0)) else { return Ok(None) };
    match NonZeroUsize::new(given)
        .filter(|_| given <= most && (asked || options.prediction.is_none()))
    {
        Some(horizon) => Ok(Some(horizon)),
        None => Err(GapError::Horizon { given, most }.into()),
    }
}

/// Effects that belong to the simulator.
///
/// # Errors
/// Those of [`Applied::from_entry`].
pub(crate) fn model_effects(subject: Subject<'_>, system: &System) -> Result<Vec<Applied>> {
    Ok(subject
        .effects()
        .iter()
        .map(|e| Applied::from_entry(system, e))
        .collect::<std::result::Result<Vec<_>, _>>()?)
}
