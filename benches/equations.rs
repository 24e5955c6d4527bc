//! Equations: one evaluation, one Jacobian, and the simulation of a log.

use std::hint::black_box;

use criterion::{Criterion, criterion_main};
use deadtime::model::{EquationsFile, Wrt};
use deadtime::simulate::{EquationOptions, simulate_equations};
use nalgebra::DMatrix;

#[allow(dead_code)]
mod support;

const FULL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/cart_pendulum.toml");

/// The textbook cart and pendulum, with viscous friction alone.
const PLAIN: &str = r#"
format = "deadtime/model@1"
name = "plain"
kind = "equations"
inputs = [{ name = "force" }]
outputs = [{ name = "position" }, { name = "angle" }]
[states]
position = {}
speed = {}
angle = { initial = 0.1 }
rate = {}
[parameters]
cart = { value = 0.8 }
bob = { value = 0.2 }
length = { value = 0.4 }
gravity = { value = 9.81 }
viscous = { value = 1.5 }
[derivatives]
position = "speed"
speed = "(force - viscous*speed + bob*sin(angle)*(length*rate^2 + gravity*cos(angle)))/(cart + bob*sin(angle)^2)"
angle = "rate"
rate = "(-cos(angle)*(force - viscous*speed + bob*length*rate^2*sin(angle)) - (cart + bob)*gravity*sin(angle))/(length*(cart + bob*sin(angle)^2))"
[output_equations]
position = "position"
angle = "angle"
"#;

fn equations(criterion: &mut Criterion) -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let plain = folder.path().join("plain.toml");
    std::fs::write(&plain, PLAIN)?;
    let mut group = criterion.benchmark_group("equations");
    support::pace(&mut group, 0);
    for (name, path) in [("cart and pendulum", plain.as_path()), ("with dry friction", FULL.as_ref())] {
        let model = EquationsFile::read(path)?.equations()?;
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
                model.derivatives_jacobian(Wrt::States, 0.0, black_box(&x), &[1.0], &p, &mut workspace, &mut jacobian);
                jacobian[5]
            });
        });
        let time_s: Vec<f64> = (0..6000).map(|k| f64::from(k) * 0.01).collect();
        let u = DMatrix::from_fn(6000, 1, |k, _| ((k * 7919) % 23) as f64 / 11.0 - 1.0);
        for (tolerance, rtol, atol) in [("1e-6", 1e-6, 1e-8), ("1e-9", 1e-9, 1e-12)] {
            let options = EquationOptions { rtol, atol, ..EquationOptions::default() };
            simulate_equations(&model, &time_s, &u, &model.initial(), &p, &options)?;
            group.bench_function(format!("6000 samples, rtol {tolerance}/{name}"), |b| {
                b.iter(|| black_box(simulate_equations(&model, &time_s, &u, &model.initial(), &p, &options)));
            });
        }
    }
    Ok(())
}

/// Runs every bench of this file.
#[allow(clippy::expect_used)]
fn benches() {
    equations(&mut support::criterion()).expect("the models are valid");
}

criterion_main!(benches);
