//! Ordinary differential equations dx/dt = f(t, x), stepped exactly to the instants required by the caller: input edges, samples, events.
//!
//! Explicit Runge-Kutta steps while they are efficient, L-stable Rosenbrock steps for stiff equations. No allocation after the [`Integrator`] is made.

mod dormand_prince;
mod drive;
mod event;
pub(crate) mod integrator;
mod lu;
mod past;
pub(crate) mod rhs;
mod rodas;
#[cfg(test)]
mod tests;

pub use integrator::{Integrator, Method};
pub use rhs::Rhs;
