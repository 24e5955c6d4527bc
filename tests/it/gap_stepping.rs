//! `deadtime gap` on machines of which a gain or a parameter steps while the log is taken. The machines are put together of two plain simulations here, not by
//! the effects themselves.

use deadtime::diagnose::{Diagnosed, GapOptions, diagnose};
use deadtime::log::Log;
use deadtime::model::ModelDocument;
use deadtime::simulate::{Commands, Plan, System};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::support::coverage::Coverage;

use super::gap_hard::{as_log, document, noisy, servo};

const TS: f64 = 0.02;
/// The sample from which on the machine is another one.
const AT: usize = 420;

fn model() -> ModelDocument {
    document(&servo(", initial_std = 0.02", ""))
}

/// Commands that jump between levels.
fn sent(samples: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let mut level = 0.0;
    let mut next = |k: usize| {
        if k.is_multiple_of(14) {
            level = rng.random_range(-1.0..1.0);
        }
        level
    };
    (0..samples).map(&mut next).collect()
}

/// What the machine hears at a sample of what was sent.
type Hears<'a> = &'a dyn Fn(usize, f64) -> f64;

/// What the machine hears, and what it is, before and behind a sample.
struct Machine<'a> {
    hears: Hears<'a>,
    is: &'a [ModelDocument; 2],
    at: usize,
}

/// Two runs, the second from the state that the first ends in.
fn logged(machine: &Machine<'_>, samples: usize, seed: u64) -> Log {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let sent = sent(samples, &mut rng);
    let heard: Vec<f64> = sent.iter().enumerate().map(|(k, u)| (machine.hears)(k, *u)).collect();
    let at = machine.at.min(samples);
    let mut state = vec![0.0, 0.0];
    let mut outputs: Vec<Vec<f64>> = vec![Vec::new(); 2];
    for (model, rows) in machine.is.iter().zip([0..at, at..samples]) {
        let system = System::new(model, |_| Ok(0.0)).unwrap();
        // One sample more: the state there begins the next run.
        let last = (rows.end + 1).min(samples);
        let time_s: Vec<f64> = (rows.start..last).map(|k| TS * (k - rows.start) as f64).collect();
        if time_s.is_empty() {
            continue;
        }
        let run = system
            .simulate(
                &Plan::new(&system),
                Commands { time_s: &time_s, inputs: &[heard[rows.start..last].to_vec()] },
                &state,
                None,
            )
            .unwrap();
        for (to, y) in outputs.iter_mut().zip(run.y.column_iter()) {
            to.extend(y.iter().take(rows.len()));
        }
        state = run.x.row(run.x.nrows() - 1).iter().copied().collect();
    }
    let time_s: Vec<f64> = (0..samples).map(|k| TS * k as f64).collect();
    let outputs: Vec<Vec<f64>> = outputs.into_iter().map(|y| noisy(y, &mut rng)).collect();
    as_log(&format!("log{seed}.csv"), time_s, &sent, &outputs)
}

fn diagnosed(machine: &Machine<'_>, seed: u64) -> Diagnosed {
    let logs = [logged(machine, 1000, seed), logged(machine, 900, seed + 1)];
    let held = logged(machine, 900, seed + 2);
    diagnose(&model(), &logs, &[held], &GapOptions::default(), &|_| ()).unwrap()
}

fn keys(found: &Diagnosed) -> Vec<String> {
    found.diagnosis.cause.effects.iter().map(|e| format!("{}:{}", e.effect, e.channel)).collect()
}

/// The parameters by name are near the truth.
fn holds(found: &Diagnosed, truths: &[(&str, f64, f64)], coverage: &mut Coverage) {
    for (name, truth, near) in truths {
        let p =
            found.diagnosis.cause.effects[0].parameters.iter().find(|p| p.name == *name).unwrap();
        assert!((p.value.unwrap() - truth).abs() < *near, "{p:?} is not {truth}");
        coverage.parameter(&keys(found)[0], p, *truth);
    }
}

fn same() -> [ModelDocument; 2] {
    [model(), model()]
}

