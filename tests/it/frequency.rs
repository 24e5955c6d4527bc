//! Dead times from frequency responses and from tables of a step response.

use deadtime::delay::{
    BodePhase, Outcome, RESPONSE_METHODS, Rational, ResponseEstimator, ResponseJob, ResponseSearch,
};
use deadtime::log::{FrequencyResponse, Quality};
use deadtime::nalgebra::Complex;
use proptest::strategy::{Strategy, ValueTree};
use proptest::test_runner::{Config, RngSeed, TestRunner};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::support::compare::{Comparison, cases, golden, list, number, text};
use crate::support::drawn::{LONGEST, Recipe, recipe};

type Plant = fn(Complex<f64>) -> Complex<f64>;

/// As many frequencies from `from` to `to`, rad/s, equally far apart in logarithms.
fn decades(from: f64, to: f64, count: usize) -> Vec<f64> {
    (0..count).map(|k| from * (to / from).powf(k as f64 / (count as f64 - 1.0))).collect()
}

fn lag(s: Complex<f64>) -> Complex<f64> {
    (s * 0.3 + 1.0).inv() * 2.0
}

/// A resonance of 1 % damping at 50 rad/s behind a lag.
fn ringing(s: Complex<f64>) -> Complex<f64> {
    (s * s / 2500.0 + s * (2.0 * 0.01 / 50.0) + 1.0).inv() * (s * 0.1 + 1.0).inv()
}

/// A zero in the right half-plane at 20 rad/s.
fn backwards(s: Complex<f64>) -> Complex<f64> {
    (1.0 - s / 20.0) / ((s * 0.3 + 1.0) * (s * 0.05 + 1.0))
}

fn normal(rng: &mut ChaCha8Rng) -> Complex<f64> {
    let mut one = || -> f64 { StandardNormal.sample(rng) };
    Complex::new(one(), one()) * std::f64::consts::FRAC_1_SQRT_2
}

fn search(max_delay_s: f64) -> ResponseSearch {
    ResponseSearch { max_delay_s, stop: Default::default() }
}

/// What is said of the noise beside the response.
#[derive(Clone, Copy)]
enum Told {
    Nothing,
    Coherence,
    Std,
}

/// A plant with a delay, under noise whose share of the magnitude grows with the frequency where its coherence is told.
fn measured(
    plant: Plant,
    delay: f64,
    omega: &[f64],
    share: f64,
    told: Told,
    rng: &mut ChaCha8Rng,
) -> FrequencyResponse {
    let clean: Vec<Complex<f64>> =
        omega.iter().map(|w| plant(Complex::new(0.0, *w)) * Complex::cis(-w * delay)).collect();
    let last = omega[omega.len() - 1];
    let shares: Vec<f64> = omega
        .iter()
        .map(|w| if matches!(told, Told::Nothing) { share } else { share * (1.0 + 9.0 * w / last) })
        .collect();
    let values = clean.iter().zip(&shares).map(|(h, s)| h * (normal(rng) * *s + 1.0)).collect();
    let quality = match told {
        Told::Nothing => Quality::Unknown,
        // (1 − γ²)/γ² = 2n·s², n averages.
        Told::Coherence => {
            Quality::Coherence(shares.iter().map(|s| 1.0 / (1.0 + 64.0 * s * s)).collect())
        }
        Told::Std => Quality::Std(
            clean
                .iter()
                .zip(&shares)
                .map(|(h, s)| s * h.norm() * std::f64::consts::FRAC_1_SQRT_2)
                .collect(),
        ),
    };
    FrequencyResponse::new("drawn", omega.to_vec(), values, quality).unwrap()
}

#[test]
fn a_fit_of_scipy_to_the_responses_of_python_control_is_found_without_being_told_the_orders() {
    let file = golden("delays_frf", "reference.json");
    let mut c = Comparison::new("delays_frf/reference.json");
    for case in cases(&file) {
        let values = list(&case["h_re"])
            .into_iter()
            .zip(list(&case["h_im"]))
            .map(|(re, im)| Complex::new(re, im))
            .collect();
        let response = FrequencyResponse::new(
            text(case, "id"),
            list(&case["omega_rad_s"]),
            values,
            Quality::Std(list(&case["std"])),
        )
        .unwrap();
        let answer = Rational { max_poles: 5 }.estimate(&response, &search(0.5)).unwrap();
        let (delay, std) = (number(case, "delay_s"), number(case, "std_s"));
        let got = (answer.delay_s.unwrap(), answer.std_s.unwrap());
        c.check("delay (standard deviations)", text(case, "id"), (got.0 - delay).abs() / std, 0.02);
        // That of the interval over all orders: other orders may add a little.
        c.check(
            "standard deviation over all orders",
            text(case, "id"),
            (got.1 / std - 1.0).abs(),
            0.1,
        );
    }
    c.finish();
}

