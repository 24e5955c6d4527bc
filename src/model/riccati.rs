//! The discrete algebraic Riccati equation and the linear-quadratic regulator.

use nalgebra::{Complex, DMatrix, SymmetricEigen};

use super::{ModelError, zeros};

/// A linear-quadratic regulator.
#[derive(Debug, Clone, PartialEq)]
pub struct Lqr {
    /// The gain of u = −K x, m×n.
    pub k: DMatrix<f64>,
    /// The stabilising solution of the Riccati equation, n×n, symmetric.
    pub x: DMatrix<f64>,
    /// The poles of A − B K.
    pub poles: Vec<Complex<f64>>,
}

/// The gain K that minimises Σ xᵀQx + uᵀRu + 2xᵀNu over x[k+1] = A x[k] + B u[k] by u = −K x, as MATLAB's `dlqr`.
///
/// Shapes: A n×n, B n×m, Q n×n, R m×m, N n×m (`None`: 0). The gain belongs to the state's realisation: two realisations of one transfer function
/// (the Tustin models of different tools, say) have different gains.
///
/// # Errors
/// As [`dare`].
pub fn dlqr(a: &DMatrix<f64>, b: &DMatrix<f64>, q: &DMatrix<f64>, r: &DMatrix<f64>, n: Option<&DMatrix<f64>>) -> Result<Lqr, ModelError> {
    solve(a, b, q, r, n)
}

/// (R + BᵀXB)⁻¹(BᵀXA + Nᵀ).
fn gain(a: &DMatrix<f64>, b: &DMatrix<f64>, r: &DMatrix<f64>, n: Option<&DMatrix<f64>>, x: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let xb = x * b;
    let weight = r + b.transpose() * &xb;
    let mut right = xb.transpose() * a;
    if let Some(n) = n {
        right += n.transpose();
    }
    weight.lu().solve(&right)
}

