//! The catalogue of effects: [`deadtime::effect`].

use pyo3::prelude::*;

use super::convert::object;
use super::error::OrRaise;
use super::model::Model;
use deadtime::effect::{menu, table};
use deadtime::report::effects::{lines_data, menu_data};
use deadtime::simulate::System;

/// All effects in general, or on every channel of a model that each can act on.
#[pyfunction]
pub(super) fn _effects<'py>(py: Python<'py>, model: Option<&Model>) -> PyResult<Bound<'py, PyAny>> {
    match model {
        None => object(py, &lines_data(&table())),
        // Where operating points are a log's means, their values do not matter here.
        Some(model) => {
            object(py, &menu_data(&menu(&System::new(&model.0, |_| Ok(0.0)).or_raise(py)?)))
        }
    }
}
