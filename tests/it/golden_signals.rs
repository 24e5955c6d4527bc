//! Events, excitations, noise, Jacobians and the steppers of differential equations against other people's arithmetic.

use crate::support::compare::{Comparison, golden, list, list_apart, number, text};
use crate::support::plants::{rng, ts};
use deadtime::delay::{Events, Experiment, Search, method};
use deadtime::signal::excitation::{Excitation, Rbs, by_name};
use deadtime::signal::{NoiseColour, unit_noise};

#[test]
fn event_criteria_agree_with_direct_sums_over_every_offset() {
    let file = golden("delays_events", "reference.json");
    let mut c = Comparison::new("delays_events/reference.json");
    let sample_time_s = 0.1;
    let max_delay = (number(&file, "window_s") / sample_time_s).round() as usize;
    for case in file["answers"].as_array().unwrap() {
        let name = text(case, "method");
        let record = &file["records"][text(case, "record")];
        let events = Events { first: list(&record["first"]), second: list(&record["second"]), ..Events::default() };
        let experiment = Experiment::of_events(ts(sample_time_s), ["a", "b"], vec![events]).unwrap();
        let estimator = method(name).unwrap().entry.with(serde_json::json!({})).unwrap();
        let got = estimator.estimate(&experiment, &Search { max_delay, ..Search::default() }).unwrap();
        for (key, got) in [("raw", got.raw_delay_s), ("delay", got.delay_s)] {
            let apart = got.map_or(f64::NAN, |s| (s - number(case, key)).abs());
            c.check(&format!("{name}, {key} delay (s)"), text(case, "id"), apart, SUMS);
        }
    }
    c.finish();
}

/// Sums of the same terms in another order.
const SUMS: f64 = 1e-10;

#[test]
fn excitations_agree_with_scipy_sample_by_sample() {
    let file = golden("signals", "reference.json");
    let mut c = Comparison::new("signals/reference.json excitations");
    for case in file["cases"].as_array().unwrap() {
        let (id, expected) = (text(case, "id"), list(&case["u"]));
        let entry = by_name(text(case, "excitation")).unwrap();
        let u = entry.with(case["options"].clone()).unwrap().generate(expected.len(), &mut rng(1)).unwrap();
        c.check(entry.name, id, list_apart(&u, &expected), SUMS);
    }
    c.finish();
}

/// Samples of a drawn record.
const DRAWN: usize = 1 << 17;
/// Standard deviations by which a correlation of so many samples may differ from the process' own: of some 130 compared none comes near with chance alone.
const CHANCE: f64 = 5.0;

/// The record's own correlations beside those of the process, each over the standard deviation that Bartlett's formula gives it.
fn correlations(c: &mut Comparison, field: &str, id: &str, x: &[f64], expected: &[f64]) {
    let sum = |lag: usize| x.iter().zip(&x[lag..]).map(|(a, b)| a * b).sum::<f64>() / x.len() as f64;
    let power = sum(0);
    let rho = |lag: isize| expected.get(lag.unsigned_abs()).copied().unwrap_or(0.0);
    for lag in 1..expected.len() {
        let k = lag as isize;
        let term = |i: isize| (rho(i + k) + rho(i - k) - 2.0 * rho(i) * rho(k)).powi(2);
        let variance: f64 = (1..60).map(term).sum::<f64>() / x.len() as f64;
        let apart = (sum(lag) / power - expected[lag]).abs() / variance.max(0.25 / x.len() as f64).sqrt();
        c.check(field, &format!("{id}, lag {lag}"), apart, CHANCE);
    }
}

#[test]
fn noise_and_random_binary_signals_have_the_spectra_of_their_filters() {
    let file = golden("signals", "reference.json");
    let mut c = Comparison::new("signals/reference.json spectra");
    for case in file["noise"].as_array().unwrap() {
        let colour = NoiseColour::Arma { ar: list(&case["ar"]), ma: list(&case["ma"]) };
        let v = unit_noise(DRAWN, &colour, &mut rng(7)).unwrap();
        correlations(&mut c, "noise (standard deviations of chance)", text(case, "id"), &v, &list(&case["autocorrelation"]));
    }
    for case in file["rbs"].as_array().unwrap() {
        let band = list(&case["band"]);
        let u = Rbs { band: [band[0], band[1]], ..Rbs::default() }.generate(DRAWN, &mut rng(8)).unwrap();
        correlations(&mut c, "rbs (standard deviations of chance)", text(case, "id"), &u, &list(&case["autocorrelation"]));
    }
    c.finish();
}
