//! Björklund's standard benchmark: the all-pass, Laguerre, area and moment methods beside the numbers that he published, and what the output-error methods reach.
//!
//! Source: Björklund (2003), LiU-TEK-LIC-2003:60, pp. 69-77 (the experiments) and Fig. 9.2, p. 109 (the numbers, 95 % kept).

use crate::support::plants;
use crate::support::plants::{respond, std_dev, sum, ts, white};
use deadtime::delay::{DelayEstimate, Experiment, Search, method};
use deadtime::model::c2d::{Conversion, ZeroOrderHold};
use deadtime::model::{Continuous, Sampled, StateSpace, TransferFunction};
use deadtime::signal::Excitation;
use deadtime::signal::excitation::Rbs;
use rayon::prelude::*;
use serde_json::json;

const SAMPLES: usize = 500;
/// The delay of the published plants, samples; their answers have one more, that of the hold.
const DELAY: usize = 9;
/// The published score of an answer that is none: the truth is 10.
const FAILED: f64 = 20.0;

/// Coefficients of Π (s + pᵢ), highest power first.
fn product(roots: &[[f64; 2]]) -> Vec<f64> {
    // Pairs [p, 0] are real factors s + p; [a, b] stands for (s + a)² + b².
    roots.iter().fold(vec![1.0], |c, &[a, b]| {
        let factor = if b == 0.0 { vec![1.0, a] } else { vec![1.0, 2.0 * a, a * a + b * b] };
        let mut out = vec![0.0; c.len() + factor.len() - 1];
        for (i, x) in c.iter().enumerate() {
            for (j, y) in factor.iter().enumerate() {
                out[i + j] += x * y;
            }
        }
        out
    })
}

/// slow2, fast2, real4 and cplx4, without their dead time, behind a zero-order hold.
fn systems() -> Vec<(&'static str, StateSpace<Sampled>)> {
    let zeros = product(&[[0.9, 0.0], [0.4, 0.0]]);
    let scaled = |c: &[f64], k: f64| c.iter().map(|v| v * k).collect::<Vec<_>>();
    let r = std::f64::consts::FRAC_1_SQRT_2;
    [
        ("slow2", vec![0.1], product(&[[0.1, 0.0], [1.0, 0.0]])),
        ("fast2", vec![10.0], product(&[[1.0, 0.0], [10.0, 0.0]])),
        ("real4", scaled(&zeros, 0.05), product(&[[1.0, 0.0], [0.6, 0.0], [0.3, 0.0], [0.1, 0.0]])),
        ("cplx4", scaled(&zeros, 1.0 / 36.0), product(&[[0.1 * r, 0.1 * r], [r, r]])),
    ]
    .into_iter()
    .map(|(name, num, den)| {
        let plant = TransferFunction::from_polynomials(&num, &den, 0.0, Continuous)
            .unwrap()
            .to_state_space()
            .unwrap();
        (name, ZeroOrderHold {}.c2d(&plant, ts(1.0)).unwrap())
    })
    .collect()
}

fn input(kind: usize, seed: u64) -> Vec<f64> {
    let band = |from, to| {
        Rbs { band: [from, to], ..Rbs::default() }
            .generate(SAMPLES, &mut plants::rng(seed))
            .unwrap()
    };
    match kind {
        0 => band(0.1, 0.3),
        1 => band(0.0, 1.0),
        _ => (0..SAMPLES)
            .map(|t| [0.0, 1.0, -1.0, 0.0][[50, 200, 350].iter().filter(|&&e| t >= e).count()])
            .collect(),
    }
}

