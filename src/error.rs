//! The one public error type; each module keeps the facts of its own failures in a small enum.

use std::path::{Path, PathBuf};

/// Everything that can stop `deadtime` from answering. "No delay visible" and its like are results, not errors.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A sample time or delay that cannot be.
    #[error(transparent)]
    Time(#[from] crate::time::TimeError),
    /// A log that cannot be read or used.
    #[error(transparent)]
    Log(#[from] crate::log::LogError),
    /// A model that cannot be built, read or converted.
    #[error(transparent)]
    Model(#[from] crate::model::ModelError),
    /// A channel that cannot be calculated from others.
    #[error(transparent)]
    Derived(#[from] crate::model::DerivedError),
    /// A signal that cannot be made.
    #[error(transparent)]
    Signal(#[from] crate::signal::SignalError),
    /// A simulation that cannot be run.
    #[error(transparent)]
    Simulate(#[from] crate::simulate::SimulateError),
    /// A model that cannot be identified.
    #[error(transparent)]
    Identify(#[from] crate::identify::IdentifyError),
    /// A gap that cannot be diagnosed.
    #[error(transparent)]
    Gap(#[from] crate::diagnose::GapError),
    /// An effect that cannot be applied.
    #[error(transparent)]
    Effect(#[from] crate::effect::EffectError),
    /// An estimation that cannot be set up.
    #[error(transparent)]
    Delay(crate::delay::DelayError),
    /// A model file's parameters that cannot be fitted.
    #[error(transparent)]
    Structured(#[from] crate::identify::structured::StructuredError),
    /// Two models that cannot be matched.
    #[error(transparent)]
    Matching(#[from] crate::identify::matching::MatchingError),
    /// A diagnosis that cannot be read or written.
    #[error(transparent)]
    Diagnosis(#[from] crate::diagnose::DiagnosisError),
    /// A diagnosis that cannot be handed over.
    #[error(transparent)]
    Export(#[from] crate::export::ExportError),
    /// Blind cases, verdicts or labels that cannot be used.
    #[error(transparent)]
    Blind(#[from] crate::blind::BlindError),
    /// A study that cannot be planned, run or read.
    #[error(transparent)]
    Study(#[from] crate::study::StudyError),
    /// A name or option that a registry does not know.
    #[error(transparent)]
    Registry(#[from] crate::registry::RegistryError),
    /// The operating system refused a file.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file that says what to do, and is far larger than any such file.
    #[error("{path}: larger than {mib} MiB, the most that is read of a file of this kind; is it a log, or a device?", path = path.display(), mib = limit >> 20)]
    Large {
        /// The file.
        path: PathBuf,
        /// Bytes at most.
        limit: u64,
    },
    /// Another run writes to the folder.
    #[error("{folder}: {other} writes there; wait for it, or give another folder", folder = folder.display(), other = process.map_or_else(|| "another process".to_owned(), |p| format!("process {p}")))]
    Busy {
        /// The folder.
        folder: PathBuf,
        /// The other's process id, where it can be read.
        process: Option<u32>,
    },
    /// Nobody waits for the answer any more.
    #[error("stopped before it was done")]
    Stopped,
}

/// The crate's result type.
pub type Result<T> = std::result::Result<T, Error>;

impl From<crate::delay::DelayError> for Error {
    fn from(error: crate::delay::DelayError) -> Self {
        match error {
            crate::delay::DelayError::Stopped => Self::Stopped,
            other => Self::Delay(other),
        }
    }
}

impl Error {
    /// Wraps an operating-system error with the file it is about.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }
}
