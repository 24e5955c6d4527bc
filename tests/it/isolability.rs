//! `deadtime gap --isolability`: what an excitation can tell apart, beside cosines that were computed elsewhere.

use std::f64::consts::TAU;

use crate::support::program::{Folder, deadtime, text};
use deadtime::diagnose::{GapOptions, Isolability, isolability};
use deadtime::effect::{Applied, Chance};
use deadtime::log::{Channel, Log};
use deadtime::model::ModelDocument;
use deadtime::simulate::{Commands, System};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

/// ω = 8 rad/s, ζ = 0.7, angle and rate, from rest: the plant of the comparison.
const ROLL: &str = r#"
format = "deadtime/model@1"
name = "roll"
kind = "lti"
inputs = [{ name = "u", unit = "1" }]
states = [{ name = "phi", unit = "rad" }, { name = "p", unit = "rad/s" }]
outputs = [{ name = "angle", unit = "rad" }, { name = "rate", unit = "rad/s" }]
initial = [0.0, 0.0]
initial_std = [0.0, 0.0]
A = [[0.0, 1.0], [-64.0, -11.2]]
B = [[0.0], [64.0]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]
"#;

const TS: f64 = 0.01;

fn document() -> ModelDocument {
    let folder = Folder::new();
    ModelDocument::read(&folder.write("m.toml", ROLL)).unwrap()
}

/// The response to a command with 5 % white noise.
fn log(name: &str, u: Vec<f64>, seed: u64) -> Log {
    let system = System::new(&document(), |_| Ok(0.0)).unwrap();
    let time_s: Vec<f64> = (0..u.len()).map(|k| TS * k as f64).collect();
    let plan = Applied::plan(&system, &[] as &[Applied], Chance::Mean).unwrap();
    let inputs = vec![u];
    let run = system
        .simulate(&plan, Commands { time_s: &time_s, inputs: &inputs }, &[0.0, 0.0], None)
        .unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut channels = vec![Channel::new("u", Some("1"), inputs[0].clone())];
    for (port, y) in system.outputs.iter().zip(run.y.column_iter()) {
        let rms = (y.norm_squared() / y.len() as f64).sqrt();
        let noisy =
            y.iter().map(|v| v + 0.05 * rms * rng.sample::<f64, _>(StandardNormal)).collect();
        channels.push(Channel::new(&port.name, port.unit.as_deref(), noisy));
    }
    Log::new(name, time_s, channels).unwrap()
}

/// Rest, then ±0.3 for half a second each, again and again: one amplitude.
fn doublets(samples: usize) -> Vec<f64> {
    (0..samples)
        .map(|k| match (k as f64 * TS) % 2.5 {
            t if t < 1.5 => 0.0,
            t if t < 2.0 => 0.3,
            _ => -0.3,
        })
        .collect()
}

/// 0.1 to 8 Hz, flat, random phases: many amplitudes.
fn multisine(samples: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let lines: Vec<(f64, f64)> =
        (1..=80).map(|i| (0.1 * f64::from(i), rng.random_range(0.0..TAU))).collect();
    let value =
        |t: f64| 0.05 * lines.iter().map(|(hz, phase)| (TAU * hz * t + phase).cos()).sum::<f64>();
    (0..samples).map(|k| value(k as f64 * TS)).collect()
}

fn look(u: Vec<f64>) -> Isolability {
    isolability(
        &document(),
        &[log("roll.csv", u, 1)],
        &GapOptions::default(),
        &deadtime::progress::HowFar::default(),
    )
    .unwrap()
}

fn cosine(found: &Isolability, one: &str, other: &str) -> f64 {
    let at = |name: &str| {
        found.effects.iter().position(|e| format!("{}:{}", e.effect, e.channel) == name).unwrap()
    };
    let (i, j) = (at(one), at(other));
    assert_eq!(found.cosines[i][j], found.cosines[j][i]);
    found.cosines[i][j]
}

fn alike(found: &Isolability, one: &str, other: &str) -> bool {
    found.classes.iter().any(|c| [one, other].iter().all(|n| c.members.iter().any(|m| m == n)))
}

/// Pairs with the cosines of a computation of small effects on the same plant by other code, and how far ours may be off: signatures are taken at several sizes here.
const PAIRS: [(&str, &str, [f64; 2], f64); 8] = [
    ("actuator_lag:u", "sensor_lag:*", [1.000, 1.000], 0.002),
    ("input_delay:u", "output_delay:*", [1.000, 0.999], 0.003),
    ("input_delay:u", "output_delay:angle", [0.43, 0.38], 0.2),
    ("input_delay:u", "actuator_lag:u", [0.986, 0.978], 0.04),
    ("deadband:u", "input_gain:u", [1.000, 0.88], 0.06),
    ("saturation:u", "input_gain:u", [1.000, 0.80], 0.2),
    ("quadratic_drag:p", "parameter_error:A[p,p]", [0.949, 0.958], 0.06),
    ("coulomb_friction:p", "parameter_error:A[p,p]", [0.67, 0.91], 0.2),
];

