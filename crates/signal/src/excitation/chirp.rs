//! Chirp: a sine whose frequency sweeps from one value to another.
//!
//! u(k) = amplitude·sin φ(k), dφ/dk = π·f(k), f in fractions of the Nyquist frequency, x = k/(N − 1). Linear: f = f₀ + (f₁ − f₀)·x. Logarithmic: f =
//! f₀·(f₁/f₀)ˣ. The frequency is f₀ at the first sample and f₁ at the last.

use std::f64::consts::PI;

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::check;
use super::generator::Excitation;
use crate::error::SignalError;

/// How the frequency moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sweep {
    /// By equal amounts in equal times.
    #[default]
    Linear,
    /// By equal factors in equal times: each octave lasts as long as the next.
    Logarithmic,
}

/// A chirp over the whole record, beginning at zero.
///
/// Fails when: a logarithmic sweep is to begin or end at frequency zero.
///
/// Source: R. Pintelon and J. Schoukens, 2012, "System Identification: A Frequency Domain Approach", 2nd edition, chapter 5 (swept sine).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Chirp {
    /// The sine's amplitude, in the input's unit, finite; default 1.
    pub amplitude: f64,
    /// Frequency at the first sample, a fraction of the Nyquist frequency from 0 to 1 (above 0 if logarithmic); default 0.01.
    pub from: f64,
    /// Frequency at the last sample, a fraction of the Nyquist frequency from 0 to 1 (above 0 if logarithmic); default 0.5.
    pub to: f64,
    /// How the frequency moves; default linearly.
    pub sweep: Sweep,
}

impl Default for Chirp {
    fn default() -> Self {
        Self { amplitude: 1.0, from: 0.01, to: 0.5, sweep: Sweep::Linear }
    }
}

impl Excitation for Chirp {
    fn generate(&self, samples: usize, _rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        let Self { amplitude, from, to, sweep } = *self;
        check::samples(samples)?;
        check::finite("chirp", "amplitude", amplitude)?;
        for (option, f) in [("from", from), ("to", to)] {
            check::fraction("chirp", option, f)?;
            if sweep == Sweep::Logarithmic {
                check::positive("chirp", option, f)?;
            }
        }
        // A record of one sample has no duration; its only value is sin 0.
        let duration = samples.saturating_sub(1).max(1) as f64;
        let ln_ratio = (to / from).ln();
        let phase = |k: usize| {
            let (k, x) = (k as f64, k as f64 / duration);
            match sweep {
                Sweep::Linear => PI * k * (from + (to - from) * x / 2.0),
                Sweep::Logarithmic if ln_ratio == 0.0 => PI * k * from,
                Sweep::Logarithmic => PI * from * duration * (ln_ratio * x).exp_m1() / ln_ratio,
            }
        };
        Ok((0..samples).map(|k| amplitude * phase(k).sin()).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    fn generate(chirp: Chirp, samples: usize) -> Result<Vec<f64>, SignalError> {
        chirp.generate(samples, &mut ChaCha8Rng::seed_from_u64(1))
    }

    /// Upward zero crossings, linearly interpolated, in samples.
    fn crossings(u: &[f64]) -> Vec<f64> {
        u.windows(2)
            .enumerate()
            .filter(|(_, w)| w[0] < 0.0 && w[1] >= 0.0)
            .map(|(k, w)| k as f64 - w[0] / (w[1] - w[0]))
            .collect()
    }

    #[test]
    fn frequency_sweeps_as_asked_between_its_ends() {
        for sweep in [Sweep::Linear, Sweep::Logarithmic] {
            let u = generate(Chirp { from: 0.005, to: 0.05, sweep, ..Chirp::default() }, 20_000)
                .unwrap();
            for pair in crossings(&u).windows(2) {
                let (measured, x) =
                    (2.0 / (pair[1] - pair[0]), (pair[0] + pair[1]) / 2.0 / 19_999.0);
                let want = match sweep {
                    Sweep::Linear => 0.005 + 0.045 * x,
                    Sweep::Logarithmic => 0.005 * 10.0_f64.powf(x),
                };
                assert!(
                    (measured / want - 1.0).abs() < 0.01,
                    "{sweep:?} at {x}: {measured} instead of {want}"
                );
            }
        }
    }

    #[test]
    fn sweep_between_equal_frequencies_is_a_sine() {
        for sweep in [Sweep::Linear, Sweep::Logarithmic] {
            let u = generate(Chirp { amplitude: 2.0, from: 0.1, to: 0.1, sweep }, 100).unwrap();
            assert!(
                u.iter()
                    .enumerate()
                    .all(|(k, v)| (v - 2.0 * (PI * 0.1 * k as f64).sin()).abs() < 1e-12)
            );
        }
    }

    #[test]
    fn nearly_equal_frequencies_lose_no_precision() {
        let near = generate(
            Chirp { from: 0.1, to: 0.1 + 1e-14, sweep: Sweep::Logarithmic, ..Chirp::default() },
            1000,
        )
        .unwrap();
        assert!(
            near.iter().enumerate().all(|(k, v)| (v - (PI * 0.1 * k as f64).sin()).abs() < 1e-9)
        );
    }

    #[test]
    fn impossible_frequencies_are_refused() {
        for (from, to) in [(-0.1, 0.5), (0.1, 1.1), (f64::NAN, 0.5)] {
            assert!(generate(Chirp { from, to, ..Chirp::default() }, 10).is_err());
        }
        assert!(generate(Chirp { from: 0.0, ..Chirp::default() }, 10).is_ok());
        let refused =
            generate(Chirp { from: 0.0, sweep: Sweep::Logarithmic, ..Chirp::default() }, 10);
        assert!(matches!(refused, Err(SignalError::Option { option: "from", .. })));
    }
}
