//! Lyapunov equations and the H2 norm.
//!
//! How it can be wrong: a pole and the mirror image of another that rounding does not separate (refused); states in widely different units (rescaled).

use nalgebra::{Complex, DMatrix, Schur};

use super::balance::Units;
use super::error::ModelError;
use super::shape::check_matrix;
use super::state_space::{StateSpace, TimeDomain};

/// A sum of poles (or a product minus 1) below this relative size is 0.
const SINGULAR: f64 = 1e-14;

/// The solution X of A X + X Aᵀ + Q = 0, as MATLAB's `lyap`. A and Q are n×n; X is symmetric where Q is.
///
/// Source: Bartels and Stewart (1972), "Solution of the matrix equation AX + XB = C", Comm. ACM 15(9), 820-826, doi:10.1145/361573.361582.
///
/// # Errors
/// [`ModelError::Shape`], [`ModelError::NotFinite`]; [`ModelError::Singular`] where two poles add up to 0.
pub fn lyap(a: &DMatrix<f64>, q: &DMatrix<f64>) -> Result<DMatrix<f64>, ModelError> {
    solved(a, q, false)
}

/// The solution X of A X Aᵀ − X + Q = 0, as MATLAB's `dlyap`. A and Q are n×n; X is symmetric where Q is.
///
/// Source: Kitagawa (1977), "An algorithm for solving the matrix equation X = FXF' + S", Int. J. Control 25(5), 745-753, doi:10.1080/00207177708922266.
///
/// # Errors
/// [`ModelError::Shape`], [`ModelError::NotFinite`]; [`ModelError::Singular`] where the product of two poles is 1.
pub fn dlyap(a: &DMatrix<f64>, q: &DMatrix<f64>) -> Result<DMatrix<f64>, ModelError> {
    solved(a, q, true)
}

fn solved(a: &DMatrix<f64>, q: &DMatrix<f64>, sampled: bool) -> Result<DMatrix<f64>, ModelError> {
    let n = a.nrows();
    for (matrix, got) in [("A", a), ("Q", q)] {
        check_matrix(matrix, got, (n, n))?;
    }
    if n == 0 {
        return Ok(q.clone());
    }
    // X is a weight of the states: in units T it is T⁻¹XT⁻¹.
    match Units::of(a).worth() {
        Some(units) => {
            let x = in_schur_form(&units.scaled(a), &units.unweighed(q), sampled)?;
            Ok(units.weighed(&x))
        }
        None => in_schur_form(a, q, sampled),
    }
}

fn in_schur_form(
    a: &DMatrix<f64>,
    q: &DMatrix<f64>,
    sampled: bool,
) -> Result<DMatrix<f64>, ModelError> {
    let n = a.nrows();
    let one = Complex::new(1.0, 0.0);
    let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
    let schur = Schur::try_new(complex(a), f64::EPSILON, 1000 * n)
        .ok_or(ModelError::IllConditioned { residual: f64::INFINITY })?;
    let (basis, t) = schur.unpack();
    let c = basis.adjoint() * complex(q) * &basis;
    let mut y = DMatrix::<Complex<f64>>::zeros(n, n);
    let size = t.norm();
    for j in (0..n).rev() {
        // The contribution of the later columns.
        let mut behind = nalgebra::DVector::<Complex<f64>>::zeros(n);
        for k in j + 1..n {
            behind += y.column(k) * t[(j, k)].conj();
        }
        let own = t[(j, j)].conj();
        let (mut left, right) = if sampled {
            (&t * own, -(c.column(j) + &t * behind))
        } else {
            (t.clone(), -(c.column(j) + behind))
        };
        for i in 0..n {
            left[(i, i)] += if sampled { -one } else { own };
            let scale = if sampled { 1.0 + (t[(i, i)] * own).norm() } else { size };
            if left[(i, i)].norm() <= SINGULAR * scale {
                let poles = [t[(i, i)], t[(j, j)]];
                return Err(ModelError::Singular {
                    first: format!("{:.4}{:+.4}i", poles[0].re, poles[0].im),
                    second: format!("{:.4}{:+.4}i", poles[1].re, poles[1].im),
                    rule: if sampled { "their product is 1" } else { "their sum is 0" },
                });
            }
        }
        let column = left
            .solve_upper_triangular(&right)
            .ok_or(ModelError::IllConditioned { residual: f64::INFINITY })?;
        y.set_column(j, &column);
    }
    let x = (&basis * y * basis.adjoint()).map(|v| v.re);
    // Rounding makes a symmetric problem's solution slightly asymmetric.
    Ok(if q == &q.transpose() { (&x + x.transpose()) * 0.5 } else { x })
}

