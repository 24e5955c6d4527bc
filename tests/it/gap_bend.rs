//! A sensor whose characteristic is bent: named where it is, and not where a plain effect explains as much.

use deadtime::diagnose::{Diagnosis, GapOptions, diagnose};
use deadtime::effect::{Applied, Chance, find};
use deadtime::model::ModelDocument;
use deadtime::simulate::{Commands, System};

use crate::support::coverage::Coverage;

use super::gap_hard::{diagnosed, document, log, servo};

const BEND: &str = "static_nonlinearity";
/// A bend from 2600 samples is nearer to the true one than a single sample's noise, 0.02 of the output's spread.
const WITHIN: f64 = 0.02;
type Acting<'a> = (&'a str, &'a str, &'a [f64]);

fn found(model: &ModelDocument, acting: &[Acting<'_>], seed: u64) -> Diagnosis {
    let logged = |i: u64| log(model, acting, 1300, seed + i, &[0.0, 0.0]);
    diagnosed(model, &[logged(0), logged(1)], &[logged(2)])
}

fn plain() -> ModelDocument {
    document(&servo(", initial_std = 0.02", ""))
}

/// The same servo with its angle alone.
fn one_output() -> ModelDocument {
    let text = servo(", initial_std = 0.02", "")
        .replace(", { name = \"rate\", unit = \"rad/s\" }", "")
        .replace("rate = \"v\"\n", "");
    document(&text)
}

fn bent(count: usize) {
    let model = plain();
    let all: [Acting<'_>; 3] = [
        (BEND, "angle", &[0.35, 0.0]),
        (BEND, "angle", &[0.0, -0.3]),
        (BEND, "rate", &[0.04, -0.05]),
    ];
    let cases = &all[..count];
    let mut coverage = Coverage::default();
    for (at, &case) in cases.iter().enumerate() {
        let d = found(&model, &[case], 4100 + 10 * at as u64);
        let named = (d.cause.verdict.as_str(), d.cause.channel.as_deref(), d.cause.effects.len());
        assert_eq!(named, (case.0, Some(case.1), 1), "{:?}", d.cause.effects);
        for (p, truth) in d.cause.effects[0].parameters.iter().zip(case.2) {
            let value = p.value.unwrap();
            assert!((value - truth).abs() < WITHIN, "{case:?}: {} {value}", p.name);
            coverage.parameter(case.0, p, *truth);
        }
        assert!(d.shrink.of_explainable.unwrap() > 0.97, "{case:?}: {:?}", d.shrink);
    }
    coverage.is_honest(2 * count);
}

#[test]
fn a_bent_sensor_is_named_with_its_numbers() {
    bent(1);
}

#[test]
#[ignore = "nightly: coverage over cases"]
fn a_bent_sensor_is_named_with_its_numbers_for_three_bends() {
    bent(3);
}

fn no_bend(count: usize) {
    let model = plain();
    let all: [Acting<'_>; 7] = [
        ("sensor_gain", "angle", &[1.2]),
        ("sensor_bias", "rate", &[0.4]),
        ("sensor_saturation", "angle", &[-0.45, 0.5]),
        ("saturation", "u", &[-0.6, 0.7]),
        ("deadband", "u", &[0.15]),
        ("input_curve", "u", &[0.3]),
        ("cubic_stiffness", "x->v", &[4.0]),
    ];
    let cases = &all[..count];
    for (at, &case) in cases.iter().enumerate() {
        let d = found(&model, &[case], 4200 + 10 * at as u64);
        let class = d.cause.indistinguishable.first().cloned().unwrap_or_default();
        let named = d.cause.verdict == case.0 || class.contains(&format!("{}:{}", case.0, case.1));
        assert!(
            named && d.cause.verdict != BEND,
            "{case:?} is called {:?}, {class:?}",
            d.cause.effects
        );
        assert!(
            d.cause.contributions.iter().all(|c| c.effect != BEND),
            "{case:?}: {:?}",
            d.cause.contributions
        );
    }
}

#[test]
fn a_plain_gain_a_limit_a_dead_zone_and_a_spring_are_no_bend_of_a_sensor() {
    no_bend(1);
}

#[test]
#[ignore = "nightly: a rate over effects"]
fn a_plain_gain_a_limit_a_dead_zone_and_a_spring_are_no_bend_of_a_sensor_for_seven_effects() {
    no_bend(7);
}

#[test]
#[ignore = "nightly: the same of another model"]
fn of_a_model_with_one_output_too() {
    let model = one_output();
    let measured = |acting: &[Acting<'_>], seed: u64| {
        let system = System::new(&model, |_| Ok(0.0)).unwrap();
        let both = plain();
        let whole = log(&both, acting, 1300, seed, &[0.0, 0.0]);
        let keep = ["u", "angle"].map(|name| whole.channel(name).unwrap().clone());
        assert_eq!(system.outputs.len(), 1);
        deadtime::log::Log::new("one.csv", whole.time_s().to_vec(), keep.to_vec()).unwrap()
    };
    let told = |acting: &[Acting<'_>], seed: u64| {
        diagnosed(&model, &[measured(acting, seed)], &[measured(acting, seed + 1)])
    };
    let gain = told(&[("sensor_gain", "angle", &[1.2])], 4300);
    assert!(
        gain.cause.verdict != BEND && gain.cause.contributions.iter().all(|c| c.effect != BEND),
        "{:?}",
        gain.cause.contributions
    );
    let bend = told(&[(BEND, "angle", &[0.3, -0.2])], 4310);
    let class = bend.cause.indistinguishable.first().cloned().unwrap_or_default();
    assert!(
        bend.cause.verdict == BEND || class.contains(&format!("{BEND}:angle")),
        "{:?}, {class:?}",
        bend.cause.effects
    );
}

#[test]
fn the_written_model_carries_it_and_simulates_it() {
    let model = plain();
    let acting: &[Acting<'_>] = &[(BEND, "angle", &[0.3, -0.2])];
    let logged = |seed: u64| log(&model, acting, 1300, seed, &[0.0, 0.0]);
    let done = diagnose(&model, &[logged(4500)], &[logged(4501)], &GapOptions::default(), &|_| ())
        .unwrap();
    let written = done.model.unwrap().to_toml().unwrap();
    let read =
        ModelDocument::from_toml(&written, std::path::Path::new("with_effects.toml")).unwrap();
    assert_eq!(
        read.effects().iter().map(|e| (e.effect.as_str(), e.channel.as_str())).collect::<Vec<_>>(),
        [(BEND, "angle")],
        "{written}"
    );
    // Its own simulation is as near to a new log as noise lets it be.
    let system = System::new(&read, |_| Ok(0.0)).unwrap();
    let carried = Applied::from_entry(&system, &read.effects()[0]).unwrap();
    let fresh = logged(4502);
    let inputs = [fresh.channel("u").unwrap().samples().values.to_vec()];
    let commands = Commands { time_s: fresh.time_s(), inputs: &inputs };
    let plan = Applied::plan(&system, &[carried], Chance::Mean).unwrap();
    let y = system.simulate(&plan, commands, &[0.0, 0.0], None).unwrap().y;
    let measured = &fresh.channel("angle").unwrap().samples().values;
    let (mean, n) = (measured.iter().sum::<f64>() / measured.len() as f64, measured.len() as f64);
    let spread = (measured.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
    let error =
        (measured.iter().zip(y.column(0).iter()).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / n)
            .sqrt();
    // The log's own noise is 0.02 of the spread.
    assert!(error < 1.2 * 0.02 * spread, "{}", error / spread);
}

#[test]
fn the_curve_rises_and_is_level_past_its_turn_whatever_its_numbers() {
    let text = "format = \"deadtime/model@1\"\nname = \"wire\"\nkind = \"lti\"\ninputs = [{ name = \"u\" }]\nstates = []\noutputs = [{ name = \"y\" }]\n\
                A = []\nB = []\nC = [[]]\nD = [[1.0]]\n";
    let system = System::new(&document(text), |_| Ok(0.0)).unwrap();
    let u: Vec<f64> = (-400..=400).map(|k| 0.01 * f64::from(k)).collect();
    let time_s: Vec<f64> = (0..u.len()).map(|k| k as f64).collect();
    for (quadratic, cubic) in [
        (0.3, 0.0),
        (-0.3, 0.0),
        (0.0, -0.2),
        (0.0, 0.2),
        (0.5, 0.08),
        (-0.5, 0.08),
        (0.2, -0.1),
        (1.0, -1e-13),
    ] {
        let mut bent = Applied::nominal(&system, find(BEND).unwrap(), "y").unwrap();
        bent.values = vec![quadratic, cubic];
        let plan = Applied::plan(&system, &[bent], Chance::Mean).unwrap();
        let y = system
            .simulate(
                &plan,
                Commands { time_s: &time_s, inputs: std::slice::from_ref(&u) },
                &[],
                None,
            )
            .unwrap()
            .y;
        assert!(y.as_slice().windows(2).all(|w| w[1] >= w[0] - 1e-12), "{quadratic} {cubic} falls");
        for (u, y) in u.iter().zip(y.as_slice()).filter(|(u, _)| u.abs() < 0.3) {
            assert!(
                (y - (u + quadratic * u * u + cubic * u.powi(3))).abs() < 1e-14,
                "{quadratic} {cubic} at {u}: {y}"
            );
        }
    }
}
