//! Two ramps: up in equal steps, down in as many, then zero.
//!
//! d = amplitude/n. u(k) = k·d for k = 0 … n; u(n + k) = u(n) − k·d for k = 1 … n; zero after that.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::check;
use super::generator::Excitation;
use crate::error::SignalError;

/// The thesis' first input: with the defaults it climbs by 0.0005 to 0.01 at sample 20 and is back at exactly zero at sample 40.
///
/// Fails when: fewer than 2·`steps` + 1 samples are requested.
///
/// Source: the thesis' Algorithm 4.1, "First type of input".
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TwoRamps {
    /// The peak, in the input's unit, finite; default 0.01, the thesis' value.
    pub amplitude: f64,
    /// Steps from zero to the peak, at least 1; default 20, the thesis' value.
    pub steps: usize,
}

impl Default for TwoRamps {
    fn default() -> Self {
        Self { amplitude: 0.01, steps: 20 }
    }
}

impl Excitation for TwoRamps {
    fn generate(&self, samples: usize, _rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        let Self { amplitude, steps } = *self;
        check::samples(samples)?;
        check::finite("two_ramps", "amplitude", amplitude)?;
        check::at_least("two_ramps", "steps", steps, 1)?;
        check::fits("two_ramps", steps.saturating_mul(2).saturating_add(1), samples)?;
        let up = |k: usize| k as f64 * (amplitude / steps as f64);
        let mut u = vec![0.0; samples];
        for k in 0..=steps {
            u[k] = up(k);
            u[steps + k] = up(steps) - up(k);
        }
        Ok(u)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    fn generate(signal: TwoRamps, samples: usize) -> Result<Vec<f64>, SignalError> {
        signal.generate(samples, &mut ChaCha8Rng::seed_from_u64(1))
    }

    #[test]
    fn default_is_algorithm_4_1_to_the_bit() {
        let mut thesis: Vec<f64> = (0..=20).map(|k| 0.0 + f64::from(k) * 0.0005).collect();
        let peak = thesis.iter().copied().fold(0.0, f64::max);
        thesis.extend((1..=20).map(|k| peak - f64::from(k) * 0.0005));
        thesis.resize(151, 0.0);
        assert_eq!(generate(TwoRamps::default(), 151).unwrap(), thesis);
    }

    #[test]
    fn peak_is_at_20_and_zero_from_40_on() {
        let u = generate(TwoRamps::default(), 151).unwrap();
        assert_eq!((u[0], u[20], u[40]), (0.0, 0.01, 0.0));
        assert!((u[10] - 0.005).abs() < 1e-17 && (u[30] - 0.005).abs() < 1e-17);
        assert!(u[40..].iter().all(|&v| v == 0.0));
    }

    #[test]
    fn down_ramp_ends_at_exactly_zero_for_any_peak() {
        for steps in 1..60 {
            let u = generate(TwoRamps { amplitude: -0.3, steps }, 2 * steps + 1).unwrap();
            assert_eq!(u[2 * steps].to_bits(), 0.0_f64.to_bits());
        }
    }

    #[test]
    fn ramps_that_do_not_fit_are_refused() {
        let refused = generate(TwoRamps::default(), 40);
        assert_eq!(
            refused,
            Err(SignalError::TooFewSamples { signal: "two_ramps", needed: 41, got: 40 })
        );
        assert!(generate(TwoRamps { amplitude: f64::NAN, steps: 20 }, 100).is_err());
        assert!(generate(TwoRamps { amplitude: 1.0, steps: 0 }, 100).is_err());
    }
}
