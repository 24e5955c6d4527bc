//! The delay of a machine that runs: sample by sample, in bounded memory.

mod following;
mod learning;
pub(crate) mod online;
pub(crate) mod options;
mod past;
mod rows;