/// The stabilising solution X of AᵀXA − X − (AᵀXB + N)(R + BᵀXB)⁻¹(BᵀXA + Nᵀ) + Q = 0.
///
/// Structure-preserving doubling: quadratic convergence, no eigenvalue ordering; then one Newton step takes off what rounding left.
///
/// Source: Chu, Fan, Lin and Wang (2004), "Structure-preserving algorithms for periodic discrete-time algebraic Riccati equations",
/// Int. J. Control 77(8), 767-788, doi:10.1080/00207170410001714988.
///
/// # Errors
/// [`ModelError::Shape`], [`ModelError::NotFinite`], [`ModelError::NotSymmetric`], [`ModelError::WeightR`]; without a stabilising solution the assumption that
/// fails: [`ModelError::NotStabilisable`], [`ModelError::UnseenOnCircle`] or [`ModelError::Indefinite`]; [`ModelError::IllConditioned`] where the answer
/// could not be trusted.
pub fn dare(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> Result<DMatrix<f64>, ModelError> {
    Ok(solve(a, b, q, r, n)?.x)
}

/// The solution with its gain and closed loop, which prove it.
fn solve(a: &DMatrix<f64>, b: &DMatrix<f64>, q: &DMatrix<f64>, r: &DMatrix<f64>, n: Option<&DMatrix<f64>>) -> Result<Lqr, ModelError> {
    check(a, b, q, r, n)?;
    let order = a.nrows();
    let r_factor = r.clone().cholesky().ok_or_else(|| ModelError::WeightR { smallest: smallest_eigenvalue(r) })?;
    // The cross term goes into A and Q: u = v − R⁻¹Nᵀx.
    let (a0, q0) = match n {
        None => (a.clone(), q.clone()),
        Some(n) => {
            let shift = r_factor.solve(&n.transpose());
            (a - b * &shift, symmetric(q - n * shift))
        }
    };
    let g0 = symmetric(b * r_factor.solve(&b.transpose()));
    let identity = DMatrix::<f64>::identity(order, order);
    let (mut ak, mut gk, mut hk) = (a0.clone(), g0, q0.clone());
    let mut settled = false;
    for _ in 0..60 {
        let w = (&identity + &gk * &hk).lu();
        let (Some(wa), Some(wg)) = (w.solve(&ak), w.solve(&gk)) else { break };
        let step = symmetric(ak.transpose() * &hk * &wa);
        gk += symmetric(&ak * wg * ak.transpose());
        ak = &ak * wa;
        hk += &step;
        if !hk.iter().all(|v| v.is_finite()) {
            break;
        }
        if step.norm() <= 1e-16 * hk.norm() {
            settled = true;
            break;
        }
    }
    let Some(k) = (if settled { gain(a, b, r, n, &hk) } else { None }) else {
        return Err(why_none(&a0, b, &q0, q, r, n));
    };
    // One Newton step: the correction solves a Stein equation with the closed loop.
    let correction = stein(&(a - b * &k), &residual(a, q, r, n, &hk, &k, b));
    let x = symmetric(&hk + correction);
    // The correction of a closed loop that is not stable overflows.
    let gain = if x.iter().all(|v| v.is_finite()) { gain(a, b, r, n, &x) } else { None };
    let closed = gain.map(|k| (zeros::eigenvalues(&(a - b * &k)), k)).filter(|(poles, _)| poles.iter().all(|p| p.norm() < 1.0));
    let Some((poles, k)) = closed else {
        return Err(why_none(&a0, b, &q0, q, r, n));
    };
    let relative = residual(a, q, r, n, &x, &k, b).norm() / x.norm().max(q.norm()).max(f64::MIN_POSITIVE);
    if relative.is_nan() || relative > 1e-8 * (1.0 + a.norm().powi(2)) {
        return Err(ModelError::IllConditioned { residual: relative });
    }
    Ok(Lqr { k, x, poles })
}

/// The residual in the form that loses least: (A − BK)ᵀX(A − BK) + Q + KᵀRK − NK − KᵀNᵀ − X.
fn residual(
    a: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
    x: &DMatrix<f64>,
    k: &DMatrix<f64>,
    b: &DMatrix<f64>,
) -> DMatrix<f64> {
    let loop_matrix = a - b * k;
    let mut sum = loop_matrix.transpose() * x * &loop_matrix + q + k.transpose() * r * k - x;
    if let Some(n) = n {
        let nk = n * k;
        sum -= &nk + nk.transpose();
    }
    symmetric(sum)
}

/// Σ (Fᵀ)ⁱ E Fⁱ, by doubling; F is stable.
fn stein(f: &DMatrix<f64>, e: &DMatrix<f64>) -> DMatrix<f64> {
    let (mut f, mut sum) = (f.clone(), e.clone());
    for _ in 0..60 {
        let step = f.transpose() * &sum * &f;
        sum += &step;
        f = &f * &f;
        if step.norm() <= 1e-17 * sum.norm() {
            break;
        }
    }
    sum
}

fn symmetric(m: DMatrix<f64>) -> DMatrix<f64> {
    (&m + m.transpose()) * 0.5
}

fn smallest_eigenvalue(m: &DMatrix<f64>) -> f64 {
    SymmetricEigen::new(symmetric(m.clone())).eigenvalues.iter().copied().fold(f64::INFINITY, f64::min)
}

fn check(a: &DMatrix<f64>, b: &DMatrix<f64>, q: &DMatrix<f64>, r: &DMatrix<f64>, n: Option<&DMatrix<f64>>) -> Result<(), ModelError> {
    let (order, inputs) = (a.nrows(), b.ncols());
    let zero = DMatrix::zeros(order, inputs);
    let n = n.unwrap_or(&zero);
    for (matrix, got, rows, columns) in
        [("A", a, order, order), ("B", b, order, inputs), ("Q", q, order, order), ("R", r, inputs, inputs), ("N", n, order, inputs)]
    {
        if got.shape() != (rows, columns) {
            return Err(ModelError::Shape { matrix, rows, columns, got_rows: got.nrows(), got_columns: got.ncols() });
        }
        if let Some(at) = got.iter().position(|v| !v.is_finite()) {
            let (row, column) = (at % rows + 1, at / rows + 1);
            return Err(ModelError::NotFinite { matrix, row, column, value: got[(row - 1, column - 1)] });
        }
    }
    for (matrix, weight) in [("Q", q), ("R", r)] {
        let tolerance = 1e-10 * weight.norm();
        for j in 0..weight.ncols() {
            for i in 0..j {
                let difference = (weight[(i, j)] - weight[(j, i)]).abs();
                if difference > tolerance {
                    return Err(ModelError::NotSymmetric { matrix, row: i + 1, column: j + 1, difference });
                }
            }
        }
    }
    Ok(())
}

/// The assumption that fails, by the Popov-Belevitch-Hautus tests.
fn why_none(
    a0: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q0: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    n: Option<&DMatrix<f64>>,
) -> ModelError {
    let order = a0.nrows();
    let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
    let loses_rank = |lambda: Complex<f64>, beside: &DMatrix<f64>, stacked: &DMatrix<f64>| {
        let mut pencil = DMatrix::zeros(order, order + beside.ncols());
        pencil.view_mut((0, 0), (order, order)).copy_from(&(complex(stacked) - DMatrix::from_diagonal_element(order, order, lambda)));
        pencil.view_mut((0, order), beside.shape()).copy_from(&complex(beside));
        let singular = pencil.singular_values();
        let largest = singular.iter().copied().fold(0.0, f64::max);
        singular.iter().copied().fold(f64::INFINITY, f64::min) <= 1e-8 * largest
    };
    let poles = zeros::eigenvalues(a0);
    if let Some(p) = poles.iter().find(|p| p.norm() >= 1.0 - 1e-9 && loses_rank(**p, b, a0)) {
        return ModelError::NotStabilisable { re: p.re, im: p.im, magnitude: p.norm() };
    }
    if let Some(p) = poles.iter().find(|p| (p.norm() - 1.0).abs() <= 1e-6 && loses_rank(**p, q0, &a0.transpose())) {
        return ModelError::UnseenOnCircle { re: p.re, im: p.im };
    }
    let inputs = b.ncols();
    let mut joint = DMatrix::zeros(order + inputs, order + inputs);
    joint.view_mut((0, 0), (order, order)).copy_from(q);
    joint.view_mut((order, order), (inputs, inputs)).copy_from(r);
    if let Some(n) = n {
        joint.view_mut((0, order), (order, inputs)).copy_from(n);
        joint.view_mut((order, 0), (inputs, order)).copy_from(&n.transpose());
    }
    let smallest = smallest_eigenvalue(&joint);
    if smallest < -1e-12 * joint.norm() { ModelError::Indefinite { smallest } } else { ModelError::IllConditioned { residual: f64::NAN } }
}
