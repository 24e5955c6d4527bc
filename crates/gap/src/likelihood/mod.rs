//! How well effects at work describe the logs: whitened residuals with the nuisances integrated out.

pub(crate) mod active_effects;
mod best_start;
pub(crate) mod constants;
pub(crate) mod errors;
pub(crate) mod gaussian;
mod log_start;
mod nuisances;
pub(crate) mod residuals;
#[cfg(test)]
pub(crate) mod servo;
mod simulated;
