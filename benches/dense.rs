//! From which size on faer is faster than nalgebra: the triangular factor and the singular values of tall matrices, and the exponential, on one thread, copies
//! between the two included.

use std::hint::black_box;

use criterion::{BenchmarkId, criterion_main};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::qr::no_pivoting::factor::{
    qr_in_place, qr_in_place_scratch, recommended_block_size,
};
use faer::{Mat, Par};
use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[allow(dead_code)]
mod support;

/// What the crate keeps to itself.
#[allow(dead_code, unused_imports, unreachable_pub)]
#[path = "../crates/model/src"]
mod model {
    mod balance;
    mod matrices;
    mod matrix;
    mod parts;

    pub(super) fn pade_13(m: &nalgebra::DMatrix<f64>) -> nalgebra::DMatrix<f64> {
        matrix::pade_13(m)
    }
}

fn tall(rows: usize, columns: usize) -> DMatrix<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    DMatrix::from_fn(rows, columns, |_, _| rng.random_range(-1.0..1.0))
}

fn copied(a: &DMatrix<f64>) -> Mat<f64> {
    Mat::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)])
}

/// As `deadtime::identify` makes it.
fn by_faer(a: &DMatrix<f64>) -> DMatrix<f64> {
    let (rows, columns) = a.shape();
    let mut qr = copied(a);
    let block = recommended_block_size::<f64>(rows, columns);
    let mut coefficients = Mat::zeros(block, rows.min(columns));
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
    DMatrix::from_fn(columns, columns, |i, j| if i <= j { qr[(i, j)] } else { 0.0 })
}

/// Runs every bench of this file.
#[allow(clippy::expect_used)]
fn benches() {
    let mut criterion = support::criterion();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    let mut group = criterion.benchmark_group("tall_triangle");
    group.sample_size(10);
    for (columns, more) in [
        (4, 256),
        (8, 256),
        (16, 256),
        (24, 256),
        (32, 256),
        (48, 256),
        (64, 256),
        (128, 256),
        (32, 4096),
        (128, 4096),
        (256, 4096),
    ] {
        let a = tall(columns + more, columns);
        let size = format!("{}x{columns}", columns + more);
        group.bench_with_input(BenchmarkId::new("nalgebra", &size), &a, |b, a| {
            b.iter(|| black_box(a.clone().qr().r()))
        });
        group.bench_with_input(BenchmarkId::new("faer", &size), &a, |b, a| {
            b.iter(|| black_box(by_faer(a)))
        });
    }
    group.finish();
    let mut group = criterion.benchmark_group("tall_singular_values");
    group.sample_size(10);
    for (columns, rows) in [(4, 100), (8, 100), (16, 100), (32, 200), (64, 400), (128, 800)] {
        let a = tall(rows, columns);
        let size = format!("{rows}x{columns}");
        group.bench_with_input(BenchmarkId::new("nalgebra", &size), &a, |b, a| {
            #[expect(clippy::disallowed_methods, reason = "the peer of the bounded one")]
            b.iter(|| black_box(a.clone().svd(true, true)))
        });
        group.bench_with_input(BenchmarkId::new("faer", &size), &a, |b, a| {
            b.iter(|| one.install(|| black_box(copied(a).thin_svd().map(|svd| svd.U().nrows()))));
        });
    }
    group.finish();
    // At the first norm nalgebra takes degree 3, at the second 5, at the third 7 or 9, at the last 13, as faer does at all four.
    let mut group = criterion.benchmark_group("exponential");
    group.sample_size(10);
    for norm in [0.02, 0.2, 0.5, 4.0] {
        for n in [4, 6, 8, 10, 12, 14, 16, 20, 24, 32, 48, 64] {
            let m = tall(n, n);
            let m =
                &m * (norm / m.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max));
            let size = format!("{n}, norm {norm}");
            group.bench_with_input(BenchmarkId::new("nalgebra", &size), &m, |b, m| {
                b.iter(|| black_box(m.exp()))
            });
            group.bench_with_input(BenchmarkId::new("faer", &size), &m, |b, m| {
                one.install(|| b.iter(|| black_box(model::pade_13(m))))
            });
        }
    }
}

criterion_main!(benches);
