//! The inverse discrete Fourier transform of any length.
//!
//! x(t) = Σₖ X(k)·exp(+2πi·k·t/n), t = 0 … n − 1: no factor 1/n.
//!
//! Source: L. I. Bluestein, 1970, "A linear filtering approach to the computation of discrete Fourier transform",
//! IEEE Transactions on Audio and Electroacoustics 18(4), 451-455.

use std::f64::consts::PI;

use nalgebra::Complex;

/// The signal whose spectrum is `spectrum`; O(n·log n) for every length n.
pub(super) fn inverse_dft(spectrum: &[Complex<f64>]) -> Vec<Complex<f64>> {
    let n = spectrum.len();
    if n.is_power_of_two() {
        let mut x = spectrum.to_vec();
        radix_2(&mut x, 1.0);
        return x;
    }
    // k·t = (k² + t² − (t − k)²)/2 makes the sum a convolution. k² is reduced first: the angle stays exact for large k.
    let chirp: Vec<Complex<f64>> =
        (0..n as u64).map(|k| Complex::from_polar(1.0, PI * (k * k % (2 * n as u64)) as f64 / n as f64)).collect();
    let padded = (2 * n).next_power_of_two();
    let mut a = vec![Complex::new(0.0, 0.0); padded];
    let mut b = a.clone();
    for (k, (x, c)) in spectrum.iter().zip(&chirp).enumerate() {
        a[k] = x * c;
        b[k] = c.conj();
        b[(padded - k) % padded] = c.conj();
    }
    radix_2(&mut a, -1.0);
    radix_2(&mut b, -1.0);
    for (a, b) in a.iter_mut().zip(&b) {
        *a *= b / padded as f64;
    }
    radix_2(&mut a, 1.0);
    chirp.iter().zip(&a).map(|(c, a)| c * a).collect()
}

/// In place; the length is a power of two; `sign` is that of the exponent.
fn radix_2(x: &mut [Complex<f64>], sign: f64) {
    let n = x.len();
    if n < 2 {
        return;
    }
    let bits = n.trailing_zeros();
    for i in 0..n {
        let j = i.reverse_bits() >> (usize::BITS - bits);
        if i < j {
            x.swap(i, j);
        }
    }
    let turn: Vec<Complex<f64>> = (0..n / 2).map(|j| Complex::from_polar(1.0, sign * 2.0 * PI * j as f64 / n as f64)).collect();
    let mut half = 1;
    while half < n {
        let stride = n / (2 * half);
        for block in x.chunks_exact_mut(2 * half) {
            let (even, odd) = block.split_at_mut(half);
            for (j, (e, o)) in even.iter_mut().zip(odd).enumerate() {
                let turned = *o * turn[j * stride];
                (*e, *o) = (*e + turned, *e - turned);
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
