//! Delays from measured states and known dynamics.

pub(super) mod state_least_squares;
