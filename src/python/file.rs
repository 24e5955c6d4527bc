//! Files written whole or not at all: [`crate::file`].

use std::path::PathBuf;

use pyo3::prelude::*;

use super::error::OrRaise;
use crate::file::write_atomic;

/// Writes bytes under a temporary name, which becomes the file's once it is whole.
#[pyfunction]
fn _write_whole(py: Python<'_>, path: PathBuf, bytes: &[u8]) -> PyResult<()> {
    py.detach(|| write_atomic(&path, |out| out.write_all(bytes))).or_raise(py)
}

pub(super) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(_write_whole, m)?)
}
