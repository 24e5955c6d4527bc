//! The nominal model on the logs: its predictions, the motion of all signals, the noise standard deviation.

pub(crate) mod feedback;
pub(crate) mod motion;
pub(crate) mod noise;
pub(crate) mod predictor;
pub(crate) mod runaway;
pub(crate) mod spectrum;
