//! The native half of the Python package: faces of the crate's types and functions, one file per mirrored module. They only delegate; what a person
//! calls, with its defaults and its neighbours' types, stands in `python/deadtime`.

mod blind;
mod bound;
#[cfg(feature = "cli")]
mod command;
mod compare;
mod convert;
mod delay;
mod diagnose;
mod effect;
mod error;
mod export;
mod file;
mod identify;
mod log;
mod model;
mod response;
mod signal;
mod simulate;
mod state_space;
mod structure;
mod study;
mod track;
mod work;

use pyo3::prelude::*;

#[pymodule(name = "_native")]
fn native(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    blind::add(m)?;
    bound::add(m)?;
    #[cfg(feature = "cli")]
    command::add(m)?;
    compare::add(m)?;
    delay::add(m)?;
    diagnose::add(m)?;
    effect::add(m)?;
    error::add(m)?;
    export::add(m)?;
    file::add(m)?;
    identify::add(m)?;
    log::add(m)?;
    model::add(m)?;
    response::add(m)?;
    signal::add(m)?;
    simulate::add(m)?;
    state_space::add(m)?;
    structure::add(m)?;
    study::add(m)?;
    track::add(m)?;
    work::add(m)?;
    // The list of names that `add` keeps is for `import *`, which nobody does here.
    m.delattr("__all__")
}
