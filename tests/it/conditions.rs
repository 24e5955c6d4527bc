//! What a record shows of itself: which complications are found where they are, and not found where they are not.

use crate::support::plants;
use crate::support::plants::{rbs, rng, second_order, std_dev, sum, times, white};
use deadtime::delay::{Condition, Experiment, Record, Recording, conditions, moving_together};
use deadtime::signal::Excitation;
use deadtime::signal::excitation::{Chirp, Doublet, Multisine, Rbs, Step, ThreeTwoOneOne};

const N: usize = 800;
const SEEDS: u64 = 60;

fn found(record: &Record, condition: Condition) -> bool {
    conditions(std::slice::from_ref(record), 35).iter().any(|f| f.condition == condition)
}

/// y = G u + noise with u = dither − k₀y(t) − k₁y(t − 1): share `level` of the loop's own motion is noise.
fn closed_loop(a: [f64; 2], b: f64, k: [f64; 2], level: f64, seed: u64) -> Record<'static> {
    let (dither, noise) = (rbs(N, 1.0, seed), white(N, level, seed + 500));
    let (mut y, mut u) = (vec![0.0; N], vec![0.0; N]);
    for t in 0..N {
        let past = |x: &[f64], lag: usize| if t >= lag { x[t - lag] } else { 0.0 };
        y[t] = b * past(&u, 5) - a[0] * past(&y, 1) - a[1] * past(&y, 2) + noise[t];
        u[t] = dither[t] - k[0] * y[t] - k[1] * past(&y, 1);
    }
    Record::new(u, y)
}

fn inputs(seed: u64) -> Vec<(&'static str, Vec<f64>)> {
    let mut r = rng(seed);
    let mut make = |name, e: &dyn Excitation| (name, e.generate(N, &mut r).unwrap());
    vec![
        make("white rbs", &Rbs::default()),
        make("slow rbs", &Rbs { band: [0.0, 0.1], ..Rbs::default() }),
        make("step", &Step::default()),
        make("doublet", &Doublet::default()),
        make("3211", &ThreeTwoOneOne::default()),
        make("chirp", &Chirp::default()),
        make("multisine", &Multisine::default()),
    ]
}

fn false_alarms(seeds: u64) {
    let mut false_alarms = Vec::new();
    for seed in 0..seeds {
        for (name, u) in inputs(seed) {
            for (noise, colour) in [(0.01, 0.0), (0.1, 0.0), (0.1, 0.9), (1.0, 0.9)] {
                let y = second_order(&u, 0.1, [-1.7, 0.72], 4);
                let mut e = white(N, noise * std_dev(&y), seed + 900);
                for t in 1..N {
                    e[t] += colour * e[t - 1];
                }
                // A gain that falls by a fifth at the largest output: no plant is quite linear.
                let bent: Vec<f64> = {
                    let peak = y.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
                    y.iter().map(|v| v * (1.0 - 0.2 * (v / peak).powi(2))).collect()
                };
                for (plant, y) in [("linear", &y), ("bent", &bent)] {
                    if found(&Record::new(u.clone(), sum(y, &e)), Condition::Feedback) {
                        false_alarms.push(format!("{name} {plant} {noise} {colour}"));
                    }
                }
            }
        }
    }
    let records = seeds as usize * 7 * 4 * 2;
    let mut kinds: std::collections::BTreeMap<&String, usize> = std::collections::BTreeMap::new();
    false_alarms.iter().for_each(|f| *kinds.entry(f).or_default() += 1);
    println!(
        "{} of {records} open-loop records pass for closed ones: {kinds:?}",
        false_alarms.len()
    );
    // One in a hundred.
    assert!(false_alarms.len() * 100 <= records);
}

#[test]
#[ignore = "nightly: a rate over draws"]
fn open_loop_records_seldom_pass_for_closed_ones_whatever_moves_them() {
    false_alarms(4);
}

#[test]
#[ignore = "nightly: a rate over draws"]
fn open_loop_records_seldom_pass_for_closed_ones_whatever_moves_them_in_thirty_draws() {
    false_alarms(SEEDS / 2);
}

