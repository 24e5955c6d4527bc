//! Dead times from measured frequency responses H(iω) instead of logs: the estimator trait, the list of all, and the whole estimation.
//!
//! A delay is a phase of −ωτ, determined modulo one turn: with a frequency spacing Δω, delays at the distance 2π/Δω are aliases. A plant's own lag, its
//! relative degree beyond the last frequency and its right half-plane zeros turn the phase, too. The intervals include their trade-off with the delay.

pub(crate) mod bode;
pub(crate) mod estimator;
mod fraction;
pub(crate) mod job;
pub(crate) mod methods;
pub(crate) mod rational;
