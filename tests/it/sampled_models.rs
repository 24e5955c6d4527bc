//! What the sampled models of low order promise of their numbers: fractions of a sample, intervals that hold the truth, smaller errors of a mean.

use crate::support::plants::{TS, rbs, second_order, std_dev, sum, ts, white};
use deadtime::delay::{DelayEstimate, Experiment, Outcome, Search, method};
use deadtime::identify::{Initial, OutputError, Record};
use rayon::prelude::*;
use serde_json::{Value, json};

fn estimate(
    name: &str,
    options: Value,
    u: Vec<f64>,
    y: Vec<f64>,
    search: &Search,
) -> DelayEstimate {
    let estimator = method(name).unwrap().entry.with(options).unwrap();
    estimator.estimate(&Experiment::siso(ts(TS), u, y).unwrap(), search).unwrap()
}

/// One lag of `lag` samples behind `delay` samples, the input held: solved exactly from one switch of the delayed input to the next.
fn one_lag(u: &[f64], lag: f64, delay: f64) -> Vec<f64> {
    let (whole, part) = (delay.floor() as usize, delay.fract());
    let at = |t: usize, back: usize| if t >= back { u[t - back] } else { 0.0 };
    let mut y = vec![0.0];
    for t in 0..u.len() - 1 {
        // From t to t + part the older input acts, from there to t + 1 the newer.
        let mut x = y[t];
        for (level, time) in [(at(t, whole + 1), part), (at(t, whole), 1.0 - part)] {
            x = level + (x - level) * (-time / lag).exp();
        }
        y.push(x);
    }
    y
}

/// Errors in samples, and how many of the intervals hold the truth, over records of one lag with fractional delays.
fn fractions(name: &str, noise: f64, records: u64) -> (f64, usize) {
    let found: Vec<(f64, bool)> = (0..records)
        .into_par_iter()
        .map(|seed| {
            let delay = 2.0 + 10.0 * ((seed as f64 * 0.618_034).fract());
            let lag = 3.0 + (seed % 5) as f64 * 2.0;
            let u = rbs(500, 1.0, 100 + seed);
            let y = one_lag(&u, lag, delay);
            let y = sum(&y, &white(500, noise * std_dev(&y), 600 + seed));
            let e = estimate(name, json!({}), u, y, &Search::default());
            assert_eq!(e.outcome, Outcome::Found, "{name}, {delay}: {e:?}");
            let [from, to] = e.ci95_s.unwrap();
            (e.delay_s.unwrap() / TS - delay, from <= delay * TS && delay * TS <= to)
        })
        .collect();
    let rms = (found.iter().map(|f| f.0 * f.0).sum::<f64>() / records as f64).sqrt();
    let held = found.iter().filter(|f| f.1).count();
    println!(
        "{name}, {noise} noise: RMS {rms:.4} samples, {held} of {records} intervals hold the truth"
    );
    (rms, held)
}

#[test]
#[ignore = "nightly: coverage over draws; injected.rs has its answers"]
fn the_sampling_zero_tells_the_fraction_of_one_lag_and_its_interval_holds_it() {
    // 200 intervals of 95 %: fewer than 181 happen once in 200 draws.
    for (noise, worst) in [(0.01, 0.02), (0.1, 0.1)] {
        let (rms, held) = fractions("sampling_zero", noise, 200);
        assert!(rms < worst && held >= 181, "{noise}: {rms} {held}");
    }
}

#[test]
fn turns_find_fractions_of_one_lag_and_two() {
    for noise in [0.02, 0.2] {
        let (rms, held) = fractions("two_step", noise, 100);
        assert!(rms < 0.2 && held >= 89, "{rms} {held}");
    }
}

#[test]
fn a_second_lag_is_said_where_the_zero_cannot_be_one_of_a_single_lag() {
    let u = rbs(600, 1.0, 5);
    let y = second_order(&u, 0.1, [-1.7, 0.72], 4);
    let y = sum(&y, &white(600, 0.01 * std_dev(&y), 6));
    let e = estimate("sampling_zero", json!({}), u, y, &Search::default());
    assert!(e.delay_s.unwrap() > 4.5 * TS, "a second lag counts as delay: {e:?}");
}

