//! The verdict on the estimates of many methods for one pair.

pub(crate) mod answer;
pub(crate) mod conclusion;
mod earned;
mod mixture;
mod number;
pub(crate) mod refusal;
mod votes;
pub(crate) mod weighing;
mod words;
