//! From continuous to sampled models, MATLAB's definitions: one file per conversion.
//!
//! | conversion | fractional input delays |
//! | --- | --- |
//! | zero-order hold, first-order hold | exact, one more state per delayed input |
//! | impulse invariance | exact; with feedthrough kept, D must be 0 at inputs of fractional delay |
//! | Tustin, zero-pole matching | to the nearest whole sample (half a sample up), or a Thiran all-pass filter |
//! | least squares | fitted together with the dynamics |

mod first_order_hold;
mod hold;
mod impulse;
mod least_squares;
mod matched;
mod thiran;
mod tustin;
mod zero_order_hold;

pub use first_order_hold::FirstOrderHold;
pub use impulse::{Feedthrough, ImpulseInvariant};
pub use least_squares::LeastSquares;
pub use matched::ZeroPoleMatching;
pub use tustin::Tustin;
pub use zero_order_hold::ZeroOrderHold;

pub use hold::Hold;
pub use hold::{delayed_taps, transition};

use super::{Continuous, ModelError, Sampled, StateSpace};
use deadtime_signal::registry::{Entry, entry};
use deadtime_signal::time::SampleTime;

/// A conversion from continuous to sampled time; the implementor is its option struct.
pub trait Conversion: Send + Sync {
    /// The sampled model.
    ///
    /// # Errors
    /// What the conversion cannot do for this model, as a [`ModelError`].
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Result<StateSpace<Sampled>, ModelError>;

    /// The first states of the sampled model are those of the continuous one at the sampling instants.
    fn keeps_states(&self) -> bool {
        false
    }
}

/// Every conversion.
pub const CONVERSIONS: &[Entry<dyn Conversion>] = &[
    entry!("zoh", "zero-order hold: exact where the input is held between samples", ZeroOrderHold, dyn Conversion),
    entry!("foh", "first-order (triangle) hold: exact where the input is a straight line between samples", FirstOrderHold, dyn Conversion),
    entry!("impulse", "impulse-invariant: the sampled impulse response times the sample time", ImpulseInvariant, dyn Conversion),
    entry!("tustin", "Tustin (bilinear), with an optional frequency at which the response is exact", Tustin, dyn Conversion),
    entry!("matched", "zero-pole matching, for one input and one output", ZeroPoleMatching, dyn Conversion),
    entry!("least_squares", "the nearest frequency response up to Nyquist, for one input and one output", LeastSquares, dyn Conversion),
];

/// The one input and output of a model, or the error that asks to select them.
fn single(method: &'static str, sys: &StateSpace<Continuous>) -> Result<(), ModelError> {
    if (sys.inputs(), sys.outputs()) == (1, 1) {
        Ok(())
    } else {
        Err(ModelError::NotSingle { method, inputs: sys.inputs(), outputs: sys.outputs() })
    }
}
