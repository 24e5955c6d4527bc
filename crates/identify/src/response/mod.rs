//! Frequency responses from records without a model: one file per method, one line each in [`RESPONSES`].
//!
//! Both methods model each line ω as y = G·u + v. The methods return G (l × m) and the covariance of the noise v (l × l). A third matrix (m × m) measures how
//! distinguishable the inputs are. Standard deviations, 95 % intervals and coherence follow in the same way (`lines`); with a reference, those of a loop
//! (`reference`).

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
