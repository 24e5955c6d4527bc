//! Functions of matrices: exponential and logarithm.

use faer::Mat;
use faer::linalg::solvers::Solve;
use nalgebra::{Complex, DMatrix, Schur};

use super::balance::Units;
use super::parts::{parts, put, taken};

/// Rows from which on faer is faster: for a small exponent, where nalgebra uses a low degree, and otherwise. From the bench `exponential` of benches/dense.rs.
const FAER: [usize; 2] = [20, 8];
/// Upper bound of a small 1-norm: up to it degree 5 is exact to rounding (Higham 2005, table 2.3).
const SMALL: f64 = 2.539_398_330_063_23e-1;

/// exp(M), computed separately for each decoupled part of M.
///
/// Source: Al-Mohy and Higham (2009), SIAM J. Matrix Anal. Appl. 31(3), 970-989, doi:10.1137/09074721X (nalgebra's implementation). Large matrices without
/// scaling use its Padé approximant of order 13.
pub fn exp(m: &DMatrix<f64>) -> DMatrix<f64> {
    let parts = parts(m.nrows(), &[m]);
    if parts.len() <= 1 {
        return of_part(m);
    }
    let mut e = DMatrix::zeros(m.nrows(), m.ncols());
    for part in &parts {
        match part[..] {
            [one] => e[(one, one)] = m[(one, one)].exp(),
            _ => put(&mut e, part, part, &of_part(&taken(m, part, part))),
        }
    }
    e
}

fn of_part(m: &DMatrix<f64>) -> DMatrix<f64> {
    if m.iter().all(|v| v.is_finite())
        && let Some(units) = Units::of(m).worth()
    {
        return units.unscaled(&of_like_units(&units.scaled(m)));
    }
    of_like_units(m)
}

fn of_like_units(m: &DMatrix<f64>) -> DMatrix<f64> {
    if m.is_empty() {
        return m.clone();
    }
    let norm = m.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max);
    let from = FAER[usize::from(norm > SMALL)];
    // This order sends values that are not finite to the library.
    if m.nrows() >= from && norm <= UNSCALED { pade_13(m) } else { m.exp() }
}

/// The largest 1-norm of M for which [`pade_13`] is exact to rounding (Higham 2005, table 2.3).
const UNSCALED: f64 = 5.371920351148152;

/// exp(M) by the [13/13] Padé approximant, (V − U)⁻¹(V + U) with U odd and V even in M.
///
/// Source: Higham (2005), SIAM J. Matrix Anal. Appl. 26(4), 1179-1193, doi:10.1137/04061101X, equations 2.11 and 2.12.
pub(super) fn pade_13(m: &DMatrix<f64>) -> DMatrix<f64> {
    let n = m.nrows();
    let mut b = [1.0; 14];
    for k in 0..13 {
        b[k + 1] = b[k] * (13 - k) as f64 / ((26 - k) * (k + 1)) as f64;
    }
    let one = Mat::<f64>::identity(n, n);
    let a = Mat::from_fn(n, n, |i, j| m[(i, j)]);
    let a2 = &a * &a;
    let a4 = &a2 * &a2;
    let a6 = &a4 * &a2;
    let sum = |at: [usize; 4]| {
        let [by_6, by_4, by_2, by_1] = at.map(|k| b[k]);
        Mat::from_fn(n, n, |i, j| {
            by_6 * a6[(i, j)] + by_4 * a4[(i, j)] + by_2 * a2[(i, j)] + by_1 * one[(i, j)]
        })
    };
    let high = |at: [usize; 3]| {
        let [by_6, by_4, by_2] = at.map(|k| b[k]);
        &a6 * Mat::from_fn(n, n, |i, j| by_6 * a6[(i, j)] + by_4 * a4[(i, j)] + by_2 * a2[(i, j)])
    };
    let odd = &a * (high([13, 11, 9]) + sum([7, 5, 3, 1]));
    let even = high([12, 10, 8]) + sum([6, 4, 2, 0]);
    let e = (&even - &odd).partial_piv_lu().solve(&even + &odd);
    DMatrix::from_fn(n, n, |i, j| e[(i, j)])
}

/// The real principal logarithm, or the eigenvalue (zero, or real and negative) that prevents it.
///
/// Inverse scaling and squaring on the complex Schur form: square roots of the triangle until it is near I. The logarithm then is a Gauss-Legendre quadrature
/// of ∫₀¹ (T − I)(I + t(T − I))⁻¹ dt, which is the [8/8] Padé approximant.
///
/// Source: Higham (2008), "Functions of Matrices", algorithm 11.9, doi:10.1137/1.9780898717778.
pub(super) fn log(m: &DMatrix<f64>) -> Result<DMatrix<f64>, f64> {
    match Units::of(m).worth() {
        Some(units) => Ok(units.unscaled(&log_of_like_units(&units.scaled(m))?)),
        None => log_of_like_units(m),
    }
}

