//! Third-order statistics against delays that are known, under noise that both sensors share.

use crate::support::plants::{TS, answer, rbs, std_dev, sum, times, ts, white};
use deadtime::delay::{DelayEstimate, Experiment, Outcome, Search, method};
use deadtime::signal::fractional_delay;
use rayon::prelude::*;

fn run(name: &str, u: &[f64], y: &[f64]) -> DelayEstimate {
    let search = Search { default_bias: 0, ..Search::default() };
    answer(
        method(name).unwrap(),
        &Experiment::siso(ts(TS), u.to_vec(), y.to_vec()).unwrap(),
        &search,
    )
}

/// Independent numbers as skewed as squares of normal ones, of variance 1.
fn skewed(samples: usize, seed: u64) -> Vec<f64> {
    white(samples, 1.0, seed).iter().map(|v| (v * v - 1.0) / 2.0_f64.sqrt()).collect()
}

/// AR(1) noise of variance 1.
fn slow(samples: usize, pole: f64, seed: u64) -> Vec<f64> {
    let mut v = white(samples, (1.0 - pole * pole).sqrt(), seed);
    for t in 1..samples {
        v[t] += pole * v[t - 1];
    }
    v
}

#[test]
fn bispectrum_intervals_hold_fractional_delays() {
    for (samples, noise) in [(600, 0.1), (2000, 0.5)] {
        let answers: Vec<Option<(f64, bool)>> = (0..200_u64)
            .into_par_iter()
            .map(|seed| {
                let delay = 2.0 + (seed as f64 * 0.737) % 20.0;
                // A filtered source: between samples only what is below Nyquist has a meaning.
                let raw = skewed(samples + 400, seed);
                let s: Vec<f64> = (0..raw.len())
                    .map(|t| if t == 0 { 0.0 } else { raw[t] + 0.7 * raw[t - 1] })
                    .collect();
                let later = fractional_delay(&s, delay);
                let u = sum(&s[200..200 + samples], &white(samples, noise, 5000 + seed));
                let y = sum(
                    &times(&later[200..200 + samples], -2.0),
                    &white(samples, 2.0 * noise, 6000 + seed),
                );
                let e = run("bispectrum", &u, &y);
                let [from, to] = e.ci95_s?;
                (e.outcome == Outcome::Found)
                    .then_some((e.delay_s? / TS - delay, from <= delay * TS && delay * TS <= to))
            })
            .collect();
        let found: Vec<_> = answers.into_iter().flatten().collect();
        let n = found.len() as f64;
        let rms = (found.iter().map(|a| a.0 * a.0).sum::<f64>() / n).sqrt();
        let coverage = found.iter().filter(|a| a.1).count() as f64 / n;
        println!(
            "bispectrum N {samples} noise {noise}: {n} of 200 found, rms {rms:.4}, coverage {coverage:.3}"
        );
        assert!(n >= 180.0 && coverage >= 0.91 && rms < 0.1, "{n} {coverage} {rms}");
    }
}

#[test]
fn noise_that_both_sensors_share_fools_correlation_and_not_the_bispectrum() {
    let (mut right, mut fooled) = (0, 0);
    for seed in 0..40 {
        let n = 4000;
        let s = skewed(n + 20, seed);
        // Twice as much common noise as signal, at lag 2; the signal at lag 9.
        let common = white(n + 20, 1.4, 300 + seed);
        let u = sum(&s[20..], &common[20..]);
        let y = sum(&s[11..11 + n], &common[18..18 + n]);
        let at = |name: &str, lag: f64| {
            run(name, &u, &y).delay_s.is_some_and(|d| (d / TS - lag).abs() < 0.5)
        };
        right += usize::from(at("bispectrum", 9.0));
        fooled += usize::from(at("crosscorr", 2.0));
    }
    println!(
        "common noise: bispectrum right in {right} of 40, crosscorr at the noise's lag in {fooled}"
    );
    assert!(right >= 36 && fooled >= 38, "{right} {fooled}");
}

#[test]
fn symmetric_noise_alone_is_seldom_taken_for_a_response_to_a_skewed_input() {
    for (pole, samples) in [(0.0, 600), (0.9, 600), (0.9, 4000)] {
        let fooled = (0..100_u64)
            .into_par_iter()
            .filter(|&seed| {
                run("bispectrum", &skewed(samples, 40 + seed), &slow(samples, pole, 900 + seed))
                    .outcome
                    == Outcome::Found
            })
            .count();
        println!("AR({pole}), N {samples}: {fooled} of 100 records of noise alone gave a delay");
        assert!(fooled <= 3, "{fooled}");
    }
}

#[test]
fn an_input_without_skewness_is_not_applicable() {
    let mut other = 0;
    for seed in 0..60 {
        for u in [rbs(600, 1.0, seed), white(600, 1.0, seed), slow(600, 0.95, seed)] {
            let y = sum(&fractional_delay(&u, 6.0), &white(600, 0.05 * std_dev(&u), 800 + seed));
            let e = run("bispectrum", &u, &y);
            other += usize::from(
                e.outcome != Outcome::NotApplicable || !e.note.unwrap().contains("skewness"),
            );
        }
    }
    println!("{other} of 180 symmetric inputs were taken for skewed");
    assert!(other <= 2, "{other}");
}
