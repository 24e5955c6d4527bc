//! The verdict and what it rests on: the noise floor, intervals, the prior of the start.

pub(crate) mod explainable;
pub(crate) mod floor;
pub(crate) mod intervals;
pub(crate) mod perturbations;
pub(crate) mod prior_sensitivity;
pub(crate) mod rule;
pub(crate) mod verdict;
