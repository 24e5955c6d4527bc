//! Algebraic Riccati equations, discrete and continuous, their regulators and filters.

pub(crate) mod continuous;
pub(crate) mod discrete;
mod doubling;
pub(crate) mod filter;
mod newton;
pub(crate) mod regulator;
