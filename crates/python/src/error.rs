//! Errors as Python exceptions: one class per kind, all of them in `deadtime.errors`.

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyType;

use deadtime::Error;

/// The classes of `deadtime.errors`, beside their base `DeadtimeError`; a test holds them against the module.
const CLASSES: [&str; 13] = [
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

/// The class that stands for an error; `None` where nobody waits for the answer any more.
fn class(error: &Error) -> Option<&'static str> {
    Some(match error {
        // Whoever met the sample time or delay first.
        Error::Time(_)
        | Error::Model(deadtime::model::ModelError::Time(_))
        | Error::Simulate(deadtime::simulate::SimulateError::DelayTime(_)) => "TimeError",
        Error::Log(_) | Error::Derived(_) => "LogError",
        Error::Model(_) | Error::Structured(_) | Error::Matching(_) | Error::Identify(_) => "ModelError",
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
    let class = |name: &str| -> PyResult<Bound<'_, PyType>> { Ok(py.import("deadtime.errors")?.getattr(name)?.cast_into()?) };
    match (class(name), &error) {
        (Ok(class), Error::File(deadtime::file::FileError::Io { path, source })) => {
            PyErr::from_type(class, (source.raw_os_error(), os_message(source), path.clone().into_os_string()))
        }
        (Ok(class), _) => PyErr::from_type(class, in_python(&deadtime::text::message(&error.to_string()))),
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

pub(super) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("ERROR_CLASSES", CLASSES)
}

/// What the operating system said, without the number that stands beside it.
fn os_message(source: &std::io::Error) -> String {
    let text = source.to_string();
    text.split(" (os error").next().unwrap_or(&text).to_owned()
}

/// Words of the library's messages, and what a reader of Python has for each.
const REMEDIES: [(&str, &str); 18] = [
    ("`max_delay`", "max_delay="),
    ("give a `model` and", "give model= and"),
    ("(`rename`)", "(log.rename)"),
    ("give two sequences of them", "give deadtime.estimate_events"),
    ("give `model`, such as", "give model=, such as"),
    ("give the option inertia={", "give inertia={"),
    ("give an input and an output", "give input= and output="),
    ("to `read_records`", "with `deadtime.read_records(path, column)`"),
    ("take another `window` of the log", "take another `log.window(start, stop)`"),
    ("a wider `window`", "a wider `log.window(start, stop)`"),
    ("choose a `window`", "choose `log.window(start, stop)`"),
    ("`resample(", "`log.resample("),
    ("give `resample` a larger", "give `log.resample(sample_time)` a larger"),
    ("`rename` each column once", "give each column one `log.rename({model_name: column})`"),
    ("`resume`", "resume=True"),
    ("`update`", "update=True"),
    ("the folder of the `cases`", "the folder of the cases by cases="),
    ("the log is said to be of a closed loop", "loop=\"closed\""),
];

/// A message with the remedies of Python: options are arguments, called alike.
pub(super) fn in_python(message: &str) -> String {
    let mut text = REMEDIES.iter().fold(message.to_owned(), |text, (option, call)| text.replace(option, call));
    // `--map NAME=COLUMN` of a name that is known.
    while let Some((before, after)) = text.split_once("--map ")
        && let Some((name, rest)) = after.split_once("=COLUMN")
    {
        text = format!("{before}log.rename({{\"{name}\": column}}){rest}");
    }
    let mut plain = String::with_capacity(text.len());
    let mut rest = text.as_str();
    while let Some((before, after)) = rest.split_once("--") {
        let name: String = after.chars().take_while(|c| c.is_ascii_lowercase() || *c == '-').collect();
        let begins = before.chars().next_back().is_none_or(|c| !c.is_ascii_alphanumeric() && c != '-');
        plain.push_str(before);
        if begins && name.starts_with(|c: char| c.is_ascii_lowercase()) {
            plain.push_str(&name.replace('-', "_"));
            plain.push('=');
        } else {
            plain.push_str("--");
            plain.push_str(&name);
        }
        rest = &after[name.len()..];
    }
    plain + rest
}