/// Every answer of one cell: `trials` noise draws on each system. The command line takes the means off, and so does this.
fn cell(name: &str, kind: usize, snr: f64, trials: u64) -> Vec<(&'static str, DelayEstimate)> {
    let u = input(kind, 77);
    let estimator = method(name).unwrap().entry.with(serde_json::json!({})).unwrap();
    let rest = method(name).unwrap().start == deadtime::delay::Start::Rest;
    let centred = |x: &[f64]| {
        let mean = if rest { 0.0 } else { x.iter().sum::<f64>() / x.len() as f64 };
        x.iter().map(|v| v - mean).collect::<Vec<_>>()
    };
    systems()
        .into_iter()
        .flat_map(|(system, plant)| {
            let clean = respond(&plant, std::slice::from_ref(&u), &[DELAY]).0.remove(0);
            let answers: Vec<_> = (0..trials)
                .into_par_iter()
                .map(|seed| {
                    let y = sum(&clean, &white(SAMPLES, std_dev(&clean) / snr.sqrt(), 1000 + seed));
                    let experiment = Experiment::siso(ts(1.0), centred(&u), centred(&y)).unwrap();
                    let search = Search { max_delay: 20, ..Search::default() };
                    (system, estimator.estimate(&experiment, &search).unwrap())
                })
                .collect();
            answers
        })
        .collect()
}

/// The published score of an answer: what is none, or outside 0 … 20, counts as 20.
fn error(estimate: &DelayEstimate) -> f64 {
    let raw = estimate.delay_s.map_or(FAILED, |d| d + 1.0);
    (if raw > 0.0 && raw < FAILED { raw } else { FAILED }) - 10.0
}

const CELLS: [(usize, f64); 6] = [(0, 100.0), (0, 1.0), (1, 100.0), (1, 1.0), (2, 100.0), (2, 1.0)];

/// Published RMS with 95 % of all answers kept, by cell.
const PUBLISHED: &[(&str, [f64; 6])] = &[
    ("oedap", [1.0, 2.1, 1.1, 2.0, 2.3, 3.8]),
    ("arxdap", [1.6, 2.9, 1.7, 1.7, 2.2, 4.2]),
    ("firdap", [2.1, 3.0, 3.0, 3.1, 4.3, 4.3]),
    ("lagudap", [0.6, 1.4, 0.8, 1.5, 0.92, 3.0]),
    ("fischer", [7.9, 8.0, 8.8, 8.7, 0.81, 1.7]),
    ("area1", [f64::NAN; 6]),
    ("area2", [2.5, 3.9, 2.2, 3.7, 2.1, 4.4]),
    ("area3", [f64::NAN; 6]),
    ("moment", [5.7, 7.5, 5.6, 7.6, 5.3, 8.0]),
];

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len().max(1) as f64).sqrt()
}

#[test]
fn random_input_at_one_percent_noise_scores_as_published_or_better() {
    for (name, published) in PUBLISHED {
        for (&(kind, snr), published) in CELLS
            .iter()
            .zip(published)
            .filter(|((kind, snr), p)| *kind < 2 && *snr > 1.0 && p.is_finite())
        {
            let errors: Vec<f64> = cell(name, kind, snr, 8).iter().map(|(_, e)| error(e)).collect();
            // area2 and moment are as biased as published; 2 more where moment gives no answer, which scores 10.
            let limit = published + if *name == "moment" { 2.0 } else { 0.6 };
            assert!(
                rms(&errors) <= limit,
                "{name}, input {kind}: {:.2} instead of {published}",
                rms(&errors)
            );
        }
    }
}

/// The window of the output-error methods there: raw delays of 1 to 20 samples.
fn window() -> Search {
    Search { min_delay: 1, max_delay: 20, ..Search::default() }
}

fn estimates(
    name: &str,
    options: &serde_json::Value,
    records: &[(Vec<f64>, Vec<f64>)],
) -> Vec<DelayEstimate> {
    let estimator = method(name).unwrap().entry.with(options.clone()).unwrap();
    let one = |(u, y): &(Vec<f64>, Vec<f64>)| {
        estimator
            .estimate(&Experiment::siso(ts(1.0), u.clone(), y.clone()).unwrap(), &window())
            .unwrap()
    };
    records.par_iter().map(one).collect()
}

