//! The nu-gap: the distance of two models in closed loop. 0: equal; 1: no controller stabilises both robustly. Poles may lie anywhere.
//!
//! Equation: δ = sup_ω σmax((I + P2 P2*)^(−1/2) (P2 − P1) (I + P1* P1)^(−1/2)). If the winding number of det(G2* G1) is not 0, δ = 1.
//!
//! G1 = [N1; M1] and G2 are normalised right coprime factors, P = N M⁻¹. The supremum is the H-infinity norm of [−M̃2 Ñ2] G1. How it can be wrong: a winding
//! number counted on a grid (here it is a number of eigenvalues). A mode of the realisation alone, which no regulator stabilises (such modes are removed
//! first). Units in which all gains are large or small: all pairs are then far apart, or near, and the channels need scaling.
//! Source: Vinnicombe (1993), "Frequency domain uncertainty and the graph topology", IEEE Trans. Automatic Control 38(9), 1371-1383.

use deadtime_signal::decompositions::{svd, symmetric_eigen};
use nalgebra::DMatrix;
use serde::Serialize;

use super::error::ModelError;
use super::hinf;
use super::matrices::Matrices;
use super::state_space::{StateSpace, TimeDomain};
use super::zeros;

/// The distance of two models.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NuGap {
    /// 0 to 1.
    pub value: f64,
    /// The frequency of the largest distance, rad/s; infinite for the limit of high frequencies, `None` where the winding numbers differ.
    pub omega_rad_s: Option<f64>,
}

/// Modes with a relative controllability or observability below this are rounding.
const HIDDEN: f64 = 1e-11;
/// Iterations of the matrix sign, which converges quadratically; a slower one has eigenvalues on the axis.
const SIGN_ROUNDS: usize = 100;
/// Relative residual of a solved Riccati equation.
const RICCATI: f64 = 1e-7;
/// An eigenvalue within this relative distance of the axis is on it: the models then have the distance 1.
const ON_AXIS: f64 = 1e-10;

/// The nu-gap of two models of the same channels. Sampled models are replaced by their bilinear images, which have the same distance. Equal delays of an input
/// have no influence.
///
/// # Errors
/// [`ModelError::Unlike`] for other channels, delays or sample times; [`ModelError::IllConditioned`] where a Riccati equation could not be solved.
pub fn nu_gap<T: TimeDomain>(p1: &StateSpace<T>, p2: &StateSpace<T>) -> Result<NuGap, ModelError> {
    let unlike = |what: &'static str, first: f64, second: f64| {
        Err(ModelError::Unlike { what, first, second })
    };
    for (what, first, second) in
        [("inputs", p1.inputs(), p2.inputs()), ("outputs", p1.outputs(), p2.outputs())]
    {
        if first != second {
            return unlike(what, first as f64, second as f64);
        }
    }
    if p1.domain() != p2.domain() {
        let seconds = |sys: &StateSpace<T>| sys.domain().sample_time_s().unwrap_or(0.0);
        return unlike("sample times", seconds(p1), seconds(p2));
    }
    if let Some((first, second)) =
        p1.input_delay().iter().zip(p2.input_delay()).find(|(a, b)| a != b)
    {
        return unlike("input delays", p1.domain().delay_s(*first), p1.domain().delay_s(*second));
    }
    let rational = |sys| {
        hinf::continuous(sys)
            .map(|m| minimal(&m))
            .ok_or(ModelError::IllConditioned { residual: f64::INFINITY })
    };
    let (one, two) = (rational(p1)?, rational(p2)?);
    let (right1, right2, left2) = (right_factor(&one)?, right_factor(&two)?, left_factor(&two)?);
    if !winds_alike(&right1, &right2)? {
        return Ok(NuGap { value: 1.0, omega_rad_s: None });
    }
    let found = hinf::on_axis_of(
        p1,
        hinf::search(&series(&left2, &right1).balanced(), [0.0, f64::INFINITY]),
    );
    Ok(NuGap { value: found.gain.min(1.0), omega_rad_s: Some(found.omega_rad_s) })
}

