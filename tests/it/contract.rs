//! The laws that every registered estimator keeps, or says in its registry line that it does not, and why.

use std::borrow::Cow;

use crate::support::plants;
use crate::support::plants::{
    Measured, ROUNDING_S, TS, delayed, estimates, process, rbs, respond, second_order, std_dev,
    sum, times, ts, white,
};
use deadtime::delay::{
    Condition, DelayError, DelayEstimate, Events, Law, METHODS, Method, Outcome, PlantModel,
    Recording, ReferenceExperiment, Scope, Search,
};
use deadtime::model::{Sampled, StateSpace};
use nalgebra::DMatrix;
use rayon::prelude::*;
use serde_json::{Value, json};

const SAMPLES: usize = 600;
const LAWS: [Law; 6] = [Law::Shift, Law::Gain, Law::Sign, Law::Exact, Law::Silence, Law::Window];

/// A short record of what a method answered, complete to the bit.
fn bits(answers: &[DelayEstimate]) -> String {
    format!("{answers:?}")
}

fn run(method: &Method, experiment: &Measured) -> Vec<DelayEstimate> {
    estimated(method, experiment, &Search::default()).unwrap()
}

fn estimated(
    method: &Method,
    experiment: &Measured,
    search: &Search,
) -> Result<Vec<DelayEstimate>, DelayError> {
    estimates(method, method.entry.with(json!({})).unwrap().as_ref(), experiment, search)
}

fn refused(method: &Method, experiment: &Measured) -> DelayError {
    match estimated(method, experiment, &Search::default()) {
        Err(e) => e,
        Ok(answers) => panic!("{} answers {answers:?}", method.entry.name),
    }
}

/// One input, one output with 1 % noise, four samples of dead time.
fn pair() -> Measured {
    let u = rbs(SAMPLES, 1.0, 11);
    let y = second_order(&u, 0.4, [-1.3, 0.42], 4);
    let noise = white(SAMPLES, 0.01 * std_dev(&y), 12);
    Measured::siso(ts(TS), u, sum(&y, &noise))
}

/// Two inputs with dead times of 2 and 9 samples on three measured states.
fn two_inputs() -> (StateSpace<Sampled>, [usize; 2]) {
    let m = DMatrix::from_row_slice;
    let a = m(3, 3, &[0.9, 0.1, 0.0, -0.2, 0.7, 0.05, 0.0, 0.1, 0.5]);
    let b = m(3, 2, &[1.0, 0.2, 0.3, -0.8, 0.1, 0.5]);
    let c = m(1, 3, &[1.0, 0.0, 0.0]);
    (StateSpace::sampled(a, b, c, DMatrix::zeros(1, 2), ts(TS)).unwrap(), [2, 9])
}

fn states(delay: [usize; 2]) -> Measured {
    let plant = two_inputs().0;
    let inputs = vec![rbs(SAMPLES, 1.0, 21), rbs(SAMPLES, 1.0, 22)];
    let (y, x) = respond(&plant, &inputs, &delay);
    let noisy = |(x, seed): (&Vec<f64>, u64)| sum(x, &white(SAMPLES, 0.01 * std_dev(x), seed));
    Measured {
        sample_time: ts(TS),
        inputs: vec!["left".into(), "right".into()],
        outputs: vec!["y".into()],
        recordings: vec![Recording {
            inputs: inputs.into_iter().map(Into::into).collect(),
            outputs: y.into_iter().map(Into::into).collect(),
            states: x.iter().zip(30..).map(noisy).map(Into::into).collect(),
        }],
        model: Some(PlantModel::Sampled(plant)),
        events: Vec::new(),
    }
}

/// A plant without dynamics: the output is the input five samples later (four of dead time and one of the hold), with 1 % noise.
fn copy(u: Vec<f64>) -> Measured {
    let y = times(&delayed(&u, 5), 0.7);
    let noise = white(u.len(), 0.01 * std_dev(&y), 13);
    Measured::siso(ts(TS), u, sum(&y, &noise))
}

/// A continuous plant of so many poles behind a hold, its time constants those of [`pair`]'s poles and a third, `slower` by a factor; four samples of dead time.
fn continuous(u: Vec<f64>, (poles, zero): (usize, bool), slower: f64, noise_seed: u64) -> Measured {
    let lags: Vec<f64> =
        [2.8, 1.96, 1.2][..poles].iter().map(|samples| samples * slower * TS).collect();
    let y = process(&u, &lags, zero.then_some(0.7 * lags[0]), 4.0 * TS, TS);
    let noise = white(u.len(), 0.01 * std_dev(&y), noise_seed);
    Measured::siso(ts(TS), u, sum(&y, &noise))
}

/// Steps from rest and back, long enough for the plant to settle.
fn steps() -> Measured {
    let u: Vec<f64> =
        (0..SAMPLES).map(|t| if (60..330).contains(&t) { 1.0 } else { 0.0 }).collect();
    let y = second_order(&u, 0.4, [-1.3, 0.42], 4);
    let noise = white(SAMPLES, 0.01 * std_dev(&y), 14);
    Measured::siso(ts(TS), u, sum(&y, &noise))
}

