//! Angles that are logged within one turn, and quaternions that jump to their negatives: no gap of the machine.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use deadtime::diagnose::{Caveat, GapOptions, diagnose, inspect};
use deadtime::effect::OnLog;
use deadtime::log::{Channel, Log};
use deadtime::model::ModelDocument;
use deadtime::progress::HowFar;
use deadtime::stop::Stop;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

/// A vehicle that turns: the rate follows its command, the heading has no home.
fn vehicle(heading: &str) -> ModelDocument {
    let text = r#"
format = "deadtime/model@1"
name = "vehicle"
kind = "equations"
inputs = [{ name = "turn", unit = "rad/s" }]
outputs = [HEADING, { name = "rate", unit = "rad/s" }]
[states]
heading = { unit = "rad", initial_std = 0.02 }
rate = { unit = "rad/s", initial_std = 0.02 }
[derivatives]
heading = "rate"
rate = "(turn - rate)/0.4"
[output_equations]
heading = "heading"
rate = "rate"
"#;
    ModelDocument::from_toml(&text.replace("HEADING", heading), Path::new("vehicle.toml")).unwrap()
}

const PLAIN: &str = r#"{ name = "heading", unit = "rad" }"#;
const ANGLE: &str = r#"{ name = "heading", unit = "rad", kind = "angle" }"#;

/// A ride of 40 s in which the command acts some samples late; the compass knows no more than one turn.
fn ride(late: usize, seed: u64) -> Log {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut heading, mut rate, mut turn) = (0.0_f64, 0.0_f64, 0.0);
    let (mut u, mut h, mut r) = (vec![], vec![], vec![]);
    for k in 0..2000 {
        if k % 60 == 0 {
            turn = rng.random_range(-1.5..2.5);
        }
        u.push(turn);
        let mut noise = || 0.01 * rng.sample::<f64, _>(StandardNormal);
        h.push((heading + noise() + PI).rem_euclid(TAU) - PI);
        r.push(rate + noise());
        let acts = u[k - late.min(k)];
        for _ in 0..20 {
            (heading, rate) = (heading + 0.001 * rate, rate + 0.001 * (acts - rate) / 0.4);
        }
    }
    let time = (0..2000).map(|k| 0.02 * f64::from(k)).collect();
    let channels = vec![
        Channel::new("turn", Some("rad/s"), u),
        Channel::new("heading", Some("rad"), h),
        Channel::new("rate", Some("rad/s"), r),
    ];
    Log::new(format!("ride {seed}"), time, channels).unwrap()
}

#[test]
fn a_heading_that_wraps_is_no_gap_where_it_is_said_to_be_an_angle() {
    let logs = [ride(8, 1), ride(8, 2)];
    assert!(logs[0].whole_turns("heading", TAU) > 2);
    let found =
        diagnose(&vehicle(ANGLE), &logs, &[ride(8, 3)], &GapOptions::default(), &|_| ()).unwrap();
    assert!(!found.caveats.iter().any(|c| matches!(c, Caveat::WholeTurns { .. })));
    let cause = &found.diagnosis.cause;
    assert_eq!(cause.verdict, "input_delay");
    assert_eq!(cause.effects[0].effect, "input_delay");
    assert!(
        (cause.effects[0].parameters[0].value.unwrap() - 0.16).abs() < 0.01,
        "{:?}",
        cause.effects
    );
    // As an angle it is simulated as well as it was made.
    let machine = vehicle(ANGLE);
    let log = machine.complete(ride(0, 4)).unwrap();
    let simulation = OnLog::new(&machine, &log).unwrap();
    let response = simulation.response().unwrap();
    let nrmse: Vec<f64> =
        simulation.nrmse(&response).unwrap().into_iter().map(|(_, e)| e.unwrap()).collect();
    assert!(nrmse.iter().all(|e| *e < 0.03), "{nrmse:?}");
}