impl<T: TimeDomain> StateSpace<T> {
    /// The H2 norm: the root of the energy of the impulse responses of all pairs, or the standard deviation of the outputs under white noise. Infinite unless
    /// every pole is stable, and for a continuous direct path. Delays have no influence.
    ///
    /// Source: Zhou, Doyle and Glover (1996), "Robust and Optimal Control", section 4.6.
    #[must_use]
    pub fn norm_h2(&self) -> f64 {
        let sampled = self.domain().sample_time_s().is_some();
        if !self.is_stable() || (!sampled && self.d().iter().any(|v| *v != 0.0)) {
            return f64::INFINITY;
        }
        let driven = self.b() * self.b().transpose();
        let reached = if sampled { dlyap(self.a(), &driven) } else { lyap(self.a(), &driven) };
        let direct = if sampled { self.d().norm_squared() } else { 0.0 };
        reached.map_or(f64::INFINITY, |p| {
            let seen = (self.c() * p * self.c().transpose()).trace();
            (seen.max(0.0) + direct).sqrt()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state_space::{Continuous, Sampled};
    use deadtime_signal::time::SampleTime;

    fn m(n: usize, entries: &[f64]) -> DMatrix<f64> {
        DMatrix::from_row_slice(n, entries.len() / n, entries)
    }

    /// ∫ (b·e^(−at))² dt = b²/2a, and Σ of the sampled squares is b²/(1 − a²) behind one sample.
    #[test]
    fn the_h2_norm_of_a_lag_is_the_energy_of_its_impulse_response() {
        let one = |v: f64| DMatrix::from_element(1, 1, v);
        let sys = StateSpace::new(one(-3.0), one(2.0), one(5.0), one(0.0), Continuous).unwrap();
        assert!((sys.norm_h2() - 10.0 / 6f64.sqrt()).abs() < 1e-14);
        let ts = Sampled(SampleTime::new(0.1).unwrap());
        let sys = StateSpace::new(one(0.6), one(2.0), one(5.0), one(3.0), ts).unwrap();
        assert!((sys.norm_h2() - (9.0 + 100.0 / 0.64_f64).sqrt()).abs() < 1e-13);
        let direct = StateSpace::new(one(-3.0), one(2.0), one(5.0), one(1.0), Continuous).unwrap();
        let unstable = StateSpace::new(one(3.0), one(2.0), one(5.0), one(0.0), Continuous).unwrap();
        assert!(direct.norm_h2().is_infinite() && unstable.norm_h2().is_infinite());
    }

    #[test]
    fn poles_that_mirror_each_other_are_named() {
        let a = m(2, &[1.0, 0.0, 0.0, -1.0]);
        let q = DMatrix::identity(2, 2);
        let told = lyap(&a, &q).unwrap_err().to_string();
        assert!(told.contains("their sum is 0"), "{told}");
        let told = dlyap(&m(2, &[2.0, 0.0, 0.0, 0.5]), &q).unwrap_err().to_string();
        assert!(told.contains("their product is 1"), "{told}");
        assert!(lyap(&a, &DMatrix::identity(3, 3)).is_err());
    }
}
