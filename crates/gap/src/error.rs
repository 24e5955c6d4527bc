//! The errors of a diagnosis.

use crate::export::source::ExportError;
use crate::format::diagnosis::DiagnosisError;
use crate::format::error::GapError;
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

/// The errors of a diagnosis, a comparison or an export.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A gap that cannot be diagnosed.
    #[error(transparent)]
    Gap(#[from] GapError),
    /// A diagnosis that cannot be read or written.
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
    /// A diagnosis that cannot be handed over.
    #[error(transparent)]
    Export(#[from] ExportError),
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

remedied!(Error { Gap, Export, Log });
flatten!(deadtime_log::Error => Error { Log, File, Time });
flatten!(deadtime_model::Error => Error { Model, Derived, Simulate, Effect, Signal, Log, File, Time });

/// The result of a diagnosis.
pub type Result<T, E = Error> = std::result::Result<T, E>;
