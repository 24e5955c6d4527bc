//! Phase: of the spectra, or of the all-pass part of a model.

pub(super) mod all_pass;
pub(super) mod arxdap;
pub(super) mod firdap;
pub(super) mod oedap;

pub use arxdap::Arxdap;
pub use firdap::Firdap;
pub use oedap::Oedap;

pub(super) mod phase_slope;

pub use phase_slope::PhaseSlope;
