//! Every effect, alone and combined, on linear, nonlinear and sampled models against a simulator that shares nothing with the crate.

use crate::support::compare::{Comparison, cases, golden, list, text};
use deadtime::effect::{Applied, Chance, EFFECTS};
use deadtime::model::{EffectEntry, ModelDocument};
use deadtime::simulate::{Commands, Realisation, System};
use serde_json::Value;

/// Relative to the largest output of a linear or sampled case: the reference's own accuracy (golden/effects/SOURCE.md).
const LINEAR: f64 = 1e-8;
/// The same for a case that is integrated: the integrator's tolerance is 1e-8 per step.
const INTEGRATED: f64 = 1e-6;

fn columns(rows: &Value) -> Vec<Vec<f64>> {
    let rows: Vec<Vec<f64>> = rows.as_array().unwrap().iter().map(list).collect();
    (0..rows[0].len()).map(|j| rows.iter().map(|r| r[j]).collect()).collect()
}

fn entry(value: &Value) -> EffectEntry {
    let parameters = value["parameters"].as_object().unwrap().iter();
    EffectEntry {
        effect: value["effect"].as_str().unwrap().to_owned(),
        channel: value["channel"].as_str().unwrap().to_owned(),
        parameters: parameters.filter_map(|(name, v)| Some((name.clone(), v.as_f64()?))).collect(),
    }
}

/// The reference knows no quantities inside equations and no exchanged channels: crates/model integrates these in tests of its own.
const ELSEWHERE: [&str; 9] = [
    "swapped_inputs",
    "internal_saturation",
    "internal_deadband",
    "internal_delay",
    "internal_lag",
    "driveline_backlash",
    "driveline_friction",
    "output_backlash",
    "swapped_outputs",
];

#[test]
fn every_effect_agrees_with_an_independent_simulation() {
    let file = golden("effects", "reference.json");
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model.json");
    let (mut seen, mut c) =
        (std::collections::BTreeSet::new(), Comparison::new("effects/reference.json"));
    for case in cases(&file) {
        let id = text(case, "id");
        std::fs::write(&model, case["model"].to_string()).unwrap();
        let system = System::new(
            &ModelDocument::read(&model).unwrap_or_else(|e| panic!("{id}: {e}")),
            |_| Ok(0.0),
        )
        .unwrap();
        let effects: Vec<Applied> = case["effects"]
            .as_array()
            .unwrap()
            .iter()
            .map(|e| {
                Applied::from_entry(&system, &entry(e)).unwrap_or_else(|e| panic!("{id}: {e}"))
            })
            .collect();
        let mut plan = Applied::plan(&system, &effects, Chance::Mean).unwrap();
        let (time_s, inputs) = (list(&case["time"]), columns(&case["u"]));
        if let Some(rows) = case["drops"].as_array() {
            for (j, path) in plan.inputs.iter_mut().enumerate() {
                if let Some(drops) = &mut path.drops {
                    let lost = rows.iter().map(|row| row[j].as_bool().unwrap()).collect();
                    drops.lost = Realisation::Known(lost);
                }
            }
        }
        let x0 = if case["x0"].is_null() { system.initial.clone() } else { list(&case["x0"]) };
        let expected = columns(&case["y"]);
        let run = match system.simulate(
            &plan,
            Commands { time_s: &time_s, inputs: &inputs },
            &x0,
            None,
        ) {
            Ok(run) => run,
            Err(e) => {
                c.fail(format!("{id}: {e}"));
                continue;
            }
        };
        let size = expected.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
        let integrated = id.starts_with("equations")
            || effects.iter().any(|e| {
                [
                    "coulomb_friction",
                    "stribeck_friction",
                    "hysteresis",
                    "quadratic_drag",
                    "cubic_stiffness",
                ]
                .contains(&e.effect.name())
            });
        let off = expected.iter().enumerate().flat_map(|(i, c)| {
            c.iter()
                .zip(run.y.column(i).iter().copied().collect::<Vec<_>>())
                .map(|(a, b)| (a - b).abs())
                .collect::<Vec<_>>()
        });
        let off = off.fold(0.0, |m: f64, v| if v.is_nan() { v } else { m.max(v) }) / size;
        let alone = match &effects[..] {
            [one] => one.effect.name(),
            _ => "several at once",
        };
        let (how, within) =
            if integrated { ("integrated", INTEGRATED) } else { ("linear or sampled", LINEAR) };
        c.check(&format!("{alone}, {how} (of the largest output)"), id, off, within);
        seen.extend(effects.iter().map(|e| e.effect.name()));
    }
    c.finish();
    seen.extend(ELSEWHERE);
    assert!(EFFECTS.iter().all(|e| seen.contains(e.name())), "no case for some effect: {seen:?}");
}
