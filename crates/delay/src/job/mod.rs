//! The whole estimation: the methods asked for, on every pair of a log, with what the record shows, what was to be expected and what to believe.

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
