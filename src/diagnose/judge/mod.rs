//! The verdict and what it rests on: the noise floor, intervals, the prior of the start.

pub(in crate::diagnose) mod explainable;
pub(in crate::diagnose) mod floor;
pub(in crate::diagnose) mod intervals;
pub(in crate::diagnose) mod perturbations;
pub(in crate::diagnose) mod prior_sensitivity;
pub(in crate::diagnose) mod rule;
pub(in crate::diagnose) mod verdict;