#[test]
fn feedback_that_matters_is_found() {
    // Noise as strong as the dither, and half of it.
    for level in [1.0, 0.5] {
        let hits = (0..SEEDS)
            .filter(|s| {
                found(&closed_loop([-0.85, 0.0], 0.1, [2.0, 0.0], level, *s), Condition::Feedback)
            })
            .count();
        println!("noise {level}: found in {hits} of {SEEDS}");
        assert!(20 * hits >= 19 * SEEDS as usize, "noise {level}: {hits} of {SEEDS}");
    }
}

#[test]
fn unstable_plants_lags_colours_and_gaps_are_told_from_their_absence() {
    let count = |record: &dyn Fn(u64) -> Record<'static>, condition| {
        (0..SEEDS).filter(|s| found(&record(*s), condition)).count()
    };
    let copy = |seed: u64| {
        let u = rbs(N, 1.0, seed);
        let y = plants::delayed(&times(&u, 0.7), 5);
        Record::new(u, sum(&y, &white(N, 0.1, seed + 1)))
    };
    let slow = |colour: f64| {
        move |seed: u64| {
            let u = rbs(N, 1.0, seed);
            let y = second_order(&u, 0.1, [-1.7, 0.72], 4);
            let mut e = white(N, 0.1 * std_dev(&y), seed + 1);
            for t in 1..N {
                e[t] += colour * e[t - 1];
            }
            Record::new(u, sum(&y, &e))
        }
    };
    let unstable = |seed: u64| closed_loop([-1.52, 0.51], 0.05, [0.9, -0.3], 0.05, seed);
    let few = SEEDS as usize / 20;
    let most = SEEDS as usize - few;
    for (what, with, without) in [
        (
            "an unstable plant",
            count(&unstable, Condition::UnstablePlant),
            count(&slow(0.9), Condition::UnstablePlant),
        ),
        ("a lag", count(&slow(0.0), Condition::Dynamics), count(&copy, Condition::Dynamics)),
        (
            "slow noise",
            count(&slow(0.9), Condition::ColouredNoise),
            count(&slow(0.0), Condition::ColouredNoise),
        ),
        (
            "slow noise",
            count(&slow(0.9), Condition::ColouredNoise),
            count(&copy, Condition::ColouredNoise),
        ),
    ] {
        println!("{what}: found in {with} of {SEEDS} with it, in {without} without");
        assert!(with >= most && without <= few, "{what}: {with} and {without}");
    }
    let mut gaps = copy(1);
    assert!(!found(&gaps, Condition::MissingOutputs));
    gaps.present = Some((0..N).map(|t| t != 100).collect());
    assert!(found(&gaps, Condition::MissingOutputs));
}

#[test]
fn inputs_that_move_together_are_named_and_independent_ones_are_not() {
    let experiment = |left: Vec<f64>, right: Vec<f64>| {
        let recording = Recording {
            outputs: vec![left.clone().into()],
            inputs: vec![left.into(), right.into()],
            states: Vec::new(),
        };
        Experiment::new(
            plants::ts(1.0),
            vec!["left".into(), "right".into()],
            vec!["y".into()],
            vec![recording],
        )
        .unwrap()
    };
    let alone = (0..SEEDS)
        .filter(|&s| {
            moving_together(&experiment(rbs(N, 1.0, s), rbs(N, 1.0, 700 + s)), 35).is_some()
        })
        .count();
    // Every other sample follows, three samples later: a correlation of a half.
    let follows = |s: u64| -> Vec<f64> {
        let (left, own) = (rbs(N, 1.0, s), rbs(N, 1.0, 800 + s));
        plants::delayed(&left, 3)
            .iter()
            .zip(&own)
            .enumerate()
            .map(|(t, (l, o))| if t % 2 == 0 { *l } else { *o })
            .collect()
    };
    let together = (0..SEEDS)
        .filter_map(|s| moving_together(&experiment(rbs(N, 1.0, s), follows(s)), 35))
        .collect::<Vec<_>>();
    assert!(alone == 0 && together.len() == SEEDS as usize, "{alone}, {}", together.len());
    assert!(
        together
            .iter()
            .all(|f| f.condition == Condition::OtherInputs && f.evidence.contains("`right`"))
    );
}
