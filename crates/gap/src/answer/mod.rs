//! The sections of a diagnosis.

pub(crate) mod by_mode;
pub(crate) mod cause;
mod class_probability;
pub(crate) mod classes;
pub(crate) mod contributions;
mod decoded;
pub(crate) mod diagnosed;
pub(crate) mod experiment;
pub(crate) mod force_profile;
pub(crate) mod found_effects;
pub(crate) mod handed;
pub(crate) mod held_out;
mod horizons;
pub(crate) mod improvement;
pub(crate) mod isolability;
pub(crate) mod later_rows;
pub(crate) mod location;
mod log_by_log;
pub(crate) mod missing_force;
pub(crate) mod nominal;
pub(crate) mod nuisances;
pub(crate) mod orders;
pub(crate) mod sections;
mod span_residual;
pub(crate) mod traces;
pub(crate) mod trims;
mod unrelated;
