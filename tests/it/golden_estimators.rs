//! Every estimator against somebody else's arithmetic: the answer that scripts/golden worked out on a stored record, and the numbers on the way to it.

use crate::support::compare::{
    Comparison, complex_list, count, golden, list, list_apart, matrix, number, points_apart,
    relative, text,
};
use crate::support::plants::ts;
use deadtime::delay::{Experiment, METHODS, ProcessModel, Search, bound, method};
use deadtime::identify::{Armax, Record, RefinedIv, fir_regularised};
use deadtime::signal::{CrossSpectra, correlation};
use serde_json::Value;

/// Input and output of a stored record.
fn record(file: &Value, name: &str) -> (Vec<f64>, Vec<f64>) {
    let record = &file["records"][name];
    (list(&record["u"]), list(&record["y"]))
}

/// Every answer of one file, in samples, against the method's own; the file's `within` (or a case's) is the largest difference allowed.
fn answers(folder: &str) {
    let file = golden(folder, "reference.json");
    let mut c = Comparison::new(&format!("{folder}/reference.json"));
    for case in file["answers"].as_array().unwrap() {
        let name = text(case, "method");
        let estimator = method(name)
            .unwrap_or_else(|| panic!("no method {name}"))
            .entry
            .with(case["options"].clone())
            .unwrap();
        let (u, y) = record(&file, text(case, "record"));
        let experiment = Experiment::siso(ts(1.0), u, y).unwrap();
        let search = Search {
            max_delay: count(case, "max_delay"),
            default_bias: count(case, "bias"),
            ..Search::default()
        };
        let got = estimator.estimate(&experiment, &search).unwrap();
        let within = case["within"].as_f64().unwrap_or_else(|| number(&file, "within"));
        let expected = [("raw", got.raw_delay_s), ("delay", got.delay_s)];
        assert!(
            expected.iter().any(|(key, _)| !case[key].is_null()),
            "{name}: nothing is compared"
        );
        for (key, got_s) in expected {
            if let Some(samples) = case[key].as_f64() {
                let apart = got_s.map_or(f64::NAN, |s| (s - samples).abs());
                if apart.is_nan() || apart > within {
                    println!("{name}: {got:?} instead of {key} {samples}");
                }
                c.check(&format!("{name}, {key} delay (samples)"), text(case, "id"), apart, within);
            }
        }
    }
    c.finish();
}

/// Tolerance of numbers that both sides compute directly.
const DIRECT: f64 = 1e-10;

#[test]
fn correlation_phase_and_bispectrum_agree_with_scipy() {
    answers("delays_correlation");
}

#[test]
fn averaged_spectra_and_correlation_sums_agree_with_scipy() {
    let file = golden("delays_correlation", "reference.json");
    let mut c = Comparison::new("delays_correlation/reference.json spectra");
    let (u, y) = record(&file, "copy");
    let expected = &file["spectra"];
    let got = CrossSpectra::welch([(&u[..], &y[..])], count(expected, "segment"));
    for (key, got) in [("uu", &got.uu), ("yy", &got.yy), ("coherence", &got.coherence())] {
        c.check(key, "", list_apart(got, &list(&expected[key])), DIRECT);
    }
    let looks = number(expected, "looks");
    c.check("looks", "", relative(got.looks - looks, looks), DIRECT);
    // The line at Nyquist's frequency is real but for the sign of rounding.
    let last = got.uy.len() - 1;
    c.check(
        "uy (point by point)",
        "",
        points_apart(&got.uy[..last], &complex_list(&expected["uy"])[..last]),
        DIRECT,
    );
    let expected = &file["correlation"];
    let signed = |key: &str| isize::try_from(expected[key].as_i64().unwrap()).unwrap();
    c.check(
        "correlation",
        "",
        list_apart(
            &correlation(&u, &y, signed("first")..=signed("last")),
            &list(&expected["sums"]),
        ),
        DIRECT,
    );
    c.finish();
}

#[test]
fn sampled_models_agree_with_direct_regressions_and_general_optimisers() {
    answers("delays_parametric");
}

fn one(file: &Value, name: &str) -> [Record<'static>; 1] {
    let (u, y) = record(file, name);
    [Record::new(u, y)]
}

