//! The triangular factor of a tall matrix, by the faster of two libraries.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::qr::no_pivoting::factor::{
    qr_in_place, qr_in_place_scratch, recommended_block_size,
};
use faer::{Mat, Par};
use nalgebra::DMatrix;

/// Columns from which on faer is faster, copies included. Speed-up in benches/dense.rs: 1 at 4 columns, 1.4 at 8, 2 at 16, 7 at 64.
const FAER: usize = 8;

/// A column whose remainder is below this share of its norm depends on the previous ones. faer's blocks lose the columns after such a one, so nalgebra is used
/// there.
const DEPENDENT: f64 = 1e-12;

/// R of a = QR, with a nonnegative diagonal. One thread, so that the number of threads does not change the result.
pub(crate) fn upper(a: DMatrix<f64>) -> DMatrix<f64> {
    let (rows, columns) = a.shape();
    if columns < FAER || rows < columns {
        return a.qr().r();
    }
    let mut qr = Mat::from_fn(rows, columns, |i, j| a[(i, j)]);
    let block = recommended_block_size::<f64>(rows, columns);
    let mut coefficients = Mat::zeros(block, columns);
    let mut memory = MemBuffer::new(qr_in_place_scratch::<f64>(
        rows,
        columns,
        block,
        Par::Seq,
        Default::default(),
    ));
    qr_in_place(
        qr.as_mut(),
        coefficients.as_mut(),
        Par::Seq,
        MemStack::new(&mut memory),
        Default::default(),
    );
    let depends = |j: usize| {
        let norm = (0..=j).map(|i| qr[(i, j)].powi(2)).sum::<f64>().sqrt();
        // A value that is not finite counts as dependent.
        let left = qr[(j, j)].abs();
        left.is_nan() || norm.is_nan() || left <= DEPENDENT * norm
    };
    if (0..columns).any(depends) {
        return a.qr().r();
    }
    let sign = |i: usize| if qr[(i, i)] < 0.0 { -1.0 } else { 1.0 };
    DMatrix::from_fn(columns, columns, |i, j| if i <= j { sign(i) * qr[(i, j)] } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn both_libraries_give_the_same_factor() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for (rows, columns) in [(8, 8), (40, 8), (300, 24), (300, 70), (5, 9)] {
            let a = DMatrix::from_fn(rows, columns, |_, j| {
                rng.random_range(-1.0..1.0) * 10.0_f64.powi(-(j as i32) / 8)
            });
            let (got, expected) = (upper(a.clone()), a.clone().qr().r());
            assert_eq!(got.shape(), expected.shape());
            assert!((0..got.nrows()).all(|i| got[(i, i)] >= 0.0));
            assert!(
                (&got - &expected).amax() < 1e-10 * expected.amax(),
                "{rows}×{columns}: {}",
                (got - expected).amax()
            );
        }
    }

    #[test]
    fn columns_of_zeros_and_repeated_ones_leave_zeros_and_no_nan() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let few = DMatrix::from_fn(60, 12, |i, j| match j {
            3 => 0.0,
            7 => (i as f64).sin(),
            _ => (i as f64).sin() * if j == 9 { 1.0 } else { (j as f64 + i as f64).cos() },
        });
        // The past of an output, the past of a step that is nearly constant, the output.
        let y: Vec<f64> = (0..360).map(|_| rng.random_range(-1.0..1.0)).collect();
        let many = DMatrix::from_fn(300, 51, |i, j| match j {
            0..10 => y[i + 9 - j],
            50 => y[i + 20],
            _ => f64::from(u8::from(i + 10 > j)),
        });
        let normal = DMatrix::from_fn(300, 51, |i, j| {
            if j == 30 { 0.0 } else { y[(7 * i + 13 * j * j) % 360] + y[(i * j) % 359] }
        });
        for a in [few, many, normal] {
            let r = upper(a.clone());
            assert!(r.iter().all(|v| v.is_finite()));
            assert!(
                (r.tr_mul(&r) - a.tr_mul(&a)).amax() < 1e-12 * a.tr_mul(&a).amax(),
                "{:?}",
                r.diagonal()
            );
        }
    }
}