#[test]
fn cosines_are_those_of_another_computation() {
    let found = [look(doublets(2000)), look(multisine(2000))];
    for (one, other, cosines, off) in PAIRS {
        for (found, expected) in found.iter().zip(cosines) {
            let ours = cosine(found, one, other);
            println!("{one} {other}: {ours:.3} for {expected:.3}");
            assert!(
                (ours - expected).abs() <= off,
                "{one} and {other}: {ours}, elsewhere {expected}"
            );
        }
    }
    println!(
        "{:?}",
        found
            .iter()
            .map(|f| f.classes.iter().map(|c| c.members.clone()).collect::<Vec<_>>())
            .collect::<Vec<_>>()
    );
}

#[test]
fn one_amplitude_cannot_tell_what_depends_on_amplitude_and_a_multisine_can() {
    let [one, many] = [look(doublets(2000)), look(multisine(2000))];
    for (a, b) in [
        ("deadband:u", "input_gain:u"),
        ("saturation:u", "input_gain:u"),
        ("deadband:u", "saturation:u"),
    ] {
        assert!(alike(&one, a, b), "{a} {b}: {:?}", one.classes);
        assert!(!alike(&many, a, b), "{a} {b}: {:?}", many.classes);
    }
    // Identical by structure, whatever the excitation.
    for found in [&one, &many] {
        assert!(
            alike(found, "actuator_lag:u", "sensor_lag:*")
                || cosine(found, "actuator_lag:u", "sensor_lag:*") > 0.999
        );
        assert!(alike(found, "input_delay:u", "clock_offset:*"));
        assert!(!alike(found, "input_delay:u", "output_delay:angle"));
    }
}

#[test]
fn what_a_poor_excitation_hides_is_not_visible_and_sizes_follow_the_noise() {
    // A command at rest: nothing on its way shows.
    let still = look(
        vec![0.0; 2000].iter().enumerate().map(|(k, _)| if k < 20 { 0.3 } else { 0.0 }).collect(),
    );
    let rich = look(multisine(2000));
    let of = |found: &Isolability, name: &str| {
        found
            .effects
            .iter()
            .find(|e| format!("{}:{}", e.effect, e.channel) == name)
            .unwrap()
            .clone()
    };
    assert!(!of(&still, "gain_fade:u").visible && of(&rich, "gain_fade:u").visible);
    // The gain's smallest size by hand: √30 noise standard deviations over the length of the signature. With 5 % of noise on each of two outputs the
    // signature of a gain g is g·√(2·1650)/0.05 (350 of 2000 samples carry no weight).
    let size = of(&rich, "input_gain:u").smallest.unwrap();
    let expected = 30.0_f64.sqrt() * 0.05 / (2.0 * 1650.0_f64).sqrt();
    assert!(
        ((size.value - 1.0).abs() / expected - 1.0).abs() < 0.1,
        "{size:?}, by hand {expected}"
    );
}

#[test]
fn the_command_needs_no_folder_and_says_what_it_cannot_tell_apart() {
    let folder = Folder::new();
    let model = folder.write("model.toml", ROLL);
    let csv = folder.path("a.csv");
    log("a.csv", doublets(2000), 1).write_csv(&csv).unwrap();
    let json = folder.path("i.json");
    let said = deadtime(&[
        "gap",
        "--model",
        text(&model),
        "--log",
        text(&csv),
        "--isolability",
        "--json",
        text(&json),
    ])
    .words();
    for part in [
        "seen from",
        "closest",
        "alternative",
        "Indistinguishable",
        "deadband:u",
        "two or more amplitudes",
    ] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    let read: Isolability = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(read.effects.len(), read.cosines.len());
    assert!(!folder.names().iter().any(|n| n.contains("diagnosis")), "nothing is diagnosed");
    // A diagnosis without a folder is printed and leaves no file.
    let before = folder.names();
    let said = deadtime(&["gap", "--model", text(&model), "--log", text(&csv)]).done();
    assert!(said.contains("Cause: ") && !said.contains("Written"), "{said}");
    assert_eq!(folder.names(), before);
}

#[test]
fn three_logs_of_a_minute_take_no_time() {
    let logs: Vec<Log> = (0..3).map(|i| log(&format!("{i}.csv"), multisine(6000), i)).collect();
    let start = std::time::Instant::now();
    isolability(&document(), &logs, &GapOptions::default(), &deadtime::progress::HowFar::default())
        .unwrap();
    let seconds = start.elapsed().as_secs_f64();
    println!("{seconds:.2} s");
    // 2 s on an idle machine; tests share theirs.
    assert!(seconds < 10.0, "{seconds} s");
}
