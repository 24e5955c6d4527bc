//! A conversion from continuous to sampled time.

use crate::error::ModelError;
use crate::state_space::{Continuous, Sampled, StateSpace};
use deadtime_signal::time::{SampleTime, Samples};

/// A sampled model, or why there is none.
pub type Converted = Result<StateSpace<Sampled>, ModelError>;

/// A conversion from continuous to sampled time; the implementor is its option struct.
pub trait Conversion: Send + Sync {
    /// The sampled model.
    ///
    /// # Errors
    /// A [`ModelError`] for a model that the conversion cannot handle.
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Converted;

    /// The whole samples to which a delay is rounded, by a conversion without fractional delays; `None` where it represents the delay.
    fn rounds(&self, _: Samples) -> Option<usize> {
        None
    }

    /// The first states of the sampled model are those of the continuous one at the sampling instants.
    fn keeps_states(&self) -> bool {
        false
    }
}

/// Checks for one input and one output; the error asks to select them.
pub(super) fn single(method: &'static str, sys: &StateSpace<Continuous>) -> Result<(), ModelError> {
    if (sys.inputs(), sys.outputs()) == (1, 1) {
        Ok(())
    } else {
        Err(ModelError::NotSingle { method, inputs: sys.inputs(), outputs: sys.outputs() })
    }
}
