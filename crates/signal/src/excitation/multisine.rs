//! Multisine: a sum of harmonics of equal amplitude, exactly periodic.
//!
//! u(k) = g·Σⱼ cos(2π·hⱼ·k/P + φⱼ), j = 1 … M, P the period in samples, g the normalisation. Schroeder phases: φⱼ = −π·j·(j − 1)/M.
//!
//! Source: M. R. Schroeder, 1970, "Synthesis of low-peak-factor signals and binary sequences with low autocorrelation",
//! IEEE Transactions on Information Theory 16(1), 85-89, DOI 10.1109/TIT.1970.1054411.

use std::f64::consts::PI;

use nalgebra::Complex;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::check;
use super::generator::Excitation;
use crate::error::SignalError;
use crate::fourier::inverse_dft;

/// The lines' phases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Schroeder's: a low peak for the power.
    #[default]
    Schroeder,
    /// Independent and uniform over the circle: nearly Gaussian values.
    Random,
}

/// Which lines of the spectrum may be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Harmonics {
    /// All.
    #[default]
    All,
    /// Odd ones only: the response of an even nonlinearity falls on the empty even lines. In an even period, the second half is exactly the first with its sign
    /// changed.
    Odd,
}

/// The measure of the amplitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Normalise {
    /// The largest absolute sample.
    #[default]
    Peak,
    /// The root of the mean square over one period.
    Rms,
}

/// A multisine with a flat spectrum on its lines and nothing between them.
///
/// Lines are harmonics of 1/(P·Ts); zero and the Nyquist frequency are never among them. Cost: O(P·log P).
///
/// Fails when: no line lies in the band, or fewer than `lines`.
///
/// Source: as the module; R. Pintelon and J. Schoukens, 2012, "System Identification: A Frequency Domain Approach", 2nd edition, chapter 5.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Multisine {
    /// Peak or root mean square by `normalise`, in the input's unit, finite and above 0; default 1.
    pub amplitude: f64,
    /// Lower and upper edge of the band, fractions of the Nyquist frequency, 0 ≤ low < high ≤ 1; default [0, 1].
    pub band: [f64; 2],
    /// The period P, in samples; default 0: the number of requested samples.
    pub period: usize,
    /// Number of lines, spread evenly over those in the band; default 0: all of them.
    pub lines: usize,
    /// Which lines may be used; default all.
    pub harmonics: Harmonics,
    /// The lines' phases; default Schroeder's.
    pub phase: Phase,
    /// The measure of the amplitude; default the peak.
    pub normalise: Normalise,
}

impl Default for Multisine {
    fn default() -> Self {
        Self {
            amplitude: 1.0,
            band: [0.0, 1.0],
            period: 0,
            lines: 0,
            harmonics: Harmonics::All,
            phase: Phase::Schroeder,
            normalise: Normalise::Peak,
        }
    }
}

impl Multisine {
    /// The harmonics hⱼ, ascending, 0 < hⱼ < P/2.
    fn harmonics(&self, period: usize) -> Result<Vec<usize>, SignalError> {
        let [low, high] = self.band;
        let (step, name) = match self.harmonics {
            Harmonics::All => (1, "all"),
            Harmonics::Odd => (2, "odd"),
        };
        // A band's edge at a line includes the line although the fraction is rounded.
        let slack = 1e-12;
        let in_band = |h: &usize| {
            let f = 2.0 * *h as f64 / period as f64;
            f >= low - slack && f <= high + slack
        };
        let available: Vec<usize> = (1..period.div_ceil(2)).step_by(step).filter(in_band).collect();
        let last = available.len().checked_sub(1).ok_or(SignalError::NoLines {
            harmonics: name,
            period,
            low,
            high,
        })?;
        match self.lines {
            0 => Ok(available),
            1 => Ok(vec![available[last / 2]]),
            asked if asked > available.len() => {
                Err(SignalError::TooFewLines { asked, available: available.len() })
            }
            asked => Ok((0..asked)
                .map(|j| available[(2 * j * last + asked - 1) / (2 * (asked - 1))])
                .collect()),
        }
    }
}