fn log_of_like_units(m: &DMatrix<f64>) -> Result<DMatrix<f64>, f64> {
    let n = m.nrows();
    if n == 0 {
        return Ok(m.clone());
    }
    // The iteration stagnates only for eigenvalues of 0.
    let schur =
        Schur::try_new(m.map(|v| Complex::new(v, 0.0)), f64::EPSILON, 1000 * n).ok_or(0.0)?;
    let (q, mut t) = schur.unpack();
    let floor = 1e-14 * m.norm();
    for i in 0..n {
        let lambda = t[(i, i)];
        if lambda.norm() <= floor || (lambda.re < 0.0 && lambda.im.abs() <= 1e-10 * lambda.norm()) {
            return Err(lambda.re);
        }
    }
    let identity = DMatrix::<Complex<f64>>::identity(n, n);
    let mut doublings = 0;
    while (&t - &identity).norm() > 0.2 && doublings < 100 {
        t = triangular_sqrt(&t);
        doublings += 1;
    }
    let e = &t - &identity;
    let mut sum = DMatrix::<Complex<f64>>::zeros(n, n);
    for (node, weight) in GAUSS_LEGENDRE_8 {
        for (t, w) in [(0.5 - 0.5 * node, 0.5 * weight), (0.5 + 0.5 * node, 0.5 * weight)] {
            let shifted = &identity + &e * Complex::new(t, 0.0);
            if let Some(term) = shifted.solve_upper_triangular(&e) {
                sum += term * Complex::new(w, 0.0);
            }
        }
    }
    let log = &q * sum * q.adjoint() * Complex::new(f64::from(doublings).exp2(), 0.0);
    Ok(log.map(|v| v.re))
}

/// Positive nodes and weights of 8-point Gauss-Legendre quadrature on [−1, 1]; the negative ones mirror them.
const GAUSS_LEGENDRE_8: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// The upper triangular square root with the principal root on the diagonal (Björck and Hammarling 1983, doi:10.1016/0024-3795(83)80010-X).
fn triangular_sqrt(t: &DMatrix<Complex<f64>>) -> DMatrix<Complex<f64>> {
    let n = t.nrows();
    let mut r = DMatrix::zeros(n, n);
    for j in 0..n {
        r[(j, j)] = t[(j, j)].sqrt();
        for i in (0..j).rev() {
            let inner: Complex<f64> = (i + 1..j).map(|k| r[(i, k)] * r[(k, j)]).sum();
            r[(i, j)] = (t[(i, j)] - inner) / (r[(i, i)] + r[(j, j)]);
        }
    }
    r
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_undoes_exp_also_for_a_defective_matrix() {
        let m = DMatrix::from_row_slice(
            4,
            4,
            &[-0.2, 0.3, 9.8, 0.1, -3.6, 0.0, 0.0, 8.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        ) * 0.1;
        let back = log(&exp(&m)).unwrap();
        assert!((back - &m).norm() < 1e-13 * m.norm().max(1.0));
    }

    #[test]
    fn the_exponential_of_a_large_matrix_is_that_of_its_blocks() {
        // exp of a chain of n equal lags has entries tᵏ/k!·e⁻ᵗ on its k-th lower diagonal.
        for (n, t) in [(16, 0.3), (40, 2.5), (62, 2.0), (62, 3.0)] {
            let chain = DMatrix::from_fn(n, n, |i, j| {
                if i == j {
                    -t
                } else if i == j + 1 {
                    t
                } else {
                    0.0
                }
            });
            let e = exp(&chain);
            for i in 0..n {
                for j in 0..n {
                    let expected = if i < j {
                        0.0
                    } else {
                        (1..=i - j).fold((-t).exp(), |product, k| product * t / k as f64)
                    };
                    assert!((e[(i, j)] - expected).abs() < 1e-15, "{n}, {t}: {i} {j}");
                }
            }
        }
        let turned = DMatrix::from_fn(24, 24, |i, j| ((7 * i + 3 * j * j) as f64).sin() / 6.0);
        let (got, expected) = (exp(&turned), turned.exp());
        assert!((&got - &expected).amax() < 1e-14 * expected.amax());
    }

    #[test]
    fn parts_that_do_not_touch_have_the_exponential_of_the_whole() {
        // Two plants with held and ramped inputs, their rows and columns mixed, and a scalar.
        let order = [3, 0, 7, 5, 8, 1, 6, 2, 4];
        let mut whole = DMatrix::zeros(9, 9);
        for (i, j, value) in [
            (0, 0, -0.2),
            (0, 1, 9.8),
            (1, 0, -3.6),
            (1, 2, 8.5),
            (2, 3, 1.0),
            (4, 4, 0.7),
            (5, 5, -8.0),
            (5, 6, 2.5),
            (6, 7, 1.0),
            (7, 8, 0.1),
        ] {
            whole[(order[i], order[j])] = value;
        }
        let (got, expected) = (exp(&whole), whole.exp());
        assert!((&got - &expected).amax() < 4e-15 * expected.amax());
        assert_eq!(got[(order[4], order[4])], 0.7f64.exp());
        assert_eq!(got[(order[0], order[5])], 0.0);
    }

    #[test]
    fn log_names_the_eigenvalue_that_forbids_it() {
        let m = DMatrix::from_row_slice(2, 2, &[-0.5, 1.0, 0.0, 0.3]);
        assert!((log(&m).unwrap_err() + 0.5).abs() < 1e-12);
    }
}
