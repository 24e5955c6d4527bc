//! The sections of a diagnosis.

mod acts;
mod along_the_run;
pub(in crate::diagnose) mod alternatives;
pub(in crate::diagnose) mod cause;
pub(in crate::diagnose) mod contributions;
pub(in crate::diagnose) mod experiment;
pub(in crate::diagnose) mod force_profile;
mod forms;
pub(in crate::diagnose) mod found_effects;
pub(in crate::diagnose) mod handed;
mod horizons;
pub(in crate::diagnose) mod improvement;
pub(in crate::diagnose) mod isolability;
pub(in crate::diagnose) mod later_rows;
pub(in crate::diagnose) mod location;
mod log_by_log;
pub(in crate::diagnose) mod missing_force;
pub(in crate::diagnose) mod nominal;
pub(in crate::diagnose) mod nuisances;
pub(in crate::diagnose) mod probabilities;
pub(in crate::diagnose) mod traces;
pub(in crate::diagnose) mod trims;
