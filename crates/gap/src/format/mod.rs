//! The diagnosis as data, with its caveats, errors and progress.

pub(crate) mod caveat;
pub(crate) mod class;
pub(crate) mod contributions;
pub(crate) mod diagnosis;
pub(crate) mod error;
pub(crate) mod errors_by_mode;
pub(crate) mod found;
pub(crate) mod next_experiment;
pub(crate) mod nuisance;
pub(crate) mod place;
pub(crate) mod progress;
