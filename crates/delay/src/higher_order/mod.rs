//! Third-order statistics.

pub(super) mod bispectrum;
