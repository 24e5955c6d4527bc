//! Laguerre series: of the plant's response, and of the signals.

pub(super) mod lagudap;

pub use lagudap::Lagudap;
