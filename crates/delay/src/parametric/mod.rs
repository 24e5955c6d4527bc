//! Sampled models of low order with the delay as a parameter.

pub(super) mod armaxstruc;
pub(super) mod arxstruc;
pub(super) mod delayest;
pub(super) mod elnaggar;
mod evidence;
pub(super) mod ivstruc;
pub(super) mod met1struc;
mod misfit;
pub(super) mod oe_posterior;
pub(super) mod oestruc;
mod profile;
pub(super) mod sampling_zero;
pub(super) mod scans;
pub(super) mod two_step;
