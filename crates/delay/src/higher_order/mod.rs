//! Third-order statistics.

pub(super) mod bispectrum;

pub use bispectrum::Bispectrum;
