//! Random binary signal: the sign of filtered white Gaussian noise.
//!
//! e: white, Gaussian; v = H·e, H an 8th-order Butterworth filter that passes the band; u(k) = levels by the sign of v(2N + k).

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::check;
use super::generator::Excitation;
use crate::butterworth::Butterworth;
use crate::error::SignalError;

/// A random binary signal as MATLAB's `idinput(N, 'rbs', band, levels)` makes it, from another random generator.
///
/// The 2N samples before the N requested ones let the filter settle. (`idinput` draws 2N more after them, which a causal filter never uses; they are not drawn
/// here). The filter is a low-pass when the band begins at 0, a high-pass when it ends at 1. It is none for [0, 1], and otherwise a band-pass (8th-order
/// prototype, 16 poles). Taking the sign spreads some power outside the band again.
///
/// Source: MATLAB System Identification Toolbox, documentation of `idinput` and `idfilt`;
/// L. Ljung, 1999, "System Identification: Theory for the User", 2nd edition, section 13.3.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Rbs {
    /// Lower and upper edge of the pass band, fractions of the Nyquist frequency, 0 ≤ low < high ≤ 1; default [0, 1], white.
    pub band: [f64; 2],
    /// The two values, in the input's unit, the lower first; default [−1, 1].
    pub levels: [f64; 2],
}

impl Default for Rbs {
    fn default() -> Self {
        Self { band: [0.0, 1.0], levels: [-1.0, 1.0] }
    }
}

impl Excitation for Rbs {
    fn generate(&self, samples: usize, rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        let Self { band, levels: [low, high] } = *self;
        check::samples(samples)?;
        check::band("rbs", band)?;
        check::levels("rbs", [low, high])?;
        let mut filter = Butterworth::pass(band[0], band[1]);
        let mut filtered = || {
            let e: f64 = StandardNormal.sample(rng);
            filter.step(e)
        };
        for _ in 0..2 * samples {
            filtered();
        }
        Ok((0..samples).map(|_| if filtered() < 0.0 { low } else { high }).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fourier::inverse_dft;
    use nalgebra::Complex;
    use rand_chacha::rand_core::SeedableRng;
    use std::f64::consts::{FRAC_2_PI, PI};

    fn generate(band: [f64; 2], samples: usize, seed: u64) -> Vec<f64> {
        Rbs { band, ..Rbs::default() }
            .generate(samples, &mut ChaCha8Rng::seed_from_u64(seed))
            .unwrap()
    }

    /// Mean power per line inside `low..high` (fractions of Nyquist).
    fn density(u: &[f64], low: f64, high: f64) -> f64 {
        let spectrum = inverse_dft(&u.iter().map(|&v| Complex::new(v, 0.0)).collect::<Vec<_>>());
        let n = u.len() as f64;
        let inside: Vec<f64> = (1..u.len() / 2)
            .filter(|&k| (low..high).contains(&(2.0 * k as f64 / n)))
            .map(|k| spectrum[k].norm_sqr())
            .collect();
        inside.iter().sum::<f64>() / inside.len() as f64
    }

    #[test]
    fn rbs_takes_just_its_two_levels() {
        for band in [[0.0, 1.0], [0.0, 0.2], [0.1, 0.3], [0.5, 1.0]] {
            let u = Rbs { band, levels: [-0.01, 0.02] }
                .generate(2000, &mut ChaCha8Rng::seed_from_u64(1))
                .unwrap();
            assert!(u.iter().all(|&v| v == -0.01 || v == 0.02));
            assert!(u.contains(&-0.01) && u.contains(&0.02));
        }
    }

    #[test]
    fn unfiltered_rbs_is_balanced_and_white() {
        let u = generate([0.0, 1.0], 100_000, 2);
        assert!((u.iter().sum::<f64>() / 1e5).abs() < 0.015);
        for lag in 1..10 {
            let r = u.iter().zip(&u[lag..]).map(|(a, b)| a * b).sum::<f64>() / 1e5;
            assert!(r.abs() < 0.015, "lag {lag}: {r}");
        }
    }

    /// Power density of the sign of Gaussian noise through the band's filter (Van Vleck's arcsine law), at a fraction of Nyquist.
    fn arcsine_density(band: [f64; 2]) -> impl Fn(f64) -> f64 {
        let mut filter = Butterworth::pass(band[0], band[1]);
        let h: Vec<f64> = (0..2000).map(|k| filter.step(if k == 0 { 1.0 } else { 0.0 })).collect();
        let r = move |lag: usize| h.iter().zip(&h[lag..]).map(|(a, b)| a * b).sum::<f64>();
        let signs: Vec<f64> = (1..500).map(|lag| FRAC_2_PI * (r(lag) / r(0)).asin()).collect();
        move |f| {
            1.0 + 2.0
                * signs
                    .iter()
                    .zip(1..)
                    .map(|(s, lag)| s * (PI * f * f64::from(lag)).cos())
                    .sum::<f64>()
        }
    }

    #[test]
    fn power_is_spread_as_the_arcsine_law_says_and_lies_inside_the_band() {
        for (band, outside) in
            [([0.0, 0.2], [0.4, 1.0]), ([0.1, 0.3], [0.55, 0.8]), ([0.6, 1.0], [0.0, 0.4])]
        {
            let u = generate(band, 65_536, 3);
            let theory = arcsine_density(band);
            for [low, high] in [band, outside] {
                let expected = (0..200)
                    .map(|i| theory(low + (high - low) * (f64::from(i) + 0.5) / 200.0))
                    .sum::<f64>()
                    / 200.0;
                let measured = density(&u, low, high) / u.len() as f64;
                assert!(
                    (measured / expected - 1.0).abs() < 0.05,
                    "band {band:?}, {low} to {high}: {measured}, not {expected}"
                );
            }
            assert!(density(&u, outside[0], outside[1]) < 0.15 * density(&u, band[0], band[1]));
        }
    }

    #[test]
    fn different_seeds_give_different_signals() {
        assert_ne!(generate([0.0, 1.0], 151, 1), generate([0.0, 1.0], 151, 2));
    }

    #[test]
    fn bad_bands_and_levels_are_refused() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        for band in [[0.5, 0.5], [0.5, 0.1], [-0.1, 0.5], [0.0, 1.1], [0.0, f64::NAN]] {
            assert!(Rbs { band, ..Rbs::default() }.generate(10, rng).is_err());
        }
        assert!(Rbs { levels: [1.0, -1.0], ..Rbs::default() }.generate(10, rng).is_err());
    }
}
