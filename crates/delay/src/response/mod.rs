//! Dead times from measured frequency responses H(iω) instead of logs: what an estimator of them is, the list of all, and the whole estimation.
//!
//! A delay is a phase of −ωτ, known modulo a turn: where frequencies stand Δω apart, delays 2π/Δω apart look alike. A plant's own lag, its relative degree beyond the last
//! frequency and its zeros in the right half-plane turn the phase too; what they trade with the delay is in the intervals.

pub(crate) mod bode;
pub(crate) mod estimator;
mod fraction;
pub(crate) mod job;
pub(crate) mod methods;
pub(crate) mod rational;
