//! Frequency responses from logs: [`deadtime::identify::response`].

use pyo3::prelude::*;
use serde_json::Value;

use super::convert::{compact, json as from_python};
use super::log::{Log, copies, sources};
use super::work::long;
use deadtime::identify::response::frequency_responses;
use deadtime::report::response::Report;

/// The text of `deadtime/response@1`, and the output of the command line.
#[pyfunction]
pub(super) fn _frequency_response(
    py: Python<'_>,
    logs: Vec<PyRef<'_, Log>>,
    channels: (Vec<String>, Vec<String>, Vec<String>),
    method: String,
    options: &Bound<'_, PyAny>,
    threads: Option<usize>,
) -> PyResult<(String, String)> {
    let options: Value = from_python(options)?;
    let logs = copies(&logs);
    let (data, text) = long(py, threads, move |_| {
        let (inputs, outputs, references) = &channels;
        let found = frequency_responses(&logs, (inputs, outputs, references), &method, options)?;
        let report = Report { logs: sources(&logs), responses: &found };
        Ok((report.data(), report.text()))
    })?;
    Ok((compact(&data)?, text.trim_end().to_owned()))
}
