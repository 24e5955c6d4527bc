//! Diagnoses on their way out: [`deadtime::export`].

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::error::{OrRaise, raise};
use super::model::Model;
use deadtime::diagnose::{Diagnosis, DiagnosisError};
use deadtime::export::{Source, TARGETS, export};

/// A diagnosis, its text given, for a target: as JSON and as YAML.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(super) fn _export(
    py: Python<'_>,
    text: &str,
    source: String,
    model: Option<PyRef<'_, Model>>,
    deviations: Vec<(String, f64)>,
    widen: f64,
    to: &str,
    options: &str,
) -> PyResult<(String, String)> {
    let diagnosis: Diagnosis = serde_json::from_str(text)
        .map_err(|error| raise(py, DiagnosisError::Unreadable { file: source, source: error }))?;
    let options =
        serde_json::from_str(options).map_err(|e| PyValueError::new_err(e.to_string()))?;
    let source = Source {
        diagnosis: &diagnosis,
        model: model.as_ref().map(|m| &m.0),
        deviations: &deviations,
        widen,
    };
    let made = export(&source, to, options).or_raise(py)?;
    Ok((made.to_json(), made.to_yaml()))
}

/// Name and summary of every target.
#[pyfunction]
pub(super) fn _targets() -> Vec<(&'static str, &'static str)> {
    TARGETS.iter().map(|t| (t.name, t.summary)).collect()
}
