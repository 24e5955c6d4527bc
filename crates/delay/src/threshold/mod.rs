//! Thresholds on an estimated impulse or step response.

pub(super) mod cusum;
pub(super) mod cusum_step;
pub(super) mod impulse;
pub(super) mod impulseest;
pub(crate) mod response;
pub(super) mod step;
