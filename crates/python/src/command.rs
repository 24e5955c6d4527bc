//! The command line, for those who installed the program with pip.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs the program with these words, its own name first; its exit code.
#[pyfunction]
fn _command(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| deadtime::cli::main(words))
}

pub(super) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(_command, m)?)
}
