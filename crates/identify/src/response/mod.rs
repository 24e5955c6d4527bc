//! Frequency responses from records without a model: one file a method, one line each in [`RESPONSES`].
//!
//! Both methods say at each line ω: y = G·u + v, with G (l × m), the covariance of the noise v (l × l) and how well the inputs are distinguishable (m × m).
//! From these follow standard deviations, 95 % intervals and coherence alike (`lines`); with a reference, those of a loop (`reference`).

mod lines;
mod lpm;
mod methods;
mod reference;
mod responses;
mod welch;

pub use lines::{Line, Point, Seen};
pub use lpm::LocalPolynomial;
pub use methods::{RESPONSES, frequency_responses};
pub use responses::{ResponseMethod, Responses};
pub use welch::Welch;
