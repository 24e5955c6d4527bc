//! Values of the crate as Python's own, and back.

use nalgebra::DMatrix;
use numpy::{AllowTypeChange, IntoPyArray, PyArray1, PyArray2, PyArrayLike1, PyArrayLike2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::error::OrRaise;
use deadtime::model::c2d::{CONVERSIONS, Conversion};
use deadtime::registry::find;
use deadtime::time::SampleTime;

/// Anything that serde writes as JSON, as dicts, lists, numbers, strings and None; a number that is not finite is None.
pub(super) fn object<'py>(
    py: Python<'py>,
    value: &impl serde::Serialize,
) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (compact(value)?,))
}

/// The same as text on one line.
pub(super) fn compact(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(value_error)
}

/// The same as the text of a file.
pub(super) fn text(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string_pretty(value).map_err(value_error)
}

/// An error that only a caller's values can bring about.
pub(super) fn value_error(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The other way, for options and plans.
pub(super) fn json(value: &Bound<'_, PyAny>) -> PyResult<serde_json::Value> {
    let text: String = value.py().import("json")?.call_method1("dumps", (value,))?.extract()?;
    serde_json::from_str(&text).map_err(value_error)
}

/// One number after the other, of an array or of anything that NumPy makes one of.
pub(super) type Numbers<'py> = PyArrayLike1<'py, f64, AllowTypeChange>;
/// Rows and columns of the same.
pub(super) type Table<'py> = PyArrayLike2<'py, f64, AllowTypeChange>;

/// A copy of the values, in order.
pub(super) fn vector(numbers: &Numbers<'_>) -> Vec<f64> {
    numbers.as_array().iter().copied().collect()
}

/// A copy of the rows and columns.
pub(super) fn matrix(table: &Table<'_>) -> DMatrix<f64> {
    let view = table.as_array();
    DMatrix::from_fn(view.nrows(), view.ncols(), |i, j| view[(i, j)])
}

/// An array that takes the numbers over.
pub(super) fn array1(py: Python<'_>, numbers: Vec<f64>) -> Bound<'_, PyArray1<f64>> {
    numbers.into_pyarray(py)
}

/// An array of the same shape that takes the numbers over, column after column in memory as they are.
pub(super) fn array2(py: Python<'_>, matrix: DMatrix<f64>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    use numpy::PyArrayMethods;
    let (rows, columns) = matrix.shape();
    let numbers: Vec<f64> = matrix.data.into();
    numbers
        .into_pyarray(py)
        .reshape_with_order([rows, columns], numpy::npyffi::NPY_ORDER::NPY_FORTRANORDER)
}

/// A sample time, and a conversion by its name with its options.
pub(super) fn conversion(
    py: Python<'_>,
    sample_time: f64,
    method: &str,
    options: &Bound<'_, PyAny>,
) -> PyResult<(SampleTime, Box<dyn Conversion>)> {
    let options = json(options)?;
    let conversion = find(CONVERSIONS, "conversion", method)
        .and_then(|entry| entry.with(options))
        .or_raise(py)?;
    Ok((SampleTime::new(sample_time).or_raise(py)?, conversion))
}