/// RMS errors of methods over plants of two lags, delays uniform in the window, with noise in units of the signal; and the share of intervals that hold the truth.
fn noisy(names: &[(&str, Value)], noise: f64, records: u64) -> Vec<(f64, f64)> {
    let search = Search { max_delay: 20, ..Search::default() };
    names
        .iter()
        .map(|(name, options)| {
            let found: Vec<Option<(f64, bool)>> = (0..records)
                .into_par_iter()
                .map(|seed| {
                    let delay = (seed % 20) as usize;
                    let u = rbs(500, 1.0, 40 + seed);
                    let y = second_order(&u, 0.1, [-1.7, 0.72], delay);
                    let y = sum(&y, &white(500, noise * std_dev(&y), 900 + seed));
                    let e = estimate(name, options.clone(), u, y, &search);
                    let [from, to] = e.ci95_s?;
                    let truth = delay as f64 * TS;
                    Some((e.delay_s? / TS - delay as f64, from - 1e-9 <= truth && truth <= to + 1e-9))
                })
                .collect();
            let answered: Vec<(f64, bool)> = found.iter().flatten().copied().collect();
            let n = answered.len() as f64;
            let rms = (answered.iter().map(|f| f.0 * f.0).sum::<f64>() / n).sqrt();
            let held = answered.iter().filter(|f| f.1).count() as f64 / n;
            println!(
                "{name} {options}: {n} of {records} answered, RMS {rms:.3} samples, {:.1} % of the intervals hold the truth",
                100.0 * held
            );
            (rms, held)
        })
        .collect()
}

#[test]
#[ignore = "nightly: drawn records"]
fn a_mean_over_the_delays_errs_less_than_the_best_of_them() {
    let found = noisy(
        &[
            ("oestruc", json!({})),
            ("oe_posterior", json!({})),
            ("oe_posterior", json!({ "center": "median" })),
        ],
        1.0,
        150,
    );
    let [best, mean, median] = [found[0].0, found[1].0, found[2].0];
    // Over 3000 records 0.464, 0.424 and 0.474: of poles as close as these the prior thinks little, which costs the median 2 %; over 300 its ratio to the best strays by 4 %.
    assert!(mean <= best && median <= 1.15 * best, "{best} {mean} {median}");
    assert!(found.iter().all(|f| f.1 >= 0.92), "{found:?}");
}

#[test]
fn intervals_hold_the_truth_under_heavy_noise() {
    // The products of elnaggar drown at such noise: it says that it sees nothing.
    for (name, noise) in [("two_step", 1.0), ("elnaggar", 0.2)] {
        let f = noisy(&[(name, json!({}))], noise, 200)[0];
        assert!(f.1 >= 0.9, "{name}: {f:?}");
    }
}

/// The covariance of an output-error model against the spread of estimates from many records.
#[test]
fn the_covariance_is_the_spread_of_many_estimates() {
    let orders = OutputError { nb: 2, nf: 1, initial: Initial::Zero };
    let fits: Vec<([f64; 3], [f64; 3])> = (0..400)
        .into_par_iter()
        .map(|seed| {
            let u = rbs(300, 1.0, 3);
            let y = one_lag(&u, 4.0, 2.4);
            let y = sum(&y, &white(300, 0.05, 1000 + seed));
            let records = [Record::new(u, y)];
            let fit = orders.scan(&records, 3)[3].clone().unwrap();
            let c = orders.covariance(&records, 3, &fit.f).unwrap();
            ([fit.b[0], fit.b[1], fit.f[0]], [c[(0, 0)], c[(1, 1)], c[(2, 2)]])
        })
        .collect();
    for i in 0..3 {
        let spread = std_dev(&fits.iter().map(|f| f.0[i]).collect::<Vec<_>>());
        let said = (fits.iter().map(|f| f.1[i]).sum::<f64>() / 400.0).sqrt();
        assert!((said / spread - 1.0).abs() < 0.15, "parameter {i}: {said} {spread}");
    }
}
