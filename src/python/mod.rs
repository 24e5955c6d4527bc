//! The native half of the Python package: faces of the crate's types and functions, one file per mirrored module. They only delegate; what a person
//! calls, with its defaults and its neighbours' types, stands in `python/deadtime`.

#[cfg(feature = "cli")]
mod command;
mod convert;
mod error;
mod log;
mod model;
mod simulate;
mod state_space;
mod work;

use pyo3::prelude::*;

#[pymodule(name = "_native")]
fn native(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    #[cfg(feature = "cli")]
    command::add(m)?;
    error::add(m)?;
    log::add(m)?;
    model::add(m)?;
    simulate::add(m)?;
    state_space::add(m)?;
    work::add(m)
}
