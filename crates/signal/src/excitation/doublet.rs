//! Doublet: a pulse up, then the same pulse down.
//!
//! u(k) = amplitude for `at` ≤ k < `at` + `width`, −amplitude for the next `width` samples, else 0. Its sum is zero.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::check;
use super::generator::Excitation;
use crate::error::SignalError;

/// A doublet, the flight tester's input for one mode: its spectrum peaks near 0.37/(`width`·Ts) Hz.
///
/// Fails when: the whole doublet does not fit into the requested samples.
///
/// Source: R. V. Jategaonkar, 2006, "Flight Vehicle System Identification: A Time-Domain Methodology", chapter on data gathering.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Doublet {
    /// Height of the first pulse, in the input's unit, finite; default 1.
    pub amplitude: f64,
    /// Index of the first pulse's first sample, from 0; default 10.
    pub at: usize,
    /// Duration of each pulse, in samples, at least 1; default 10.
    pub width: usize,
}

impl Default for Doublet {
    fn default() -> Self {
        Self { amplitude: 1.0, at: 10, width: 10 }
    }
}

impl Excitation for Doublet {
    fn generate(&self, samples: usize, _rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        let Self { amplitude, at, width } = *self;
        check::samples(samples)?;
        check::finite("doublet", "amplitude", amplitude)?;
        check::at_least("doublet", "width", width, 1)?;
        check::fits("doublet", width.saturating_mul(2).saturating_add(at), samples)?;
        let mut u = vec![0.0; samples];
        u[at..at + width].fill(amplitude);
        u[at + width..at + 2 * width].fill(-amplitude);
        Ok(u)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn doublet_goes_up_then_down_and_sums_to_zero() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        let u = Doublet { amplitude: 0.5, at: 1, width: 2 }.generate(7, rng).unwrap();
        assert_eq!(u, [0.0, 0.5, 0.5, -0.5, -0.5, 0.0, 0.0]);
        assert_eq!(Doublet::default().generate(151, rng).unwrap().iter().sum::<f64>(), 0.0);
    }

    #[test]
    fn spectrum_peaks_where_the_doc_says() {
        let u = Doublet { amplitude: 1.0, at: 0, width: 100 }
            .generate(200, &mut ChaCha8Rng::seed_from_u64(1))
            .unwrap();
        let power = |f: f64| {
            let (mut re, mut im) = (0.0, 0.0);
            for (k, v) in u.iter().enumerate() {
                let (sin, cos) = (2.0 * std::f64::consts::PI * f * k as f64).sin_cos();
                (re, im) = (re + v * cos, im + v * sin);
            }
            re * re + im * im
        };
        let peak = (1..1000)
            .map(|i| f64::from(i) * 1e-5)
            .max_by(|a, b| power(*a).total_cmp(&power(*b)))
            .unwrap();
        assert!((peak * 100.0 - 0.37).abs() < 0.005, "{peak}");
    }

    #[test]
    fn doublet_that_does_not_fit_is_refused() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        let refused = Doublet::default().generate(29, rng);
        assert_eq!(
            refused,
            Err(SignalError::TooFewSamples { signal: "doublet", needed: 30, got: 29 })
        );
        assert!(Doublet { width: 0, ..Doublet::default() }.generate(100, rng).is_err());
    }
}
