//! Continuous models of low order whose dead time is a real number: P1D to P3DZ.
//!
//! Equation: (τ̂, θ̂) = argmin Σ (y(t) − ŷ(t))², ŷ = K·(1 + T_z·s)/D(s)·e^(−τs)·u sampled, u held between its samples, D of one to three poles (see `chain`).

mod chain;
pub(crate) mod family;
mod fit;
pub(crate) mod identified;
mod integrator;
pub(crate) mod model;
pub(crate) mod orders;
pub(crate) mod shares;