impl Excitation for Multisine {
    fn generate(&self, samples: usize, rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        check::samples(samples)?;
        check::positive("multisine", "amplitude", self.amplitude)?;
        check::band("multisine", self.band)?;
        let period = if self.period == 0 { samples } else { self.period };
        check::samples(period)?;
        let harmonics = self.harmonics(period)?;
        let m = harmonics.len() as f64;
        let mut spectrum = vec![Complex::new(0.0, 0.0); period];
        for (j, &h) in harmonics.iter().enumerate() {
            let phase = match self.phase {
                // j·(j + 1) from zero on; whole turns are taken off first so that the angle stays exact.
                Phase::Schroeder => {
                    -PI * ((j as u128 * (j as u128 + 1)) % (2 * harmonics.len() as u128)) as f64 / m
                }
                Phase::Random => 2.0 * PI * rng.random::<f64>(),
            };
            spectrum[h] = Complex::from_polar(1.0, phase);
        }
        let mut u: Vec<f64> = inverse_dft(&spectrum).into_iter().map(|v| v.re).collect();
        if self.harmonics == Harmonics::Odd && period.is_multiple_of(2) {
            let (first, second) = u.split_at_mut(period / 2);
            for (a, b) in first.iter().zip(second) {
                *b = -a;
            }
        }
        let size = match self.normalise {
            Normalise::Peak => u.iter().fold(0.0_f64, |peak, v| peak.max(v.abs())),
            Normalise::Rms => (u.iter().map(|v| v * v).sum::<f64>() / period as f64).sqrt(),
        };
        for v in &mut u {
            *v *= self.amplitude / size;
        }
        Ok(u.iter().copied().cycle().take(samples).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use rand_chacha::rand_core::SeedableRng;

    fn generate(multisine: Multisine, samples: usize) -> Vec<f64> {
        multisine.generate(samples, &mut ChaCha8Rng::seed_from_u64(1)).unwrap()
    }

    /// |U(h)| of one period, by the direct sum.
    fn magnitudes(u: &[f64]) -> Vec<f64> {
        let n = u.len();
        (0..=n / 2)
            .map(|h| {
                let line: Complex<f64> = u
                    .iter()
                    .enumerate()
                    .map(|(k, &v)| {
                        Complex::from_polar(v, -2.0 * PI * (h * k % n) as f64 / n as f64)
                    })
                    .sum();
                line.norm()
            })
            .collect()
    }

    fn crest(u: &[f64]) -> f64 {
        let peak = u.iter().fold(0.0_f64, |peak, v| peak.max(v.abs()));
        peak / (u.iter().map(|v| v * v).sum::<f64>() / u.len() as f64).sqrt()
    }

    #[test]
    fn signal_is_the_sum_of_its_cosines() {
        for period in [7, 20, 151, 256] {
            let u =
                generate(Multisine { normalise: Normalise::Rms, ..Multisine::default() }, period);
            let m = (period - 1) / 2;
            for (k, v) in u.iter().enumerate() {
                let sum: f64 = (1..=m)
                    .map(|j| {
                        (2.0 * PI * (j * k) as f64 / period as f64
                            - PI * (j * (j - 1)) as f64 / m as f64)
                            .cos()
                    })
                    .sum();
                assert!(
                    (v - sum * (2.0 / m as f64).sqrt()).abs() < 1e-10,
                    "period {period}, sample {k}"
                );
            }
        }
    }

    #[test]
    fn spectrum_is_flat_on_the_lines_and_empty_elsewhere() {
        for phase in [Phase::Schroeder, Phase::Random] {
            for period in [200, 151] {
                let u = generate(
                    Multisine { phase, period, band: [0.2, 0.6], ..Multisine::default() },
                    period,
                );
                let lines = magnitudes(&u);
                let level = lines[period / 4];
                for (h, &line) in lines.iter().enumerate() {
                    let f = 2.0 * h as f64 / period as f64;
                    let want = if (0.2 - 1e-9..=0.6 + 1e-9).contains(&f) { level } else { 0.0 };
                    assert!((line - want).abs() < 1e-11 * level, "period {period}, line {h}");
                }
            }
        }
    }

    #[test]
    fn odd_multisine_leaves_even_lines_exactly_empty() {
        for phase in [Phase::Schroeder, Phase::Random] {
            let u = generate(
                Multisine { harmonics: Harmonics::Odd, phase, ..Multisine::default() },
                200,
            );
            assert!(
                u[..100].iter().zip(&u[100..]).all(|(a, b)| *a == -*b),
                "half-wave symmetry to the bit"
            );
            let lines = magnitudes(&u);
            for h in 0..=100 {
                let want = if h % 2 == 1 { lines[1] } else { 0.0 };
                assert!((lines[h] - want).abs() < 1e-11 * lines[1], "line {h}");
            }
        }
    }

    #[test]
    fn signal_repeats_to_the_bit_after_its_period() {
        for harmonics in [Harmonics::All, Harmonics::Odd] {
            let u = generate(Multisine { period: 60, harmonics, ..Multisine::default() }, 1000);
            assert!(u.iter().zip(&u[60..]).all(|(a, b)| a.to_bits() == b.to_bits()));
        }
    }

    #[test]
    fn schroeder_phases_keep_the_crest_factor_low() {
        for period in [31, 64, 151, 1000, 4096] {
            for harmonics in [Harmonics::All, Harmonics::Odd] {
                let c = crest(&generate(Multisine { harmonics, ..Multisine::default() }, period));
                assert!(c < 1.8, "period {period}, {harmonics:?}: {c}");
            }
        }
        assert!(
            crest(&generate(Multisine { phase: Phase::Random, ..Multisine::default() }, 1000))
                > 2.5
        );
    }

    #[test]
    fn amplitude_is_the_peak_or_the_root_mean_square() {
        let u = generate(Multisine { amplitude: 0.3, ..Multisine::default() }, 151);
        assert_abs_diff_eq!(u.iter().fold(0.0_f64, |p, v| p.max(v.abs())), 0.3, epsilon = 1e-15);
        let u = generate(
            Multisine { amplitude: 0.3, normalise: Normalise::Rms, ..Multisine::default() },
            151,
        );
        assert_abs_diff_eq!(u.iter().map(|v| v * v).sum::<f64>() / 151.0, 0.09, epsilon = 1e-14);
    }

    #[test]
    fn lines_are_spread_evenly_over_the_band() {
        let five = Multisine { lines: 5, band: [0.0, 0.21], ..Multisine::default() };
        assert_eq!(five.harmonics(200).unwrap(), [1, 6, 11, 16, 21]);
        assert_eq!(Multisine { lines: 1, ..five }.harmonics(200).unwrap(), [11]);
        assert_eq!(
            Multisine { lines: 21, ..five }.harmonics(200).unwrap(),
            (1..=21).collect::<Vec<_>>()
        );
        assert_eq!(
            Multisine { lines: 22, ..five }.harmonics(200),
            Err(SignalError::TooFewLines { asked: 22, available: 21 })
        );
        let odd = Multisine { harmonics: Harmonics::Odd, ..Multisine::default() };
        assert_eq!(odd.harmonics(11).unwrap(), [1, 3, 5]);
        assert_eq!(odd.harmonics(10).unwrap(), [1, 3]);
    }

    #[test]
    fn bands_without_a_line_are_refused() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        let between = Multisine { band: [0.011, 0.019], ..Multisine::default() };
        assert!(matches!(
            between.generate(200, rng),
            Err(SignalError::NoLines { period: 200, .. })
        ));
        assert!(Multisine { amplitude: 0.0, ..Multisine::default() }.generate(200, rng).is_err());
        assert!(
            Multisine { period: usize::MAX, ..Multisine::default() }.generate(200, rng).is_err()
        );
    }

    #[test]
    fn a_million_samples_are_made_in_seconds() {
        assert_eq!(generate(Multisine::default(), 1_000_003).len(), 1_000_003);
    }
}