/// The loss of every delay and number of coefficients beside that of a dense covariance matrix; A, B and C at one of them.
#[test]
fn armax_losses_and_coefficients_agree_with_the_exact_likelihood() {
    let file = golden("delays_parametric", "reference.json");
    let mut c = Comparison::new("delays_parametric/reference.json armax");
    let expected = &file["armax"];
    let orders = list(&expected["orders"]);
    let [na, nb, nc] = [0, 1, 2].map(|i| orders[i] as usize);
    let losses = matrix(&expected["losses"]);
    let scan = Armax { na, nb, nc }.scan(&one(&file, "coloured"), 0, losses.nrows() - 1);
    let least = losses.min();
    for nk in 0..losses.nrows() {
        for m in 1..=nb {
            let (id, theirs, fit) = (
                format!("nk {nk}, {m} coefficients"),
                losses[(nk, m - 1)],
                scan.fits[nk][m - 1].as_ref().unwrap(),
            );
            // A delay whose probability is nothing whatever its C is left at C = 1: theirs must say so too, and be no worse.
            if fit.c.iter().all(|v| *v == 0.0) {
                let unlikely = scan.rows as f64 * (theirs / least).ln();
                c.check(
                    "losses not searched: probability beside the best",
                    &id,
                    (-0.5 * unlikely).exp(),
                    HOPELESS,
                );
                c.check(
                    "losses not searched: below the least",
                    &id,
                    (theirs / fit.loss - 1.0).max(0.0),
                    ARMAX_LOSS,
                );
            } else {
                c.check("loss", &id, relative(fit.loss - theirs, theirs), ARMAX_LOSS);
            }
        }
    }
    let model = &expected["model"];
    let fit = scan.fits[count(model, "nk")][count(model, "m") - 1].as_ref().unwrap();
    for (key, got) in [("a", &fit.a), ("b", &fit.b), ("c", &fit.c)] {
        c.check(key, "", list_apart(got, &list(&model[key])), ARGUMENT);
    }
    c.finish();
}

/// e^−60, what a delay that is not searched may weigh.
const HOPELESS: f64 = 8.8e-27;
/// Of a minimum's value, which two searches reach to the square of how near they come to its place.
const ARMAX_LOSS: f64 = 1e-6;
/// Of the place of a minimum, or of a fixed point, that two searches end near.
const ARGUMENT: f64 = 1e-4;

#[test]
fn refined_instrumental_variables_agree_with_numpy() {
    let file = golden("delays_parametric", "reference.json");
    let mut c = Comparison::new("delays_parametric/reference.json iv");
    let fits = RefinedIv { nb: 1, nf: 2, noise: 4 }.scan(&one(&file, "coloured"), 10);
    for expected in file["iv"].as_array().unwrap() {
        let nk = count(expected, "nk");
        let (id, fit) = (format!("nk {nk}"), fits[nk].as_ref().unwrap());
        let loss = number(expected, "loss");
        c.check("loss", &id, relative(fit.loss - loss, loss), IV_LOSS);
        assert!(fit.converged, "{id}");
        for (key, got) in [("b", &fit.b), ("f", &fit.f), ("d", &fit.d)] {
            c.check(key, &id, list_apart(got, &list(&expected[key])), ARGUMENT);
        }
    }
    c.finish();
}

/// Rounds end here once a loss changes by less than 1e-9 of itself, there by 1e-14.
const IV_LOSS: f64 = 1e-6;

#[test]
fn process_models_agree_with_step_responses_in_partial_fractions() {
    answers("delays_process");
}

#[test]
fn slopes_and_bounds_agree_with_the_information_matrix_and_quadrature() {
    let file = golden("delays_process", "reference.json");
    let mut c = Comparison::new("delays_process/reference.json bounds");
    let (u, _) = record(&file, "p2dz");
    let e = &file["slopes"];
    let model = ProcessModel {
        gain: number(e, "gain"),
        lags_s: list(&e["lags"]),
        zero_s: Some(number(e, "zero")),
        delay_s: number(e, "delay"),
    };
    let slopes = model.slopes(&u, ts(1.0)).unwrap();
    c.check("response", "", list_apart(&slopes.response, &list(&e["response"])), DIRECT);
    c.check("by_delay", "", list_apart(&slopes.by_delay, &list(&e["by_delay"])), DIRECT);
    let mut close = |key: &str, got: f64, from: &Value, within: f64| {
        c.check(key, "", relative(got - number(from, key), number(from, key)), within)
    };
    let noise = number(e, "noise");
    close("known", bound::known_model(&slopes.by_delay, noise), e, DIRECT);
    // Their derivatives by the other parameters are differences of fourth order.
    close("joint", bound::joint(&slopes.by_delay, &slopes.by_others, noise).unwrap(), e, 1e-7);
    let b = &file["bounds"];
    let (samples, snr) = (count(b, "samples"), number(b, "snr"));
    close("two_sensors_white", bound::two_sensors_white(samples, snr), b, DIRECT);
    close("reference_white", bound::reference_white(samples, snr), b, DIRECT);
    close("reference", bound::reference(&u, number(b, "noise")), b, DIRECT);
    let band = [0, 1].map(|i| list(&b["band_hz"])[i]);
    // Sums of 4096 points there, adaptive quadrature here.
    close(
        "two_sensors",
        bound::two_sensors(number(b, "duration_s"), band, |f| 0.9 / (1.0 + (f / 5.0).powi(2))),
        b,
        1e-6,
    );
    let (slope, most) = (number(b, "slope"), number(b, "most"));
    close("ziv_zakai", bound::ziv_zakai(number(b, "window"), |h| (slope * h).min(most)), b, 1e-4);
    close("anomaly", bound::anomaly_probability(number(b, "peak"), number(b, "cells")), b, 1e-6);
    c.finish();
}

