//! Nonlinear models written as equations: dx/dt and the outputs as expressions in states, inputs, parameters and `time`.
//!
//! Expressions are compiled once to a flat program; an evaluation allocates nothing. Parameters are an argument of every evaluation, so that a fit can change
//! them. Jacobians are exact (forward-mode derivatives of the same program).

pub(crate) mod error;
pub(crate) mod explain;
mod function;
pub(crate) mod inner;
pub(crate) mod parse;
mod program;
pub(crate) mod system;
#[cfg(test)]
mod tests;
pub(crate) mod token;
