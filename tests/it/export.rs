//! What a diagnosis is handed over as: hand-calculated steps, fields and transfer functions.

use std::f64::consts::TAU;
use std::path::Path;

use deadtime::diagnose::Diagnosis;
use deadtime::export::{Node, Source, TARGETS, export};
use deadtime::model::ModelDocument;
use serde_json::{Value, json};

use crate::support::program::deadtime;

fn example() -> Value {
    serde_json::from_str(include_str!("../../examples/diagnosis.json")).unwrap()
}

/// `(effect, channel, parameter, unit, value, interval)`, as a contribution.
fn contribution(
    effect: &str,
    channel: &str,
    parameters: &[(&str, &str, f64, Option<[f64; 2]>)],
) -> Value {
    let one = |(name, unit, value, ci95): &(&str, &str, f64, Option<[f64; 2]>)| json!({ "name": name, "unit": unit, "value": value, "std": ci95.map(|_| 0.1), "ci95": ci95 });
    json!({ "effect": effect, "channel": channel, "parameters": parameters.iter().map(one).collect::<Vec<_>>(), "strength": "clear",
            "share": { "learnt": 0.5, "held_out": 0.5, "ci95": null }, "without_it": 0.4, "class": [], "surrogate": false })
}

fn diagnosis(contributions: Vec<Value>) -> Diagnosis {
    let mut found = example();
    found["cause"]["contributions"] = contributions.into();
    found["prediction"]["mode"] = json!("simulation");
    serde_json::from_value(found).unwrap()
}

fn made(found: &Diagnosis, to: &str, options: Value, widen: f64) -> Value {
    let deviations = [("p".to_owned(), 2.0)];
    let source = Source { diagnosis: found, model: None, deviations: &deviations, widen };
    serde_json::from_str(&export(&source, to, options).unwrap().to_json()).unwrap()
}

#[test]
fn ranges_are_the_intervals_inside_what_makes_sense() {
    let found = diagnosis(vec![
        contribution("input_delay", "u", &[("delay", "s", 0.01, Some([0.002, 0.018]))]),
        contribution("input_gain", "u", &[("gain", "1", 1.2, Some([1.1, 1.3]))]),
        contribution("sensor_bias", "p", &[("offset", "rad/s", 0.3, None)]),
    ]);
    let made = made(&found, "domain-randomisation", json!({}), 2.0);
    let ranges = made["ranges"].as_array().unwrap();
    let row = |at: usize| {
        let r = &ranges[at];
        let word = |key: &str| r[key].as_str().unwrap().to_owned();
        (word("operation"), r["low"].as_f64().unwrap(), r["high"].as_f64().unwrap(), word("from"))
    };
    // No delay is below 0, however wide the interval.
    let (set, low, high, from) = row(0);
    assert!(
        (set.as_str(), low, from.as_str()) == ("set", 0.0, "ci95") && (high - 0.026).abs() < 1e-12
    );
    let (scale, low, high, _) = row(1);
    assert!(scale == "scale" && (low - 1.0).abs() < 1e-12 && (high - 1.4).abs() < 1e-12);
    // A parameter at a bound has no interval: its range is the value.
    assert_eq!(row(2), ("add".to_owned(), 0.3, 0.3, "value".to_owned()));
    // 0.05 of 2 rad/s; the other output's deviation is not known.
    assert_eq!(
        (made["noise"][0]["std"].as_f64(), made["noise"][1]["std"].as_f64()),
        (Some(0.1), None)
    );
}

#[test]
fn noise_of_one_step_predictions_is_not_taken_for_the_sensors() {
    let mut found = diagnosis(vec![]);
    found.prediction.mode = deadtime::diagnose::Mode::Predictor;
    assert_eq!(made(&found, "domain-randomisation", json!({}), 1.0)["noise"], json!([]));
}

