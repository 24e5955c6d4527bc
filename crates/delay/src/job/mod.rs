//! The whole estimation: the methods asked for on every pair of a log, what the record shows, the expected accuracy and the verdict.

mod answers;
pub(crate) mod asked;
pub(crate) mod chosen;
pub(crate) mod estimation;
pub(crate) mod events;
mod pair;
mod poor;
mod seen;
mod states;
mod words;