/// Highest frequency of the drawn plants' responses, rad a sample: some ten times their fastest pole.
const LAST: f64 = 20.0;

/// To how many samples a method is held on noise-free responses, and the class of plants that it is exempt from, with the reason.
type Contract = (f64, Option<(fn(&Recipe) -> bool, &'static str)>);

fn contract(name: &str) -> Contract {
    match name {
        "rational" => (1e-6, None),
        // What its head says of the slope beyond the last frequency: ±2/(π·ω_N).
        "bode_phase" => (
            std::f64::consts::FRAC_2_PI / LAST,
            Some((
                Recipe::goes_backwards,
                "a zero in the right half-plane turns the phase and leaves the magnitude alone",
            )),
        ),
        other => panic!(
            "{other} has no contract: say to what it is exact, and on which plants it need not"
        ),
    }
}

/// Of random stable plants with delays of 0 to 40 samples, fractions included.
#[test]
#[ignore = "nightly: every method on drawn plants"]
fn every_method_finds_injected_delays_of_drawn_plants_but_on_the_class_it_is_exempt_from() {
    let mut runner = TestRunner::new(Config {
        rng_seed: RngSeed::Fixed(1),
        failure_persistence: None,
        ..Config::default()
    });
    let (strategy, omega) = (recipe(), decades(0.02, LAST, 90));
    let drawn: Vec<(Recipe, FrequencyResponse)> =
        std::iter::repeat_with(|| strategy.new_tree(&mut runner).unwrap().current())
            .filter_map(|r| {
                let values = r.frequency_response(&omega)?;
                Some((
                    r,
                    FrequencyResponse::new("drawn", omega.clone(), values, Quality::Unknown)
                        .unwrap(),
                ))
            })
            .take(30)
            .collect();
    for method in RESPONSE_METHODS {
        let (within, exemption) = contract(method.entry.name);
        let estimator = method.entry.with(serde_json::json!({})).unwrap();
        let off = |(r, response): &&(Recipe, FrequencyResponse)| {
            let answer = estimator.estimate(response, &search(LONGEST + 5.0)).unwrap();
            let apart = answer.delay_s.map_or(f64::INFINITY, |s| (s - r.delay).abs());
            answer.outcome != Outcome::Found || apart > within
        };
        let (excused, held): (Vec<_>, Vec<_>) =
            drawn.iter().partition(|(r, _)| exemption.is_some_and(|(holds, _)| holds(r)));
        assert!(
            held.len() >= 12,
            "{}: only {} plants are left to it",
            method.entry.name,
            held.len()
        );
        let missed: Vec<&Recipe> = held.iter().filter(|d| off(d)).map(|(r, _)| r).collect();
        println!(
            "{}: {} of {} responses off, {} excused",
            method.entry.name,
            missed.len(),
            held.len(),
            excused.len()
        );
        assert!(
            missed.is_empty(),
            "{}: {} of {} off: {missed:?}",
            method.entry.name,
            missed.len(),
            held.len()
        );
        // The exemption is needed.
        assert!(
            exemption.is_none() || excused.iter().any(off),
            "{}: {exemption:?} excuses nothing",
            method.entry.name
        );
    }
}

#[test]
#[ignore = "nightly: coverage over draws"]
fn intervals_hold_injected_delays_of_plants_that_ring_go_backwards_or_lag() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let plants: [(Plant, f64, [f64; 2]); 3] = [
        (lag, 0.05, [0.5, 120.0]),
        (ringing, 0.021, [3.0, 200.0]),
        (backwards, 0.05, [0.5, 120.0]),
    ];
    let (mut inside, mut tried, mut wide) = (0, 0, 0.0_f64);
    for told in [Told::Nothing, Told::Coherence, Told::Std] {
        for (plant, delay, [from, to]) in plants {
            for _ in 0..12 {
                let response = measured(plant, delay, &decades(from, to, 60), 0.03, told, &mut rng);
                let answer = Rational { max_poles: 4 }.estimate(&response, &search(0.3)).unwrap();
                tried += 1;
                if let Some([low, high]) = answer.ci95_s {
                    inside += usize::from(low <= delay && delay <= high);
                    wide = wide.max(high - low);
                }
            }
        }
    }
    println!("{inside} of {tried} intervals hold the delay, none wider than {wide:.4} s");
    // Of 108 intervals of 95 % fewer than 96 hold the truth once in 400 times.
    assert!(inside >= 96, "{inside} of {tried}");
    assert!(wide < 0.05, "{wide}");
}

#[test]
fn the_phase_that_the_magnitude_explains_is_no_delay() {
    let omega = decades(0.5, 120.0, 80);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let delayed = BodePhase::default()
        .estimate(&measured(lag, 0.05, &omega, 0.02, Told::Nothing, &mut rng), &search(0.5))
        .unwrap();
    let [low, high] = delayed.ci95_s.unwrap();
    assert!(low <= 0.05 && 0.05 <= high && high - low < 0.03, "{low} {high}");
    let backwards = BodePhase::default()
        .estimate(&measured(backwards, 0.05, &omega, 0.02, Told::Nothing, &mut rng), &search(0.5))
        .unwrap();
    assert!(
        backwards.delay_s.unwrap() > 0.06,
        "a zero in the right half-plane looks like delay to it, as it says"
    );
}

#[test]
fn a_zero_in_the_right_half_plane_is_said_and_no_part_of_the_delay() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let response =
        measured(backwards, 0.05, &decades(0.5, 120.0, 60), 0.02, Told::Nothing, &mut rng);
    let answer = Rational { max_poles: 4 }.estimate(&response, &search(0.3)).unwrap();
    assert!((answer.delay_s.unwrap() - 0.05).abs() < 2e-3, "{answer:?}");
    // 2/z.
    assert!(answer.note.as_deref().unwrap().contains("another 0.1"), "{:?}", answer.note);
}

