//! Singular values and eigenvalues by iterations that end.
//!
//! nalgebra's come first. Where they do not converge or do not rebuild the matrix, faer's are used. Causes are entries that underflow, and two equal columns at
//! the end of the iteration.
//!
//! How it can be wrong: entries that are no numbers have no decomposition.

use faer::traits::ComplexField as OtherField;
use faer::{Mat, Side};
use nalgebra::{Complex, ComplexField, DMatrix, DVector, Dyn, SVD, Schur, SymmetricEigen};

/// Steps of an iteration on a small matrix; each value of a large one has its share.
const STEPS: usize = 10_000;
/// Steps for each value, about 50 times what one takes.
const STEPS_EACH: usize = 100;

/// The allowed distance of a decomposition from the matrix, by entry, over the largest.
const REBUILT: f64 = 1e-12;

/// An entry of this size next to 1 is lost in the rounding of any norm.
const VANISHING: f64 = 1e-100;

/// A scalar of both matrix libraries, real or complex: this crate compiles the decompositions of both, and no other crate compiles them again.
pub trait Scalar: ComplexField<RealField = f64> + OtherField<Real = f64> {
    /// See [`svd`].
    fn svd(m: &DMatrix<Self>) -> Option<SVD<Self, Dyn, Dyn>>;
    /// See [`symmetric_eigen`].
    fn symmetric_eigen(m: &DMatrix<Self>) -> Option<SymmetricEigen<Self, Dyn>>;
}

macro_rules! scalar {
    ($scalar:ty) => {
        impl Scalar for $scalar {
            fn svd(m: &DMatrix<Self>) -> Option<SVD<Self, Dyn, Dyn>> {
                singular(m)
            }
            fn symmetric_eigen(m: &DMatrix<Self>) -> Option<SymmetricEigen<Self, Dyn>> {
                symmetric(m)
            }
        }
    };
}
scalar!(f64);
scalar!(Complex<f64>);

fn steps<T>(m: &DMatrix<T>) -> usize {
    STEPS.max(STEPS_EACH * m.nrows().min(m.ncols()))
}

fn decomposable<T: Scalar>(m: &DMatrix<T>) -> bool {
    !m.is_empty() && m.iter().all(|v| ComplexField::is_finite(v))
}

/// The matrix over the power of two near its largest entry, and that power. Squares of its entries neither overflow nor underflow: entries below [`VANISHING`]
/// are 0.
fn other<T: Scalar>(m: &DMatrix<T>) -> (Mat<T>, f64) {
    let largest = m.iter().map(|v| v.clone().modulus()).fold(0.0, f64::max);
    let unit = if largest > 0.0 { largest.log2().floor().exp2() } else { 1.0 };
    let entry = |i, j| {
        let v: T = m[(i, j)].clone().unscale(unit);
        if v.clone().modulus() < VANISHING { T::from_real(0.0) } else { v }
    };
    (Mat::from_fn(m.nrows(), m.ncols(), entry), unit)
}

/// M = U·Σ·Vᴴ, thin, singular values in falling order; `None` for an empty matrix and one with entries that are not finite.
#[must_use]
pub fn svd<T: Scalar>(m: &DMatrix<T>) -> Option<SVD<T, Dyn, Dyn>> {
    T::svd(m)
}

fn singular<T: Scalar>(m: &DMatrix<T>) -> Option<SVD<T, Dyn, Dyn>> {
    if !decomposable(m) {
        return None;
    }
    SVD::try_new_unordered(m.clone(), true, true, 5.0 * f64::EPSILON, steps(m))
        .filter(|found| match (&found.u, &found.v_t) {
            (Some(u), Some(v_t)) => rebuilds(m, u, &found.singular_values, v_t),
            _ => false,
        })
        .map(|mut found| {
            // The sort panics on values that are no numbers, which rebuild nothing.
            found.sort_by_singular_values();
            found
        })
        .or_else(|| other_svd(m))
}

