//! Equations: one evaluation and one Jacobian; benches/simulate.rs simulates them.

use std::hint::black_box;

use criterion::{Criterion, criterion_main};
use deadtime::model::{EquationsFile, Wrt};

#[allow(dead_code)]
mod support;

/// Without dry friction, which is stiff.
const PLAIN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../benches/support/cart_pendulum.toml");
const FULL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/cart_pendulum.toml");

fn equations(criterion: &mut Criterion) -> Result<(), Box<dyn std::error::Error>> {
    let mut group = criterion.benchmark_group("equations");
    support::pace(&mut group, 0);
    for (name, path) in [("cart and pendulum", PLAIN), ("with dry friction", FULL)] {
        let model = EquationsFile::read(path.as_ref())?.equations()?;
        let (p, x, mut workspace) = (model.nominal(), [0.1, 0.2, 0.3, -0.4], model.workspace());
        let mut dx = [0.0; 4];
        group.bench_function(format!("derivatives/{name}"), |b| {
            b.iter(|| {
                model.derivatives(0.0, black_box(&x), &[1.0], &p, &mut workspace, &mut dx);
                dx
            });
        });
        let mut jacobian = vec![0.0; 16];
        group.bench_function(format!("jacobian by states/{name}"), |b| {
            b.iter(|| {
                model.derivatives_jacobian(
                    Wrt::States,
                    0.0,
                    black_box(&x),
                    &[1.0],
                    &p,
                    &mut workspace,
                    &mut jacobian,
                );
                jacobian[5]
            });
        });
    }
    Ok(())
}

/// Runs every bench of this file.
#[allow(clippy::expect_used)]
fn benches() {
    equations(&mut support::criterion()).expect("the models are valid");
}

criterion_main!(benches);
