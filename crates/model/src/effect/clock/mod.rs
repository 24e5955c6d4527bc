//! Effects between the clocks of commands and sensors.

pub(super) mod offset;
pub(super) mod skew;
