//! The one public error type: a thin sum of the facts that each layer keeps.

use std::path::Path;

use deadtime_delay::DelayError;
use deadtime_gap::DiagnosisError;
use deadtime_gap::GapError;
use deadtime_gap::export::ExportError;
use deadtime_identify::IdentifyError;
use deadtime_identify::matching::MatchingError;
use deadtime_identify::structured::StructuredError;
use deadtime_log::LogError;
use deadtime_model::DerivedError;
use deadtime_model::ModelError;
use deadtime_model::effect::EffectError;
use deadtime_model::simulate::SimulateError;
use deadtime_signal::SignalError;
use deadtime_signal::file::FileError;
use deadtime_signal::flatten;
use deadtime_signal::registry::RegistryError;
use deadtime_signal::remedied;
use deadtime_signal::stop::Stopped;
use deadtime_signal::time::TimeError;
use deadtime_study::StudyError;
use deadtime_study::blind::BlindError;

/// Everything that can stop `deadtime` from answering. "No delay visible" and its like are results, not errors.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A sample time or delay that cannot be.
    #[error(transparent)]
    Time(#[from] TimeError),
    /// A log that cannot be read or used.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A model that cannot be built, read or converted.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A channel that cannot be calculated from others.
    #[error(transparent)]
    Derived(#[from] DerivedError),
    /// A signal that cannot be made.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// A simulation that cannot be run.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// A model that cannot be identified.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A gap that cannot be diagnosed.
    #[error(transparent)]
    Gap(#[from] GapError),
    /// An effect that cannot be applied.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// An estimation that cannot be set up.
    #[error(transparent)]
    Delay(DelayError),
    /// A model file's parameters that cannot be fitted.
    #[error(transparent)]
    Structured(#[from] StructuredError),
    /// Two models that cannot be matched.
    #[error(transparent)]
    Matching(#[from] MatchingError),
    /// A diagnosis that cannot be read or written.
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
    /// A diagnosis that cannot be handed over.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// Blind cases, verdicts or labels that cannot be used.
    #[error(transparent)]
    Blind(#[from] BlindError),
    /// A study that cannot be planned, run or read.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// A name or option outside a registry.
    #[error(transparent)]
    Registry(#[from] RegistryError),
    /// A file that the operating system refuses, or that is no such file.
    #[error(transparent)]
    File(#[from] FileError),
    /// Nobody waits for the answer any more.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

remedied!(Error { Log, Identify, Gap, Delay, Export, Blind, Study });
flatten!(deadtime_log::Error => Error { Log, File, Time });
flatten!(deadtime_model::Error => Error { Model, Derived, Simulate, Effect, Signal, Log, File, Time });
flatten!(deadtime_identify::Error => Error { Identify, Structured, Matching, Model, Derived, Simulate, Effect, Signal, Log, File, Time, Registry, Stopped });
flatten!(deadtime_delay::Error => Error { Delay, Identify, Structured, Matching, Model, Derived, Simulate, Effect, Signal, Log, File, Time, Registry, Stopped });
flatten!(deadtime_gap::Error => Error { Gap, Diagnosis, Export, Model, Derived, Simulate, Effect, Signal, Log, File, Time, Registry, Stopped });
flatten!(deadtime_study::Error => Error { Study, Blind, Gap, Diagnosis, Export, Delay, Identify, Structured, Matching, Model, Derived, Simulate, Effect, Signal, Log, File, Time, Registry, Stopped });

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

/// The result type of the program.
pub type Result<T, E = Error> = std::result::Result<T, E>;
