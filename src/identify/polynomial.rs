//! Polynomials F(q) = 1 + f₁q⁻¹ + …: roots, stability, and filtering by 1/F.

use nalgebra::{Complex, DMatrix};

use super::regression::Record;

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
    roots(f).map_or(f64::NAN, |roots| roots.iter().map(|p| p.norm()).fold(0.0, f64::max))
}

/// x/F with zero initial state.
pub(crate) fn filtered(x: &[f64], f: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; x.len()];
    filter(x, f, &mut out);
    out
}

/// The impulse response of 1/F up to where all that follows of it is below `least`; `rows` values at most.
pub(super) fn impulse_response(f: &[f64], rows: usize, least: f64, h: &mut Vec<f64>) {
    h.clear();
    let mut small = 0;
    while h.len() < rows && small < f.len().max(1) {
        let past: f64 = f.iter().zip(h.iter().rev()).map(|(c, v)| c * v).sum();
        let value = if h.is_empty() { 1.0 } else { -past };
        small = if value.abs() < least { small + 1 } else { 0 };
        h.push(value);
    }
}

/// out = x/F with zero initial state.
pub(super) fn filter(x: &[f64], f: &[f64], out: &mut [f64]) {
    if let &[f1, f2] = f {
        second_order(x, f1, f2, out);
        return;
    }
    for t in 0..x.len() {
        let past: f64 = f.iter().enumerate().filter(|(i, _)| *i < t).map(|(i, c)| c * out[t - 1 - i]).sum();
        out[t] = x[t] - past;
    }
}

/// Four values from the two before them at once: what lies between them need not be waited for.
fn second_order(x: &[f64], f1: f64, f2: f64, out: &mut [f64]) {
    // The impulse response of 1/F.
    let h1 = -f1;
    let h2 = -f1 * h1 - f2;
    let h3 = -f1 * h2 - f2 * h1;
    let h4 = -f1 * h3 - f2 * h2;
    let (mut y1, mut y2) = (0.0, 0.0);
    let ((xs, last), (to, rest)) = (x.as_chunks::<4>(), out.as_chunks_mut::<4>());
    for (o, &[a, b, c, d]) in to.iter_mut().zip(xs) {
        let before = -f2 * y2;
        *o = [
            a + before + h1 * y1,
            b + h1 * a + h1 * before + h2 * y1,
            c + h1 * b + h2 * a + h2 * before + h3 * y1,
            d + h1 * c + h2 * b + h3 * a + h3 * before + h4 * y1,
        ];
        (y2, y1) = (o[2], o[3]);
    }
    for (o, &v) in rest.iter_mut().zip(last) {
        let y = (v - f2 * y2) - f1 * y1;
        (y2, y1) = (y1, y);
        *o = y;
    }
}

/// A record without missing samples, both channels through 1/C from rest.
pub(crate) fn prefiltered<'b>(record: &Record<'_>, c: &[f64]) -> Record<'b> {
    Record::new(filtered(&record.u, c), filtered(&record.y, c))
}

/// The roots of 1 + f₁q⁻¹ + … in z; `None` where they cannot be found.
pub(super) fn roots(f: &[f64]) -> Option<Vec<Complex<f64>>> {
    let n = f.len();
    if n == 0 {
        return Some(Vec::new());
    }
    if f.iter().any(|c| !c.is_finite()) {
        return None;
    }
    let companion = DMatrix::from_fn(n, n, |i, j| if i == 0 { -f[j] } else { f64::from(u8::from(i == j + 1)) });
    // The iteration of `complex_eigenvalues` need not end where the coefficients differ by many powers of ten.
    let schur = nalgebra::Schur::try_new(companion, f64::EPSILON, 100 * n)?;
    let roots: Vec<Complex<f64>> = schur.complex_eigenvalues().iter().copied().collect();
    roots.iter().all(|r| r.re.is_finite() && r.im.is_finite()).then_some(roots)
}

/// The polynomial with these roots, which come in conjugate pairs.
pub(super) fn from_roots(roots: &[Complex<f64>]) -> Vec<f64> {
    let mut f = vec![Complex::new(1.0, 0.0)];
    for root in roots {
        let mut next = f.clone();
        next.push(Complex::new(0.0, 0.0));
        for (i, v) in f.iter().enumerate() {
            next[i + 1] -= root * v;
        }
        f = next;
    }
    f.iter().skip(1).map(|v| v.re).collect()
}

/// Roots nearer to the unit circle than this, or on it, are pulled in to it: a filter must forget.
const CIRCLE: f64 = 0.995;

/// The polynomial whose roots outside the unit circle are replaced by their mirror images inside: its spectrum is the same but for the gain.
pub(super) fn reflected(f: &[f64]) -> Option<Vec<f64>> {
    let all = roots(f)?;
    if all.iter().all(|r| r.norm() < 1.0 - 1e-9) {
        return Some(f.to_vec());
    }
    let inside: Vec<Complex<f64>> = all
        .into_iter()
        .map(|r| {
            let r = if r.norm() > 1.0 { r.conj().inv() } else { r };
            if r.norm() > CIRCLE { r * (CIRCLE / r.norm()) } else { r }
        })
        .collect();
    Some(from_roots(&inside))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_outside_come_back_inside_mirrored() {
        // (1 − 2q⁻¹)(1 − 0.5q⁻¹) → (1 − 0.5q⁻¹)².
        let f = reflected(&[-2.5, 1.0]).unwrap();
        assert!((f[0] + 1.0).abs() < 1e-9 && (f[1] - 0.25).abs() < 1e-9, "{f:?}");
        // 1 + 4q⁻²: ±2i → ±0.5i.
        let f = reflected(&[0.0, 4.0]).unwrap();
        assert!(f[0].abs() < 1e-9 && (f[1] - 0.25).abs() < 1e-9, "{f:?}");
        assert_eq!(reflected(&[-0.9]).unwrap(), [-0.9]);
        assert!(reflected(&[f64::NAN]).is_none());
    }

    #[test]
    fn four_values_at_once_are_those_of_one_after_the_other() {
        let x: Vec<f64> = (0..203).map(|t| ((t * 7919) % 13) as f64 - 6.0).collect();
        for f in [[-1.2, 0.5], [-1.999, 0.9991], [0.3, -0.6], [0.0, 0.9999]] {
            for samples in [0, 1, 3, 4, 6, 203] {
                let got = filtered(&x[..samples], &f);
                // An order of 3 whose last coefficient is 0 goes one value at a time.
                let want = filtered(&x[..samples], &[f[0], f[1], 0.0]);
                let size = want.iter().fold(1.0, |most: f64, v| most.max(v.abs()));
                // Either way rounds a few times per sample, and 1/F makes of a rounding what it makes of a pulse.
                let pulse: Vec<f64> = (0..samples).map(|t| f64::from(u8::from(t == 0))).collect();
                let grows: f64 = filtered(&pulse, &[f[0], f[1], 0.0]).iter().map(|h| h.abs()).sum();
                assert!(got.iter().zip(&want).all(|(g, w)| (g - w).abs() <= 16.0 * f64::EPSILON * grows * size), "{f:?} {samples}");
            }
        }
    }

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
