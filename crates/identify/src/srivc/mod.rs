//! Continuous-time transfer functions with real-valued dead times, from sampled records.
//!
//! How it can be wrong: another minimum. Starts come from filtered least squares at several corners, refined by instruments, and from a subspace model. A
//! result far worse than the latter is refused. An input that is not held between its samples: the delay's bias is at least half a sample. A plant of higher
//! order: the dead time includes its lag. Coloured noise taken for white: the last steps weight by the noise's own autoregression.

mod filters;
mod method;
mod point;
mod starts;

pub use method::Srivc;
