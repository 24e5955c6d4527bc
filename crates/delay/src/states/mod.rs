//! Delays from measured states and known dynamics.

pub(super) mod state_least_squares;

pub use state_least_squares::{Coefficients, Selection, StateLeastSquares};
