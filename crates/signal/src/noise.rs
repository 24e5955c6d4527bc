//! Measurement noise: white or coloured, at a given signal-to-noise ratio.
//!
//! A(q)·v = C(q)·e with A = 1 + a₁·q⁻¹ + …, C = 1 + c₁·q⁻¹ + …, e white and Gaussian; SNR = var(signal)/var(v).
//!
//! Source: L. Ljung, 1999, "System Identification: Theory for the User", 2nd edition (ARMA models);
//! S. Björklund, 2003, "A Survey and Comparison of Time-Delay Estimation Methods in Linear Systems" (this definition of the ratio).

use crate::decompositions::{eigenvalues, symmetric_eigen};
use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::error::{Allowed, SignalError};
use super::stats;
use crate::MOST_SAMPLES;

/// The noise's spectrum. Coefficients begin at lag 1; the leading 1 is not written.
///
/// Noise through 1/(1 − 0.7·q⁻¹) is `Ar { coefficients: vec![-0.7] }`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum NoiseColour {
    /// Independent from sample to sample.
    #[default]
    White,
    /// Autoregressive: A(q)·v = e.
    Ar {
        /// a₁, a₂, … of A.
        coefficients: Vec<f64>,
    },
    /// Autoregressive with moving average: A(q)·v = C(q)·e.
    Arma {
        /// a₁, a₂, … of A.
        ar: Vec<f64>,
        /// c₁, c₂, … of C.
        ma: Vec<f64>,
    },
}

/// Which variance of the noise the ratio holds for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoiseScaling {
    /// The process' variance: records scatter around the ratio, as measured ones do, and samples stay independent of one another.
    #[default]
    Expected,
    /// The variance of the very record drawn, about its mean: every record has exactly the ratio.
    Realised,
}

/// Noise at a signal-to-noise ratio.
///
/// Source: as the module.
///
/// # Example
/// ```
/// use deadtime_signal::{Noise, NoiseScaling};
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let signal: Vec<f64> = (0..100).map(|k| f64::from(k % 2)).collect(); // variance 0.25
/// let noise = Noise { snr: 4.0, scaling: NoiseScaling::Realised, ..Noise::default() };
/// let noisy = noise.add(&signal, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let v: Vec<f64> = noisy.iter().zip(&signal).map(|(y, s)| y - s).collect();
/// let mean = v.iter().sum::<f64>() / 100.0;
/// let variance = v.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 100.0;
/// assert!((variance - 0.0625).abs() < 1e-12);
/// # Ok::<(), deadtime_signal::SignalError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Noise {
    /// var(noise-free signal)/var(noise), a ratio and not decibels, above 0; infinite means no noise. Default 100.
    pub snr: f64,
    /// The noise's spectrum. Default white.
    pub colour: NoiseColour,
    /// Which variance of the noise the ratio holds for. Default the expected one.
    pub scaling: NoiseScaling,
}

impl Default for Noise {
    fn default() -> Self {
        Self { snr: 100.0, colour: NoiseColour::White, scaling: NoiseScaling::Expected }
    }
}

impl Noise {
    /// `signal` plus noise, of the same length and unit. An infinite ratio returns the signal and draws nothing from `rng`.
    ///
    /// # Errors
    /// [`SignalError::Option`] for a ratio that is not above 0 or a coefficient that is not finite. [`SignalError::Constant`] for a signal that does not vary,
    /// unless the ratio is infinite. Also [`SignalError::NoSamples`]; [`SignalError::NotFinite`]; [`SignalError::Scale`]; [`SignalError::UnstableNoise`].
    pub fn add(&self, signal: &[f64], rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        let snr = self.snr;
        if snr.is_nan() || snr <= 0.0 {
            return Err(SignalError::Option {
                signal: "noise",
                option: "snr",
                value: snr,
                allowed: Allowed::PositiveOrInfinite,
            });
        }
        if let Some((index, &value)) = signal.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            return Err(SignalError::NotFinite { index, value });
        }
        let filter = ArmaFilter::new(&self.colour)?;
        let &first = signal.first().ok_or(SignalError::NoSamples)?;
        if snr.is_infinite() {
            return Ok(signal.to_vec());
        }
        // Asked of the values and not of the variance, which rounding keeps above zero for a constant such as 0.1.
        if signal.iter().all(|&v| v == first) {
            return Err(SignalError::Constant { samples: signal.len(), snr });
        }
        let noise = filter.generate(signal.len(), rng);
        let noise_variance = match self.scaling {
            NoiseScaling::Expected => filter.variance(),
            NoiseScaling::Realised => variance(&noise),
        };
        let signal_variance = variance(signal);
        let gain = (signal_variance / snr / noise_variance).sqrt();
        if !(gain.is_finite() && gain > 0.0) {
            return Err(SignalError::Scale { variance: signal_variance, snr });
        }
        Ok(signal.iter().zip(&noise).map(|(s, v)| s + gain * v).collect())
    }
}

