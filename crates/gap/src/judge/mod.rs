//! The verdict and its inputs: the noise floor, intervals, the prior of the initial state.

pub(crate) mod along_the_run;
pub(crate) mod explainable;
pub(crate) mod floor;
pub(crate) mod forms;
pub(crate) mod intervals;
pub(crate) mod perturbations;
pub(crate) mod prior_sensitivity;
pub(crate) mod rule;
pub(crate) mod verdict;
