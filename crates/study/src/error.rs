//! The errors of planning, running and reading a study.

use std::path::{Path, PathBuf};

use deadtime_signal::text::shown;

use crate::blind::error::BlindError;
use deadtime_delay::DelayError;
use deadtime_gap::export::ExportError;
use deadtime_gap::{DiagnosisError, GapError};
use deadtime_identify::IdentifyError;
use deadtime_identify::matching::MatchingError;
use deadtime_identify::structured::StructuredError;
use deadtime_log::LogError;
use deadtime_model::effect::EffectError;
use deadtime_model::simulate::SimulateError;
use deadtime_model::{DerivedError, ModelError};
use deadtime_signal::file::FileError;
use deadtime_signal::registry::RegistryError;
use deadtime_signal::remedy::{Message, Remedied, Remedy};
use deadtime_signal::stop::Stopped;
use deadtime_signal::time::TimeError;
use deadtime_signal::{SignalError, flatten, remedied};

/// The errors of a study, a gate or a blind check.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A study that cannot be planned, run or read.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// Blind cases, verdicts or labels that cannot be used.
    #[error(transparent)]
    Blind(#[from] BlindError),
    /// A gap that cannot be diagnosed.
    #[error(transparent)]
    Gap(#[from] GapError),
    /// A diagnosis that cannot be read or written.
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
    /// A diagnosis that cannot be handed over.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// An estimation that cannot be set up.
    #[error(transparent)]
    Delay(DelayError),
    /// A model that cannot be identified.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A model file's parameters that cannot be fitted.
    #[error(transparent)]
    Structured(#[from] StructuredError),
    /// Two models that cannot be matched.
    #[error(transparent)]
    Matching(#[from] MatchingError),
    /// A model that cannot be built, read or converted.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A channel that cannot be calculated from others.
    #[error(transparent)]
    Derived(#[from] DerivedError),
    /// A simulation that cannot be run.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// An effect that cannot be applied.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A signal that cannot be made.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// A log that cannot be read or used.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A file that the operating system refuses, or that is no such file.
    #[error(transparent)]
    File(#[from] FileError),
    /// A sample time or delay that cannot be.
    #[error(transparent)]
    Time(#[from] TimeError),
    /// A name or option outside a registry.
    #[error(transparent)]
    Registry(#[from] RegistryError),
    /// Nobody waits for the answer any more.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

remedied!(Error { Study, Blind, Gap, Export, Delay, Identify, Log });
flatten!(deadtime_log::Error => Error { Log, File, Time });
flatten!(deadtime_model::Error => Error { Model, Derived, Simulate, Effect, Signal, Log, File, Time });
flatten!(deadtime_identify::Error => Error { Identify, Structured, Matching, Model, Derived, Simulate, Effect, Signal, Log, File, Time, Registry, Stopped });
flatten!(deadtime_delay::Error => Error { Delay, Identify, Structured, Matching, Model, Derived, Simulate, Effect, Signal, Log, File, Time, Registry, Stopped });
flatten!(deadtime_gap::Error => Error { Gap, Diagnosis, Export, Model, Derived, Simulate, Effect, Signal, Log, File, Time, Registry, Stopped });

impl Error {
    /// An operating-system error with the file it is about.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        FileError::io(path, source).into()
    }
}

impl From<DelayError> for Error {
    fn from(error: DelayError) -> Self {
        deadtime_delay::Error::from(error).into()
    }
}

/// The result of work on studies.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A plan, a folder of results or a file of results that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// Neither a shipped plan nor a file.
    #[error("plan `{name}`: no such file, and no shipped plan of that name; there are: {known}", name = shown(name), known = known.join(", "))]
    UnknownPlan {
        /// The requested name.
        name: String,
        /// The shipped plans.
        known: Vec<&'static str>,
    },
    /// The file is no `deadtime/plan@1`, or has an impossible content.
    #[error("plan {plan}: {detail}", plan = shown(plan))]
    Plan {
        /// The plan's name or file.
        plan: String,
        /// The fault, and the remedy.
        detail: String,
    },
    /// The folder holds another study, or one that was stopped.
    #[error("{}", self.remedied().unwrap_or_default())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// The fault, and the remedy.
        detail: Message,
    },
    /// A file of results that cannot be read.
    #[error("{}", self.remedied().unwrap_or_default())]
    Results {
        /// The file.
        path: PathBuf,
        /// The fault, and the remedy.
        detail: Message,
    },
    /// A plan that needs more than it may.
    #[error("{}", self.remedied().unwrap_or_default())]
    Budget {
        /// The plan's name.
        plan: String,
        /// Combinations of its lists.
        settings: f64,
        /// Settings times methods.
        cells: f64,
        /// Cells times trials.
        estimates: f64,
        /// Memory, or room on the disk.
        what: &'static str,
        /// 10⁹ bytes estimated.
        needed_gb: f64,
        /// 10⁹ bytes allowed.
        limit_gb: f64,
        /// The option that lifts the limit.
        option: Remedy,
    },
    /// The operating system gives no threads, or one stopped.
    #[error("no worker thread: {detail}")]
    Threads {
        /// The message.
        detail: String,
    },
    /// Two studies that cannot be compared.
    #[error("{}", self.remedied().unwrap_or_default())]
    Gate {
        /// The file and its fault, and the remedy.
        detail: Message,
    },
    /// A record that cannot be made.
    #[error("{}", self.remedied().unwrap_or_default())]
    Record {
        /// The plan's name.
        plan: String,
        /// The requested plant, input and delay.
        setting: String,
        /// The record's number in its setting, from 0.
        trial: usize,
        /// The record's seed.
        seed: u64,
        /// Why not.
        source: Box<Error>,
    },
}

impl Remedied for StudyError {
    fn remedied(&self) -> Option<Message> {
        Some(match self {
            Self::Folder { folder, detail } => Message::from(format!("{}: ", folder.display())).and(detail.clone()),
            Self::Results { path, detail } => Message::from(format!("{}: ", path.display())).and(detail.clone()),
            Self::Budget { plan, settings, cells, estimates, what, needed_gb, limit_gb, option } => Message::from(format!(
                "plan {}: {settings} settings, {cells} cells and {estimates} estimates need about {needed_gb:.1} GB of {what}, at most {limit_gb} GB are allowed; \
                 ask for less, or lift the limit by ",
                shown(plan)
            ))
            .and(option.clone())
            .and(format!(" {}", (1.1 * needed_gb).ceil())),
            Self::Gate { detail } => detail.clone(),
            Self::Record { plan, setting, trial, seed, source } => {
                Message::from(format!("plan {plan}, {setting}, trial {trial} (seed {seed}): ")).and(source.message())
            }
            _ => return None,
        })
    }
}
