//! Step: zero, then a constant.
//!
//! u(k) = 0 for k < `at`, amplitude from there on.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::check;
use super::generator::Excitation;
use crate::error::SignalError;

/// A step.
///
/// Fails when: sample `at` is outside the requested samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Step {
    /// The value after the step, in the input's unit, finite; default 1.
    pub amplitude: f64,
    /// Index of the first sample of that value, from 0; default 10, so that the record shows the rest before the step.
    pub at: usize,
}

impl Default for Step {
    fn default() -> Self {
        Self { amplitude: 1.0, at: 10 }
    }
}

impl Excitation for Step {
    fn generate(&self, samples: usize, _rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        check::samples(samples)?;
        check::finite("step", "amplitude", self.amplitude)?;
        check::fits("step", self.at.saturating_add(1), samples)?;
        Ok((0..samples).map(|k| if k < self.at { 0.0 } else { self.amplitude }).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn step_holds_its_value_from_its_sample_on() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        assert_eq!(Step { amplitude: 2.0, at: 2 }.generate(4, rng).unwrap(), [0.0, 0.0, 2.0, 2.0]);
        assert_eq!(Step { amplitude: 2.0, at: 0 }.generate(2, rng).unwrap(), [2.0, 2.0]);
    }

    #[test]
    fn step_after_the_record_is_refused() {
        let refused = Step::default().generate(10, &mut ChaCha8Rng::seed_from_u64(1));
        assert_eq!(
            refused,
            Err(SignalError::TooFewSamples { signal: "step", needed: 11, got: 10 })
        );
    }
}
