//! Frequency responses from logs: [`deadtime::identify::response`].

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::Value;

use super::convert::json as from_python;
use super::log::Log;
use super::work::long;
use deadtime::identify::response::frequency_responses;
use deadtime::report::response::Report;

/// The text of `deadtime/response@1`, and what the command line prints.
#[pyfunction]
fn _frequency_response(
    py: Python<'_>,
    logs: Vec<PyRef<'_, Log>>,
    channels: (Vec<String>, Vec<String>, Vec<String>),
    method: String,
    options: &Bound<'_, PyAny>,
    threads: Option<usize>,
) -> PyResult<(String, String)> {
    let options: Value = from_python(options)?;
    let logs: Vec<deadtime::log::Log> = logs.iter().map(|log| log.0.clone()).collect();
    let (data, text) = long(py, threads, move |_| {
        let (inputs, outputs, references) = &channels;
        let found = frequency_responses(&logs, (inputs, outputs, references), &method, options)?;
        let report = Report {
            logs: logs.iter().map(|l| l.source().to_owned()).collect(),
            responses: &found,
        };
        Ok((report.data(), report.text()))
    })?;
    let data = serde_json::to_string(&data).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok((data, text.trim_end().to_owned()))
}

pub(super) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(_frequency_response, m)?)
}
