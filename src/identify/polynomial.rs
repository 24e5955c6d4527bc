//! Polynomials 1 + f₁q⁻¹ + … by their roots.

use nalgebra::{Complex, DMatrix};

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
}