#[test]
fn noise_alone_is_no_delay() {
    let mut found = 0;
    for seed in 0..12 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let omega = decades(1.0, 100.0, 60);
        let values = omega.iter().map(|_| normal(&mut rng)).collect();
        let response = FrequencyResponse::new("noise", omega, values, Quality::Unknown).unwrap();
        for estimator in
            [&Rational { max_poles: 3 } as &dyn ResponseEstimator, &BodePhase::default()]
        {
            found += usize::from(
                estimator.estimate(&response, &search(1.0)).unwrap().outcome == Outcome::Found,
            );
        }
    }
    assert!(found <= 1, "{found} of 24");
}

#[test]
fn delays_that_the_distance_of_the_frequencies_does_not_tell_apart_are_not_searched() {
    // 1 rad/s apart: delays 2π s apart look alike.
    let omega: Vec<f64> = (1..40).map(f64::from).collect();
    let values =
        omega.iter().map(|w| Complex::cis(-0.4 * w) / Complex::new(1.0, 0.1 * w)).collect();
    let job =
        ResponseJob::new(FrequencyResponse::new("grid", omega, values, Quality::Unknown).unwrap());
    let report = job.run().unwrap();
    assert!((report.pairs[0].verdict.delay_s.unwrap() - 0.4).abs() < 1e-6);
    assert!(
        report.max_delay_s <= std::f64::consts::PI
            && deadtime::report::estimate::preamble(&report)
                .contains("delays 6.2832 s apart look alike"),
        "{}",
        deadtime::report::estimate::preamble(&report)
    );
    let error = ResponseJob { max_delay_s: Some(7.0), ..job }.run().unwrap_err().to_string();
    assert!(error.contains("at most 6.2832 s"), "{error}");
}

#[test]
fn a_narrow_band_is_said() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let response = measured(lag, 0.05, &decades(20.0, 40.0, 60), 0.02, Told::Nothing, &mut rng);
    let report = ResponseJob::new(response).run().unwrap();
    assert!(
        report.pairs[0].verdict.why.contains("less than two octaves")
            || report.pairs[0].verdict.delay_s.is_none(),
        "{:?}",
        report.pairs[0].verdict
    );
}

#[cfg(feature = "cli")]
mod program {
    use serde_json::Value;

    use super::*;
    use crate::support::program::{Folder, deadtime};

    #[test]
    fn a_table_of_decibels_and_degrees_is_estimated_and_how_it_was_read_is_said() {
        let folder = Folder::new();
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let omega = decades(0.5, 120.0, 60);
        let response = measured(lag, 0.05, &omega, 0.02, Told::Coherence, &mut rng);
        let Quality::Coherence(coherence) = response.quality() else { panic!("no coherence") };
        let rows: Vec<String> = omega
            .iter()
            .zip(response.values())
            .zip(coherence)
            .map(|((w, h), c)| {
                format!(
                    "{},{},{},{c}",
                    w / std::f64::consts::TAU,
                    20.0 * h.norm().log10(),
                    h.arg().to_degrees()
                )
            })
            .collect();
        let table =
            format!("frequency [Hz],magnitude [dB],phase [deg],coherence\n{}\n", rows.join("\n"));
        let (file, json) = (folder.write("frf.csv", &table), folder.path("answer.json"));
        let said = deadtime(&[
            "estimate",
            "--frf",
            file.to_str().unwrap(),
            "--json",
            json.to_str().unwrap(),
        ])
        .words();
        assert!(said.contains("Dead time 0.05") || said.contains("Dead time 0.049"), "{said}");
        assert!(
            said.contains("`magnitude [dB]` as magnitude (dB), `phase [deg]` as phase (deg), `coherence` as squared coherence"),
            "{said}"
        );
        let report: Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
        assert_eq!(report["format"], "deadtime/estimate@1");
        assert_eq!(report["pairs"][0]["estimates"][0]["method"], "rational");
        deadtime(&["estimate", "--frf", file.to_str().unwrap(), "--method", "p1d"])
            .refused(&["no method for frequency responses `p1d`", "rational, bode_phase"]);
        deadtime(&["estimate", "--frf", file.to_str().unwrap(), "--set", "rational.max_poles=11"])
            .refused(&["max_poles = 11"]);
        let bad = folder.write("bad.csv", "frequency,re,im\n1,2,3\n");
        deadtime(&["estimate", "--frf", bad.to_str().unwrap()])
            .refused(&["bad.csv", "call it `frequency [Hz]` or `frequency [rad/s]`"]);
    }

