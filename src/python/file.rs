//! Files written whole or not at all: [`crate::file`].

use std::path::PathBuf;

use pyo3::prelude::*;

use super::error::OrRaise;
use crate::file::write_atomic;

/// Writes a text under a temporary name, which becomes the file's once it is whole.
#[pyfunction]
fn _write_text(py: Python<'_>, path: PathBuf, text: &str) -> PyResult<()> {
    py.detach(|| write_atomic(&path, |out| out.write_all(text.as_bytes()))).or_raise(py)
}

pub(super) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(_write_text, m)?)
}
