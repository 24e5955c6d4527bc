//! Invariant zeros of a state-space model, by reduction to a model with an invertible D.

use deadtime_signal::decompositions::{eigenvalues as iterated_eigenvalues, svd};
use nalgebra::{Complex, DMatrix};

use super::balance::Units;
use super::matrices::Matrices;

/// Eigenvalues of a real square matrix.
///
/// States that only drive or only follow the others are removed first. The diagonal contains their eigenvalues, so chains of integrators and of delays stay
/// exact. The remainder is balanced. The QR iteration is bounded.
///
/// Source: Parlett and Reinsch (1969), "Balancing a matrix for calculation of eigenvalues and eigenvectors", doi:10.1007/BF02165404.
pub(super) fn eigenvalues(a: &DMatrix<f64>) -> Vec<Complex<f64>> {
    let n = a.nrows();
    if a.iter().any(|v| !v.is_finite()) {
        return vec![Complex::new(f64::NAN, f64::NAN); n];
    }
    let mut left: Vec<usize> = (0..n).collect();
    let mut found = Vec::with_capacity(n);
    let alone = |left: &[usize], i: usize| {
        let others = || left.iter().filter(|&&j| j != i);
        others().all(|&j| a[(i, j)] == 0.0) || others().all(|&j| a[(j, i)] == 0.0)
    };
    while let Some(at) = (0..left.len()).find(|&at| alone(&left, left[at])) {
        let i = left.remove(at);
        found.push(Complex::new(a[(i, i)], 0.0));
    }
    let rest = a.select_rows(&left).select_columns(&left);
    found.extend(match Units::of(&rest).worth() {
        Some(units) => iterated_eigenvalues(&units.scaled(&rest)),
        None => iterated_eigenvalues(&rest),
    });
    found
}

/// The finite s where [A − sI, B; C, D] loses rank against its normal rank.
///
/// Source: Emami-Naeini and Van Dooren (1982), "Computation of zeros of linear multivariable systems", Automatica 18(4), 415-430,
/// doi:10.1016/0005-1098(82)90070-X.
pub(super) fn invariant_zeros(sys: Matrices) -> Vec<Complex<f64>> {
    let (Matrices { a, b, c, d }, time) = sys.for_zeros();
    let scale = [&a, &b, &c, &d].iter().map(|m| m.norm()).fold(0.0, f64::max);
    let tolerance = scale * 1e-13;
    let [a, b, c, d] = reduce([a, b, c, d], tolerance);
    let [a, c, b, d] =
        reduce([a.transpose(), c.transpose(), b.transpose(), d.transpose()], tolerance)
            .map(|m| m.transpose());
    if a.is_empty() {
        return Vec::new();
    }
    let found = if d.is_empty() {
        eigenvalues(&a)
    } else {
        d.lu().solve(&c).map_or_else(Vec::new, |feedback| eigenvalues(&(a - b * feedback)))
    };
    found.into_iter().map(|s| s * time).collect()
}

/// Removes states until D has full row rank; the zeros stay the same.
fn reduce([mut a, mut b, mut c, mut d]: [DMatrix<f64>; 4], tolerance: f64) -> [DMatrix<f64>; 4] {
    loop {
        let (n, m) = (a.nrows(), d.ncols());
        // Rows of [C D] rotated so that D is [D1; 0] with D1 of full row rank.
        let (rotation, rank) = row_compression(&d, tolerance);
        c = &rotation * c;
        d = &rotation * d;
        let rows = c.nrows();
        let c2 = c.rows(rank, rows - rank).into_owned();
        // States rotated so that C2 is [0 S] with S of full column rank.
        let (state_rotation, seen) = row_compression(&c2.transpose(), tolerance);
        if seen == 0 {
            return [a, b, c.rows(0, rank).into_owned(), d.rows(0, rank).into_owned()];
        }
        // row_compression puts the seen directions first; they are needed last.
        let order: Vec<usize> = (seen..n).chain(0..seen).collect();
        let v = state_rotation.select_rows(&order).transpose();
        let rotated = v.transpose() * &a * &v;
        let rotated_b = v.transpose() * &b;
        let c1 = c.rows(0, rank) * &v;
        let kept = n - seen;
        a = rotated.view((0, 0), (kept, kept)).into_owned();
        b = rotated_b.rows(0, kept).into_owned();
        let mut new_c = DMatrix::zeros(seen + rank, kept);
        new_c.view_mut((0, 0), (seen, kept)).copy_from(&rotated.view((kept, 0), (seen, kept)));
        new_c.view_mut((seen, 0), (rank, kept)).copy_from(&c1.columns(0, kept));
        let mut new_d = DMatrix::zeros(seen + rank, m);
        new_d.view_mut((0, 0), (seen, m)).copy_from(&rotated_b.rows(kept, seen));
        new_d.view_mut((seen, 0), (rank, m)).copy_from(&d.rows(0, rank));
        c = new_c;
        d = new_d;
    }
}

