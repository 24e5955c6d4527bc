//! Denominators F(q) = 1 + f₁q⁻¹ + …: stability, roots, and filtering by 1/F.

use nalgebra::DMatrix;

/// Largest nf.
pub const MAX_ORDER: usize = 16;

/// F(q) has all roots well inside the unit circle (Schur-Cohn recursion).
pub(super) fn is_stable(f: &[f64]) -> bool {
    let mut a = [0.0; MAX_ORDER];
    let mut n = f.len();
    a[..n].copy_from_slice(f);
    while n > 0 {
        let k = a[n - 1];
        if k.is_nan() || k.abs() >= 1.0 - 1e-9 {
            return false;
        }
        let scale = 1.0 / (1.0 - k * k);
        let previous = a;
        for i in 0..n - 1 {
            a[i] = (previous[i] - k * previous[n - 2 - i]) * scale;
        }
        n -= 1;
    }
    true
}

/// The polynomial, its roots pulled in by a common factor until they are inside the unit circle.
pub(super) fn stabilised(mut f: Vec<f64>) -> Option<Vec<f64>> {
    for _ in 0..60 {
        if is_stable(&f) {
            return Some(f);
        }
        let mut factor = 0.9;
        for c in &mut f {
            *c *= factor;
            factor *= 0.9;
        }
    }
    None
}

/// The largest magnitude among the roots of F.
pub(crate) fn largest_pole(f: &[f64]) -> f64 {
    let n = f.len();
    if n == 0 {
        return 0.0;
    }
    let companion = DMatrix::from_fn(n, n, |i, j| if i == 0 { -f[j] } else { f64::from(u8::from(i == j + 1)) });
    companion.complex_eigenvalues().iter().map(|p| p.norm()).fold(0.0, f64::max)
}

/// x/F with zero initial state.
pub(crate) fn filtered(x: &[f64], f: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; x.len()];
    filter(x, f, &mut out);
    out
}

/// out = x/F with zero initial state.
pub(super) fn filter(x: &[f64], f: &[f64], out: &mut [f64]) {
    if let &[f1, f2] = f {
        let (mut y1, mut y2) = (0.0, 0.0);
        for (o, &v) in out.iter_mut().zip(x) {
            let y = (v - f2 * y2) - f1 * y1;
            (y2, y1) = (y1, y);
            *o = y;
        }
        return;
    }
    for t in 0..x.len() {
        let past: f64 = f.iter().enumerate().filter(|(i, _)| *i < t).map(|(i, c)| c * out[t - 1 - i]).sum();
        out[t] = x[t] - past;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stability_is_that_of_the_roots() {
        assert!(is_stable(&[-1.8, 0.81]));
        assert!(!is_stable(&[-2.0, 1.0]));
        assert!(!is_stable(&[-2.1, 1.05]));
        assert!(is_stable(&[]));
        assert!(!is_stable(&[f64::NAN, 0.0]));
        // (z − 0.9)(z² + 0.5z + 0.8): inside; (z − 1.1)(…): outside.
        let cubic = |p: f64| vec![0.5 - p, 0.8 - 0.5 * p, -0.8 * p];
        assert!(is_stable(&cubic(0.9)));
        assert!(!is_stable(&cubic(1.1)));
    }
}
