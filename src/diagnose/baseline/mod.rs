//! The model as it is on the logs: how it predicts, how far everything moves, how large the noise is.

pub(in crate::diagnose) mod feedback;
pub(in crate::diagnose) mod motion;
pub(in crate::diagnose) mod noise;
pub(in crate::diagnose) mod predictor;
pub(in crate::diagnose) mod runaway;
pub(in crate::diagnose) mod spectrum;