/// Whether det(G2* G1) has the winding number 0: as many zeros right of the axis as poles, and none on it.
fn winds_alike(right1: &Matrices, right2: &Matrices) -> Result<bool, ModelError> {
    let conjugate = Matrices {
        a: -right2.a.transpose(),
        b: -right2.c.transpose(),
        c: right2.b.transpose(),
        d: right2.d.transpose(),
    };
    let product = series(&conjugate, right1);
    let n = product.a.nrows();
    let Some(feedback) = product.d.clone().lu().solve(&product.c) else { return Ok(false) };
    if n == 0 {
        return Ok(true);
    }
    let zeros = zeros::eigenvalues(&(&product.a - &product.b * feedback));
    if zeros.iter().any(|z| z.re.is_nan()) {
        return Err(ModelError::IllConditioned { residual: f64::INFINITY });
    }
    Ok(zeros.iter().all(|z| z.re.abs() > ON_AXIS * z.norm())
        && zeros.iter().filter(|z| z.re > 0.0).count() == right2.a.nrows())
}

/// The series connection.
fn series(after: &Matrices, before: &Matrices) -> Matrices {
    let (n1, n2) = (before.a.nrows(), after.a.nrows());
    let mut a = DMatrix::zeros(n1 + n2, n1 + n2);
    a.view_mut((0, 0), (n1, n1)).copy_from(&before.a);
    a.view_mut((n1, 0), (n2, n1)).copy_from(&(&after.b * &before.c));
    a.view_mut((n1, n1), (n2, n2)).copy_from(&after.a);
    let b = stacked(&before.b, &(&after.b * &before.d));
    let c = stacked(&(&after.d * &before.c).transpose(), &after.c.transpose()).transpose();
    Matrices { a, b, c, d: &after.d * &before.d }
}

fn stacked(above: &DMatrix<f64>, below: &DMatrix<f64>) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(above.nrows() + below.nrows(), above.ncols());
    all.rows_mut(0, above.nrows()).copy_from(above);
    all.rows_mut(above.nrows(), below.nrows()).copy_from(below);
    all
}

fn transposed(sys: &Matrices) -> Matrices {
    Matrices {
        a: sys.a.transpose(),
        b: sys.c.transpose(),
        c: sys.b.transpose(),
        d: sys.d.transpose(),
    }
}

/// [N; M] with P = N M⁻¹ and N*N + M*M = I: the loop of the regulator with unit weights on outputs and inputs.
///
/// Source: Meyer and Franklin (1987), "A connection between normalized coprime factorizations and linear quadratic regulator theory", IEEE Trans. Automatic
/// Control 32(3), 227-228.
fn right_factor(sys: &Matrices) -> Result<Matrices, ModelError> {
    let m = sys.b.ncols();
    let weight = DMatrix::identity(m, m) + sys.d.transpose() * &sys.d;
    let root = inverse_root(&weight);
    let inverse = &root * &root;
    let x = regulator(sys, &inverse)?;
    let f = -(&inverse * (sys.b.transpose() * x + sys.d.transpose() * &sys.c));
    Ok(Matrices {
        a: &sys.a + &sys.b * &f,
        b: &sys.b * &root,
        c: stacked(&(&sys.c + &sys.d * &f), &f),
        d: stacked(&(&sys.d * &root), &root),
    })
}

/// [−M̃ Ñ] with P = M̃⁻¹ Ñ.
fn left_factor(sys: &Matrices) -> Result<Matrices, ModelError> {
    let p = sys.c.nrows();
    let mut left = transposed(&right_factor(&transposed(sys))?);
    // The factor of Pᵀ is [Ñᵀ; M̃ᵀ]: its columns are swapped and M̃ gets its sign.
    let swapped = |m: &DMatrix<f64>| {
        let inputs = m.ncols() - p;
        DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| {
            if j < p { -m[(i, inputs + j)] } else { m[(i, j - p)] }
        })
    };
    (left.b, left.d) = (swapped(&left.b), swapped(&left.d));
    Ok(left)
}

/// W^(−1/2) of a symmetric positive matrix.
fn inverse_root(weight: &DMatrix<f64>) -> DMatrix<f64> {
    if weight.is_empty() {
        return weight.clone();
    }
    let Some(eigen) = symmetric_eigen(weight) else {
        return DMatrix::from_element(weight.nrows(), weight.ncols(), f64::NAN);
    };
    &eigen.eigenvectors
        * DMatrix::from_diagonal(&eigen.eigenvalues.map(|v| 1.0 / v.sqrt()))
        * eigen.eigenvectors.transpose()
}

