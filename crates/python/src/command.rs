//! The command line, for those who installed the program with pip.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs the program with these words, its own name first; its exit code. Ctrl-C removes half-written files, as in the program itself.
#[pyfunction]
pub(super) fn _command(py: Python<'_>, words: Vec<OsString>) -> u8 {
    deadtime::cli::end_when_asked();
    py.detach(|| deadtime::cli::main(words))
}
