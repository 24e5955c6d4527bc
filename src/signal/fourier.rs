//! The inverse discrete Fourier transform of any length.

use nalgebra::Complex;
use rustfft::FftPlanner;

/// x(t) = Σₖ X(k)·exp(+2πi·k·t/n), t = 0 … n − 1: no factor 1/n. O(n·log n) for every length n.
pub(super) fn inverse_dft(spectrum: &[Complex<f64>]) -> Vec<Complex<f64>> {
    let mut x = spectrum.to_vec();
    FftPlanner::new().plan_fft_inverse(x.len()).process(&mut x);
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn inverse_dft_is_the_direct_sum_for_every_length() {
        for n in (1..70).chain([127, 128, 151, 1000]) {
            let spectrum: Vec<_> = (0..n).map(|k| Complex::new((k as f64 * 1.7).sin(), (k as f64 * k as f64 * 0.3).cos())).collect();
            for (t, fast) in inverse_dft(&spectrum).iter().enumerate() {
                let slow: Complex<f64> =
                    spectrum.iter().enumerate().map(|(k, x)| x * Complex::from_polar(1.0, 2.0 * PI * (k * t % n) as f64 / n as f64)).sum();
                assert!((fast - slow).norm() < 1e-11, "length {n}, sample {t}");
            }
        }
    }
}
