//! Continuous process models: fractional dead times, their intervals, and a published case that stops searches which start elsewhere.

use crate::support::plants;
use crate::support::plants::{TS, answer, process, rbs, rng, std_dev, sum, ts, white};
use deadtime::delay::{Experiment, Method, Outcome, Search, method};
use deadtime::signal::Excitation;
use deadtime::signal::excitation::Prbs;
use rand::RngExt;
use rayon::prelude::*;
use serde_json::json;

const NAMES: [&str; 6] = ["p1d", "p2d", "p3d", "p1dz", "p2dz", "p3dz"];

/// A random plant of a method's own shape, its delay in samples, and its noisy response.
fn drawn(name: &str, seed: u64, samples: usize, noise: f64) -> (f64, Experiment<'static>) {
    let mut rng = rng(seed);
    let poles = name[1..2].parse::<usize>().unwrap();
    let zero = name.ends_with('z');
    // From half a sample to thirty.
    let mut lags: Vec<f64> =
        (0..poles).map(|_| TS * 10.0_f64.powf(rng.random_range(-0.3..1.5))).collect();
    lags.sort_by(|a, b| b.total_cmp(a));
    let zero = zero.then(|| lags[0] * rng.random_range(-0.8..0.8));
    let delay = rng.random_range(0.0..25.0);
    let u = rbs(samples, 1.0, seed + 10_000);
    let y = process(&u, &lags, zero, delay * TS, TS);
    let e = white(samples, noise * std_dev(&y), seed + 20_000);
    (delay, Experiment::siso(ts(TS), u, sum(&y, &e)).unwrap())
}

fn interval_holds(noises: &[f64]) {
    for &noise in noises {
        for name in NAMES {
            let records = 40_u64;
            let clock = std::time::Instant::now();
            let results: Vec<Option<(f64, f64, bool)>> = (0..records)
                .into_par_iter()
                .map(|seed| {
                    let (delay, experiment) = drawn(name, seed, 500, noise);
                    let e = answer(method(name).unwrap(), &experiment, &Search::default());
                    if e.outcome != Outcome::Found {
                        return None;
                    }
                    let [from, to] = e.ci95_s.unwrap();
                    Some((
                        e.delay_s.unwrap() / TS - delay,
                        e.std_s.unwrap() / TS,
                        from - 1e-9 <= delay * TS && delay * TS <= to + 1e-9,
                    ))
                })
                .collect();
            let found: Vec<&(f64, f64, bool)> = results.iter().flatten().collect();
            let mut off: Vec<f64> = found.iter().map(|f| f.0.abs()).collect();
            off.sort_by(f64::total_cmp);
            let mut z: Vec<f64> = found.iter().map(|f| f.0.abs() / f.1).collect();
            z.sort_by(f64::total_cmp);
            let held = found.iter().filter(|f| f.2).count();
            println!(
                "{name} noise {noise}: {} found, {held} hold ({:.1} %), |error| median {:.4} 95 % {:.4} worst {:.4} samples, |z| median {:.2} 95 % {:.2}, {:.1} ms each",
                found.len(),
                100.0 * held as f64 / found.len() as f64,
                off[off.len() / 2],
                off[off.len() * 95 / 100],
                off[off.len() - 1],
                z[z.len() / 2],
                z[z.len() * 95 / 100],
                clock.elapsed().as_secs_f64() * 1e3 / records as f64
            );
            // 95 % of 40 draws, less three standard deviations of that.
            assert!(
                found.len() >= 38 && held as f64 >= 0.847 * found.len() as f64,
                "{name}, noise {noise}: {held} of {}",
                found.len()
            );
        }
    }
}

#[test]
#[ignore = "nightly: coverage over noises"]
fn the_interval_holds_a_fractional_delay_as_often_as_it_says_at_every_noise() {
    interval_holds(&[0.001, 0.03, 0.3]);
}

