//! How well effects at work describe the logs: whitened residuals with the nuisances integrated out.

pub(in crate::diagnose) mod active_effects;
mod best_start;
pub(in crate::diagnose) mod constants;
mod cross_validation;
pub(in crate::diagnose) mod errors;
pub(in crate::diagnose) mod gaussian;
mod nuisances;
pub(in crate::diagnose) mod residuals;
#[cfg(test)]
pub(in crate::diagnose) mod servo;
mod simulated;
