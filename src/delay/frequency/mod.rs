//! Phase: of the spectra, or of the all-pass part of a model.

pub(super) mod phase_slope;

pub use phase_slope::PhaseSlope;
