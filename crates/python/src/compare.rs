//! Results side by side: [`deadtime::compare`].

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde::de::DeserializeOwned;

use deadtime::compare::{diagnoses, studies};
use deadtime::report::{compare, page};

/// Names and texts of diagnoses, or of studies: the comparison as JSON, as text, and as a page.
#[pyfunction]
fn _compare(
    py: Python<'_>,
    kind: &str,
    named: Vec<(String, String)>,
) -> PyResult<(String, String, String)> {
    py.detach(|| match kind {
        "diagnosis" => {
            let found = diagnoses(&read(named)?);
            Ok((json(&found)?, compare::diagnoses(&found), page::compared_diagnoses(&found)))
        }
        _ => {
            let found = studies(&read(named)?);
            Ok((json(&found)?, compare::studies(&found), page::compared_studies(&found)))
        }
    })
}

fn read<T: DeserializeOwned>(named: Vec<(String, String)>) -> PyResult<Vec<(String, T)>> {
    let one = |(name, text): (String, String)| match serde_json::from_str(&text) {
        Ok(found) => Ok((name, found)),
        Err(error) => Err(PyValueError::new_err(format!("{name}: {error}"))),
    };
    named.into_iter().map(one).collect()
}

fn json(found: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string_pretty(found).map_err(|e| PyValueError::new_err(e.to_string()))
}

pub(super) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(_compare, m)?)
}
