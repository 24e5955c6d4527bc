//! `deadtime gap` under wind: a ratio of two parameters that is off, and a sensor that stops at a limit.

use deadtime::diagnose::{Diagnosed, GapOptions, Member, diagnose};
use deadtime::log::{Channel, Log};
use deadtime::model::ModelDocument;
use deadtime::report::diagnosis::summary;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

use super::gap_hard::document;

const HOVER: &str = r#"
format = "deadtime/model@1"
name = "hover"
kind = "equations"
inputs = [{ name = "u", unit = "1" }]
outputs = [{ name = "speed", unit = "m/s" }]
[states]
v = { unit = "m/s", initial = 0.0, initial_std = 0.05 }
[parameters]
thrust = { value = 3.0, unit = "N" }
mass = { value = 1.5, unit = "kg" }
[derivatives]
v = "thrust*u/mass - 0.8*v"
[output_equations]
speed = "v"
"#;

const PERIOD: f64 = 0.02;

/// A flight whose thrust over mass is `ratio` times the model's, in a wind of `wind` m/s² with a memory of half a second.
fn flown(ratio: f64, wind: f64, seed: u64) -> Log {
    flown_below(f64::INFINITY, ratio, wind, seed)
}

/// The same with a sensor that stops at a limit.
fn flown_below(limit: f64, ratio: f64, wind: f64, seed: u64) -> Log {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut v, mut gust, mut held) = (0.0, 0.0, 0.0);
    let (mut u, mut speed) = (Vec::new(), Vec::new());
    for k in 0..1500 {
        if k % 40 == 0 {
            held = 0.6 * rng.sample::<f64, _>(StandardNormal);
        }
        let kept = (-PERIOD / 0.5_f64).exp();
        gust =
            kept * gust + wind * (1.0 - kept * kept).sqrt() * rng.sample::<f64, _>(StandardNormal);
        u.push(held);
        speed.push(limit.min(v + 0.005 * rng.sample::<f64, _>(StandardNormal)));
        v += PERIOD * (2.0 * ratio * held - 0.8 * v + gust);
    }
    let time_s = (0..u.len()).map(|k| PERIOD * k as f64).collect();
    let channels = vec![Channel::new("u", Some("1"), u), Channel::new("speed", Some("m/s"), speed)];
    Log::new(format!("flight{seed}.csv"), time_s, channels).unwrap()
}

fn found(model: &ModelDocument, ratio: f64, wind: f64, seed: u64) -> Diagnosed {
    let logs = [0, 1, 2].map(|i| flown(ratio, wind, seed + i));
    diagnose(model, &logs[..2], &logs[2..], &GapOptions::default(), &|_| ()).unwrap()
}

#[test]
fn a_ratio_that_is_off_is_probable_though_neither_number_is_known() {
    let model = document(HOVER);
    for (ratio, wind, seed) in [(0.75, 0.2, 10), (1.3, 0.3, 20), (1.25, 0.15, 30)] {
        let d = found(&model, ratio, wind, seed);
        let cause = &d.diagnosis.cause;
        let keys = |member: &Member| match member {
            Member::One(key) => vec![key.clone()],
            Member::Several(keys) => keys.clone(),
        };
        let holds = |key: &str| {
            let class = cause
                .classes
                .iter()
                .find(|c| c.members.iter().flat_map(keys).any(|member| member == key));
            class.map(|c| c.probability)
        };
        for key in ["parameter_error:thrust", "parameter_error:mass", "input_gain:u"] {
            assert!(holds(key).is_some_and(|p| p > 0.5), "{ratio}: {key} of {:?}", cause.classes);
        }
        let said = summary(&d);
        assert!(said.contains("Shrink: on held-out data the error falls"), "{said}");
    }
}

/// Wind alone: no other value of a parameter.
#[test]
fn wind_recalibrates_nothing() {
    let model = document(HOVER);
    for seed in [40, 50, 60] {
        let cause = found(&model, 1.0, 0.5, seed).diagnosis.cause;
        let block = cause.recalibration.unwrap();
        assert!(!block.accepted, "{seed}: {block:?}");
    }
}

/// Wind hides the error that a sensor limit makes; the repeated value shows it.
#[test]
#[ignore = "nightly: a rate over draws"]
fn a_sensor_that_stops_at_a_limit_is_named_in_wind() {
    let model = document(HOVER);
    let named = [70, 80, 90].into_iter().filter(|&seed| {
        let logs = [0, 1, 2].map(|i| flown_below(0.7, 1.0, 0.5, seed + i));
        let found = diagnose(&model, &logs[..2], &logs[2..], &GapOptions::default(), &|_| ());
        let cause = found.unwrap().diagnosis.cause;
        cause.contributions.iter().any(|c| c.effect == "sensor_saturation")
    });
    assert!(named.count() >= 2);
}
