//! Discrete Fourier transforms of any length.

use std::sync::Arc;

use nalgebra::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::FftPlanner;

/// X(k) = Σₜ x(t)·exp(−2πi·k·t/n), k = 0 … n − 1, in place. O(n·log n) for every length n.
pub fn dft(x: &mut [Complex<f64>]) {
    FftPlanner::new().plan_fft_forward(x.len()).process(x);
}

/// x(t) = Σₖ X(k)·exp(+2πi·k·t/n), t = 0 … n − 1: no factor 1/n. O(n·log n) for every length n.
pub(super) fn inverse_dft(spectrum: &[Complex<f64>]) -> Vec<Complex<f64>> {
    let mut x = spectrum.to_vec();
    FftPlanner::new().plan_fft_inverse(x.len()).process(&mut x);
    x
}

/// The transform of real signals of one length, planned once.
pub struct RealFourier {
    length: usize,
    forward: Arc<dyn RealToComplex<f64>>,
    inverse: Arc<dyn ComplexToReal<f64>>,
}

impl RealFourier {
    /// Transforms of signals of `length` samples.
    pub fn new(length: usize) -> Self {
        let length = length.max(1);
        let mut planner = RealFftPlanner::new();
        Self {
            length,
            forward: planner.plan_fft_forward(length),
            inverse: planner.plan_fft_inverse(length),
        }
    }

    /// Samples of a signal.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Memory that one transform after the other may use.
    pub fn scratch(&self) -> Vec<Complex<f64>> {
        vec![
            Complex::new(0.0, 0.0);
            self.forward.get_scratch_len().max(self.inverse.get_scratch_len())
        ]
    }

    /// X(k) = Σₜ x(t)·exp(−2πi·k·t/n), k = 0 … n/2, of n samples, which are overwritten.
    pub fn forward(
        &self,
        x: &mut [f64],
        spectrum: &mut [Complex<f64>],
        scratch: &mut [Complex<f64>],
    ) {
        // The lengths fit, so the transform cannot refuse.
        let _ = self.forward.process_with_scratch(x, spectrum, scratch);
    }

    /// n·x(t) = Σₖ X(k)·exp(+2πi·k·t/n) over the whole circle, of which `spectrum` is the half from 0 to n/2; it is overwritten.
    pub fn inverse(
        &self,
        spectrum: &mut [Complex<f64>],
        x: &mut [f64],
        scratch: &mut [Complex<f64>],
    ) {
        // The imaginary parts at 0 and at the Nyquist frequency have no counterpart in a real signal.
        if let Some(first) = spectrum.first_mut() {
            first.im = 0.0;
        }
        if self.length.is_multiple_of(2)
            && let Some(last) = spectrum.last_mut()
        {
            last.im = 0.0;
        }
        let _ = self.inverse.process_with_scratch(spectrum, x, scratch);
    }

    /// The spectrum of `x`, cut or filled with zeros to the length n.
    pub fn spectrum(&self, x: impl IntoIterator<Item = f64>) -> Vec<Complex<f64>> {
        let mut input = Vec::with_capacity(self.length);
        input.extend(x.into_iter().take(self.length));
        input.resize(self.length, 0.0);
        let mut spectrum = self.forward.make_output_vec();
        self.forward(&mut input, &mut spectrum, &mut self.scratch());
        spectrum
    }

    /// The signal of a spectrum, with the factor 1/n.
    pub fn series(&self, mut spectrum: Vec<Complex<f64>>) -> Vec<f64> {
        spectrum.resize(self.length / 2 + 1, Complex::new(0.0, 0.0));
        let mut x = self.inverse.make_output_vec();
        self.inverse(&mut spectrum, &mut x, &mut self.scratch());
        let share = 1.0 / self.length as f64;
        x.iter_mut().for_each(|v| *v *= share);
        x
    }
}

/// The smallest length of at least `n` that transforms quickly: 2^a, 3·2^a or 9·2^a.
pub fn fast_length(n: usize) -> usize {
    let power = |odd: usize| odd * n.div_ceil(odd).next_power_of_two();
    power(1).min(power(3)).min(power(9))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn complex(n: usize) -> Vec<Complex<f64>> {
        let value =
            |k: usize| Complex::new((k as f64 * 1.7).sin(), (k as f64 * k as f64 * 0.3).cos());
        (0..n).map(value).collect()
    }

    #[test]
    fn the_transform_and_its_inverse_come_back() {
        for n in (0..40).chain([127, 128, 151, 1000]) {
            let x = complex(n);
            let mut spectrum = x.clone();
            dft(&mut spectrum);
            let back = inverse_dft(&spectrum);
            assert!(back.iter().zip(&x).all(|(b, x)| (b / n as f64 - x).norm() < 1e-12), "{n}");
        }
    }

    #[test]
    fn inverse_dft_is_the_direct_sum_for_every_length() {
        for n in (1..70).chain([127, 128, 151, 1000]) {
            let spectrum = complex(n);
            for (t, fast) in inverse_dft(&spectrum).iter().enumerate() {
                let slow: Complex<f64> = spectrum
                    .iter()
                    .enumerate()
                    .map(|(k, x)| {
                        x * Complex::from_polar(1.0, 2.0 * PI * (k * t % n) as f64 / n as f64)
                    })
                    .sum();
                assert!((fast - slow).norm() < 1e-11, "length {n}, sample {t}");
            }
        }
    }

    #[test]
    fn the_real_transform_is_the_direct_sum_and_comes_back() {
        for n in (1..40).chain([127, 128, 151, 192]) {
            let x: Vec<f64> = (0..n)
                .map(|t| (t as f64 * 1.3).sin() + (t as f64 * t as f64 * 0.7).cos())
                .collect();
            let fourier = RealFourier::new(n);
            let spectrum = fourier.spectrum(x.iter().copied());
            assert_eq!(spectrum.len(), n / 2 + 1);
            for (k, fast) in spectrum.iter().enumerate() {
                let slow: Complex<f64> = x
                    .iter()
                    .enumerate()
                    .map(|(t, x)| {
                        Complex::from_polar(*x, -2.0 * PI * (k * t % n) as f64 / n as f64)
                    })
                    .sum();
                assert!((fast - slow).norm() < 1e-11, "length {n}, line {k}");
            }
            let back = fourier.series(spectrum);
            assert!(back.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-12), "length {n}");
        }
    }

    #[test]
    fn fast_lengths_are_long_enough_and_close() {
        for n in 1..5000 {
            let fast = fast_length(n);
            assert!(fast >= n && fast < 2 * n.max(9), "{n}: {fast}");
        }
        assert_eq!((fast_length(2_097_151), fast_length(1100), fast_length(9)), (1 << 21, 1152, 9));
    }
}
