//! Errors as Python exceptions: one class per kind, all of them in `deadtime.errors`.

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyType;

use deadtime::Error;
use deadtime::remedy::{Remedied, Remedy};

/// The classes of `deadtime.errors` other than their base `DeadtimeError`; a test holds them against the module.
pub(super) const CLASSES: [&str; 13] = [
    "TimeError",
    "LogError",
    "ModelError",
    "SignalError",
    "SimulateError",
    "GapError",
    "EffectError",
    "DelayError",
    "DiagnosisError",
    "BlindError",
    "StudyError",
    "RegistryError",
    "FileError",
];

/// The class of an error; `None` where no caller waits for the answer any more.
fn class(error: &Error) -> Option<&'static str> {
    Some(match error {
        // Whoever met the sample time or delay first.
        Error::Time(_)
        | Error::Model(deadtime::model::ModelError::Time(_))
        | Error::Simulate(deadtime::simulate::SimulateError::DelayTime(_)) => "TimeError",
        Error::Log(_) | Error::Derived(_) => "LogError",
        Error::Model(_) | Error::Structured(_) | Error::Matching(_) | Error::Identify(_) => {
            "ModelError"
        }
        Error::Signal(_) => "SignalError",
        Error::Simulate(_) => "SimulateError",
        Error::Gap(_) => "GapError",
        Error::Effect(_) => "EffectError",
        Error::Delay(_) => "DelayError",
        Error::Diagnosis(_) | Error::Export(_) => "DiagnosisError",
        Error::Blind(_) => "BlindError",
        Error::Study(_) => "StudyError",
        Error::Registry(_) => "RegistryError",
        Error::File(_) => "FileError",
        Error::Stopped(_) => return None,
    })
}

/// An error as the exception of its kind. A file's keeps the operating system's number, so that `except FileNotFoundError` is not needed to tell why.
pub(super) fn raise(py: Python<'_>, error: impl Into<Error>) -> PyErr {
    let error = error.into();
    let Some(name) = class(&error) else { return PyKeyboardInterrupt::new_err(()) };
    let class = |name: &str| -> PyResult<Bound<'_, PyType>> {
        Ok(py.import("deadtime.errors")?.getattr(name)?.cast_into()?)
    };
    match (class(name), &error) {
        (Ok(class), Error::File(deadtime::file::FileError::Io { path, reason })) => {
            PyErr::from_type(
                class,
                (reason.raw_os_error(), os_message(reason), path.clone().into_os_string()),
            )
        }
        (Ok(class), _) => {
            PyErr::from_type(class, deadtime::text::message(&error.message().worded(call)))
        }
        (Err(missing), _) => missing,
    }
}

/// The result of the crate as Python's.
pub(super) trait OrRaise<T> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T, E: Into<Error>> OrRaise<T> for Result<T, E> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|e| raise(py, e))
    }
}

/// The message of the operating system, without its number.
fn os_message(reason: &std::io::Error) -> String {
    let text = reason.to_string();
    text.split(" (os error").next().unwrap_or(&text).to_owned()
}

/// The argument or the call of a remedy.
pub(super) fn call(remedy: &Remedy) -> String {
    let call = match remedy {
        Remedy::MaxDelay => "max_delay=",
        Remedy::StepTime => "time=",
        Remedy::Model => "model=",
        Remedy::Rename => "`log.rename({name: column})`",
        Remedy::ColumnOf { channel } => return format!("`log.rename({{\"{channel}\": column}})`"),
        Remedy::Columns { of } => {
            let each: Vec<String> =
                of.iter().map(|(name, column)| format!("\"{name}\": \"{column}\"")).collect();
            return format!("`log.rename({{{}}})`", each.join(", "));
        }
        Remedy::NewNames => "the new names make",
        Remedy::Events => "them to deadtime.estimate_events",
        Remedy::Channels => "input= and output=",
        Remedy::Records => "with `deadtime.read_records(path, column)`",
        Remedy::Window => "`log.window(start, stop)`",
        Remedy::Resample => "`log.resample(sample_time)`",
        Remedy::ResampleAt { seconds } => return format!("`log.resample({seconds})`"),
        Remedy::TimeColumn => "time=",
        Remedy::TimeUnit => "time_unit=",
        Remedy::ColumnNames => "columns=",
        Remedy::Only { column, value } => {
            return format!("where=(\"{column}\", \"{value}\")");
        }
        Remedy::Missing { number } => return format!("missing=[{number}]"),
        Remedy::Unchecked => "unchecked=True",
        Remedy::HeaderStamps => "stamps=\"header\"",
        Remedy::ClosedLoop => "loop=\"closed\"",
        Remedy::Delay => "delay=",
        Remedy::States => "states={name: (channel, std)}",
        Remedy::Candidate { term } => return format!("`model.with_candidate(\"{term}\")`"),
        Remedy::FitParameters => "`deadtime.identify_structure(log, model, \"all\")`",
        Remedy::Identify => "`deadtime.identify`",
        Remedy::RestartEvery => "restart_every=",
        Remedy::LookAt => "rows=",
        Remedy::Effects => "a smaller model",
        Remedy::ExportOption { name } => return format!("{name}="),
        Remedy::Resume => "resume=True",
        Remedy::Update => "update=True",
        Remedy::Cases => "cases=",
        Remedy::MaxMemory => "max_memory_gb=",
        Remedy::MaxDisk => "max_disk_gb=",
    };
    call.to_owned()
}