/// The experiment that suits a method; its dead time is four samples (but for the two of the states).
fn suitable(method: &Method) -> Measured {
    match method.reference {
        ReferenceExperiment::Plant => pair(),
        ReferenceExperiment::Process { poles, zero } => {
            continuous(rbs(SAMPLES, 1.0, 17), (poles, zero), 1.0, 18)
        }
        ReferenceExperiment::Copy => copy(rbs(SAMPLES, 1.0, 15)),
        ReferenceExperiment::Steps => steps(),
        // Squares of normal numbers: as skewed as an exponential distribution and more.
        ReferenceExperiment::Skewed => {
            copy(white(SAMPLES, 1.0, 16).iter().map(|v| v * v - 1.0).collect())
        }
        ReferenceExperiment::States => states(two_inputs().1),
        ReferenceExperiment::Events => events(),
    }
}

/// Events at random intervals of half a second to a second and a half, seen four sample times later at the second place, to 1 % of a sample time.
fn events() -> Measured {
    let mut time = 5.0;
    let first: Vec<f64> = (rbs(SAMPLES, 0.1, 17).iter().zip(white(SAMPLES, 0.1, 18)))
        .map(|(a, b)| {
            time += 1.0 + (2.0 * a + b).clamp(-0.5, 0.5);
            time
        })
        .collect();
    let second = (first.iter().zip(white(SAMPLES, 0.01 * TS, 19)))
        .map(|(t, jitter)| t + 4.0 * TS + jitter)
        .collect();
    let events = vec![Events { first, second, ..Events::default() }];
    Measured { outputs: vec!["y".into()], ..Measured::of_events(ts(TS), events) }
}

/// The same experiment with its output `k` samples later.
fn later(method: &Method, k: usize) -> Measured {
    match method.scope {
        Scope::Events => change(suitable(method), same, |times| {
            times.iter().map(|t| t + k as f64 * TS).collect()
        }),
        Scope::Pair | Scope::States => change(suitable(method), same, |y| delayed(y, k)),
    }
}

/// What a method is held to, s.
fn tolerance_s(method: &Method) -> f64 {
    method.tolerance * TS
}

fn change(
    mut experiment: Measured,
    input: impl Fn(&[f64]) -> Vec<f64>,
    output: impl Fn(&[f64]) -> Vec<f64>,
) -> Measured {
    for recording in &mut experiment.recordings {
        recording.inputs.iter_mut().for_each(|u| *u = input(u).into());
        recording.outputs.iter_mut().for_each(|y| y.values = output(&y.values).into());
    }
    for events in &mut experiment.events {
        (events.first, events.second) = (input(&events.first), output(&events.second));
    }
    experiment
}

fn same(x: &[f64]) -> Vec<f64> {
    x.to_vec()
}

fn delays_s(answers: &[DelayEstimate], what: &str) -> Vec<f64> {
    let found = |a: &DelayEstimate| {
        assert_eq!(a.outcome, Outcome::Found, "{what}: {a:?}");
        a.delay_s.unwrap()
    };
    answers.iter().map(found).collect()
}

fn assert_close(got: &[f64], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(got.len(), expected.len(), "{what}");
    for (g, e) in got.iter().zip(expected) {
        assert!((g - e).abs() <= tolerance, "{what}: {got:?} instead of {expected:?}");
    }
}

#[test]
fn every_exemption_gives_its_reason_once() {
    for method in METHODS {
        for law in LAWS {
            let reasons: Vec<&str> =
                method.exempt.iter().filter(|(l, _)| *l == law).map(|(_, why)| *why).collect();
            assert!(
                reasons.len() <= 1,
                "{} is exempt from {law:?} more than once",
                method.entry.name
            );
            assert!(
                reasons.iter().all(|why| why.split_whitespace().count() >= 4),
                "{} and {law:?}: {reasons:?}",
                method.entry.name
            );
        }
    }
}

#[test]
fn every_method_finds_the_dead_time_of_its_suitable_experiment() {
    for method in METHODS {
        let expected: Vec<f64> = match method.scope {
            Scope::Pair | Scope::Events => vec![4.0 * TS],
            Scope::States => two_inputs().1.iter().map(|&d| d as f64 * TS).collect(),
        };
        let answers = run(method, &suitable(method));
        let found = delays_s(&answers, method.entry.name);
        for ((a, got), want) in answers.iter().zip(&found).zip(&expected) {
            let [from, to] = a.ci95_s.unwrap();
            // An honest interval misses one record in twenty, as this one may be; twice as wide it misses hardly any. Its rate is tested over many records.
            let more = 1e-9 + 0.5 * (to - from);
            assert!(
                (got - want).abs() <= tolerance_s(method)
                    && from - more <= *want
                    && *want <= to + more,
                "{}: {a:?}",
                method.entry.name
            );
        }
    }
}

