//! What a verdict says of records whose dead time is known: the interval holds it, and a record without a response has none.

use std::collections::BTreeMap;

use crate::support::plants::{process, rbs, std_dev, sum, times, white};
use deadtime::delay::{Job, Scope, chosen};
use deadtime::log::{Channel, Log};
use rayon::prelude::*;

/// Quick ones of every class that the record may trust.
const METHODS: [&str; 11] = [
    "oestruc",
    "arxstruc",
    "delayest",
    "met1struc",
    "oe_posterior",
    "p1d",
    "p2d",
    "impulseest",
    "arxdap",
    "lagudap",
    "fischer",
];

/// First-order noise with this pole.
fn coloured(samples: usize, pole: f64, seed: u64) -> Vec<f64> {
    let mut last = 0.0;
    white(samples, 1.0, seed)
        .into_iter()
        .map(|e| {
            last = pole * last + e;
            last
        })
        .collect()
}

fn verdict(u: &[f64], y: &[f64]) -> Option<(f64, [f64; 2])> {
    let time_s = (0..u.len()).map(|k| k as f64).collect();
    let log = Log::new(
        "test",
        time_s,
        vec![Channel::new("u", None, u.to_vec()), Channel::new("y", None, y.to_vec())],
    )
    .unwrap();
    let methods = chosen(&METHODS.map(str::to_owned), &BTreeMap::new(), &[Scope::Pair]).unwrap();
    let job = Job { methods, ..Job::new(vec![log], ["u"], ["y"]) };
    let verdict = job.run().unwrap().pairs.remove(0).verdict;
    verdict.delay_s.zip(verdict.ci95_s)
}

/// Lags that most methods' models are too small for, coloured noise, fractional delays: one method's interval holds seven or eight of ten of these.
#[test]
#[ignore = "nightly: coverage over draws"]
fn the_interval_of_all_methods_together_holds_what_single_ones_miss() {
    let plants: [(&[f64], Option<f64>); 4] =
        [(&[6.0], None), (&[6.0, 2.0], None), (&[5.0, 3.0, 1.0], None), (&[6.0, 2.0], Some(4.0))];
    let held: Vec<bool> = (0..96_u64)
        .into_par_iter()
        .filter_map(|i| {
            let (lags, zero) = plants[i as usize % 4];
            let delay = 0.37 * (i % 23) as f64;
            let u = if i % 3 == 0 { coloured(400, 0.8, 900 + i) } else { rbs(400, 1.0, 900 + i) };
            let response = process(&u, lags, zero, delay, 1.0);
            let noise =
                if i % 2 == 0 { white(400, 1.0, 500 + i) } else { coloured(400, 0.9, 500 + i) };
            let ratio: f64 = [3.0, 30.0][i as usize / 8 % 2];
            let y =
                sum(&response, &times(&noise, std_dev(&response) / std_dev(&noise) / ratio.sqrt()));
            verdict(&u, &y).map(|(_, [from, to])| (from - 1e-9..=to + 1e-9).contains(&delay))
        })
        .collect();
    let share = held.iter().filter(|h| **h).count() as f64 / held.len() as f64;
    assert!(held.len() >= 90, "{} of 96 answered", held.len());
    assert!(share >= 0.9, "{share:.2} of {} intervals hold the truth", held.len());
}

/// Slow and resonant outputs that have nothing to do with the input: output-error models see a response in some.
#[test]
#[ignore = "nightly: a rate over draws"]
fn a_record_without_a_response_has_no_verdict() {
    let answered = (0..40_u64)
        .into_par_iter()
        .filter(|i| {
            let u = if i % 2 == 0 { rbs(400, 1.0, 300 + i) } else { coloured(400, 0.95, 300 + i) };
            let e = white(400, 1.0, 700 + i);
            let mut y = vec![0.0; 400];
            for t in 2..400 {
                y[t] = 2.0 * 0.97 * (0.1 + 0.02 * *i as f64).cos() * y[t - 1]
                    - 0.97 * 0.97 * y[t - 2]
                    + e[t];
            }
            verdict(&u, &y).is_some()
        })
        .count();
    assert!(answered <= 1, "{answered} of 40");
}

/// Without noise the cost of an exact fit falls on for ever, from one side of a whole sample to the other: the search once never ended.
#[test]
fn a_pure_delay_without_noise_is_answered() {
    let u: Vec<f64> =
        (0..300_u64).map(|k| (((k * 2_654_435_761) % (1 << 32)) >> 13 & 1) as f64).collect();
    let y: Vec<f64> = (0..300).map(|k| if k < 4 { 0.0 } else { u[k - 4] }).collect();
    let time_s = (0..300).map(|k| 0.1 * f64::from(k)).collect();
    let log =
        Log::new("pure", time_s, vec![Channel::new("u", None, u), Channel::new("y", None, y)])
            .unwrap();
    let methods = chosen(&["arxstruc".to_owned()], &BTreeMap::new(), &[Scope::Pair]).unwrap();
    let report = Job { methods, ..Job::new(vec![log], ["u"], ["y"]) }.run().unwrap();
    let delay_s = report.pairs[0].estimates[0].delay_s.unwrap();
    // Four samples, of which one is the hold's.
    assert!((delay_s - 0.3).abs() < 1e-9, "{delay_s}");
}
