//! Phase: of the spectra, or of the all-pass part of a model.

pub(super) mod all_pass;
pub(super) mod arxdap;
pub(super) mod firdap;
pub(super) mod oedap;

pub(super) mod phase_slope;