#[test]
fn delaying_the_output_moves_the_answer_by_as_much() {
    for method in METHODS.iter().filter(|m| m.promises(Law::Shift)) {
        let before = delays_s(&run(method, &suitable(method)), method.entry.name);
        for k in [1, 3, 12, 25, 30] {
            let after = delays_s(&run(method, &later(method, k)), method.entry.name);
            let expected: Vec<f64> = before.iter().map(|d| d + k as f64 * TS).collect();
            assert_close(
                &after,
                &expected,
                tolerance_s(method),
                &format!("{}, y {k} samples later", method.entry.name),
            );
        }
    }
}

#[test]
fn delaying_the_plants_input_moves_a_state_methods_answer_for_that_input_alone() {
    for method in METHODS.iter().filter(|m| m.scope == Scope::States) {
        let [left, right] = two_inputs().1;
        for (a, b) in
            [(0, 0), (0, right), (left, 0), (left + 5, right), (left, right + 20), (30, 3), (7, 7)]
        {
            let answers = run(method, &states([a, b]));
            assert_eq!(answers.len(), 2);
            let found = delays_s(&answers, method.entry.name);
            assert_close(
                &found,
                &[a as f64 * TS, b as f64 * TS],
                tolerance_s(method),
                &format!("{} with {a} and {b}", method.entry.name),
            );
        }
    }
}

#[test]
fn a_state_method_is_exact_on_noise_free_states() {
    for method in METHODS.iter().filter(|m| m.scope == Scope::States) {
        let clean = |delay| {
            let (plant, _) = two_inputs();
            let mut experiment = states(delay);
            let recording = &mut experiment.recordings[0];
            let inputs: Vec<Vec<f64>> = recording.inputs.iter().map(|u| u.to_vec()).collect();
            recording.states =
                respond(&plant, &inputs, &delay).1.into_iter().map(Into::into).collect();
            delays_s(&run(method, &experiment), method.entry.name)
        };
        for (a, b) in [(2, 9), (0, 1), (34, 0), (17, 33)] {
            assert_close(
                &clean([a, b]),
                &[a as f64 * TS, b as f64 * TS],
                ROUNDING_S,
                &format!("{a}, {b}"),
            );
        }
    }
}

#[test]
fn a_gain_on_input_or_output_changes_nothing() {
    for method in METHODS.iter().filter(|m| m.promises(Law::Gain)) {
        let plain = run(method, &suitable(method));
        for (on_u, on_y) in [(3.7, 1.0), (1.0, 0.011), (1e-6, 1e6), (1e7, 1e-9)] {
            let scaled =
                run(method, &change(suitable(method), |u| times(u, on_u), |y| times(y, on_y)));
            let what = format!("{} with u × {on_u}, y × {on_y}", method.entry.name);
            assert_close(
                &delays_s(&scaled, &what),
                &delays_s(&plain, &what),
                ROUNDING_S.max(1e-3 * tolerance_s(method)),
                &what,
            );
            for (a, b) in scaled.iter().zip(&plain) {
                let relative = a.std_s.unwrap() / b.std_s.unwrap() - 1.0;
                assert!(relative.abs() < 1e-6, "{what}: the uncertainty too: {a:?} {b:?}");
            }
        }
    }
}

