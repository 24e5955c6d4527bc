//! The model as it is on the logs: how it predicts, how far everything moves, how large the noise is.

pub(crate) mod feedback;
pub(crate) mod motion;
pub(crate) mod noise;
pub(crate) mod predictor;
pub(crate) mod runaway;
pub(crate) mod spectrum;