/// `signal` plus noise of the given colour, whose expected variance is var(`signal`)/`snr`. [`Noise`] has the other options.
///
/// # Errors
/// As [`Noise::add`].
pub fn add_noise(
    signal: &[f64],
    snr: f64,
    colour: &NoiseColour,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<f64>, SignalError> {
    Noise { snr, colour: colour.clone(), scaling: NoiseScaling::Expected }.add(signal, rng)
}

/// Stationary noise of the given colour, expected variance 1, mean 0.
///
/// # Errors
/// [`SignalError::NoSamples`], [`SignalError::TooManySamples`], [`SignalError::Option`] for a coefficient that is not finite,
/// [`SignalError::UnstableNoise`].
pub fn unit_noise(
    samples: usize,
    colour: &NoiseColour,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<f64>, SignalError> {
    match samples {
        0 => return Err(SignalError::NoSamples),
        1..=MOST_SAMPLES => {}
        asked => return Err(SignalError::TooManySamples { asked, most: MOST_SAMPLES }),
    }
    let filter = ArmaFilter::new(colour)?;
    let gain = filter.variance().sqrt().recip();
    Ok(filter.generate(samples, rng).into_iter().map(|v| gain * v).collect())
}

/// Of no samples there is none.
fn variance(x: &[f64]) -> f64 {
    stats::variance(x).unwrap_or(f64::NAN)
}

/// x⁺ = F·x + G·e, v = x₁ + e, with innovations of variance 1. F is the companion matrix of A, G = c − a.
struct ArmaFilter {
    a: Vec<f64>,
    c: Vec<f64>,
    /// The states' stationary covariance, P = F·P·Fᵀ + G·Gᵀ.
    covariance: DMatrix<f64>,
}

impl ArmaFilter {
    fn new(colour: &NoiseColour) -> Result<Self, SignalError> {
        let (ar, ma): (&[f64], &[f64]) = match colour {
            NoiseColour::White => (&[], &[]),
            NoiseColour::Ar { coefficients } => (coefficients, &[]),
            NoiseColour::Arma { ar, ma } => (ar, ma),
        };
        for (option, coefficients) in [("ar", ar), ("ma", ma)] {
            if let Some(&value) = coefficients.iter().find(|v| !v.is_finite()) {
                return Err(SignalError::Option {
                    signal: "noise",
                    option,
                    value,
                    allowed: Allowed::Finite,
                });
            }
        }
        let n = ar.len().max(ma.len());
        let padded = |coefficients: &[f64]| -> Vec<f64> {
            (0..n).map(|i| coefficients.get(i).copied().unwrap_or(0.0)).collect()
        };
        let (a, c) = (padded(ar), padded(ma));
        if n == 0 {
            return Ok(Self { a, c, covariance: DMatrix::zeros(0, 0) });
        }
        let f = DMatrix::from_fn(n, n, |i, j| {
            let shift = if j == i + 1 { 1.0 } else { 0.0 };
            if j == 0 { shift - a[i] } else { shift }
        });
        let radius = eigenvalues(&f).iter().map(|z| z.norm()).fold(0.0, f64::max);
        let g = DVector::from_fn(n, |i, _| c[i] - a[i]);
        let covariance = stationary_covariance(f, &g)
            .filter(|_| is_stable(&a))
            .ok_or(SignalError::UnstableNoise { radius })?;
        Ok(Self { a, c, covariance })
    }

    /// The variance of v.
    fn variance(&self) -> f64 {
        1.0 + self.covariance.get((0, 0)).copied().unwrap_or(0.0)
    }

    /// Starts in the stationary distribution, so the first sample is distributed as the last.
    fn generate(&self, samples: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let n = self.a.len();
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let mut x = vec![0.0; n];
        if n > 0 {
            // P may be singular (a factor common to A and C): its square root by eigenvalues, where Cholesky's would fail.
            if let Some(eigen) = symmetric_eigen(&self.covariance) {
                let drawn =
                    DVector::from_fn(n, |i, _| eigen.eigenvalues[i].max(0.0).sqrt() * normal());
                x.copy_from_slice((eigen.eigenvectors * drawn).as_slice());
            }
        }
        (0..samples)
            .map(|_| {
                let e = normal();
                let v = e + x.first().copied().unwrap_or(0.0);
                for i in 0..n {
                    x[i] = x.get(i + 1).copied().unwrap_or(0.0) + self.c[i] * e - self.a[i] * v;
                }
                v
            })
            .collect()
    }
}

/// Every zero of A lies inside the unit circle: all reflection coefficients of its step-down recursion are below 1 in size. Unlike the
/// eigenvalues' radius, this does not take a double pole on the circle for one just inside.
fn is_stable(a: &[f64]) -> bool {
    let mut a = a.to_vec();
    while let Some(k) = a.pop() {
        if k.abs() >= 1.0 {
            return false;
        }
        a = a
            .iter()
            .zip(a.iter().rev())
            .map(|(forward, backward)| (forward - k * backward) / (1.0 - k * k))
            .collect();
    }
    true
}

/// P = Σ Fᵏ·G·Gᵀ·(Fᵏ)ᵀ, the number of terms doubled in each round; `None` when the sum does not end.
fn stationary_covariance(mut f: DMatrix<f64>, g: &DVector<f64>) -> Option<DMatrix<f64>> {
    let mut p = g * g.transpose();
    // 2⁶⁰ terms: more than any pole needs that a double distinguishes from the unit circle.
    for _ in 0..60 {
        let more = &f * &p * f.transpose();
        p += &more;
        if !p.iter().all(|v| v.is_finite()) {
            return None;
        }
        if more.amax() <= f64::EPSILON * 1e-3 * p.amax() {
            return Some(p);
        }
        f = &f * &f;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use rand_chacha::rand_core::SeedableRng;

    fn rng(seed: u64) -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(seed)
    }

    fn signal(samples: usize) -> Vec<f64> {
        (0..samples).map(|k| (k as f64 * 0.1).sin() * 3.0 + 7.0).collect()
    }

    fn autocovariance(v: &[f64], lag: usize) -> f64 {
        v.iter().zip(&v[lag..]).map(|(a, b)| a * b).sum::<f64>() / v.len() as f64
    }

    #[test]
    fn realised_scaling_gives_exactly_the_ratio() {
        let s = signal(200);
        for colour in [NoiseColour::White, NoiseColour::Ar { coefficients: vec![-0.9] }] {
            for snr in [0.5, 1.0, 100.0] {
                let y = Noise { snr, colour: colour.clone(), scaling: NoiseScaling::Realised }
                    .add(&s, &mut rng(3))
                    .unwrap();
                let v: Vec<f64> = y.iter().zip(&s).map(|(y, s)| y - s).collect();
                assert_abs_diff_eq!(variance(&s) / variance(&v) / snr, 1.0, epsilon = 1e-10);
            }
        }
    }

    #[test]
    fn expected_scaling_gives_the_ratio_on_average_over_records() {
        let s = signal(50);
        let colour = NoiseColour::Ar { coefficients: vec![-0.8] };
        let records = 4000;
        let mut generator = rng(5);
        let power: f64 = (0..records)
            .map(|_| {
                let y = add_noise(&s, 10.0, &colour, &mut generator).unwrap();
                y.iter().zip(&s).map(|(y, s)| (y - s).powi(2)).sum::<f64>() / 50.0
            })
            .sum::<f64>()
            / f64::from(records);
        assert!((variance(&s) / power / 10.0 - 1.0).abs() < 0.03, "{power}");
    }

    #[test]
    fn first_sample_is_distributed_as_the_last() {
        let colour = NoiseColour::Arma { ar: vec![-1.6, 0.8], ma: vec![0.5] };
        let mut generator = rng(6);
        let (mut first, mut last) = (0.0, 0.0);
        for _ in 0..20_000 {
            let v = unit_noise(30, &colour, &mut generator).unwrap();
            first += v[0] * v[0] / 20_000.0;
            last += v[29] * v[29] / 20_000.0;
        }
        assert!((first - 1.0).abs() < 0.05 && (last - 1.0).abs() < 0.05, "{first} {last}");
    }

    #[test]
    fn ar_noise_has_the_processs_autocorrelation() {
        let v = unit_noise(200_000, &NoiseColour::Ar { coefficients: vec![-0.7] }, &mut rng(7))
            .unwrap();
        for lag in 0..5 {
            assert!((autocovariance(&v, lag) - 0.7_f64.powi(lag as i32)).abs() < 0.02, "lag {lag}");
        }
    }

    #[test]
    fn ma_noise_is_uncorrelated_beyond_its_order() {
        let v = unit_noise(200_000, &NoiseColour::Arma { ar: vec![], ma: vec![0.5] }, &mut rng(8))
            .unwrap();
        assert_abs_diff_eq!(autocovariance(&v, 1), 0.5 / 1.25, epsilon = 0.02);
        assert!(autocovariance(&v, 2).abs() < 0.02);
    }

    #[test]
    fn variance_of_the_process_is_the_sum_of_its_squared_impulse_response() {
        let filter =
            ArmaFilter::new(&NoiseColour::Arma { ar: vec![-1.6, 0.8], ma: vec![0.5, 0.2, -0.3] })
                .unwrap();
        let (a, c) = ([-1.6, 0.8], [0.5, 0.2, -0.3]);
        let mut h = vec![1.0_f64];
        for k in 1..2000 {
            let ar: f64 = (1..=2).filter(|&i| i <= k).map(|i| -a[i - 1] * h[k - i]).sum();
            h.push(ar + if k <= 3 { c[k - 1] } else { 0.0 });
        }
        let direct: f64 = h.iter().map(|v| v * v).sum();
        assert_abs_diff_eq!(filter.variance() / direct, 1.0, epsilon = 1e-12);
    }

    #[test]
    fn a_factor_common_to_both_polynomials_leaves_white_noise() {
        let cancelled = NoiseColour::Arma { ar: vec![-0.5], ma: vec![-0.5] };
        assert_abs_diff_eq!(ArmaFilter::new(&cancelled).unwrap().variance(), 1.0, epsilon = 1e-15);
        assert_eq!(unit_noise(9, &cancelled, &mut rng(1)).unwrap().len(), 9);
    }

    #[test]
    fn unstable_noise_filters_are_refused_with_their_pole() {
        for coefficients in [vec![-1.0], vec![-1.2], vec![-2.0, 1.0], vec![0.0, -1.5]] {
            let refused = unit_noise(10, &NoiseColour::Ar { coefficients }, &mut rng(1));
            assert!(
                matches!(refused, Err(SignalError::UnstableNoise { radius }) if radius > 0.999),
                "{refused:?}"
            );
        }
        assert!(
            unit_noise(10, &NoiseColour::Ar { coefficients: vec![-0.9999] }, &mut rng(1)).is_ok()
        );
    }

    #[test]
    fn constant_signal_is_refused_unless_no_noise_is_asked_for() {
        let s = [0.1; 17];
        let refused = add_noise(&s, 5.0, &NoiseColour::White, &mut rng(1));
        assert_eq!(refused, Err(SignalError::Constant { samples: 17, snr: 5.0 }));
        assert_eq!(add_noise(&s, f64::INFINITY, &NoiseColour::White, &mut rng(1)).unwrap(), s);
    }

    #[test]
    fn impossible_ratios_and_signals_are_refused() {
        for snr in [0.0, -1.0, f64::NAN] {
            assert!(matches!(
                add_noise(&signal(5), snr, &NoiseColour::White, &mut rng(1)),
                Err(SignalError::Option { .. })
            ));
        }
        assert_eq!(
            add_noise(&[], 1.0, &NoiseColour::White, &mut rng(1)),
            Err(SignalError::NoSamples)
        );
        assert!(matches!(
            add_noise(&[0.0, f64::NAN], 1.0, &NoiseColour::White, &mut rng(1)),
            Err(SignalError::NotFinite { index: 1, .. })
        ));
        assert!(matches!(
            add_noise(&[1e300, -1e300], 1.0, &NoiseColour::White, &mut rng(1)),
            Err(SignalError::Scale { .. })
        ));
        assert!(
            unit_noise(5, &NoiseColour::Ar { coefficients: vec![f64::NAN] }, &mut rng(1)).is_err()
        );
        assert_eq!(unit_noise(0, &NoiseColour::White, &mut rng(1)), Err(SignalError::NoSamples));
    }

    #[test]
    fn same_seed_gives_the_same_noise() {
        let s = signal(40);
        let colour = NoiseColour::Ar { coefficients: vec![-0.5] };
        assert_eq!(
            add_noise(&s, 2.0, &colour, &mut rng(4)),
            add_noise(&s, 2.0, &colour, &mut rng(4))
        );
        assert_ne!(
            add_noise(&s, 2.0, &colour, &mut rng(4)),
            add_noise(&s, 2.0, &colour, &mut rng(5))
        );
    }

    #[test]
    fn colours_are_written_as_data() {
        let colour: NoiseColour =
            serde_json::from_str(r#"{"ar": {"coefficients": [-0.7]}}"#).unwrap();
        assert_eq!(colour, NoiseColour::Ar { coefficients: vec![-0.7] });
        assert_eq!(serde_json::to_string(&NoiseColour::White).unwrap(), r#""white""#);
        assert!(serde_json::from_str::<NoiseColour>(r#"{"ar": {"coefficient": [-0.7]}}"#).is_err());
    }
}