#[test]
fn a_power_of_two_as_gain_changes_no_bit() {
    for method in METHODS.iter().filter(|m| m.promises(Law::Gain)) {
        let plain = run(method, &suitable(method));
        let scaled = run(
            method,
            &change(
                suitable(method),
                |u| times(u, 2.0_f64.powi(-20)),
                |y| times(y, 2.0_f64.powi(13)),
            ),
        );
        let delays = |answers: &[DelayEstimate]| {
            answers.iter().map(|a| a.delay_s.unwrap().to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(delays(&plain), delays(&scaled), "{}", method.entry.name);
    }
}

#[test]
fn the_sign_of_input_or_output_changes_nothing() {
    for method in METHODS.iter().filter(|m| m.promises(Law::Sign)) {
        let plain = run(method, &suitable(method));
        for (on_u, on_y) in [(-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
            let turned =
                run(method, &change(suitable(method), |u| times(u, on_u), |y| times(y, on_y)));
            let what = format!("{} with u × {on_u}, y × {on_y}", method.entry.name);
            assert_close(
                &delays_s(&turned, &what),
                &delays_s(&plain, &what),
                ROUNDING_S.max(1e-3 * tolerance_s(method)),
                &what,
            );
        }
    }
}

#[test]
fn what_state_least_squares_is_exempt_from_it_indeed_does_not_do() {
    let method = METHODS.iter().find(|m| m.entry.name == "state_least_squares").unwrap();
    let plain = run(method, &suitable(method));
    let later = run(method, &change(suitable(method), same, |y| delayed(y, 3)));
    assert_eq!(bits(&plain), bits(&later), "it does not look at outputs");
    for gain in [-1.0, 4.0] {
        let scaled = run(method, &change(suitable(method), |u| times(u, gain), same));
        assert!(
            scaled.iter().all(|a| a.outcome != Outcome::Found),
            "u × {gain}: A and B no longer describe the data: {scaled:?}"
        );
    }
}

#[test]
fn the_same_samples_at_another_sample_time_scale_the_answer() {
    for method in METHODS {
        let plain = run(method, &suitable(method));
        for seconds in [1e-6, 0.004, 1.0, 86_400.0] {
            let mut experiment = suitable(method);
            experiment.sample_time = ts(seconds);
            // Events are in seconds: on another clock they are at other times.
            for events in &mut experiment.events {
                events.first.iter_mut().chain(&mut events.second).for_each(|t| *t *= seconds / TS);
            }
            let scaled = run(method, &experiment);
            for (a, b) in scaled.iter().zip(&plain) {
                let what = format!("{} every {seconds} s", method.entry.name);
                let per_sample = |v: Option<f64>, ts_s: f64| v.unwrap() / ts_s;
                for (x, y) in [(a.delay_s, b.delay_s), (a.std_s, b.std_s)] {
                    assert!(
                        (per_sample(x, seconds) - per_sample(y, TS)).abs() < 1e-9,
                        "{what}: {a:?} {b:?}"
                    );
                }
                let (x, y) = (a.ci95_s.unwrap(), b.ci95_s.unwrap());
                assert_close(&x.map(|v| v / seconds), &y.map(|v| v / TS), 1e-9, &what);
            }
        }
    }
}

#[test]
fn every_method_answers_to_the_bit_alike_twice_and_on_any_number_of_threads() {
    for method in METHODS {
        let experiment = suitable(method);
        let first = bits(&run(method, &experiment));
        assert_eq!(first, bits(&run(method, &experiment)), "{} twice", method.entry.name);
        for threads in [1, 2, 3, 8] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert_eq!(
                first,
                pool.install(|| bits(&run(method, &experiment))),
                "{} on {threads} threads",
                method.entry.name
            );
        }
    }
}

#[test]
fn an_estimator_keeps_nothing_from_one_experiment_to_the_next() {
    for method in METHODS {
        let estimator = method.entry.with(json!({})).unwrap();
        let search = Search::default();
        let answers = |of: &Measured| estimates(method, estimator.as_ref(), of, &search);
        let fresh = bits(&answers(&suitable(method)).unwrap());
        let other = change(suitable(method), |u| times(u, 0.3), |y| delayed(y, 2));
        drop(answers(&other));
        assert_eq!(fresh, bits(&answers(&suitable(method)).unwrap()), "{}", method.entry.name);
    }
}

#[test]
fn a_record_that_is_too_short_is_refused_with_the_length_it_needs() {
    for method in METHODS {
        // A record that is cut where its input still rests is refused as constant, which is another matter: it begins shortly before the first motion.
        let first = suitable(method)
            .recordings
            .first()
            .and_then(|r| r.inputs.first().cloned())
            .map_or(0, |u| u.iter().position(|v| *v != u[0]).unwrap_or(0));
        let cut = |samples: usize| {
            let mut experiment = suitable(method);
            let part = |c: &mut Cow<'static, [f64]>| {
                *c = c.iter().skip(first.saturating_sub(4)).take(samples).copied().collect()
            };
            for recording in &mut experiment.recordings {
                recording.inputs.iter_mut().chain(&mut recording.states).for_each(part);
                recording.outputs.iter_mut().for_each(|c| part(&mut c.values));
            }
            experiment.events.iter_mut().for_each(|e| {
                [&mut e.first, &mut e.second].into_iter().for_each(|t| t.truncate(samples))
            });
            experiment
        };
        let DelayError::TooShort { method: name, needed, got, .. } = refused(method, &cut(8))
        else {
            panic!("{}: another error than TooShort", method.entry.name)
        };
        assert_eq!((name, got), (method.entry.name, 8));
        // The length it names is the length it needs: one sample less is refused, as many are taken.
        let DelayError::TooShort { needed: again, got, .. } = refused(method, &cut(needed - 1))
        else {
            panic!("{}: another error than TooShort", method.entry.name)
        };
        assert_eq!((again, got), (needed, needed - 1), "{}", method.entry.name);
        let taken = estimated(method, &cut(needed), &Search::default());
        assert!(taken.is_ok(), "{} refuses {needed} samples: {taken:?}", method.entry.name);
    }
}

#[test]
fn an_empty_record_or_none_at_all_is_refused() {
    for method in METHODS {
        let mut experiment = suitable(method);
        experiment.recordings.clear();
        experiment.events.clear();
        assert!(
            matches!(refused(method, &experiment), DelayError::Count { .. }),
            "{}",
            method.entry.name
        );
        let empty = change(suitable(method), |_| Vec::new(), |_| Vec::new());
        let mut empty_too = empty;
        empty_too
            .recordings
            .iter_mut()
            .for_each(|r| r.states.iter_mut().for_each(|x| x.to_mut().clear()));
        let refusal = refused(method, &empty_too);
        assert!(
            matches!(
                refusal,
                DelayError::Count { .. }
                    | DelayError::Constant { .. }
                    | DelayError::TooShort { .. }
            ),
            "{}: {refusal:?}",
            method.entry.name
        );
    }
}

#[test]
fn a_constant_channel_is_refused_by_its_name() {
    for method in METHODS {
        let still = |x: &[f64]| vec![0.25; x.len()];
        let flat_input = refused(method, &change(suitable(method), still, same));
        let input = suitable(method).inputs[0].clone();
        assert_eq!(
            flat_input,
            DelayError::Constant { role: "input", channel: input, value: 0.25 },
            "{}",
            method.entry.name
        );
        let flat_output = refused(method, &change(suitable(method), same, still));
        assert_eq!(
            flat_output,
            DelayError::Constant { role: "output", channel: "y".into(), value: 0.25 },
            "{}",
            method.entry.name
        );
    }
}

#[test]
fn a_sample_that_is_no_number_is_refused_with_its_place() {
    let spoil = |x: &[f64], with: f64| {
        let mut x = x.to_vec();
        x[17] = with;
        x
    };
    for method in METHODS {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let place = |error: DelayError, role: &str| match error {
                DelayError::NotFinite { role: r, sample: 17, value, .. } => {
                    assert_eq!(
                        (r, value.to_bits()),
                        (role, bad.to_bits()),
                        "{}",
                        method.entry.name
                    );
                }
                other => panic!("{}: {other:?}", method.entry.name),
            };
            place(refused(method, &change(suitable(method), |u| spoil(u, bad), same)), "input");
            place(refused(method, &change(suitable(method), same, |y| spoil(y, bad))), "output");
            if method.scope == Scope::States {
                let mut experiment = suitable(method);
                let spoiled = spoil(&experiment.recordings[0].states[1], bad);
                experiment.recordings[0].states[1] = spoiled.into();
                place(refused(method, &experiment), "state");
            }
        }
    }
}

