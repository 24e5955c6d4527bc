//! Ordinary differential equations dx/dt = f(t, x), stepped exactly to the instants where the caller must stop: input edges, samples, events.
//!
//! Explicit Runge-Kutta steps as long as they pay, L-stable Rosenbrock steps where the equations are stiff. No allocation after the [`Integrator`] is made.

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
