//! Delay of a signal by any number of samples, whole or not.

use std::f64::consts::PI;

use nalgebra::Complex;

use super::fourier::{RealFourier, fast_length};

/// Zero samples around a signal that is delayed by a fraction: the ringing of its ends decays there and does not wrap around.
const REST: usize = 64;

/// `x` later by `samples` (earlier where negative), as long as `x`. The result is x(t − d) of the band-limited signal through the samples, which is zero
/// outside them.
///
/// Whole samples are moved to the bit. For a fraction the spectrum is multiplied by exp(−iωd) between zeros on both sides. At the Nyquist frequency, where a
/// delay has no phase of its own, the factor is cos(πd). An end that does not fade out rings, as every band-limited signal must. A delay that is no finite
/// number gives zeros. O(N·log N).
///
/// # Example
/// ```
/// use deadtime_signal::fractional_delay;
/// let pulse = |t: f64| (-(t - 50.0).powi(2) / 18.0).exp();
/// let x: Vec<f64> = (0..100).map(|t| pulse(f64::from(t))).collect();
/// let later = fractional_delay(&x, 3.3);
/// assert!((0..100).all(|t| (later[t as usize] - pulse(f64::from(t) - 3.3)).abs() < 1e-9));
/// ```
#[must_use]
pub fn fractional_delay(x: &[f64], samples: f64) -> Vec<f64> {
    let n = x.len();
    let whole = samples.floor();
    let fraction = samples - whole;
    if !samples.is_finite() || whole.abs() > n as f64 {
        return vec![0.0; n];
    }
    // The comparison above bounds it.
    let whole = whole as isize;
    if fraction == 0.0 {
        return (0..n)
            .map(|t| t.checked_add_signed(-whole).and_then(|i| x.get(i)).copied().unwrap_or(0.0))
            .collect();
    }
    let circle = turned(x, fraction);
    // From n before the record to n behind it, each sample has a separate place on the circle.
    let place =
        |t: usize| (t + circle.len()).checked_add_signed(-whole).map_or(0, |i| i % circle.len());
    (0..n).map(|t| circle.get(place(t)).copied().unwrap_or(0.0)).collect()
}

/// x later by a fraction of a sample, on a circle three times as long. First comes the record, then the ringing after it, last the ringing before it.
fn turned(x: &[f64], fraction: f64) -> Vec<f64> {
    let fourier = RealFourier::new(fast_length(3 * x.len() + 2 * REST));
    let mut spectrum = fourier.spectrum(x.iter().copied());
    let step = 2.0 * PI / fourier.length() as f64;
    for (k, line) in spectrum.iter_mut().enumerate() {
        *line *= if 2 * k == fourier.length() {
            Complex::new((PI * fraction).cos(), 0.0)
        } else {
            Complex::from_polar(1.0, -step * k as f64 * fraction)
        };
    }
    fourier.series(spectrum)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The band-limited signal through the samples, at a time between them, by its definition.
    fn interpolated(x: &[f64], at: f64) -> f64 {
        let sinc = |v: f64| if v == 0.0 { 1.0 } else { (PI * v).sin() / (PI * v) };
        x.iter().enumerate().map(|(t, x)| x * sinc(at - t as f64)).sum()
    }

    #[test]
    fn a_fractional_delay_is_the_sum_of_sincs_of_a_signal_that_fades_out() {
        let x: Vec<f64> = (0..200)
            .map(|t| (0.9 * f64::from(t)).sin() * (PI * f64::from(t) / 199.0).sin().powi(6))
            .collect();
        for delay in [0.5, 0.01, 7.25, -3.6, 60.9] {
            let later = fractional_delay(&x, delay);
            for (t, got) in later.iter().enumerate() {
                let expected = interpolated(&x, t as f64 - delay);
                assert!(
                    (got - expected).abs() < 1e-7,
                    "delay {delay}, sample {t}: {got} and {expected}"
                );
            }
        }
    }

    #[test]
    fn whole_samples_are_moved_to_the_bit_and_delays_add_up() {
        let x: Vec<f64> = (0..97).map(|t| (0.3 * f64::from(t)).sin()).collect();
        assert_eq!(fractional_delay(&x, 5.0)[5..], x[..92]);
        assert_eq!(fractional_delay(&x, -5.0)[..92], x[5..]);
        assert_eq!(fractional_delay(&x, 0.0), x);
        for bad in [f64::NAN, f64::INFINITY, 1e300, -98.0] {
            assert_eq!(fractional_delay(&x, bad), [0.0; 97], "{bad}");
        }
        assert!(fractional_delay(&[], 0.5).is_empty());
    }
}
