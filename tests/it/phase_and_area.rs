//! Intervals of the all-pass, Laguerre, area and moment methods: how often they hold the truth, fractions of a sample and several recordings included.

use crate::support::plants::{Measured, answer, rbs, second_order, std_dev, sum, ts, white};
use deadtime::delay::{
    Experiment, Method, Outcome, Recording, ReferenceExperiment, Search, method,
};
use rayon::prelude::*;

const PHASE: [&str; 4] = ["oedap", "arxdap", "firdap", "lagudap"];
const ALL: [&str; 9] =
    ["oedap", "arxdap", "firdap", "lagudap", "fischer", "area1", "area2", "area3", "moment"];

fn input(method: &Method, samples: usize, seed: u64) -> Vec<f64> {
    match method.reference {
        ReferenceExperiment::Steps => (0..samples)
            .map(|t| if t > samples / 10 && t < samples / 2 { 1.0 } else { 0.0 })
            .collect(),
        _ => rbs(samples, 1.0, seed),
    }
}

/// (answers, intervals that hold the truth) of 100 records: one lag or two equal ones of 1.4 to 9.5 samples, 0 to 19 samples of delay.
fn held(name: &str, noise: f64) -> (usize, usize) {
    let method = method(name).unwrap();
    let each: Vec<Option<bool>> = (0..100_u64)
        .into_par_iter()
        .map(|seed| {
            let delay = (seed * 7 % 20) as usize;
            let p = 0.5 + 0.4 * (seed * 13 % 17) as f64 / 17.0;
            let u = input(method, 600, 900 + seed);
            let y = second_order(
                &u,
                0.4,
                if seed % 2 == 0 { [-p, 0.0] } else { [-2.0 * p, p * p] },
                delay,
            );
            let y = sum(&y, &white(600, noise * std_dev(&y), 5000 + seed));
            let [from, to] =
                answer(method, &Experiment::siso(ts(1.0), u, y).unwrap(), &Search::default())
                    .ci95_s?;
            Some(from <= delay as f64 + 1e-9 && delay as f64 <= to + 1e-9)
        })
        .collect();
    (each.iter().flatten().count(), each.iter().flatten().filter(|h| **h).count())
}

#[test]
#[ignore = "nightly: coverage over draws"]
fn intervals_hold_the_truth_on_plants_of_one_and_two_lags() {
    for name in ALL {
        for noise in [0.01, 0.1, 1.0] {
            let (found, held) = held(name, noise);
            println!("{name}, noise {noise}: {held} of {found} intervals hold the truth");
            // With 95 % each, less than 88 % of 100 happens once in 200 draws; an answer that is seldom given says little.
            assert!(
                found < 20 || held as f64 >= 0.88 * found as f64,
                "{name}, noise {noise}: {held} of {found}"
            );
            assert!(
                noise > 0.01 || name == "moment" || found >= 99,
                "{name}: only {found} answers at 1 % noise"
            );
        }
    }
}

#[test]
fn a_dead_time_that_ends_within_a_sample_is_inside_the_interval() {
    for name in PHASE {
        let method = method(name).unwrap();
        let held = (0..40_u64).filter(|&seed| {
            // y = (b₁q⁻¹ + b₂q⁻²)/(1 − pq⁻¹) u(t − 6): a lag behind a hold whose dead time is 6 + m.
            let (m, lag) = (seed as f64 / 40.0, 3.0 + (seed % 5) as f64);
            let (p, kept) = ((-1.0_f64 / lag).exp(), (-(1.0 - m) / lag).exp());
            let (b1, b2) = (1.0 - kept, kept - p);
            let u = rbs(600, 1.0, 70 + seed);
            let mut y = vec![0.0; 600];
            for t in 8..600 {
                y[t] = p * y[t - 1] + b1 * u[t - 7] + b2 * u[t - 8];
            }
            let y = sum(&y, &white(600, 0.01 * std_dev(&y), 80 + seed));
            let [from, to] =
                answer(method, &Experiment::siso(ts(1.0), u, y).unwrap(), &Search::default())
                    .ci95_s
                    .unwrap();
            from <= 6.0 + m + 1e-9 && 6.0 + m <= to + 1e-9
        });
        let held = held.count();
        println!("{name}: {held} of 40 fractional dead times inside the interval");
        assert!(held >= 35, "{name}: {held} of 40");
    }
}