/// U·Σ·Vᴴ is M but for rounding.
fn rebuilds<T: Scalar>(
    m: &DMatrix<T>,
    u: &DMatrix<T>,
    values: &DVector<f64>,
    v_t: &DMatrix<T>,
) -> bool {
    let (_, unit) = other(m);
    let sigma = DMatrix::from_diagonal(&values.map(|s| T::from_real(s / unit)));
    let off = u * sigma * v_t - m.map(|v| v.unscale(unit));
    // The largest entry over the unit is below 2; NaN fails the test.
    off.iter().all(|v| v.clone().modulus() <= 2.0 * REBUILT)
}

fn other_svd<T: Scalar>(m: &DMatrix<T>) -> Option<SVD<T, Dyn, Dyn>> {
    let (rows, columns, count) = (m.nrows(), m.ncols(), m.nrows().min(m.ncols()));
    let (own, unit) = other(m);
    let found = own.thin_svd().ok()?;
    let (u, v, s) = (found.U(), found.V(), found.S().column_vector());
    Some(SVD {
        u: Some(DMatrix::from_fn(rows, count, |i, j| u[(i, j)].clone())),
        v_t: Some(DMatrix::from_fn(count, columns, |i, j| {
            ComplexField::conjugate(v[(j, i)].clone())
        })),
        singular_values: DVector::from_fn(count, |i, _| unit * ComplexField::real(s[i].clone())),
    })
}

/// Singular values in falling order; `None` as in [`svd`].
#[must_use]
pub fn singular_values<T: Scalar>(m: &DMatrix<T>) -> Option<DVector<f64>> {
    svd(m).map(|found| found.singular_values)
}

/// M = V·Λ·Vᴴ of a symmetric or Hermitian matrix, whose lower triangle is read; `None` as in [`svd`].
#[must_use]
pub fn symmetric_eigen<T: Scalar>(m: &DMatrix<T>) -> Option<SymmetricEigen<T, Dyn>> {
    T::symmetric_eigen(m)
}

fn symmetric<T: Scalar>(m: &DMatrix<T>) -> Option<SymmetricEigen<T, Dyn>> {
    if !decomposable(m) || !m.is_square() {
        return None;
    }
    let lower = DMatrix::from_fn(m.nrows(), m.nrows(), |i, j| {
        if i >= j { m[(i, j)].clone() } else { ComplexField::conjugate(m[(j, i)].clone()) }
    });
    SymmetricEigen::try_new(m.clone(), f64::EPSILON, steps(m))
        .filter(|e| rebuilds(&lower, &e.eigenvectors, &e.eigenvalues, &e.eigenvectors.adjoint()))
        .or_else(|| other_symmetric(m))
}

fn other_symmetric<T: Scalar>(m: &DMatrix<T>) -> Option<SymmetricEigen<T, Dyn>> {
    let n = m.nrows();
    let (own, unit) = other(m);
    let found = own.self_adjoint_eigen(Side::Lower).ok()?;
    let (v, s) = (found.U(), found.S().column_vector());
    Some(SymmetricEigen {
        eigenvectors: DMatrix::from_fn(n, n, |i, j| v[(i, j)].clone()),
        eigenvalues: DVector::from_fn(n, |i, _| unit * ComplexField::real(s[i].clone())),
    })
}

