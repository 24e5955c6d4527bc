//! All roots of a polynomial at once.

use nalgebra::Complex;

const ONE: Complex<f64> = Complex::new(1.0, 0.0);

/// Sweeps over all roots; some ten are usual.
const SWEEPS: usize = 200;

/// The value and the derivative of Σ cₖ·xᵏ.
pub fn evaluate(c: &[f64], x: Complex<f64>) -> [Complex<f64>; 2] {
    let mut sums = [Complex::ZERO; 2];
    for &c in c.iter().rev() {
        sums = [sums[0] * x + c, sums[1] * x + sums[0]];
    }
    sums
}

/// Newton's step p/p′ at x, by the reversed polynomial outside the unit circle, where powers of x would overflow.
fn newton(c: &[f64], reversed: &[f64], x: Complex<f64>) -> Complex<f64> {
    if x.norm_sqr() <= 1.0 {
        let [p, slope] = evaluate(c, x);
        return p / slope;
    }
    // p(x) = xⁿ·q(1/x), so p′/p = n/x − q′/q/x².
    let degree = (c.len() - 1) as f64;
    let inverse = x.inv();
    let [q, slope] = evaluate(reversed, inverse);
    (inverse * (Complex::from(degree) - inverse * slope / q)).inv()
}

/// The roots of c₀ + c₁x + … + cₙxⁿ, c₀ and cₙ not zero; fewer than two coefficients have none.
///
/// Aberth's simultaneous iteration from circles of the radii of Newton's polygon. A sweep is O(n²), and each root is as accurate as the coefficients permit, at
/// any spread of their sizes.
///
/// Source: Aberth (1973), Math. Comp. 27(122), 339-344, doi:10.1090/S0025-5718-1973-0329236-7; Bini (1996), Numer. Algorithms 13, 179-200,
/// doi:10.1007/BF02207694, for the start.
pub fn roots(c: &[f64]) -> Vec<Complex<f64>> {
    if c.len() < 2 || c.iter().any(|v| !v.is_finite()) || c[0] == 0.0 || c[c.len() - 1] == 0.0 {
        return Vec::new();
    }
    let reversed: Vec<f64> = c.iter().rev().copied().collect();
    let mut x = start(c);
    for _ in 0..SWEEPS {
        let mut moved = false;
        for i in 0..x.len() {
            let step = newton(c, &reversed, x[i]);
            if !step.is_finite() || step.norm() <= f64::EPSILON * x[i].norm() {
                continue;
            }
            let others: Complex<f64> = x
                .iter()
                .enumerate()
                .filter(|(j, _)| *j != i)
                .map(|(_, other)| (x[i] - other).inv())
                .sum();
            let step = step / (ONE - step * others);
            if step.is_finite() {
                x[i] -= step;
                moved |= step.norm() > 4.0 * f64::EPSILON * x[i].norm();
            }
        }
        if !moved {
            break;
        }
    }
    x
}

/// As many points on circles as the upper convex hull of (k, ln|cₖ|) has roots of that size.
fn start(c: &[f64]) -> Vec<Complex<f64>> {
    let point = |k: usize| (k as f64, c[k].abs().ln());
    let mut hull: Vec<usize> = Vec::new();
    for k in (0..c.len()).filter(|&k| c[k] != 0.0) {
        while let [.., a, b] = hull[..] {
            let ((xa, ya), (xb, yb), (xk, yk)) = (point(a), point(b), point(k));
            if (yb - ya) * (xk - xa) > (yk - ya) * (xb - xa) {
                break;
            }
            hull.pop();
        }
        hull.push(k);
    }
    let mut points = Vec::with_capacity(c.len() - 1);
    for (edge, ends) in hull.windows(2).enumerate() {
        let &[from, to] = ends else { continue };
        let ((xa, ya), (xb, yb)) = (point(from), point(to));
        let radius = ((ya - yb) / (xb - xa)).exp();
        for i in from..to {
            // An angle that is no fraction of a turn, so that no start lies on the real axis or on another's mirror image.
            let turn =
                std::f64::consts::TAU * (i - from) as f64 / (xb - xa) + 0.7 + 0.4 * edge as f64;
            points.push(Complex::from_polar(radius, turn));
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sorted(mut x: Vec<Complex<f64>>) -> Vec<Complex<f64>> {
        x.sort_by(|a, b| a.re.total_cmp(&b.re).then(a.im.total_cmp(&b.im)));
        x
    }

    #[test]
    fn roots_of_a_product_are_those_of_its_factors() {
        // (x − 0.5)(x + 3)(x² + x + 1.25), roots 0.5, −3, −0.5 ± i.
        let found = sorted(roots(&[-1.875, 1.625, 2.25, 3.5, 1.0]));
        let expected = [
            Complex::new(-3.0, 0.0),
            Complex::new(-0.5, -1.0),
            Complex::new(-0.5, 1.0),
            Complex::new(0.5, 0.0),
        ];
        for (f, e) in found.iter().zip(&expected) {
            assert!((f - e).norm() < 1e-12, "{found:?}");
        }
        assert!(roots(&[1.0]).is_empty() && roots(&[]).is_empty() && roots(&[0.0, 1.0]).is_empty());
    }

    #[test]
    fn roots_of_many_noisy_coefficients_are_the_eigenvalues_of_the_companion() {
        let mut state = 7_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let c: Vec<f64> = (0..71)
            .map(|k| 0.02 * random() + if k < 8 { 0.0 } else { 0.8_f64.powi(k - 8) })
            .collect();
        let n = c.len() - 1;
        let companion = nalgebra::DMatrix::from_fn(n, n, |i, j| {
            if i == 0 { -c[n - 1 - j] / c[n] } else { f64::from(u8::from(i == j + 1)) }
        });
        let eigenvalues = crate::decompositions::eigenvalues(&companion);
        for root in roots(&c) {
            let nearest =
                eigenvalues.iter().map(|e| (e - root).norm()).fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-9 * root.norm().max(1.0), "{root}");
        }
        // Vieta: the product of the roots, and no root found twice.
        let product = roots(&c).into_iter().fold(ONE, |p, r| p * r);
        assert!((product.re - c[0] / c[n]).abs() < 1e-9 * (c[0] / c[n]).abs(), "{product}");
    }

    #[test]
    fn sizes_far_apart_do_not_hurt() {
        // 1e-12 + x^10·(1 − 0.5x): ten roots of size 0.063 and one at 2.
        let mut c = vec![0.0; 12];
        (c[0], c[10], c[11]) = (1e-12, 1.0, -0.5);
        let found = roots(&c);
        assert_eq!(found.len(), 11);
        assert_eq!(
            found.iter().filter(|x| (x.norm() / 10.0_f64.powf(-1.2) - 1.0).abs() < 0.01).count(),
            10
        );
        assert!(found.iter().any(|x| (x - Complex::new(2.0, 0.0)).norm() < 1e-9));
    }
}