#[test]
fn isaac_lab_gets_whole_physics_steps_and_the_rest_by_hand() {
    let found = diagnosis(vec![
        contribution("input_delay", "torque", &[("delay", "s", 0.031, Some([0.0298, 0.0322]))]),
        contribution("coulomb_friction", "speed", &[("level", "rad/s^2", 4.0, Some([3.0, 5.0]))]),
        contribution("sensor_bias", "p", &[("offset", "rad/s", 0.3, Some([0.2, 0.4]))]),
        contribution("actuator_lag", "torque", &[("time_constant", "s", 0.05, Some([0.04, 0.06]))]),
    ]);
    let made =
        made(&found, "isaaclab", json!({ "physics_dt": 0.005, "inertia": { "speed": 0.02 } }), 1.0);
    assert_eq!(
        made["actuators"]["torque"],
        json!({ "class_type": "DelayedPDActuatorCfg", "min_delay": 5, "max_delay": 7 })
    );
    let friction = &made["events"]["friction_speed"]["params"];
    assert_eq!(friction["friction_distribution_params"], json!([0.06, 0.1]));
    let noise = &made["observations"]["p"]["noise"];
    assert_eq!(
        (&noise["noise_cfg"]["std"], &noise["bias_noise_cfg"]["n_min"]),
        (&json!(0.1), &json!(0.2))
    );
    let by_hand: Vec<&str> =
        made["by_hand"].as_array().unwrap().iter().map(|b| b["effect"].as_str().unwrap()).collect();
    assert_eq!(by_hand, ["actuator_lag"]);
    // Without the step, and with one that is none, nothing is made up.
    let source = Source { diagnosis: &found, model: None, deviations: &[], widen: 1.0 };
    let refused = |options: Value| export(&source, "isaaclab", options).unwrap_err().to_string();
    assert!(refused(json!({})).contains("physics_dt"));
    assert!(refused(json!({ "physics_dt": -1.0 })).contains("above 0"));
    assert!(
        refused(json!({ "dt": 1.0 })).contains("physics_dt"),
        "an unknown option is answered with those there are"
    );
}

#[test]
fn mujoco_gets_fields_by_name_with_what_the_file_must_have() {
    let found = diagnosis(vec![
        contribution("input_delay", "torque", &[("delay", "s", 0.031, Some([0.03, 0.032]))]),
        contribution("coulomb_friction", "speed", &[("level", "rad/s^2", 4.0, Some([3.0, 5.0]))]),
        contribution(
            "parameter_error",
            "joint/elbow/damping",
            &[("value", "N m s/rad", 0.1, Some([0.09, 0.11]))],
        ),
        contribution("deadband", "torque", &[("width", "N m", 0.1, Some([0.09, 0.11]))]),
    ]);
    let made =
        made(&found, "mujoco", json!({ "timestep": 0.002, "names": { "speed": "elbow" } }), 1.0);
    let field = |at: usize| &made["fields"][at];
    assert_eq!(
        (field(0)["field"].as_str(), field(0)["name"].as_str()),
        (Some("actuator_delay"), Some("torque"))
    );
    assert!(
        field(0)["needs"].as_str().unwrap().contains("nsample=\"17\""),
        "16 steps of delay and the sample itself: {}",
        field(0)
    );
    assert_eq!(
        (field(1)["name"].as_str(), field(1)["times"].as_str()),
        (Some("elbow"), Some("dof_M0"))
    );
    assert_eq!(field(2)["path"].as_str(), Some("joint/elbow/damping"));
    assert_eq!(made["by_hand"][0]["effect"].as_str(), Some("deadband"));
}

const LAG: &str = r#"
format = "deadtime/model@1"
name = "lateral"
kind = "lti"
inputs = [{ name = "u" }]
states = [{ name = "x" }]
outputs = [{ name = "y" }]
input_delay_s = [0.01]
A = [[-2.0]]
B = [[3.0]]
C = [[1.0]]
D = [[0.0]]
effects = [
  { effect = "input_delay", channel = "u", parameters = { delay = 0.02 } },
  { effect = "input_gain", channel = "u", parameters = { gain = 1.5 } },
  { effect = "actuator_lag", channel = "u", parameters = { time_constant = 0.1 } },
  { effect = "sensor_gain", channel = "y", parameters = { gain = 2.0 } },
  { effect = "deadband", channel = "u", parameters = { width = 0.1 } },
]
"#;

#[test]
fn a_transfer_function_has_gain_lag_and_delay_of_the_effects() {
    let found = diagnosis(vec![
        contribution("input_delay", "u", &[("delay", "s", 0.02, Some([0.018, 0.022]))]),
        contribution("backlash", "u", &[("width", "1", 0.1, None)]),
    ]);
    let model = ModelDocument::from_toml(LAG, Path::new("lag.toml")).unwrap();
    let source = Source { diagnosis: &found, model: Some(&model), deviations: &[], widen: 1.0 };
    let made: Value =
        serde_json::from_str(&export(&source, "transfer-function", json!({})).unwrap().to_json())
            .unwrap();
    let tf = &made["functions"][0];
    // 2·1.5·3/((s + 2)(0.1 s + 1)) = 90/(s² + 12 s + 20), 0.01 + 0.02 s late.
    let numbers = |key: &str| {
        tf[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<_>>()
    };
    let near = |a: &[f64], b: &[f64]| {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9 * b.abs().max(1.0))
    };
    assert!(near(&numbers("numerator"), &[90.0]), "{tf}");
    assert!(near(&numbers("denominator"), &[1.0, 12.0, 20.0]), "{tf}");
    let delay = |key: &str| tf["delay"][key].as_f64().unwrap();
    assert!(
        near(&[delay("value_s"), delay("low_s"), delay("high_s")], &[0.03, 0.028, 0.032]),
        "{tf}"
    );
    let out: Vec<&str> = made["left_out"]
        .as_array()
        .unwrap()
        .iter()
        .map(|e| e["effect"].as_str().unwrap())
        .collect();
    assert_eq!(
        out,
        ["deadband", "backlash"],
        "what is not linear, and what the model does not have"
    );
    let none = Source { model: None, ..source };
    assert!(
        export(&none, "transfer-function", json!({}))
            .unwrap_err()
            .to_string()
            .contains("model_with_effects.toml")
    );
}