/// The stabilising solution X of AᵀX + XA − (XB + CᵀD)(I + DᵀD)⁻¹(BᵀX + DᵀC) + CᵀC = 0. The method is the sign of the Hamiltonian matrix.
///
/// Source: Roberts (1980), "Linear model reduction and solution of the algebraic Riccati equation by use of the sign function", doi:10.1080/00207178008922881.
/// For scaling by the determinant Byers (1987), doi:10.1016/0024-3795(87)90222-9.
fn regulator(sys: &Matrices, inverse: &DMatrix<f64>) -> Result<DMatrix<f64>, ModelError> {
    let n = sys.a.nrows();
    if n == 0 {
        return Ok(DMatrix::zeros(0, 0));
    }
    let failed = ModelError::IllConditioned { residual: f64::INFINITY };
    let through = inverse * sys.d.transpose() * &sys.c;
    let a = &sys.a - &sys.b * &through;
    let g = &sys.b * inverse * sys.b.transpose();
    let q = sys.c.transpose() * (&sys.c - &sys.d * through);
    let mut sign = DMatrix::zeros(2 * n, 2 * n);
    sign.view_mut((0, 0), (n, n)).copy_from(&a);
    sign.view_mut((0, n), (n, n)).copy_from(&-&g);
    sign.view_mut((n, 0), (n, n)).copy_from(&-&q);
    sign.view_mut((n, n), (n, n)).copy_from(&-a.transpose());
    for _ in 0..SIGN_ROUNDS {
        let lu = sign.clone().lu();
        let log_determinant: f64 = lu.u().diagonal().iter().map(|v| v.abs().ln()).sum();
        let scale = (-log_determinant / (2 * n) as f64).exp();
        let Some(inverse) = lu.try_inverse() else { return Err(failed) };
        // Near the end the scale is 1 up to rounding.
        let scale = if (scale - 1.0).abs() < 1e-2 { 1.0 } else { scale };
        let next = (&sign * scale + inverse / scale) * 0.5;
        let change = (&next - &sign).norm();
        sign = next;
        if !change.is_finite() {
            return Err(failed);
        }
        if change <= 1e-14 * sign.norm() {
            break;
        }
    }
    // The stable subspace [I; X] has the sign −1: (sign + I)[I; X] = 0.
    let shifted = &sign + DMatrix::identity(2 * n, 2 * n);
    let (left, right) = (shifted.columns(0, n).into_owned(), shifted.columns(n, n).into_owned());
    let solved = svd(&right).and_then(|found| found.solve(&-left, f64::EPSILON).ok());
    let Some(x) = solved else { return Err(failed) };
    let x = (&x + x.transpose()) * 0.5;
    let residual = (a.transpose() * &x + &x * &a - &x * g * &x + &q).norm()
        / (q.norm() + 2.0 * (&x * &a).norm()).max(f64::MIN_POSITIVE);
    if residual <= RICCATI { Ok(x) } else { Err(ModelError::IllConditioned { residual }) }
}

/// The controllable and observable part.
///
/// Source: the staircase of Rosenbrock (1970), by orthogonal bases of the subspaces reachable in increasing numbers of steps.
pub(super) fn minimal(sys: &Matrices) -> Matrices {
    let reached = reachable(sys);
    transposed(&reachable(&transposed(&reached)))
}

