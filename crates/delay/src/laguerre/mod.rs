//! Laguerre series: of the plant's response, and of the signals.

pub(super) mod fischer;
pub(super) mod lagudap;