/// An orthogonal U with U·M = [R; 0], R of full row rank, and that rank.
fn row_compression(m: &DMatrix<f64>, tolerance: f64) -> (DMatrix<f64>, usize) {
    let rows = m.nrows();
    if m.is_empty() {
        return (DMatrix::identity(rows, rows), 0);
    }
    // A square padding makes the thin SVD return all of U.
    let mut padded = DMatrix::zeros(rows, m.ncols().max(rows));
    padded.view_mut((0, 0), m.shape()).copy_from(m);
    let Some(found) = svd(&padded) else { return (DMatrix::identity(rows, rows), 0) };
    let rank = found.singular_values.iter().filter(|&&s| s > tolerance).count();
    (found.u.map_or_else(|| DMatrix::identity(rows, rows), |u| u.transpose()), rank)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_of_integrators_have_exact_eigenvalues() {
        for n in 1..6 {
            let chain = DMatrix::from_fn(n, n, |i, j| f64::from(u8::from(i == j + 1)));
            assert_eq!(eigenvalues(&chain), vec![Complex::default(); n]);
        }
    }

    /// The same chain in rotated coordinates without zeros; its eigenvalues are those of a matrix perturbed by rounding.
    #[test]
    fn the_iteration_ends_for_a_nilpotent_matrix_without_zeros() {
        let chain = DMatrix::from_fn(3, 3, |i, j| f64::from(u8::from(i == j + 1)));
        let q =
            DMatrix::from_row_slice(3, 3, &[2.0, -1.0, 2.0, 2.0, 2.0, -1.0, -1.0, 2.0, 2.0]) / 3.0;
        let found = eigenvalues(&(&q * chain * q.transpose()));
        assert!(found.len() == 3 && found.iter().all(|v| v.norm() < 1e-4), "{found:?}");
    }

    /// A Hamiltonian matrix on which the basic QR iteration stagnates, for any added multiple of I: eigenvalues ±1.51874 ± 0.42865i (numpy).
    #[test]
    fn the_iteration_ends_for_a_hamiltonian_matrix_with_a_zero_block() {
        let a = DMatrix::from_row_slice(
            4,
            4,
            &[
                1.065665329375194,
                0.9784526067499143,
                -0.0026639749204228243,
                -0.05580970327206547,
                0.699587462454943,
                -1.318007698368866,
                -0.05580970327206547,
                -1.1692013147111868,
                -1.4492288565246412,
                0.0,
                -1.065665329375194,
                -0.699587462454943,
                0.0,
                0.0,
                -0.9784526067499143,
                1.318007698368866,
            ],
        );
        let found = eigenvalues(&a);
        for v in &found {
            assert!(
                (v.re.abs() - 1.51874354).abs() < 1e-8 && (v.im.abs() - 0.42865482).abs() < 1e-8,
                "{found:?}"
            );
        }
        assert!((found.iter().sum::<Complex<f64>>()).norm() < 1e-12, "{found:?}");
    }

    #[test]
    fn a_matrix_without_rows_has_no_eigenvalues_and_the_iteration_alone_finds_those_of_a_companion()
    {
        assert!(
            eigenvalues(&DMatrix::zeros(0, 0)).is_empty()
                && iterated_eigenvalues(&DMatrix::zeros(0, 0)).is_empty()
        );
        // (x − 1)(x − 2)(x − 4) = x³ − 7x² + 14x − 8.
        let companion =
            DMatrix::from_row_slice(3, 3, &[7.0, -14.0, 8.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let mut found = iterated_eigenvalues(&companion);
        found.sort_by(|a, b| a.re.total_cmp(&b.re));
        assert!(
            found.iter().zip([1.0, 2.0, 4.0]).all(|(v, root)| (v - root).norm() < 1e-12),
            "{found:?}"
        );
    }

    #[test]
    fn a_matrix_with_nan_has_no_eigenvalues_to_speak_of() {
        assert!(eigenvalues(&DMatrix::from_element(2, 2, f64::NAN)).iter().all(|v| v.re.is_nan()));
    }
}