#[test]
fn several_recordings_know_more_than_one() {
    for name in ALL {
        let method = method(name).unwrap();
        // Moments drown where the others still see.
        let noise = if name == "moment" { 0.03 } else { 0.1 };
        let experiment = |count: u64| {
            let recordings = (0..count).map(|seed| {
                let u = input(method, 500, 300 + seed);
                let y = second_order(&u, 0.4, [-1.3, 0.42], 4);
                let y = sum(&y, &white(500, noise * std_dev(&y), 400 + seed));
                Recording { inputs: vec![u.into()], outputs: vec![y.into()], states: Vec::new() }
            });
            Experiment::new(ts(1.0), vec!["u".into()], vec!["y".into()], recordings.collect())
                .unwrap()
        };
        let width = |count| {
            let found = answer(method, &experiment(count), &Search::default());
            (found.outcome, found.ci95_s.map_or(f64::INFINITY, |[from, to]| to - from))
        };
        let (one, nine) = (width(1), width(9));
        println!("{name}: one recording {one:?}, nine {nine:?}");
        assert!(nine.0 == Outcome::Found && nine.1 < one.1, "{name}: {one:?} {nine:?}");
    }
}

#[test]
fn a_plant_that_area_methods_cannot_read_has_no_number() {
    // A response whose sum is zero has no gain to divide by.
    let u = rbs(600, 1.0, 5);
    let mut y = vec![0.0; 600];
    for t in 5..600 {
        y[t] = u[t - 4] - u[t - 5];
    }
    let y = sum(&y, &white(600, 0.1, 6));
    for name in ["area2", "area3", "moment"] {
        let found = answer(
            method(name).unwrap(),
            &Experiment::siso(ts(1.0), u.clone(), y.clone()).unwrap(),
            &Search::default(),
        );
        assert_eq!((found.outcome, found.delay_s), (Outcome::Singular, None), "{name}: {found:?}");
    }
    // Random input has no step that is held.
    let found = answer(
        method("area1").unwrap(),
        &Experiment::siso(ts(1.0), u, y).unwrap(),
        &Search::default(),
    );
    assert_eq!(found.outcome, Outcome::NotApplicable, "{found:?}");
}

#[test]
fn hostile_records_get_an_answer_or_an_error_but_no_nan() {
    let n = 400;
    let u = rbs(n, 1.0, 1);
    let y = second_order(&u, 0.4, [-1.3, 0.42], 4);
    let pulse: Vec<f64> = (0..n).map(|t| f64::from(u8::from(t == 30))).collect();
    let ramp: Vec<f64> = (0..n).map(|t| t as f64).collect();
    let growing: Vec<f64> = (0..n).map(|t| 1.2_f64.powi(t as i32)).collect();
    let wave: Vec<f64> = (0..n).map(|t| (0.3 * t as f64).sin()).collect();
    let times = |x: &[f64], k: f64| x.iter().map(|v| v * k).collect::<Vec<_>>();
    let cases = [
        (u.clone(), y.clone()),
        (u.clone(), u.clone()),
        (pulse.clone(), second_order(&pulse, 0.4, [-1.3, 0.42], 4)),
        (ramp.clone(), second_order(&ramp, 0.4, [-1.3, 0.42], 4)),
        (u.clone(), growing.clone()),
        (growing, y.clone()),
        (wave.clone(), second_order(&wave, 0.4, [-1.3, 0.42], 4)),
        (times(&u, 1e300), times(&y, 1e300)),
        (times(&u, 1e-300), times(&y, 1e-300)),
        (u.clone(), pulse),
    ];
    for name in ALL {
        let estimator = method(name).unwrap().entry.with(serde_json::json!({})).unwrap();
        let mut answers = 0;
        for (case, (u, y)) in cases.iter().enumerate() {
            for (max_delay, bias) in [(35, 1), (0, 0), (10, 3)] {
                let search = Search { max_delay, default_bias: bias, ..Search::default() };
                // A second recording of three samples has no row for any model.
                let mut experiment = Measured::siso(ts(1.0), u.clone(), y.clone());
                experiment.recordings.push(Recording {
                    inputs: vec![vec![1.0; 3].into()],
                    outputs: vec![vec![0.5; 3].into()],
                    states: Vec::new(),
                });
                let Ok(experiment) = experiment.checked() else { continue };
                for e in estimator.estimate(&experiment, &search).iter() {
                    answers += 1;
                    let [from, to] = e.ci95_s.unwrap_or([0.0; 2]);
                    let numbers = [
                        e.delay_s.unwrap_or(0.0),
                        e.std_s.unwrap_or(0.0),
                        e.raw_delay_s.unwrap_or(0.0),
                        from,
                        to,
                    ];
                    assert!(
                        numbers.iter().all(|v| v.is_finite()),
                        "{name}, case {case}, {max_delay}: {e:?}"
                    );
                    assert!(
                        e.delay_s.is_none_or(|d| from <= d && d <= to),
                        "{name}, case {case}, {max_delay}: {e:?}"
                    );
                }
            }
        }
        assert!(answers >= cases.len(), "{name}: only {answers} answers");
    }
}