/// Records of the 24 open-loop cells, `trials` each, cell after cell; SNR 100 in every other four.
fn open_loop(trials: u64) -> Vec<Vec<(Vec<f64>, Vec<f64>)>> {
    let mut cells = Vec::new();
    for (kind, snr) in CELLS {
        let u = input(kind, 501);
        for (_, plant) in systems() {
            let clean = respond(&plant, std::slice::from_ref(&u), &[DELAY]).0.remove(0);
            let noisy = |t| {
                sum(
                    &clean,
                    &white(
                        SAMPLES,
                        std_dev(&clean) / f64::sqrt(snr),
                        70_000 + 100 * cells.len() as u64 + t,
                    ),
                )
            };
            cells.push((0..trials).map(|t| (u.clone(), noisy(t))).collect());
        }
    }
    cells
}

/// Records of the 18 closed-loop cells (pp. 73-75): two plants, three PI controllers, three noises, reference 4 and then 2.
fn closed_loop(trials: u64) -> Vec<Vec<(Vec<f64>, Vec<f64>)>> {
    const N: usize = 2000;
    let mut cells = Vec::new();
    for (_, plant) in systems().into_iter().take(2) {
        for (gain, integral) in [(0.6, 50.0), (0.25, 5.0), (0.9, 12.0)] {
            for (b, a) in [(0.71, [-0.7, 0.0]), (1.0, [0.0, 0.0]), (0.92, [-0.368, 1.671e-5])] {
                let record = |trial| {
                    // A standard deviation of 0.1 gives the ratios of signal to noise that he tells, 790 to 1147.
                    let noise = plants::second_order(
                        &white(N + 1, 0.1, 90_000 + 100 * cells.len() as u64 + trial),
                        b,
                        a,
                        0,
                    );
                    let (mut u, mut y) = (vec![0.0; N], vec![0.0; N]);
                    let (mut x, mut before, mut power) =
                        (nalgebra::DVector::<f64>::zeros(plant.order()), 0.0, 0.0);
                    for t in 0..N {
                        let clean = 0.5 * (plant.c() * &x)[(0, 0)];
                        power += clean * clean;
                        y[t] = clean + noise[t + 1];
                        let error = if t < N / 2 { 4.0 } else { 2.0 } - y[t];
                        u[t] = if t > 0 { u[t - 1] } else { 0.0 }
                            + gain * ((1.0 + 1.0 / integral) * error - before);
                        before = error;
                        x = plant.a() * x
                            + plant.b().column(0) * if t >= DELAY { u[t - DELAY] } else { 0.0 };
                    }
                    let ratio = power / noise[1..].iter().map(|v| v * v).sum::<f64>();
                    assert!((700.0..1300.0).contains(&ratio), "{ratio}");
                    (u, y)
                };
                cells.push((0..trials).map(record).collect());
            }
        }
    }
    cells
}

/// The mean of the cells' RMS, of all answers' best `share`.
fn mean_rms(cells: &[Vec<DelayEstimate>], share: f64) -> f64 {
    let mut all: Vec<(f64, usize)> = cells
        .iter()
        .enumerate()
        .flat_map(|(i, c)| c.iter().map(move |e| (error(e).abs(), i)))
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all.truncate((share * all.len() as f64).round() as usize);
    let of = |i: usize| rms(&all.iter().filter(|e| e.1 == i).map(|e| e.0).collect::<Vec<_>>());
    (0..cells.len()).map(of).sum::<f64>() / cells.len() as f64
}