fn reachable(sys: &Matrices) -> Matrices {
    let n = sys.a.nrows();
    let mut basis = DMatrix::<f64>::zeros(n, 0);
    let mut next = sys.b.clone();
    while basis.ncols() < n && next.ncols() > 0 {
        let whole = next.norm();
        // Twice, against the rounding of the first pass.
        for _ in 0..2 {
            next -= &basis * (basis.transpose() * &next);
        }
        let Some(found) = svd(&next) else { break };
        let Some(u) = found.u else { break };
        let fresh: Vec<usize> = (0..found.singular_values.len())
            .filter(|&i| found.singular_values[i] > HIDDEN * whole)
            .collect();
        let fresh = u.select_columns(&fresh);
        next = &sys.a * &fresh;
        basis = stacked(&basis.transpose(), &fresh.transpose()).transpose();
    }
    Matrices {
        a: basis.transpose() * &sys.a * &basis,
        b: basis.transpose() * &sys.b,
        c: &sys.c * &basis,
        d: sys.d.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state_space::{Continuous, Sampled};
    use crate::transfer_function::TransferFunction;
    use deadtime_signal::time::SampleTime;

    fn continuous(num: &[f64], den: &[f64]) -> StateSpace<Continuous> {
        TransferFunction::from_polynomials(num, den, 0.0, Continuous)
            .unwrap()
            .to_state_space()
            .unwrap()
    }

    #[test]
    fn constants_are_as_far_apart_as_points_of_the_sphere() {
        let gain = |k: f64| {
            StateSpace::continuous(
                DMatrix::zeros(0, 0),
                DMatrix::zeros(0, 1),
                DMatrix::zeros(1, 0),
                DMatrix::from_element(1, 1, k),
            )
            .unwrap()
        };
        for (a, b) in [(0.3, 2.0), (-1.5, 4.0), (0.0, 7.0)] {
            let found = nu_gap(&gain(a), &gain(b)).unwrap().value;
            let expected = f64::abs(a - b) / f64::sqrt((1.0 + a * a) * (1.0 + b * b));
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        // Antipodes: 1 + ab = 0.
        assert!((nu_gap(&gain(2.0), &gain(-0.5)).unwrap().value - 1.0).abs() < 1e-12);
    }

    #[test]
    fn near_integrators_on_both_sides_of_the_axis_are_near() {
        // |P1 − P2|² = (2e)²/(w² + e²)² and 1 + |P|² = (w² + e² + 1)/(w² + e²): the distance is 2e/(w² + e² + 1), largest at 0.
        for e in [0.001, 0.3] {
            let found =
                nu_gap(&continuous(&[1.0], &[1.0, -e]), &continuous(&[1.0], &[1.0, e])).unwrap();
            assert!((found.value - 2.0 * e / (1.0 + e * e)).abs() < 1e-9, "{found:?}");
            assert!(found.omega_rad_s.unwrap().abs() < 1e-6, "{found:?}");
        }
    }

    #[test]
    fn small_responses_of_which_one_is_unstable_are_1_apart() {
        // Everywhere within 0.05 of each other: only the winding number distinguishes them.
        let one = |v: f64| DMatrix::from_element(1, 1, v);
        let small = StateSpace::continuous(one(-1.0), one(0.0), one(1.0), one(0.0)).unwrap();
        let unstable = continuous(&[0.05], &[1.0, -1.0]);
        for (one, two) in [(&small, &unstable), (&unstable, &small)] {
            assert_eq!(nu_gap(one, two).unwrap(), NuGap { value: 1.0, omega_rad_s: None });
        }
    }

    #[test]
    fn an_integrator_that_no_output_shows_counts_for_nothing() {
        let model = |hidden: bool| {
            let n = if hidden { 2 } else { 1 };
            let a = DMatrix::from_row_slice(2, 2, &[-8.178, 0.0, 1.0, 0.0])
                .view((0, 0), (n, n))
                .into_owned();
            let b = DMatrix::from_row_slice(2, 1, &[255.59, 0.0]).rows(0, n).into_owned();
            StateSpace::continuous(
                a,
                b,
                DMatrix::from_row_slice(1, 2, &[1.0, 0.0]).columns(0, n).into_owned(),
                DMatrix::zeros(1, 1),
            )
            .unwrap()
        };
        assert!(nu_gap(&model(true), &model(false)).unwrap().value < 1e-10);
    }

    #[test]
    fn sampled_models_and_equal_delays_are_judged_alike_and_unlike_ones_refused() {
        let ts = SampleTime::new(0.1).unwrap();
        let sampled = |b: f64, pole: f64, delay: usize| {
            TransferFunction::from_polynomials(&[b], &[1.0, -pole], delay, Sampled(ts))
                .unwrap()
                .to_state_space()
                .unwrap()
        };
        let (one, two) = (sampled(0.2, 0.9, 0), sampled(0.25, 1.05, 0));
        let found = nu_gap(&one, &two).unwrap();
        // By the definition on the circle, frequency by frequency.
        let at = |w: f64| {
            let [p, q] = [&one, &two].map(|s| s.frequency_response(w)[(0, 0)]);
            (p - q).norm() / ((1.0 + p.norm_sqr()) * (1.0 + q.norm_sqr())).sqrt()
        };
        let largest =
            (0..=4000).map(|k| at(f64::from(k) * ts.nyquist_rad_s() / 4000.0)).fold(0.0, f64::max);
        assert!(
            found.value < 0.9
                && (found.value - largest).abs() < 1e-6
                && found.value >= largest - 1e-12,
            "{found:?} {largest}"
        );
        assert!((at(found.omega_rad_s.unwrap()) - found.value).abs() < 1e-9);
        let delayed = nu_gap(&sampled(0.2, 0.9, 3), &sampled(0.25, 1.05, 3)).unwrap();
        assert!((delayed.value - found.value).abs() < 1e-12);
        let told = nu_gap(&sampled(0.2, 0.9, 3), &sampled(0.25, 1.05, 2)).unwrap_err().to_string();
        assert!(told.contains("input delays") && told.contains("0.3"), "{told}");
    }
}
