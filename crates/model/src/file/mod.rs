//! The model file, `deadtime/model@1`: TOML or JSON by its extension; linear, as equations or as transfer functions by its `kind`.

#![deny(clippy::indexing_slicing)]

pub(crate) mod candidate;
pub(crate) mod channel;
mod check;
mod compiled_candidates;
pub(crate) mod document;
pub(crate) mod equations;
pub(crate) mod lti;
pub(crate) mod nuisance;
mod table;
mod text;
mod transfer;
