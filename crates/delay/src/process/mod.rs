//! Process models of one to three poles, with or without a zero.

mod chain;
pub(crate) mod family;
mod fit;
mod guesses;
pub(crate) mod identified;
pub(crate) mod integrating;
mod integrator;
pub(crate) mod model;
pub(crate) mod orders;
mod reach;
pub(crate) mod shares;
mod solved;
mod structure;
