//! Continuous-time transfer functions with real-valued dead times, from sampled records.
//!
//! How it can be wrong: another minimum (starts from filtered least squares at several corners, refined by instruments, and from a subspace model; a model far
//! worse than the subspace model of its order is refused), an input that is not held between its samples (a bias of half a sample of delay and more), a
//! plant of higher order (its lag is called dead time), coloured noise taken for white (the last steps weigh by the noise's own autoregression).

mod filters;
mod method;
mod point;
mod starts;

pub use method::Srivc;