#[test]
fn thresholds_areas_all_pass_parts_and_laguerre_series_agree_with_scipy() {
    answers("delays_response");
}

/// The prior is found by a search that ends at 3 % of ln(−ln λ) and 7 % of ln γ; the likelihood is so flat there that the response hardly moves.
const OF_STD: f64 = 0.05;

#[test]
fn the_regularised_response_agrees_with_the_outputs_covariance_matrix() {
    let file = golden("delays_response", "reference.json");
    let mut c = Comparison::new("delays_response/reference.json regularised");
    let expected = &file["regularised"];
    let fir = fir_regularised(&one(&file, "plant"), count(expected, "taps")).unwrap();
    let (coefficients, std) = (list(&expected["coefficients"]), list(&expected["std"]));
    for (i, (h, s)) in coefficients.iter().zip(&std).enumerate() {
        c.check(
            "coefficients (of their standard deviations)",
            &format!("tap {i}"),
            (fir.coefficients[i] - h).abs() / s,
            OF_STD,
        );
    }
    let own: Vec<f64> = fir.covariance.diagonal().iter().map(|v| v.sqrt()).collect();
    c.check("standard deviations", "", list_apart(&own, &std), OF_STD);
    let variance = number(expected, "variance");
    c.check("variance", "", relative(fir.variance - variance, variance), OF_STD);
    c.check("decay", "", (fir.decay.ln() / number(expected, "decay").ln()).ln().abs(), OF_STD);
    c.finish();
}

/// No method without a witness: a row of docs/results/validation.md that names data, data that hold an answer of the method, and how far it is from them.
#[test]
fn every_method_has_a_witness_in_the_table() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = std::fs::read_to_string(root.join("docs/results/validation.md")).unwrap();
    for method in METHODS {
        let name = method.entry.name;
        let row = page
            .lines()
            .find(|line| line.starts_with(&format!("| `{name}` |")))
            .unwrap_or_else(|| panic!("{name} has no row"));
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        assert!(
            cells.len() == 6 && cells.iter().all(|cell| !cell.is_empty()),
            "{name}: an empty cell in {row}"
        );
        // Every `9.0e-11 samples (1e-5)` and `beside it loss 4.2e-13 (1e-10)` of the last cell.
        for told in cells[5].split("; ") {
            let (apart, within) = told
                .trim_end_matches(')')
                .rsplit_once('(')
                .unwrap_or_else(|| panic!("{name}: {told}"));
            let apart = apart
                .split(' ')
                .rev()
                .find_map(|word| word.parse::<f64>().ok())
                .unwrap_or_else(|| panic!("{name}: {told}"));
            assert!(apart <= within.parse::<f64>().unwrap(), "{name}: {told}");
        }
        let folders: Vec<&str> =
            cells[3].split('[').filter_map(|part| Some(part.split_once(']')?.0)).collect();
        let held = |folder: &&str| {
            let text =
                std::fs::read_to_string(root.join("golden").join(folder).join("reference.json"))
                    .unwrap();
            // Answers name their method; the regression on states is a section of its own name.
            text.contains(&format!("\"method\":\"{name}\""))
                || text.contains(&format!("\"{name}\":"))
        };
        assert!(folders.iter().any(held), "{name}: none of {folders:?} holds an answer of it");
        for folder in folders {
            assert!(
                root.join("golden").join(folder).join("SOURCE.md").exists(),
                "{name}: {folder} has no source"
            );
        }
    }
}
