//! 6 000 samples through a whole simulator, with and without effects.

use std::hint::black_box;

use criterion::{Criterion, criterion_main};
use deadtime::effect::{Applied, Chance};
use deadtime::model::{EffectEntry, ModelDocument};
use deadtime::simulate::{Commands, Correction, Measured, System, Tolerance};
use nalgebra::DMatrix;

#[allow(dead_code)]
mod support;

const SAMPLES: usize = 6000;
/// Three states, one input.
const LINEAR: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/uav_lateral_stabilised.toml");
/// Four states, one input.
const EQUATIONS: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../benches/support/cart_pendulum.toml");

type Case = (&'static str, &'static [(&'static str, &'static [(&'static str, f64)])]);

const CASES: [Case; 5] = [
    ("no effect", &[]),
    ("fractional delay", &[("input_delay", &[("delay", 0.0137)])]),
    (
        "lag and saturation",
        &[
            ("saturation", &[("lower", -0.6), ("upper", 0.7)]),
            ("actuator_lag", &[("time_constant", 0.05)]),
        ],
    ),
    ("rate limit", &[("rate_limit", &[("rate", 20.0)])]),
    (
        "gain fade and output delay",
        &[("gain_fade", &[("rate", 0.01)]), ("output_delay", &[("delay", 0.0137)])],
    ),
];

fn simulations(criterion: &mut Criterion) -> Result<(), deadtime::Error> {
    let time_s: Vec<f64> = (0..SAMPLES).map(|k| k as f64 * 0.01).collect();
    let inputs =
        [(0..SAMPLES).map(|k| ((k * 7919) % 23) as f64 / 11.0 - 1.0).collect::<Vec<f64>>()];
    let commands = Commands { time_s: &time_s, inputs: &inputs };
    let loose = Tolerance { relative: 1e-6, absolute: 1e-8, ..Tolerance::default() };
    for (name, path, tolerances) in [
        ("linear, 3 states", LINEAR, vec![("", Tolerance::default())]),
        (
            "equations, 4 states",
            EQUATIONS,
            vec![(", 1e-8", Tolerance::default()), (", 1e-6", loose)],
        ),
    ] {
        let system = System::new(&ModelDocument::read(path.as_ref())?, |_| Ok(0.0))?;
        let mut group = criterion.benchmark_group(format!("simulate/{name}"));
        support::pace(&mut group, SAMPLES);
        for (how, tolerance) in tolerances {
            for (case, effects) in CASES {
                let entry = |(effect, values): &(&str, &[(&str, f64)])| EffectEntry {
                    effect: (*effect).to_owned(),
                    channel: if *effect == "output_delay" {
                        "*".to_owned()
                    } else {
                        system.inputs[0].name.clone()
                    },
                    parameters: values
                        .iter()
                        .map(|(name, value)| ((*name).to_owned(), *value))
                        .collect(),
                };
                let applied = effects
                    .iter()
                    .map(|e| Applied::from_entry(&system, &entry(e)))
                    .collect::<Result<Vec<_>, _>>()?;
                let mut plan = Applied::plan(&system, &applied, Chance::Mean)?;
                plan.tolerance = tolerance;
                let run = system.simulate(&plan, commands, &system.initial, None)?;
                let measured: Vec<Measured> = run
                    .y
                    .column_iter()
                    .map(|y| Measured { values: y.iter().copied().collect(), present: None })
                    .collect();
                group.bench_function(format!("{case}{how}"), |b| {
                    b.iter(|| black_box(system.simulate(&plan, commands, &system.initial, None)))
                });
                let gain = DMatrix::from_element(system.states.len(), system.outputs.len(), 1e-3);
                let correction =
                    Some(Correction { gain: &gain, measured: &measured, horizon: None });
                group.bench_function(format!("{case}{how}, corrected"), |b| {
                    b.iter(|| {
                        black_box(system.simulate(&plan, commands, &system.initial, correction))
                    });
                });
            }
        }
    }
    Ok(())
}

/// Runs every bench of this file.
#[allow(clippy::expect_used)]
fn benches() {
    simulations(&mut support::criterion()).expect("the models are valid");
}

criterion_main!(benches);
