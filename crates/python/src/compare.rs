//! Results side by side: [`deadtime::compare`].

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde::de::DeserializeOwned;

use super::convert::text;
use deadtime::compare::{diagnoses, studies};
use deadtime::report::{compare, page};

/// Names and texts of diagnoses, or of studies: the comparison as JSON, as text, and as a page.
#[pyfunction]
pub(super) fn _compare(
    py: Python<'_>,
    kind: &str,
    named: Vec<(String, String)>,
) -> PyResult<(String, String, String)> {
    py.detach(|| match kind {
        "diagnosis" => {
            let found = diagnoses(&read(named)?);
            Ok((text(&found)?, compare::diagnoses(&found), page::compared_diagnoses(&found)))
        }
        _ => {
            let found = studies(&read(named)?);
            Ok((text(&found)?, compare::studies(&found), page::compared_studies(&found)))
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