#[test]
fn channels_of_unequal_length_are_refused() {
    // One place may see fewer events than the other.
    for method in METHODS.iter().filter(|m| m.scope != Scope::Events) {
        let longer = change(suitable(method), same, |y| [y, &[0.0]].concat());
        assert!(
            matches!(refused(method, &longer), DelayError::Count { .. }),
            "{}",
            method.entry.name
        );
    }
}

#[test]
fn what_stands_at_a_missing_output_sample_is_not_looked_at() {
    for method in METHODS.iter().filter(|m| m.scope == Scope::Pair) {
        let with = |filler: f64| {
            let mut experiment = suitable(method);
            let series = &mut experiment.recordings[0].outputs[0];
            let present: Vec<bool> = (0..SAMPLES).map(|t| t % 29 != 3).collect();
            for (value, there) in series.values.to_mut().iter_mut().zip(&present) {
                *value = if *there { *value } else { filler };
            }
            series.present = Some(present.into());
            run(method, &experiment)
        };
        assert_eq!(bits(&with(0.0)), bits(&with(1e12)), "{}", method.entry.name);
        assert_eq!(bits(&with(0.0)), bits(&with(f64::NAN)), "{}", method.entry.name);
        if method.withstands(Condition::MissingOutputs) {
            assert_close(
                &delays_s(&with(0.0), method.entry.name),
                &[4.0 * TS],
                tolerance_s(method),
                method.entry.name,
            );
        } else {
            let estimate = &with(0.0)[0];
            assert_eq!(
                estimate.outcome,
                Outcome::NotApplicable,
                "{}: {estimate:?}",
                method.entry.name
            );
            assert!(
                estimate.note.as_ref().is_some_and(|n| n.contains("missing")),
                "{}: {estimate:?}",
                method.entry.name
            );
        }
    }
}

#[test]
fn an_answer_has_a_delay_when_its_outcome_says_so_and_its_interval_holds_it() {
    let nothing = Measured::siso(ts(TS), rbs(SAMPLES, 1.0, 1), white(SAMPLES, 1.0, 2));
    let mut step = vec![0.0; SAMPLES];
    step[SAMPLES - 3..].fill(1.0);
    let poor = Measured::siso(ts(TS), step.clone(), second_order(&step, 0.4, [-1.3, 0.42], 1));
    let far = change(pair(), same, |y| delayed(y, 31));
    for method in METHODS {
        let experiments = match method.scope {
            Scope::Pair => vec![suitable(method), nothing.clone(), poor.clone(), far.clone()],
            Scope::Events => vec![suitable(method)],
            Scope::States => vec![
                suitable(method),
                states([35, 0]),
                change(suitable(method), |u| times(u, 0.0001), same),
            ],
        };
        for experiment in experiments {
            for a in run(method, &experiment) {
                let (e, what) = (&a, format!("{}: {a:?}", method.entry.name));
                assert_eq!(e.delay_s.is_some(), e.outcome.has_delay(), "{what}");
                assert_eq!(e.std_s.is_some(), e.outcome.has_delay(), "{what}");
                assert_eq!(e.ci95_s.is_some(), e.outcome.has_delay(), "{what}");
                assert_eq!(e.raw_delay_s.is_some(), e.outcome.has_delay(), "{what}");
                if let (Some(delay), Some(std), Some([from, to])) = (e.delay_s, e.std_s, e.ci95_s) {
                    assert!(
                        delay >= 0.0 && std > 0.0 && from <= delay && delay <= to && from >= 0.0,
                        "{what}"
                    );
                } else {
                    assert!(
                        e.note.as_ref().is_some_and(|n| !n.is_empty()),
                        "no delay and no reason: {what}"
                    );
                }
            }
        }
    }
}