/// 12·e^(−8s)/(s² + 4s + 4) every 0.1 s, PRBS of order 8 held for 20 samples, noise of a signal-to-noise ratio of 15 dB: CONTSID's demonstration of a search that is stuck.
fn demonstration(seed: u64) -> Experiment<'static> {
    let u =
        Prbs { order: 8, clock: 20, ..Prbs::default() }.generate(255 * 20, &mut rng(1)).unwrap();
    let y: Vec<f64> = process(&u, &[0.5, 0.5], None, 8.0, 0.1).iter().map(|v| 3.0 * v).collect();
    let noise = white(y.len(), std_dev(&y) * 10.0_f64.powf(-15.0 / 20.0), seed);
    Experiment::siso(ts(0.1), u, sum(&y, &noise)).unwrap()
}

fn with(
    name: &str,
    options: serde_json::Value,
    experiment: &Experiment,
    search: &Search,
) -> deadtime::delay::DelayEstimate {
    let found: &'static Method = method(name).unwrap();
    found.entry.with(options).unwrap().estimate(experiment, search).unwrap()
}

#[test]
fn eight_seconds_are_found_from_every_start_between_0_and_20() {
    let search = Search { max_delay: 200, ..Search::default() };
    let experiment = demonstration(1);
    let clock = std::time::Instant::now();
    let plain = with("p2d", json!({}), &experiment, &search);
    println!("{plain:?} in {:?}", clock.elapsed());
    assert_eq!(plain.outcome, Outcome::Found);
    let [from, to] = plain.ci95_s.unwrap();
    assert!((plain.delay_s.unwrap() - 8.0).abs() < 0.05 && from <= 8.0 && 8.0 <= to, "{plain:?}");
    let starts: Vec<f64> = (0..=20).map(f64::from).collect();
    starts.par_iter().for_each(|&start| {
        let e = with("p2d", json!({ "initial_delay_s": start }), &experiment, &search);
        assert!(
            (e.delay_s.unwrap() - plain.delay_s.unwrap()).abs() < 1e-6,
            "from {start} s: {e:?}"
        );
    });
}

#[test]
#[ignore = "nightly: coverage over draws"]
fn a_record_that_begins_in_motion_is_fitted_with_its_start() {
    for name in ["p1d", "p2d", "p3d", "p2dz"] {
        let held = (0..30_u64).into_par_iter().filter(|&seed| {
            let (delay, experiment) = drawn(name, seed, 700, 0.02);
            let recording = &experiment.recordings()[0];
            // The first 200 samples are not seen.
            let later = Experiment::siso(
                ts(TS),
                recording.inputs[0][200..].to_vec(),
                recording.outputs[0].values[200..].to_vec(),
            )
            .unwrap();
            let e = with(name, json!({ "initial": "estimated" }), &later, &Search::default());
            let [from, to] = e.ci95_s.unwrap_or([f64::NAN; 2]);
            from - 1e-9 <= delay * TS && delay * TS <= to + 1e-9
        });
        let held = held.count();
        println!("{name}: {held} of 30 intervals hold the truth");
        // 95 % of 30, less three standard deviations.
        assert!(held >= 25, "{name}: {held} of 30");
    }
}

#[test]
fn several_records_say_more_than_one() {
    let one = drawn("p2d", 3, 400, 0.3).1;
    let mut four = one.recordings().to_vec();
    for seed in 0..3 {
        let (delay, more) = drawn("p2d", 3, 400, 0.0);
        let mut more = more.recordings()[0].clone();
        let y = &mut more.outputs[0].values;
        *y = sum(y, &white(400, 0.3 * std_dev(y), 900 + seed)).into();
        assert!(delay > 0.0);
        four.push(more);
    }
    let four = Experiment::new(ts(TS), vec!["u".into()], vec!["y".into()], four).unwrap();
    let std = |e: &Experiment| answer(method("p2d").unwrap(), e, &Search::default()).std_s.unwrap();
    let ratio = std(&one) / std(&four);
    println!("four records: {ratio:.2} times as sure");
    assert!(ratio > 1.4 && ratio < 2.9, "{ratio}");
}

