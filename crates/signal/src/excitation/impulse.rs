//! Impulse: one sample that is not zero.
//!
//! u(k) = amplitude for k = `at`, else 0.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::check;
use super::generator::Excitation;
use crate::error::SignalError;

/// A discrete impulse; held over one sample time by a zero-order hold.
///
/// Fails when: sample `at` is outside the requested samples.
///
/// Source: the thesis, section 4.1.2 (u(0) = 0.01, else 0).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Impulse {
    /// The value at sample `at`, in the input's unit, finite; default 0.01, the thesis' value.
    pub amplitude: f64,
    /// Index of the sample, from 0; default 0.
    pub at: usize,
}

impl Default for Impulse {
    fn default() -> Self {
        Self { amplitude: 0.01, at: 0 }
    }
}

impl Excitation for Impulse {
    fn generate(&self, samples: usize, _rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        check::samples(samples)?;
        check::finite("impulse", "amplitude", self.amplitude)?;
        check::fits("impulse", self.at.saturating_add(1), samples)?;
        Ok((0..samples).map(|k| if k == self.at { self.amplitude } else { 0.0 }).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn impulse_is_one_sample_where_asked() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        assert_eq!(Impulse::default().generate(3, rng).unwrap(), [0.01, 0.0, 0.0]);
        assert_eq!(Impulse { amplitude: -2.0, at: 2 }.generate(3, rng).unwrap(), [0.0, 0.0, -2.0]);
    }

    #[test]
    fn impulse_outside_the_record_is_refused() {
        let refused =
            Impulse { amplitude: 1.0, at: 3 }.generate(3, &mut ChaCha8Rng::seed_from_u64(1));
        assert_eq!(
            refused,
            Err(SignalError::TooFewSamples { signal: "impulse", needed: 4, got: 3 })
        );
    }
}