fn noise(records: u64) {
    for method in METHODS.iter().filter(|m| m.scope == Scope::Pair && m.promises(Law::Silence)) {
        let fooled = (0..records).into_par_iter().filter(|seed| {
            let nothing =
                Measured::siso(ts(TS), rbs(400, 1.0, 2 * seed), white(400, 1.0, 2 * seed + 1));
            run(method, &nothing)[0].outcome == Outcome::Found
        });
        let fooled = fooled.count();
        println!("{}: a delay in noise alone in {fooled} of {records} records", method.entry.name);
        // Of methods that are fooled once in a hundred, one in forty fails with 25 records; of those fooled once in ten, seven in ten.
        assert!(
            fooled <= 1,
            "{} finds a delay in noise alone in {fooled} of {records} records",
            method.entry.name
        );
    }
}

#[test]
fn noise_alone_is_not_taken_for_a_response() {
    noise(5);
}

#[test]
#[ignore = "nightly: a rate over draws"]
fn noise_alone_is_not_taken_for_a_response_in_25_records() {
    noise(25);
}

fn slow_noise(records: u64) {
    for band in [[0.0, 1.0], [0.0, 0.1]] {
        for method in METHODS.iter().filter(|m| m.scope == Scope::Pair && m.promises(Law::Silence))
        {
            let name = method.entry.name;
            let fooled = (0..records).into_par_iter().filter(|seed| {
                let u = deadtime::signal::excitation::Rbs { band, ..Default::default() };
                let u =
                    deadtime::signal::Excitation::generate(&u, 400, &mut plants::rng(3000 + seed))
                        .unwrap();
                let mut y = white(400, 1.0, 4000 + seed);
                for t in 1..400 {
                    y[t] += 0.9 * y[t - 1];
                }
                run(method, &Measured::siso(ts(TS), u, y))[0].outcome == Outcome::Found
            });
            let fooled = fooled.count();
            println!(
                "{name}, input band {band:?}: a delay in slow noise alone in {fooled} of {records} records"
            );
            assert!(fooled <= 1, "{name}, input band {band:?}: {fooled} of {records} records");
        }
    }
}

#[test]
#[ignore = "nightly: a rate over draws"]
fn slow_noise_alone_is_seldom_taken_for_a_response() {
    slow_noise(4);
}

#[test]
#[ignore = "nightly: a rate over draws"]
fn slow_noise_alone_is_seldom_taken_for_a_response_in_twenty_records() {
    slow_noise(20);
}

#[test]
fn beyond_the_window_the_answer_is_at_the_edge_and_the_window_doubles_once() {
    for method in METHODS
        .iter()
        .filter(|m| m.scope == Scope::Pair && m.promises(Law::Shift) && m.promises(Law::Window))
    {
        let search = Search { max_delay: 12, ..Search::default() };
        let at = |k: usize| {
            let later = change(suitable(method), same, |y| delayed(y, k));
            estimated(method, &later, &search).unwrap().remove(0)
        };
        // 4 + 7 samples and one of the hold: the longest delay of the window, found in the doubled one.
        let found = at(7);
        assert_eq!(found.outcome, Outcome::Found, "{}", method.entry.name);
        assert_close(
            &[found.delay_s.unwrap()],
            &[11.0 * TS],
            tolerance_s(method),
            method.entry.name,
        );
        assert!(at(60).outcome != Outcome::Found, "{}: {:?}", method.entry.name, at(60));
    }
}

