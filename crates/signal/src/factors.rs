//! Roots of a polynomial that reproduce it, for any spread of its coefficients and any distance of its roots.
//!
//! How it can be wrong: roots may agree with the polynomial one by one and not jointly (the product of all factors is tested). Coefficients cancel in narrow
//! bands (values are compared, at points near the roots). Rounding spoils values (they are sums in double-double arithmetic).

use nalgebra::Complex;

use super::polynomial::roots;

/// Sweeps over all roots; some ten are usual.
const SWEEPS: usize = 60;
/// A root that moves less than this, relatively, has converged.
const STANDS: f64 = 4.0 * f64::EPSILON;
/// An imaginary part below this, relatively, is none, and conjugates agree to this.
const CONJUGATE: f64 = 1e-11;

/// A number as the sum of two floating-point numbers, the second below half a unit of the first's last place.
///
/// Source: Dekker (1971), "A floating-point technique for extending the available precision", doi:10.1007/BF01397083.
#[derive(Debug, Clone, Copy, Default)]
struct Double {
    high: f64,
    low: f64,
}

impl Double {
    fn sum(a: f64, b: f64) -> Self {
        let high = a + b;
        let part = high - a;
        Self { high, low: (a - (high - part)) + (b - part) }
    }

    fn add(self, other: Self) -> Self {
        let (high, low) = (Self::sum(self.high, other.high), Self::sum(self.low, other.low));
        let first = Self::sum(high.high, high.low + low.high);
        Self::sum(first.high, first.low + low.low)
    }

    fn times(self, by: f64) -> Self {
        let high = self.high * by;
        Self::sum(high, self.high.mul_add(by, -high) + self.low * by)
    }

    fn value(self) -> f64 {
        self.high + self.low
    }
}

/// Σ cₖ·xᵏ with twice the digits, rounded once.
fn value(c: &[f64], x: Complex<f64>) -> Complex<f64> {
    let (mut re, mut im) = (Double::default(), Double::default());
    for &c in c.iter().rev() {
        let next = re.times(x.re).add(im.times(-x.im)).add(Double { high: c, low: 0.0 });
        im = re.times(x.im).add(im.times(x.re));
        re = next;
    }
    Complex::new(re.value(), im.value())
}

/// lead·Π(x − root).
fn product(lead: f64, roots: &[Complex<f64>], x: Complex<f64>) -> Complex<f64> {
    roots.iter().fold(Complex::from(lead), |product, root| product * (x - root))
}

/// The relative distance of lead·Π(x − root) from c₀ + c₁x + … + cₙxⁿ, at the worst of the points.
///
/// Infinite where a value is no number.
pub fn unlike(c: &[f64], roots: &[Complex<f64>], points: &[Complex<f64>]) -> f64 {
    let Some(&lead) = c.last() else { return f64::INFINITY };
    points.iter().fold(0.0, |worst: f64, &x| {
        let off = (product(lead, roots, x) / value(c, x) - 1.0).norm();
        if off.is_nan() { f64::INFINITY } else { worst.max(off) }
    })
}

/// Roots of c₀ + c₁x + … + cₙxⁿ to the last digits, conjugates exact; c₀ and cₙ are not zero. `None` where roots are so close that twice the digits do not
/// separate them.
///
/// Börsch-Supan's simultaneous iteration from those of [`roots`], with values of twice the digits.
///
/// Source: Börsch-Supan (1970), "Residuenabschätzung für Polynom-Nullstellen mittels Lagrange-Interpolation", Numer. Math. 14, 287-296,
/// doi:10.1007/BF02163336.
pub fn refined_roots(c: &[f64]) -> Option<Vec<Complex<f64>>> {
    let lead = *c.last()?;
    let mut x = roots(c);
    let mut moved = x.len() + 1 == c.len();
    for _ in 0..SWEEPS {
        if !moved {
            return conjugated(x);
        }
        moved = false;
        let w: Vec<Complex<f64>> = (0..x.len())
            .map(|i| {
                let others = (0..x.len()).filter(|&j| j != i).map(|j| x[i] - x[j]);
                others.fold(value(c, x[i]) / lead, |w, apart| w / apart)
            })
            .collect();
        for (i, next) in stepped(&x, &w).into_iter().enumerate() {
            if !next.is_finite() {
                return None;
            }
            moved |= (next - x[i]).norm() > STANDS * x[i].norm();
            x[i] = next;
        }
    }
    None
}

/// x − w/(1 + Σ wⱼ/(x − xⱼ)).
fn stepped(x: &[Complex<f64>], w: &[Complex<f64>]) -> Vec<Complex<f64>> {
    (0..x.len())
        .map(|i| {
            let others: Complex<f64> =
                (0..x.len()).filter(|&j| j != i).map(|j| w[j] / (x[i] - x[j])).sum();
            x[i] - w[i] / (others + 1.0)
        })
        .collect()
}

/// The same roots with conjugates that are exact; `None` where one has none.
fn conjugated(x: Vec<Complex<f64>>) -> Option<Vec<Complex<f64>>> {
    let is_real = |r: &Complex<f64>| r.im.abs() <= CONJUGATE * r.norm();
    let (real, complex): (Vec<Complex<f64>>, Vec<Complex<f64>>) = x.into_iter().partition(is_real);
    let (upper, mut lower): (Vec<Complex<f64>>, Vec<Complex<f64>>) =
        complex.into_iter().partition(|r| r.im > 0.0);
    let mut found: Vec<Complex<f64>> = real.into_iter().map(|r| Complex::from(r.re)).collect();
    for r in upper {
        let apart = |other: &Complex<f64>| (other - r.conj()).norm();
        let at = (0..lower.len()).min_by(|&i, &j| apart(&lower[i]).total_cmp(&apart(&lower[j])))?;
        if apart(&lower.remove(at)) > CONJUGATE * r.norm() {
            return None;
        }
        found.extend([r, r.conj()]);
    }
    lower.is_empty().then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// (x − 1)(x − 1 − 2⁻²⁰)(x − 1 + 2⁻²⁰) has these coefficients exactly, and roots that single digits give to 1e-6.
    #[test]
    fn close_roots_of_exact_coefficients_are_found_to_the_last_digit() {
        let e = 2f64.powi(-20);
        // (x − 1)³ − e²(x − 1).
        let c = [-1.0 + e * e, 3.0 - e * e, -3.0, 1.0];
        let mut found: Vec<f64> = refined_roots(&c).unwrap().iter().map(|r| r.re).collect();
        found.sort_by(f64::total_cmp);
        for (found, expected) in found.iter().zip([1.0 - e, 1.0, 1.0 + e]) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
    }

    #[test]
    fn roots_of_another_polynomial_are_unlike_this_one() {
        let c = [6.0, 5.0, 1.0];
        let points = [Complex::new(0.0, 1.0), Complex::new(0.0, 30.0)];
        let roots = |a: f64, b: f64| [Complex::from(a), Complex::from(b)];
        assert!(unlike(&c, &roots(-2.0, -3.0), &points) < 1e-15);
        assert!(unlike(&c, &roots(-2.0, -3.1), &points) > 1e-3);
        assert!(unlike(&c, &roots(f64::NAN, -3.0), &points).is_infinite());
    }
}