#[test]
fn a_heading_that_wraps_is_what_is_said_first_where_nothing_says_that_it_is_an_angle() {
    let logs = [ride(8, 1)];
    let found = diagnose(&vehicle(PLAIN), &logs, &[], &GapOptions::default(), &|_| ()).unwrap();
    let said: Vec<String> =
        found.caveats.iter().filter(|c| c.comes_first()).map(ToString::to_string).collect();
    assert!(
        said.iter().any(
            |s| s.contains("`heading` jumps by a whole turn") && s.contains("kind = \"angle\"")
        ),
        "{said:?}"
    );
    let checked = inspect(&vehicle(PLAIN), &logs, &Stop::default(), &HowFar::default()).unwrap();
    assert!(
        checked.checks.iter().any(|c| c.ok == Some(false)
            && c.channel == "heading"
            && c.finding.contains("whole turn")),
        "{:?}",
        checked.checks
    );
    let checked = inspect(&vehicle(ANGLE), &logs, &Stop::default(), &HowFar::default()).unwrap();
    assert!(!checked.checks.iter().any(|c| c.finding.contains("whole turn")));
}

#[test]
fn an_angle_needs_a_unit_that_says_what_a_turn_is() {
    let text = vehicle(PLAIN).to_toml().unwrap().replacen("unit = \"rad\"", "kind = \"angle\"", 1);
    let wrong = ModelDocument::from_toml(&text, Path::new("vehicle.toml")).unwrap_err().to_string();
    assert!(
        wrong.contains("vehicle.toml") && wrong.contains("`heading`") && wrong.contains("`deg`"),
        "{wrong}"
    );
    // It is written as it was read.
    let again =
        ModelDocument::from_toml(&vehicle(ANGLE).to_toml().unwrap(), Path::new("again.toml"))
            .unwrap();
    assert_eq!(again.outputs()[0].turn(), Some(TAU));
}

/// A body that turns about one axis, its attitude logged with a scalar that is never negative.
#[test]
fn an_attitude_that_jumps_to_its_negative_is_no_gap() {
    let text = r#"
format = "deadtime/model@1"
name = "top"
kind = "equations"
inputs = [{ name = "spin", unit = "rad/s" }]
outputs = [{ name = "qx" }, { name = "qy" }, { name = "qz" }, { name = "qw" }]
[states]
half = { unit = "rad", initial = 0.0, initial_std = 0.0 }
[derivatives]
half = "spin/2"
[output_equations]
qx = "0"
qy = "0"
qz = "sin(half)"
qw = "cos(half)"
[groups]
attitude = { outputs = ["qx", "qy", "qz", "qw"], kind = "attitude" }
"#;
    let model = ModelDocument::from_toml(text, Path::new("top.toml")).unwrap();
    let (mut half, mut rows) = (0.0_f64, vec![]);
    let spin = |k: usize| 2.0 + (k as f64 / 40.0).sin();
    for k in 0..600 {
        let sign = if half.cos() < 0.0 { -1.0 } else { 1.0 };
        rows.push([spin(k), 0.0, 0.0, sign * half.sin(), sign * half.cos()]);
        half += 0.02 * spin(k) / 2.0;
    }
    let names = ["spin", "qx", "qy", "qz", "qw"];
    let channels = names
        .iter()
        .enumerate()
        .map(|(i, name)| Channel::new(*name, None, rows.iter().map(|r| r[i]).collect()))
        .collect();
    let log = Log::new("top", (0..600).map(|k| 0.02 * f64::from(k)).collect(), channels).unwrap();
    let error = |log: &Log| {
        let simulation = OnLog::new(&model, log).unwrap();
        let response = simulation.response().unwrap();
        simulation
            .nrmse(&response)
            .unwrap()
            .into_iter()
            .filter_map(|(_, e)| e.ok())
            .fold(0.0, f64::max)
    };
    assert!(error(&log) > 0.5, "as logged it jumps");
    assert!(error(&model.complete(log).unwrap()) < 1e-6);
}