/// Four samples of dead time under one complication; the seed draws input and noise.
fn complicated(condition: Condition, method: &Method, seed: u64) -> Option<Measured> {
    let n = 800;
    let noise = white(n, 1.0, 7000 + seed);
    let u = rbs(n, 1.0, 8000 + seed);
    let loops = |a: [f64; 2], b: f64, k: [f64; 2], level: f64| {
        // y(t) = b·u(t − 5) − a₁y(t − 1) − a₂y(t − 2) + e, u = dither − k₀y(t) − k₁y(t − 1).
        let (mut y, mut v) = (vec![0.0; n], vec![0.0; n]);
        for t in 0..n {
            let past = |x: &[f64], lag: usize| if t >= lag { x[t - lag] } else { 0.0 };
            y[t] = b * past(&v, 5) - a[0] * past(&y, 1) - a[1] * past(&y, 2) + level * noise[t];
            v[t] = u[t] - k[0] * y[t] - k[1] * past(&y, 1);
        }
        Measured::siso(ts(TS), v, y)
    };
    Some(match condition {
        // z = 1.02 and 0.5, held by feedback: the poles of the loop are at most 0.93.
        Condition::UnstablePlant => loops([-1.52, 0.51], 0.05, [0.9, -0.3], 0.05),
        // A stable plant of time constant 7 samples whose noise the controller feeds back.
        Condition::Feedback => loops([-0.85, 0.0], 0.1, [1.2, -0.6], 0.1),
        Condition::ColouredNoise => {
            let plain = suitable(method);
            let y = plain.recordings[0].outputs[0].values.to_vec();
            let mut slow = white(y.len(), 0.03 * std_dev(&y), 9000 + seed);
            for t in 1..slow.len() {
                slow[t] += 0.9 * slow[t - 1];
            }
            change(plain, same, |y| sum(y, &slow))
        }
        // A fraction of a sample is seen: the sampled plant below is no continuous one with a whole delay.
        Condition::Dynamics
            if let ReferenceExperiment::Process { poles, zero } = method.reference =>
        {
            continuous(u, (poles, zero), 2.5, 7000 + seed)
        }
        Condition::Dynamics => {
            let y = second_order(&u, 0.1, [-1.7, 0.72], 4);
            let y = sum(&y, &times(&noise, 0.01 * std_dev(&y)));
            Measured::siso(ts(TS), u, y)
        }
        // The methods that claim it have copies as their reference.
        Condition::TwoSensors => change(suitable(method), same, |y| {
            sum(y, &white(y.len(), 0.05 * std_dev(y), 9500 + seed))
        }),
        // Have tests of their own.
        Condition::MissingOutputs
        | Condition::OtherInputs
        | Condition::InverseResponse
        | Condition::Integrating => {
            return None;
        }
    })
}

fn withstands(records: u64) {
    for method in METHODS.iter().filter(|m| m.scope == Scope::Pair) {
        for &condition in method.withstands {
            let held: Vec<bool> = (0..records)
                .into_par_iter()
                .filter_map(|seed| {
                    let experiment = complicated(condition, method, seed)?;
                    // The controllers answer within the sample, the plants do not.
                    let in_loop =
                        matches!(condition, Condition::UnstablePlant | Condition::Feedback);
                    let search = Search { min_delay: usize::from(in_loop), ..Search::default() };
                    let estimate = estimated(method, &experiment, &search).unwrap().remove(0);
                    let [from, to] = estimate.ci95_s.unwrap_or([f64::NAN; 2]);
                    Some(
                        estimate.outcome == Outcome::Found
                            && from <= 4.0 * TS + ROUNDING_S
                            && 4.0 * TS <= to + ROUNDING_S,
                    )
                })
                .collect();
            let count = held.iter().filter(|h| **h).count();
            println!(
                "{} under {condition:?}: {count} of {} intervals hold the truth",
                method.entry.name,
                held.len()
            );
            // With 95 % each, 8 or fewer of 12 happen once in 450 draws, one or none of four once in 2000.
            let least = if records == 12 { 9 } else { 2 };
            assert!(
                held.is_empty() || count >= least,
                "{} under {condition:?}: {count} of {}",
                method.entry.name,
                held.len()
            );
        }
    }
}

#[test]
#[ignore = "nightly: coverage over draws"]
fn what_a_method_claims_to_withstand_leaves_the_truth_inside_its_interval_in_twelve_records() {
    withstands(12);
}

#[test]
fn options_survive_the_way_through_json() {
    for method in METHODS {
        let defaults = (method.entry.defaults)();
        let object =
            defaults.as_object().unwrap_or_else(|| panic!("{}: {defaults}", method.entry.name));
        let experiment = suitable(method);
        let plain = bits(&run(method, &experiment));
        let text = serde_json::to_string(&defaults).unwrap();
        let read: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(read, defaults);
        let built = method.entry.with(read).unwrap();
        assert_eq!(
            plain,
            bits(&estimates(method, built.as_ref(), &experiment, &Search::default()).unwrap()),
            "{}",
            method.entry.name
        );
        for (key, value) in object {
            let one = method.entry.with(json!({ key: value })).unwrap();
            assert_eq!(
                plain,
                bits(&estimates(method, one.as_ref(), &experiment, &Search::default()).unwrap()),
                "{} {key}",
                method.entry.name
            );
            let wrong = method.entry.with(json!({ key: { "no": "such" } })).err();
            assert!(
                wrong.is_some_and(|e| e.to_string().contains(method.entry.name)),
                "{} takes nonsense for {key}",
                method.entry.name
            );
        }
        let unknown =
            method.entry.with(json!({ "no_such_option": 1 })).err().map(|e| e.to_string());
        let unknown = unknown.unwrap_or_else(|| {
            panic!("{} takes an option that it does not have", method.entry.name)
        });
        assert!(
            unknown.contains("no_such_option")
                && object.keys().all(|k| unknown.contains(k.as_str())),
            "{unknown}"
        );
    }
}

