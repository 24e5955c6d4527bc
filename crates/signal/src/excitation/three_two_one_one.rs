//! 3-2-1-1: four pulses of alternating sign, 3, 2, 1 and 1 units long.
//!
//! u = +amplitude for 3·`unit` samples from `at` on, − for 2·`unit`, + for `unit`, − for `unit`, else 0.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::check;
use super::generator::Excitation;
use crate::error::SignalError;

/// The pulses' lengths, in units, and signs.
const PULSES: [(usize, f64); 4] = [(3, 1.0), (2, -1.0), (1, 1.0), (1, -1.0)];

/// The 3-2-1-1 of flight testing: a wider band than the doublet's from a still simple manoeuvre. Its sum is one unit, not zero.
///
/// Fails when: its 7·`unit` samples after `at` do not fit into the requested samples.
///
/// Source: R. V. Jategaonkar, 2006, "Flight Vehicle System Identification: A Time-Domain Methodology", chapter on data gathering.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ThreeTwoOneOne {
    /// Height of the pulses, in the input's unit, finite; default 1.
    pub amplitude: f64,
    /// Index of the first pulse's first sample, from 0; default 10.
    pub at: usize,
    /// Duration of one unit, in samples, at least 1; default 10.
    pub unit: usize,
}

impl Default for ThreeTwoOneOne {
    fn default() -> Self {
        Self { amplitude: 1.0, at: 10, unit: 10 }
    }
}

impl Excitation for ThreeTwoOneOne {
    fn generate(&self, samples: usize, _rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        let Self { amplitude, at, unit } = *self;
        check::samples(samples)?;
        check::finite("three_two_one_one", "amplitude", amplitude)?;
        check::at_least("three_two_one_one", "unit", unit, 1)?;
        check::fits("three_two_one_one", unit.saturating_mul(7).saturating_add(at), samples)?;
        let mut u = vec![0.0; samples];
        let mut start = at;
        for (units, sign) in PULSES {
            let end = start + units * unit;
            u[start..end].fill(sign * amplitude);
            start = end;
        }
        Ok(u)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn pulses_last_three_two_one_and_one_units() {
        let u = ThreeTwoOneOne { amplitude: 2.0, at: 1, unit: 1 }
            .generate(9, &mut ChaCha8Rng::seed_from_u64(1))
            .unwrap();
        assert_eq!(u, [0.0, 2.0, 2.0, 2.0, -2.0, -2.0, 2.0, -2.0, 0.0]);
    }

    #[test]
    fn manoeuvre_that_does_not_fit_is_refused() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        let refused = ThreeTwoOneOne::default().generate(79, rng);
        assert_eq!(
            refused,
            Err(SignalError::TooFewSamples { signal: "three_two_one_one", needed: 80, got: 79 })
        );
        assert!(
            ThreeTwoOneOne { unit: 0, ..ThreeTwoOneOne::default() }.generate(100, rng).is_err()
        );
    }
}
