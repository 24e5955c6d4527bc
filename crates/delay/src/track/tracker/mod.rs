//! The delay of a running machine: sample by sample, in bounded memory.

mod following;
mod learning;
pub(crate) mod online;
pub(crate) mod options;
mod past;
mod rows;
