//! The whole estimation: the requested methods on every pair of a log, the conditions of the record, the predicted accuracy and the verdict.

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
