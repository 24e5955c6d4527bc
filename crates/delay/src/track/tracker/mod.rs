//! The delay of a machine that runs: sample by sample, in bounded memory.

mod following;
mod learning;
pub(crate) mod online;
mod past;
mod rows;
