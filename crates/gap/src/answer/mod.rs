//! The sections of a diagnosis.

mod acts;
mod along_the_run;
pub(crate) mod alternatives;
pub(crate) mod cause;
pub(crate) mod contributions;
pub(crate) mod experiment;
pub(crate) mod force_profile;
mod forms;
pub(crate) mod found_effects;
pub(crate) mod handed;
mod horizons;
pub(crate) mod improvement;
pub(crate) mod isolability;
pub(crate) mod later_rows;
pub(crate) mod location;
mod log_by_log;
pub(crate) mod missing_force;
pub(crate) mod nominal;
pub(crate) mod nuisances;
pub(crate) mod probabilities;
pub(crate) mod traces;
pub(crate) mod trims;