fn gain_steps(cases: &[(u64, f64, f64)]) {
    let mut coverage = Coverage::default();
    for &(seed, before, later) in cases {
        let hears = move |k: usize, u: f64| if k < AT { before * u } else { later * u };
        let found = diagnosed(&Machine { hears: &hears, is: &same(), at: AT }, seed);
        assert_eq!(keys(&found), ["gain_jump:u"], "{:?}", found.diagnosis.cause.ranking);
        holds(
            &found,
            &[("gain", before, 0.03), ("later", later, 0.03), ("time", TS * AT as f64, 0.3)],
            &mut coverage,
        );
    }
    coverage.is_honest(3 * cases.len());
}

#[test]
fn a_gain_that_steps_is_named_with_both_gains_and_its_time() {
    gain_steps(&[(900, 1.0, 0.6)]);
}

#[test]
#[ignore = "nightly: coverage over sizes"]
fn a_gain_that_steps_is_named_with_both_gains_and_its_time_of_three_sizes() {
    gain_steps(&[(900, 1.0, 0.6), (910, 0.8, 1.3), (920, 1.0, -0.5)]);
}

/// The damping of the servo doubles: no gain of the input does that.
fn parameter_steps(cases: &[(u64, &str, &str)]) {
    let damped = |damping: &str| {
        document(
            &servo(", initial_std = 0.02", "")
                .replace("value = 2.4", &format!("value = {damping}")),
        )
    };
    let mut coverage = Coverage::default();
    for &(seed, before, later) in cases {
        let found = diagnosed(
            &Machine { hears: &|_, u| u, is: &[damped(before), damped(later)], at: AT },
            seed,
        );
        assert_eq!(keys(&found), ["parameter_jump:damping"], "{:?}", found.diagnosis.cause.ranking);
        let [before, later]: [f64; 2] = [before, later].map(|v| v.parse().unwrap());
        holds(
            &found,
            &[("value", before, 0.1), ("later", later, 0.2), ("time", TS * AT as f64, 0.3)],
            &mut coverage,
        );
    }
    coverage.is_honest(3 * cases.len());
}

#[test]
fn a_parameter_that_steps_is_named_with_both_values_and_its_time() {
    parameter_steps(&[(930, "2.4", "5.0")]);
}

#[test]
#[ignore = "nightly: coverage over sizes"]
fn a_parameter_that_steps_is_named_with_both_values_and_its_time_of_two_sizes() {
    parameter_steps(&[(930, "2.4", "5.0"), (934, "2.0", "1.4")]);
}

/// What stands still, fades or depends on the size of a command is not called a step.
fn no_step(count: usize) {
    let machines: [(&str, Hears<'_>); 3] = [
        ("gain_fade:u", &|k, u| (1.0 - 0.03 * TS * k as f64) * u),
        ("input_gain:u", &|_, u| 0.7 * u),
        ("saturation:u", &|_, u| u.clamp(-0.5, 0.6)),
    ];
    for (at, (named, hears)) in machines.into_iter().enumerate().take(count) {
        let found =
            diagnosed(&Machine { hears, is: &same(), at: usize::MAX }, 940 + 10 * at as u64);
        assert_eq!(keys(&found), [named]);
    }
}

#[test]
fn what_does_not_step_is_not_called_a_step() {
    no_step(1);
}

#[test]
#[ignore = "nightly: three machines"]
fn what_does_not_step_is_not_called_a_step_of_three_kinds() {
    no_step(3);
}

/// A step that comes in one of two logs is no step at the same time in both: where it is found, the held-out log must not be worse.
#[test]
#[ignore = "nightly: one more diagnosis"]
fn a_step_in_one_log_alone_does_no_harm() {
    let hears = |k: usize, u: f64| if k < AT { u } else { 0.5 * u };
    let stepping = Machine { hears: &hears, is: &same(), at: AT };
    let steady = Machine { hears: &|_, u| u, is: &same(), at: usize::MAX };
    let logs = [logged(&stepping, 1000, 980), logged(&steady, 900, 981)];
    let found =
        diagnose(&model(), &logs, &[logged(&steady, 900, 982)], &GapOptions::default(), &|_| ())
            .unwrap();
    let shrink = &found.diagnosis.shrink;
    assert!(
        shrink.after.zip(shrink.before).is_none_or(|(after, before)| after <= 1.02 * before),
        "{shrink:?}"
    );
}