    /// Three time constants to one delay: what a model of two poles calls dead time is partly lag.
    #[test]
    #[ignore = "nightly: coverage over draws"]
    fn intervals_from_step_tables_hold_the_dead_time_whatever_the_number_of_poles() {
        let folder = Folder::new();
        let mut rng = ChaCha8Rng::seed_from_u64(17);
        let (mut held, mut all) = (0, 0);
        for poles in [&[10.0][..], &[10.0, 4.0], &[10.0, 6.0, 4.0]] {
            for delay in [2.3, 3.0, 5.7, 8.1] {
                // 1 − Σ Tᵢⁿ⁻¹/Π(Tᵢ − Tⱼ)·e^(−t/Tᵢ), a row each 0.7 s, noise of one per cent.
                let others = |at: f64| poles.iter().filter(move |p| **p != at);
                let left = |t: f64, at: f64| {
                    others(at).map(|other| at / (at - other)).product::<f64>() * (-t / at).exp()
                };
                let response = |t: f64| 1.0 - poles.iter().map(|at| left(t, *at)).sum::<f64>();
                let rows: Vec<String> = (0..140)
                    .map(|k| {
                        let noise: f64 = StandardNormal.sample(&mut rng);
                        format!(
                            "{},{}",
                            0.7 * f64::from(k),
                            response((0.7 * f64::from(k) - delay).max(0.0)) + 0.01 * noise
                        )
                    })
                    .collect();
                let table = folder.write("step.csv", &format!("time,y\n{}\n", rows.join("\n")));
                let json = folder.path("answer.json");
                let arguments = [
                    "estimate",
                    "--step-table",
                    table.to_str().unwrap(),
                    "--json",
                    json.to_str().unwrap(),
                ];
                deadtime(&arguments).words();
                let report: Value =
                    serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
                let ends = report["pairs"][0]["verdict"]["ci95_s"].as_array().unwrap();
                all += 1;
                held += usize::from(
                    ends[0].as_f64().unwrap() <= delay && delay <= ends[1].as_f64().unwrap(),
                );
            }
        }
        // 95 % of twelve: fewer than ten once in fifty times.
        assert!(held >= 10, "{held} of {all}");
    }

    #[test]
    fn a_table_of_a_step_response_is_estimated_with_its_step_put_beside_it() {
        let folder = Folder::new();
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        // 3·(1 − e^(−(t − 4.37)/12)) behind a step of 2 at 0, a row a second.
        let rows: Vec<String> = (0..160)
            .map(|t| {
                let after = (f64::from(t) - 4.37).max(0.0);
                let noise: f64 = StandardNormal.sample(&mut rng);
                format!("{t},{}", 20.0 + 3.0 * (1.0 - (-after / 12.0).exp()) + 0.01 * noise)
            })
            .collect();
        let table = folder.write("step.csv", &format!("time,level [cm]\n{}\n", rows.join("\n")));
        let json = folder.path("answer.json");
        let arguments = [
            "estimate",
            "--step-table",
            table.to_str().unwrap(),
            "--step-size",
            "2",
            "--json",
            json.to_str().unwrap(),
        ];
        let said = deadtime(&arguments).words();
        assert!(said.contains("step → level"), "{said}");
        let report: Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
        let estimates = report["pairs"][0]["estimates"].as_array().unwrap();
        let p1d = estimates.iter().find(|e| e["method"] == "p1d").unwrap();
        assert!((p1d["delay_s"].as_f64().unwrap() - 4.37).abs() < 0.1, "{p1d}");
        let verdict = &report["pairs"][0]["verdict"];
        assert!((verdict["delay_s"].as_f64().unwrap() - 4.37).abs() < 0.5, "{verdict}");
        deadtime(&["estimate", "--step-table", table.to_str().unwrap(), "--step-time", "3.5"])
            .refused(&["step.csv", "a row every 1 s", "--step-time"]);
    }
}
