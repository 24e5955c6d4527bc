//! Thresholds on an estimated impulse or step response.

pub(super) mod impulse;
pub(super) mod step;

pub use impulse::{Records, Threshold};
pub use step::Step;