#[test]
fn option_structs_survive_the_way_through_json_with_other_values() {
    use deadtime::delay::{Area1, Area2, Area3, Arxdap, Firdap, Fischer, Lagudap, Moment, Oedap};
    use deadtime::delay::{
        Armaxstruc, Arxstruc, Center, Cost, Cusum, CusumStep, Delayest, Elnaggar, Impulseest,
        Initial, Ivstruc, Met1struc, OePosterior, Oestruc, Others, P3dz, Poles, Prewindow, Process,
        Records, SamplingZero, Selection, StateLeastSquares, Step, Threshold, TwoStep,
    };
    fn there_and_back<
        T: serde::Serialize + serde::de::DeserializeOwned + PartialEq + std::fmt::Debug,
    >(
        options: T,
    ) {
        let text = serde_json::to_string(&options).unwrap();
        assert_eq!(serde_json::from_str::<T>(&text).unwrap(), options, "{text}");
    }
    there_and_back(Arxstruc { na: 3, nb: 2, others: Others::Regressors, max_samples: 99 });
    there_and_back(Armaxstruc { na: 1, nb: 2, nc: 4, max_samples: 17 });
    there_and_back(Met1struc { order: 4, past: 9, na: 3, nb: 2, max_samples: 999 });
    there_and_back(Ivstruc { nb: 2, nf: 3, noise: 1, max_samples: 17 });
    there_and_back(Delayest { na: 1, nb: 3 });
    for cost in [Cost::Products, Cost::Regression] {
        there_and_back(Elnaggar { cost });
    }
    for center in [Center::Mean, Center::Median, Center::Mode] {
        there_and_back(OePosterior {
            nb: 2,
            nf: 1,
            initial: Initial::Estimated,
            center,
            max_samples: 17,
        });
    }
    there_and_back(SamplingZero { initial: Initial::Estimated, max_samples: 17 });
    there_and_back(TwoStep { max_turns: 3, max_samples: 17 });
    there_and_back(Firdap { taps: 40 });
    there_and_back(Arxdap { na: 3, nb: 2 });
    there_and_back(Oedap { nb: 2, nf: 4, max_samples: 17 });
    there_and_back(Lagudap { order: Some(12), pole: Some(0.4), max_samples: 17 });
    there_and_back(Fischer { order: 20 });
    there_and_back(Area1 { held: 90 });
    there_and_back(Area2 { taps: 40 });
    there_and_back(Area3 { taps: 40 });
    there_and_back(Moment { taps: 40 });
    there_and_back(Oestruc {
        nb: 2,
        nf: 4,
        initial: Initial::Estimated,
        max_samples: 17,
        always_answers: true,
    });
    let threshold = Threshold {
        taps: 9,
        h_std: 3.5,
        family_wise: Some(0.05),
        records: Records::Averaged,
        prewindow: Prewindow::Rest,
    };
    there_and_back(threshold);
    there_and_back(Step(threshold));
    for prewindow in [Prewindow::None, Prewindow::Rest, Prewindow::Auto] {
        let cusum = Cusum {
            taps: 9,
            drift: 0.5,
            level: Some(7.0),
            false_alarm: 0.1,
            records: Records::Averaged,
            prewindow,
        };
        there_and_back(cusum);
        there_and_back(CusumStep(cusum));
    }
    there_and_back(Impulseest { taps: 9, false_alarm: 0.2 });
    let start = Some(0.25);
    there_and_back(P3dz(Process {
        poles: Poles::Any,
        initial: Initial::Estimated,
        initial_delay_s: start,
        max_samples: 17,
        others: Others::Apart,
    }));
    for selection in [Selection::Largest, Selection::ProductSum, Selection::LargestProduct] {
        there_and_back(StateLeastSquares { selection, ..StateLeastSquares::default() });
    }
}

#[test]
fn every_method_is_named_once_and_summed_up_in_one_line() {
    let mut names: Vec<&str> = METHODS.iter().map(|m| m.entry.name).collect();
    for method in METHODS {
        let (name, summary) = (method.entry.name, method.entry.summary);
        assert!(
            !name.is_empty()
                && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_'),
            "{name}"
        );
        assert!(name != "all", "`all` means every method");
        assert!(
            summary.split_whitespace().count() >= 5
                && !summary.contains('\n')
                && !summary.ends_with('.'),
            "{name}: {summary}"
        );
    }
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), METHODS.len());
}

#[test]
fn outcomes_are_written_as_the_file_format_names_them() {
    let format = [
        (Outcome::Found, "found"),
        (Outcome::AtEdge, "at_edge"),
        (Outcome::NotVisible, "not_visible"),
        (Outcome::NotRichEnough, "not_rich_enough"),
        (Outcome::Singular, "singular"),
        (Outcome::NotConverged, "not_converged"),
        (Outcome::Flat, "flat"),
        (Outcome::NotApplicable, "not_applicable"),
    ];
    for (outcome, name) in format {
        assert_eq!(serde_json::to_value(outcome).unwrap(), json!(name));
        assert_eq!(serde_json::from_value::<Outcome>(json!(name)).unwrap(), outcome);
        assert_eq!(outcome.name(), name);
        assert_eq!(outcome.has_delay(), ["found", "at_edge"].contains(&name), "{name}");
    }
}