#[test]
fn equations_are_linearised_where_a_log_starts() {
    let text = r#"
format = "deadtime/model@1"
name = "lateral"
kind = "equations"
inputs = [{ name = "torque" }]
outputs = [{ name = "angle" }]
[states]
angle = { initial = 0.0 }
speed = { initial = 0.0 }
[parameters]
k = { value = 4.0 }
[derivatives]
angle = "speed"
speed = "torque - k*sin(angle) - speed*abs(speed)"
[output_equations]
angle = "angle"
"#;
    let found = diagnosis(vec![]);
    let model = ModelDocument::from_toml(text, Path::new("pendulum.toml")).unwrap();
    let source = Source { diagnosis: &found, model: Some(&model), deviations: &[], widen: 1.0 };
    let made = export(&source, "transfer-function", json!({})).unwrap();
    let made: Value = serde_json::from_str(&made.to_json()).unwrap();
    let denominator: Vec<f64> = made["functions"][0]["denominator"]
        .as_array()
        .unwrap()
        .iter()
        .map(|v| v.as_f64().unwrap())
        .collect();
    assert!(
        denominator.len() == 3
            && (denominator[2] - 4.0).abs() < 1e-9
            && denominator[1].abs() < 1e-9,
        "{denominator:?}"
    );
    assert_eq!(made["linearised"], json!(true));
    // 1/(4 − ω²) at ω = 1 Hz, by the poles as well.
    let omega = TAU;
    let poles = made["functions"][0]["poles"].as_array().unwrap();
    let size: f64 = poles
        .iter()
        .map(|p| p[0].as_f64().unwrap().hypot(omega - p[1].as_f64().unwrap()))
        .product();
    assert!((1.0 / size - 1.0 / (omega * omega - 4.0)).abs() < 1e-9);
}

#[test]
fn every_target_takes_every_effect_without_losing_one() {
    let parts: Vec<Value> = deadtime::effect::table()
        .iter()
        .map(|line| {
            let mut parameters: Vec<_> = line
                .parameters
                .iter()
                .map(|p| (p.name.as_ref(), p.unit.as_str(), 0.5, Some([0.4, 0.6])))
                .collect();
            if parameters.is_empty() {
                // A candidate has the parameters of its own expression.
                parameters.push(("k", "1", 0.5, Some([0.4, 0.6])));
            }
            contribution(line.effect, "c", &parameters)
        })
        .collect();
    let found = diagnosis(parts);
    for target in &TARGETS {
        let options =
            if target.name == "isaaclab" { json!({ "physics_dt": 0.01 }) } else { json!({}) };
        let model = ModelDocument::from_toml(LAG, Path::new("lag.toml")).unwrap();
        let source = Source { diagnosis: &found, model: Some(&model), deviations: &[], widen: 1.0 };
        let made: Node = export(&source, target.name, options).unwrap();
        let text = made.to_json();
        let missing: Vec<&str> = deadtime::effect::table()
            .iter()
            .map(|line| line.effect)
            // Held by a field of the target instead of by name.
            .filter(|effect| {
                let held: &[&str] = match target.name {
                    "mujoco" => &[
                        "input_delay",
                        "output_delay",
                        "actuator_lag",
                        "input_gain",
                        "saturation",
                        "coulomb_friction",
                    ],
                    "isaaclab" => &["input_delay", "delay_jump", "sensor_bias"],
                    _ => &[],
                };
                !text.contains(&format!("\"{effect}\"")) && !held.contains(effect)
            })
            .collect();
        assert!(missing.is_empty(), "{}: {missing:?}", target.name);
    }
}

#[test]
fn the_command_writes_json_and_yaml_and_names_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let diagnosis = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/diagnosis.json");
    let file = folder.path().join("ranges.yaml");
    deadtime(&[
        "export",
        diagnosis,
        "--to",
        "domain-randomisation",
        "--out",
        file.to_str().unwrap(),
    ])
    .done();
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(
        text.starts_with("format: deadtime/ranges@1\n") && text.contains("low: 0.0298\n"),
        "{text}"
    );
    let refused = |words: &[&str], says: &str| {
        deadtime(&[&["export", diagnosis], words].concat()).refused(&[says])
    };
    refused(&["--to", "gazebo"], "mujoco, isaaclab");
    refused(&["--to", "isaaclab"], "--set physics_dt=");
    refused(&["--to", "transfer-function"], "--model");
}
