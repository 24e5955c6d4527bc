//! The active effects: one score for every set of effects, and one search over sets.

mod alternatives;
pub(crate) mod class;
pub(crate) mod conclusion;
mod fit;
pub(crate) mod found;
mod gram;
mod proposals;
mod removals;
mod score;
pub(crate) mod search;
mod set;
mod training;