/// Eigenvalues of a real square matrix: none without rows, NaN for entries that are not finite.
#[must_use]
pub fn eigenvalues(a: &DMatrix<f64>) -> Vec<Complex<f64>> {
    let n = a.nrows();
    if n == 0 {
        return Vec::new();
    }
    let mut found = Vec::new();
    if decomposable(a) {
        if let Some(schur) = Schur::try_new(a.clone(), f64::EPSILON, STEPS_EACH * n) {
            let values = schur.complex_eigenvalues();
            if values.iter().all(ComplexField::is_finite) {
                return values.iter().copied().collect();
            }
        }
        let (own, unit) = other(a);
        let values = own.eigenvalues().unwrap_or_default();
        found.extend(values.iter().map(|v| Complex::new(v.re, v.im) * unit));
    }
    found.resize(n, Complex::new(f64::NAN, f64::NAN));
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The norm of what entries of a 6×6 matrix may be off.
    const OFF: f64 = 12.0 * REBUILT;

    /// Rows and columns, and entries in units of 10^±300 to none at all.
    fn matrices() -> impl Strategy<Value = DMatrix<f64>> {
        (1_usize..7, 1_usize..7, prop::sample::select(vec![0, 3, 16, 150, 300])).prop_flat_map(
            |(rows, columns, span)| {
                let entry = prop_oneof![
                    2 => Just(0.0),
                    2 => prop::sample::select(vec![1.0, -1.0]),
                    6 => (-1.0..1.0, -span..=span).prop_map(|(v, e): (f64, i32)| v * 10_f64.powi(e)),
                ];
                proptest::collection::vec(entry, rows * columns)
                    .prop_map(move |all| DMatrix::from_row_slice(rows, columns, &all))
            },
        )
    }

    fn rebuilt<T: Scalar>(m: &DMatrix<T>, found: SVD<T, Dyn, Dyn>) -> f64 {
        let size = m.iter().map(|v| v.clone().modulus()).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
        let unit = |v: T| v.unscale(size);
        let sigma = DMatrix::from_diagonal(&found.singular_values.map(|s| T::from_real(s / size)));
        (found.u.unwrap() * sigma * found.v_t.unwrap() - m.clone().map(unit)).norm()
    }

    proptest! {
        #[test]
        fn singular_values_rebuild_matrices_of_any_units(m in matrices()) {
            for found in [svd(&m), other_svd(&m)] {
                let apart = rebuilt(&m, found.unwrap());
                prop_assert!(apart < OFF, "{apart} {m}");
            }
            let turned = m.map(|v| Complex::new(0.6 * v, 0.8 * v));
            for found in [svd(&turned), other_svd(&turned)] {
                prop_assert!(rebuilt(&turned, found.unwrap()) < OFF);
            }
        }

        #[test]
        fn eigenvalues_of_any_units_are_numbers(m in matrices()) {
            let n = m.nrows().min(m.ncols());
            let square = m.view((0, 0), (n, n)).into_owned();
            prop_assert!(eigenvalues(&square).iter().all(|v| v.is_finite()), "{square}");
        }

        #[test]
        fn eigenvalues_rebuild_symmetric_matrices_of_any_units(m in matrices()) {
            let size = m.amax().max(f64::MIN_POSITIVE);
            let unit = &m / size;
            let gram = unit.tr_mul(&unit);
            for found in [symmetric_eigen(&gram), other_symmetric(&gram)] {
                let found = found.unwrap();
                let v = &found.eigenvectors;
                let apart = (v * DMatrix::from_diagonal(&found.eigenvalues) * v.transpose() - &gram).norm();
                prop_assert!(apart < OFF, "{apart} {gram}");
            }
        }
    }

    /// Squares of an entry that underflow next to one that does not are 0/0 in nalgebra's iteration.
    #[test]
    fn singular_values_of_entries_whose_squares_underflow() {
        for (small, tiny) in [(2.9e-15, -9.0e-156), (1e-8, 1e-160), (3e-12, 1e-170), (0.1, 1e-162)]
        {
            let mut m = DMatrix::<f64>::zeros(4, 4);
            (m[(1, 0)], m[(2, 3)], m[(0, 3)]) = (-1.0, small, tiny);
            for unit in [1.0, 1e274, 1e-100] {
                let found = singular_values(&(&m * unit)).unwrap();
                approx::assert_relative_eq!(found[0], unit, max_relative = 1e-14);
                approx::assert_relative_eq!(found[1], small * unit, max_relative = 1e-14);
                assert!(found[2] == 0.0 && found[3] == 0.0, "{found}");
            }
        }
    }

    #[test]
    fn entries_that_are_no_numbers_have_no_decomposition() {
        for bad in [f64::NAN, f64::INFINITY] {
            let m = DMatrix::from_row_slice(2, 2, &[1.0, bad, bad, 2.0]);
            assert!(svd(&m).is_none() && singular_values(&m).is_none());
            assert!(symmetric_eigen(&m).is_none());
            assert!(eigenvalues(&m).iter().all(|v| v.re.is_nan()));
        }
        let none = DMatrix::<f64>::zeros(0, 3);
        assert!(svd(&none).is_none() && eigenvalues(&DMatrix::zeros(0, 0)).is_empty());
    }
}
