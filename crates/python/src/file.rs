//! Files written whole or not at all: [`deadtime::file`].

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use pyo3::prelude::*;

use super::error::OrRaise;
use deadtime::file::{Lock as Inner, read_text, write_atomic};

/// Writes bytes under a temporary name, which becomes the file's once it is whole.
#[pyfunction]
pub(super) fn _write_whole(py: Python<'_>, path: PathBuf, bytes: &[u8]) -> PyResult<()> {
    py.detach(|| write_atomic(&path, |out| out.write_all(bytes))).or_raise(py)
}

/// The text of a file with instructions.
#[pyfunction]
pub(super) fn _read_text(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    py.detach(|| read_text(&path)).or_raise(py)
}

/// Held while a run writes to a folder.
#[pyclass(frozen, module = "deadtime._native", name = "Lock")]
pub(super) struct Lock(Mutex<Option<Inner>>);

#[pymethods]
impl Lock {
    /// Locks a folder, which is made if it is missing.
    #[new]
    fn new(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        Ok(Self(Mutex::new(Some(py.detach(|| Inner::of(&folder)).or_raise(py)?))))
    }

    /// Lets go of it.
    fn close(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
    }
}
