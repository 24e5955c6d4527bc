//! The continuous algebraic Riccati equation, the regulator that it gives, and the filters that are their transposes.
//!
//! How it can be wrong: a solution that is not the stabilising one (the poles of the loop are looked at), rounding (Newton steps take it off), units far apart
//! (states are brought to like ones).

use nalgebra::{Complex, DMatrix};

use super::balance::Units;
use super::error::ModelError;
use super::lyapunov::lyap;
use super::riccati::{Lqr, check_weights, dlqr, doubling, smallest_eigenvalue, symmetric};
use super::zeros;

/// Newton steps, each of which halves the residual at least.
const NEWTON_STEPS: usize = 20;
/// The residual relative to the terms of the equation above which a solution is refused.
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

/// The gain K that minimises ∫ xᵀQx + uᵀRu + 2xᵀNu dt over ẋ = A x + B u by u = −K x, as MATLAB's `lqr`.
///
/// Structure-preserving doubling of the Cayley transform, then Newton steps.
/// Source: Chu, Fan and Lin (2005), "A structure-preserving doubling algorithm for continuous-time algebraic Riccati equations", Linear Algebra Appl. 396, 55-80,
/// doi:10.1016/j.laa.2004.10.010; Kleinman (1968), doi:10.1109/TAC.1968.1098829.
///
/// # Errors
/// [`ModelError::Shape`], [`ModelError::NotFinite`], [`ModelError::NotSymmetric`], [`ModelError::WeightR`]; [`ModelError::IllConditioned`] where no stabilising solution was found.
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
    // An input counts by what it moves at unit cost, a state by what it costs.
    let driven = b * inverse.map(|v| v.abs().sqrt());
    let seen = DMatrix::from_diagonal(&q.diagonal().map(|v| v.abs().sqrt()));
    let Some(units) = Units::beside(a, &driven, &seen).worth() else {
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
    let (mut k, mut x) = (gain(&first), first);
    let mut error = residual(&x, &k);
    for _ in 0..NEWTON_STEPS {
        let Ok(step) = lyap(&(a - b * &k).transpose(), &error) else { break };
        let next = symmetric(&x + step);
        let next_k = gain(&next);
        let next_error = residual(&next, &next_k);
        let helps = next_error.norm() < 0.5 * error.norm();
        if !helps {
            break;
        }
        (x, k, error) = (next, next_k, next_error);
    }
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

/// Kalman's filter in steady state.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter {
    /// The predictor's gain, n×p: x̂⁺ = A x̂ + L (y − C x̂), or the same of the derivative.
    pub gain: DMatrix<f64>,
    /// The covariance of the prediction's error, n×n.
    pub covariance: DMatrix<f64>,
    /// The poles of A − L C.
    pub poles: Vec<Complex<f64>>,
}

impl Filter {
    fn of(dual: Lqr) -> Self {
        Self { gain: dual.k.transpose(), covariance: dual.x, poles: dual.poles }
    }
}

/// Kalman's filter of x(k+1) = A x(k) + w, y = C x + v with covariances Q of w (n×n), R of v (p×p) and N between the two (n×p; `None`: 0), as MATLAB's `dlqe` and
/// `kalman` (the predictor's gain, A times that of the update).
///
/// # Errors
/// As [`dlqr`], of the transposed plant.
pub fn dlqe(
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<Filter, ModelError> {
    dlqr(&a.transpose(), &c.transpose(), q, r, n).map(Filter::of)
}

/// Kalman's filter of ẋ = A x + w, y = C x + v with intensities Q of w (n×n), R of v (p×p) and N between the two (n×p; `None`: 0), as MATLAB's `lqe`.
///
/// # Errors
/// As [`lqr`], of the transposed plant.
pub fn lqe(
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<Filter, ModelError> {
    lqr(&a.transpose(), &c.transpose(), q, r, n).map(Filter::of)
}

#[cfg(test)]
mod tests {
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
        let filter = lqe(&one, &one, &one, &one, None).unwrap();
        assert!((filter.gain[(0, 0)] - silver).abs() < 1e-15);
        // P = P/(1 + P) + 1: the golden ratio, and the predictor's gain P/(1 + P).
        let filter = dlqe(&one, &one, &one, &one, None).unwrap();
        let golden = (1.0 + 5f64.sqrt()) / 2.0;
        assert!((filter.covariance[(0, 0)] - golden).abs() < 1e-15);
        assert!((filter.gain[(0, 0)] - golden / (1.0 + golden)).abs() < 1e-15);
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

    #[test]
    fn what_no_input_moves_and_inputs_without_cost_are_refused() {
        let a = m(2, &[1.0, 0.0, 0.0, -1.0]);
        let (b, one) = (m(2, &[0.0, 1.0]), m(1, &[1.0]));
        assert!(lqr(&a, &b, &DMatrix::identity(2, 2), &one, None).is_err());
        let free = lqr(&a, &b, &DMatrix::identity(2, 2), &m(1, &[0.0]), None);
        assert!(matches!(free, Err(ModelError::WeightR { .. })));
    }
}
