//! From continuous to sampled models, MATLAB's definitions: one file per conversion.
//!
//! | conversion | fractional input delays |
//! | --- | --- |
//! | zero-order hold, first-order hold | exact, one more state per delayed input |
//! | impulse invariance | exact; with feedthrough kept, D must be 0 at inputs of fractional delay |
//! | Tustin, zero-pole matching | to the nearest whole sample (half a sample up), or a Thiran all-pass filter |
//! | generalised bilinear, forward and backward difference | to the nearest whole sample |
//! | least squares | fitted together with the dynamics |

pub(crate) mod conversion;
mod conversions;
mod differences;
mod first_order_hold;
pub(crate) mod hold;
mod impulse;
mod least_squares;
mod matched;
mod thiran;
mod tustin;
mod zero_order_hold;

pub use conversion::{Conversion, Converted};
pub use conversions::CONVERSIONS;
pub use differences::{BackwardDifference, ForwardDifference, GeneralisedBilinear};
pub use first_order_hold::FirstOrderHold;
pub use hold::Hold;
pub use hold::{delayed_taps, transition};
pub use impulse::{Feedthrough, ImpulseInvariant};
pub use least_squares::LeastSquares;
pub use matched::ZeroPoleMatching;
pub use thiran::thiran;
pub use tustin::Tustin;
pub use zero_order_hold::ZeroOrderHold;
