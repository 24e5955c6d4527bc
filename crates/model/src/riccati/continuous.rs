//! The continuous algebraic Riccati equation, and its regulator.
//!
//! How it can be wrong: the solution is not the stabilising one (the poles of the loop are checked). Rounding leaves a residual (Newton steps remove it). Units
//! are far apart (the states are scaled).

use nalgebra::DMatrix;

use super::doubling::doubling;
use super::newton::{Newton, Refined};
use super::regulator::{Lqr, check_weights, smallest_eigenvalue, symmetric};
use crate::balance::Units;
use crate::error::ModelError;
use crate::lyapunov::lyap;
use crate::zeros;

/// Largest number of Newton steps; each at least halves the residual.
const NEWTON_STEPS: usize = 20;
/// Largest relative residual of an accepted solution, relative to the terms of the equation.
const TRUSTED: f64 = 1e-9;

/// The stabilising solution X of AᵀX + XA − (XB + N)R⁻¹(BᵀX + Nᵀ) + Q = 0, as MATLAB's `care`.
///
/// Shapes: A n×n, B n×m, Q n×n, R m×m, N n×m (`None`: 0).
///
/// # Errors
/// As [`lqr`].
pub fn care(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<DMatrix<f64>, ModelError> {
    Ok(lqr(a, b, q, r, n)?.x)
}

/// The gain K that minimises ∫ xᵀQx + uᵀRu + 2xᵀNu dt over ẋ = A x + B u by u = −K x. MATLAB: `lqr`.
///
/// Structure-preserving doubling of the Cayley transform, then Newton steps.
/// Source: Chu, Fan and Lin (2005), "A structure-preserving doubling algorithm for continuous-time algebraic Riccati equations", Linear Algebra Appl. 396, 55-80,
/// doi:10.1016/j.laa.2004.10.010; Kleinman (1968), doi:10.1109/TAC.1968.1098829.
///
/// # Errors
/// [`ModelError::Shape`], [`ModelError::NotFinite`], [`ModelError::NotSymmetric`], [`ModelError::WeightR`]; [`ModelError::IllConditioned`] where no
/// stabilising solution was found.
pub fn lqr(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<Lqr, ModelError> {
    let (order, inputs) = (a.nrows(), b.ncols());
    let zero = DMatrix::zeros(order, inputs);
    let n = n.unwrap_or(&zero);
    check_weights([a, b, q, r, n])?;
    let Some(inverse) = r.clone().cholesky().map(|c| c.inverse()) else {
        return Err(ModelError::WeightR { smallest: smallest_eigenvalue(r) });
    };
    if order == 0 || inputs == 0 {
        let poles = zeros::eigenvalues(a);
        if order > 0 && !poles.iter().all(|p| p.re < 0.0) {
            return Err(ModelError::IllConditioned { residual: f64::INFINITY });
        }
        let x = if order == 0 { q.clone() } else { lyap(&a.transpose(), q)? };
        return Ok(Lqr { k: DMatrix::zeros(inputs, order), x, poles });
    }
    // The weight of an input is its effect at unit cost, that of a state its cost.
    let driven = b * inverse.map(|v| v.abs().sqrt());
    let seen = DMatrix::from_diagonal(&q.diagonal().map(|v| v.abs().sqrt()));
    let Some(units) = Units::of_model(a, &driven, &seen).worth() else {
        return in_units([a, b, q, r, n], &inverse);
    };
    let (b, n) = (units.driven(b), units.shown(&n.transpose()).transpose());
    let found = in_units([&units.scaled(a), &b, &units.weighed(q), r, &n], &inverse)?;
    let (k, x) = (units.unshown(&found.k), units.unweighed(&found.x));
    Ok(Lqr { k, x, ..found })
}

fn in_units(
    [a, b, q, r, n]: [&DMatrix<f64>; 5],
    inverse: &DMatrix<f64>,
) -> Result<Lqr, ModelError> {
    let ill = |residual| ModelError::IllConditioned { residual };
    let gain = |x: &DMatrix<f64>| inverse * (b.transpose() * x + n.transpose());
    let residual = |x: &DMatrix<f64>, k: &DMatrix<f64>| {
        symmetric(a.transpose() * x + x * a - k.transpose() * r * k + q)
    };
    let first = cayley(
        &(a - b * inverse * n.transpose()),
        &symmetric(b * inverse * b.transpose()),
        &symmetric(q - n * inverse * n.transpose()),
    )
    .ok_or_else(|| ill(f64::INFINITY))?;
    let newton = Newton {
        gain: |x: &DMatrix<f64>| Some(gain(x)),
        residual: |x: &DMatrix<f64>, k: &DMatrix<f64>| residual(x, k),
        correction: |k: &DMatrix<f64>, error: &DMatrix<f64>| {
            lyap(&(a - b * k).transpose(), error).ok()
        },
        steps: NEWTON_STEPS,
        free: 0,
        settled: 0.0,
    };
    let Refined { x, k, error } = newton.refine(first).ok_or_else(|| ill(f64::INFINITY))?;
    let poles = zeros::eigenvalues(&(a - b * &k));
    let size = q.norm() + 2.0 * a.norm() * x.norm() + (k.transpose() * r * &k).norm();
    let relative = error.norm() / size.max(f64::MIN_POSITIVE);
    if relative <= TRUSTED && poles.iter().all(|p| p.re < 0.0) {
        Ok(Lqr { k, x, poles })
    } else {
        Err(ill(relative))
    }
}

/// The doubling of the Cayley transform (s + γ)/(s − γ) of AᵀX + XA − XGX + H = 0.
fn cayley(a: &DMatrix<f64>, g: &DMatrix<f64>, h: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let size = a.norm().max((g.norm() * h.norm()).sqrt());
    // Beyond every pole, so that the shifted matrices are regular.
    let gamma = if size > 0.0 { 2.0 * size } else { 1.0 };
    let shifted = a - DMatrix::identity(n, n) * gamma;
    let inverse = shifted.clone().lu().try_inverse()?;
    let w = (shifted.transpose() + h * &inverse * g).lu().try_inverse()?;
    let by = 2.0 * gamma;
    let e = DMatrix::identity(n, n) + w.transpose() * by;
    doubling(&e, &(&inverse * g * &w * by), &(&w * h * &inverse * by))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn m(rows: usize, entries: &[f64]) -> DMatrix<f64> {
        DMatrix::from_row_slice(rows, entries.len() / rows, entries)
    }

    /// 2ax − x²b²/r + q = 0 by hand: a = b = q = r = 1 gives 1 + √2.
    #[test]
    fn the_scalar_equation_has_the_silver_ratio_as_its_solution() {
        let one = m(1, &[1.0]);
        let found = lqr(&one, &one, &one, &one, None).unwrap();
        let silver = 1.0 + 2f64.sqrt();
        assert!(
            (found.x[(0, 0)] - silver).abs() < 1e-15 && (found.k[(0, 0)] - silver).abs() < 1e-15
        );
        assert!((found.poles[0].re + 2f64.sqrt()).abs() < 1e-15);
    }

    /// A double integrator with Q = diag(1, 0), R = 1: X = [√2 1; 1 √2], K = [1 √2].
    #[test]
    fn the_double_integrator_has_its_textbook_gain_in_any_units() {
        for t in [1.0, 1e9, 1e-9] {
            let a = m(2, &[0.0, t, 0.0, 0.0]);
            let found =
                lqr(&a, &m(2, &[0.0, 1.0 / t]), &m(2, &[1.0, 0.0, 0.0, 0.0]), &m(1, &[1.0]), None)
                    .unwrap();
            let root = 2f64.sqrt();
            assert!((found.k[(0, 0)] - 1.0).abs() < 1e-14, "{t} {found:?}");
            assert!((found.k[(0, 1)] / t - root).abs() < 1e-14, "{t} {found:?}");
            assert!((found.x[(0, 1)] / t - 1.0).abs() < 1e-14, "{t} {found:?}");
        }
    }

    /// Other tools that check symmetry require the last bit.
    #[test]
    fn solutions_are_symmetric_to_the_last_bit() {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        for _ in 0..300 {
            let mut drawn = |rows: usize, columns: usize| {
                DMatrix::from_fn(rows, columns, |_, _| random.random_range(-1.0..1.0))
            };
            let (a, b) = (drawn(4, 4), drawn(4, 2));
            let found =
                lqr(&a, &b, &DMatrix::identity(4, 4), &DMatrix::identity(2, 2), None).unwrap();
            assert_eq!(found.x, found.x.transpose());
        }
    }

    #[test]
    fn what_no_input_moves_and_inputs_without_cost_are_refused() {
        let a = m(2, &[1.0, 0.0, 0.0, -1.0]);
        let (b, one) = (m(2, &[0.0, 1.0]), m(1, &[1.0]));
        assert!(lqr(&a, &b, &DMatrix::identity(2, 2), &one, None).is_err());
        let free = lqr(&a, &b, &DMatrix::identity(2, 2), &m(1, &[0.0]), None);
        assert!(matches!(free, Err(ModelError::WeightR { .. })));
    }
}