fn open_loop_accuracy(trials: u64) {
    let cells = open_loop(trials);
    let run = |name: &str, options| {
        cells.iter().map(|c| estimates(name, &options, c)).collect::<Vec<_>>()
    };
    // The aims at 1000 trials are 0.92 (published: 0.89), 0.85 and 0.70; over 20 trials the mean has a standard deviation of 0.04, of which 3.5 are added.
    let std = 0.04 * (20.0 / trials as f64).sqrt();
    let runs = [
        (run("oestruc", json!({})), 0.92),
        (run("oe_posterior", json!({ "center": "mode" })), 0.85),
        (run("oe_posterior", json!({})), 0.70),
    ];
    for (i, (answers, aim)) in runs.iter().enumerate() {
        let got = mean_rms(answers, 1.0);
        let held = answers
            .iter()
            .flatten()
            .filter_map(|e| e.ci95_s)
            .map(|[a, b]| a <= 9.0 && 9.0 <= b)
            .collect::<Vec<_>>();
        let share = held.iter().filter(|h| **h).count() as f64 / held.len() as f64;
        let flags = answers
            .iter()
            .enumerate()
            .filter(|(c, _)| c % 8 < 4)
            .flat_map(|(_, c)| c)
            .filter(|e| e.delay_s.is_none())
            .count();
        println!("{i}: {got:.3}, {share:.3} of intervals hold the truth, {flags} flags at SNR 100");
        assert!(got <= aim + 3.5 * std, "{i}: {got:.3}");
        // Of 480 intervals of 95 % fewer than 92 % hold the truth once in a thousand draws, of 96 fewer than 87 %.
        assert!(share >= if trials == 20 { 0.92 } else { 0.87 }, "{i}: {share:.3}");
        // Of 240 records that are flagged needlessly at a rate of 1 % more than 8 are so once in a thousand draws.
        assert!(flags <= 8, "{i}: {flags}");
    }
}

#[test]
fn output_error_methods_reach_the_published_accuracy_in_open_loop() {
    open_loop_accuracy(4);
}

#[test]
#[ignore = "nightly: accuracy over trials"]
fn output_error_methods_reach_the_published_accuracy_in_open_loop_over_twenty_trials() {
    open_loop_accuracy(20);
}

#[test]
fn the_posterior_mean_beats_the_published_accuracy_in_closed_loop() {
    let answers: Vec<_> =
        closed_loop(6).iter().map(|c| estimates("oe_posterior", &json!({}), c)).collect();
    let got = mean_rms(&answers, 0.95);
    println!("{got:.3}");
    assert!(got <= 0.65, "{got:.3}, published 0.73");
}

fn flagged(names: &[&str]) {
    let plants = systems();
    for name in names {
        for slow in [false, true] {
            let records: Vec<_> = (0..200)
                .map(|t: u64| {
                    let other =
                        Rbs { band: [0.0, if slow { 0.05 } else { 1.0 }], ..Rbs::default() };
                    let other = other.generate(SAMPLES, &mut plants::rng(30_000 + t)).unwrap();
                    let clean =
                        respond(&plants[(t % 4) as usize].1, &[other], &[DELAY]).0.remove(0);
                    let noise = white(SAMPLES, 0.1 * std_dev(&clean), 40_000 + t);
                    (input((t % 2) as usize, 50_000 + t), sum(&clean, &noise))
                })
                .collect();
            let fooled = estimates(name, &json!({}), &records)
                .iter()
                .filter(|e| e.delay_s.is_some())
                .count();
            println!("{name}, slow {slow}: {fooled} of 200");
            // With the 1 % that is aimed at, more than 7 happen once in a thousand draws.
            assert!(fooled <= 7, "{name}, slow {slow}: {fooled} of 200");
        }
    }
}

#[test]
fn an_input_that_has_nothing_to_do_with_the_output_is_flagged() {
    flagged(&["oestruc"]);
}

#[test]
#[ignore = "nightly: a rate of four methods"]
fn an_input_that_has_nothing_to_do_with_the_output_is_flagged_by_four_methods() {
    flagged(&["oestruc", "oe_posterior", "arxstruc", "met1struc"]);
}