#[test]
#[ignore = "nightly: a rate over draws"]
fn the_search_finds_what_starts_at_every_sample_up_to_twenty_find() {
    for name in ["p1d", "p2d", "p3d", "p2dz"] {
        let worse = (0..6_u64).into_par_iter().filter(|&seed| {
            let (_, experiment) = drawn(name, 500 + seed, 300, [0.01, 0.3, 1.0][seed as usize % 3]);
            let plain = with(name, json!({}), &experiment, &Search::default());
            let Some(found) = plain.delay_s else { return false };
            // Another start may find a lower minimum only where the search has missed one.
            (0..20).any(|i| {
                let e = with(
                    name,
                    json!({ "initial_delay_s": f64::from(i) * TS }),
                    &experiment,
                    &Search::default(),
                );
                e.delay_s.is_none_or(|d| (d - found).abs() > 1e-3 * TS)
            })
        });
        let worse = worse.count();
        println!("{name}: {worse} of 6 answers change with the start");
        assert!(worse <= 1, "{name}: {worse} of 6");
    }
}

/// What a held input does at some time within a sample shows at the next one: of a plant without a pole no method that fits poles can know more.
#[test]
fn a_gain_alone_leaves_the_whole_sample_open() {
    for noise in [0.0, 0.1] {
        for name in NAMES {
            for delay in [1, 4, 9] {
                let u = rbs(400, 1.0, 7 + delay as u64);
                let y: Vec<f64> =
                    (0..400).map(|t| if t < delay { 0.0 } else { -2.5 * u[t - delay] }).collect();
                let y = sum(&y, &white(400, 2.5 * noise, 40 + delay as u64));
                let e = answer(
                    method(name).unwrap(),
                    &Experiment::siso(ts(TS), u, y).unwrap(),
                    &Search::default(),
                );
                let (found, [from, to]) =
                    (e.delay_s.unwrap() / TS, e.ci95_s.unwrap().map(|s| s / TS));
                let whole = delay as f64;
                assert!(
                    from <= whole - 1.0 + 1e-9 && whole - 1e-9 <= to,
                    "{name}, {delay} samples, noise {noise}: {from} to {to}"
                );
                assert!(
                    (whole - 1.0 - 0.2..=whole + 0.2).contains(&found),
                    "{name}, {delay} samples, noise {noise}: {found}"
                );
            }
        }
    }
}

#[test]
fn a_pole_left_out_is_said() {
    let u = rbs(600, 1.0, 4);
    let y = process(&u, &[1.0, 0.6], None, 0.5, TS);
    let experiment =
        Experiment::siso(ts(TS), u, sum(&y, &white(600, 0.01 * std_dev(&y), 5))).unwrap();
    let note = |name| answer(method(name).unwrap(), &experiment, &Search::default()).note;
    assert!(note("p1d").is_some_and(|n| n.contains("still follows the input")));
    assert_eq!(note("p2d"), None);
}

#[test]
#[ignore = "nightly: a million samples"]
fn of_a_million_samples_a_part_is_used_and_that_is_said() {
    let n = 1_000_000;
    let u = rbs(n, 1.0, 1);
    let y = plants::second_order(&u, 0.4, [-1.3, 0.42], 4);
    let experiment = Experiment::siso(ts(TS), u, sum(&y, &white(n, 0.1 * std_dev(&y), 2))).unwrap();
    for name in NAMES {
        let clock = std::time::Instant::now();
        let e = answer(method(name).unwrap(), &experiment, &Search::default());
        println!("{name}: {:?} for a million samples, {:?}", clock.elapsed(), e.delay_s);
        assert!(
            e.note.is_some_and(|n| n.contains("used the first 50000 of 1000000 samples")),
            "{name}"
        );
        let short = drawn("p2d", 8, 500, 0.03).1;
        let clock = std::time::Instant::now();
        for _ in 0..5 {
            let _ = answer(method(name).unwrap(), &short, &Search::default());
        }
        println!("{name}: {:?} for 500", clock.elapsed() / 5);
    }
}
