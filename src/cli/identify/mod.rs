//! `deadtime identify`: from logs to a model file, or to the parameters of one.

pub(crate) mod command;
mod common;
mod linear;
mod matching;
mod structured;
