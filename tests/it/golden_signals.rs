//! Events, excitations, noise, Jacobians and the steppers of differential equations against other people's arithmetic.

use crate::support::compare::{Comparison, count, golden, list, list_apart, matrix, number, text};
use crate::support::plants::{rng, ts};
use deadtime::delay::{Events, Experiment, Search, method};
use deadtime::model::{EquationsFile, Wrt};
use deadtime::signal::excitation::{Excitation, Rbs, by_name};
use deadtime::signal::{NoiseColour, unit_noise};
use deadtime::simulate::ode::{Integrator, Method, Rhs};
use nalgebra::DMatrix;

#[test]
fn event_criteria_agree_with_direct_sums_over_every_offset() {
    let file = golden("delays_events", "reference.json");
    let mut c = Comparison::new("delays_events/reference.json");
    let sample_time_s = 0.1;
    let max_delay = (number(&file, "window_s") / sample_time_s).round() as usize;
    for case in file["answers"].as_array().unwrap() {
        let name = text(case, "method");
        let record = &file["records"][text(case, "record")];
        let events = Events {
            first: list(&record["first"]),
            second: list(&record["second"]),
            ..Events::default()
        };
        let experiment =
            Experiment::of_events(ts(sample_time_s), ["a", "b"], vec![events]).unwrap();
        let estimator = method(name).unwrap().entry.with(serde_json::json!({})).unwrap();
        let got =
            estimator.estimate(&experiment, &Search { max_delay, ..Search::default() }).unwrap();
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
        let u = entry
            .with(case["options"].clone())
            .unwrap()
            .generate(expected.len(), &mut rng(1))
            .unwrap();
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
    let sum =
        |lag: usize| x.iter().zip(&x[lag..]).map(|(a, b)| a * b).sum::<f64>() / x.len() as f64;
    let power = sum(0);
    let rho = |lag: isize| expected.get(lag.unsigned_abs()).copied().unwrap_or(0.0);
    for (lag, own) in expected.iter().enumerate().skip(1) {
        let k = lag as isize;
        let term = |i: isize| (rho(i + k) + rho(i - k) - 2.0 * rho(i) * rho(k)).powi(2);
        let variance: f64 = (1..60).map(term).sum::<f64>() / x.len() as f64;
        let apart = (sum(lag) / power - own).abs() / variance.max(0.25 / x.len() as f64).sqrt();
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
        correlations(
            &mut c,
            "noise (standard deviations of chance)",
            text(case, "id"),
            &v,
            &list(&case["autocorrelation"]),
        );
    }
    for case in file["rbs"].as_array().unwrap() {
        let band = list(&case["band"]);
        let u = Rbs { band: [band[0], band[1]], ..Rbs::default() }
            .generate(DRAWN, &mut rng(8))
            .unwrap();
        correlations(
            &mut c,
            "rbs (standard deviations of chance)",
            text(case, "id"),
            &u,
            &list(&case["autocorrelation"]),
        );
    }
    c.finish();
}

/// A case of golden/equations; its model is read as it stands, since the order of its tables counts.
#[derive(serde::Deserialize)]
struct Plant {
    id: String,
    model: EquationsFile,
    time_s: Vec<f64>,
    u: Vec<Vec<f64>>,
    x: Vec<Vec<f64>>,
}

#[derive(serde::Deserialize)]
struct Plants {
    cases: Vec<Plant>,
}

/// Extrapolated differences of a sixth-order error, whose own rounding is some 1e-11 of the largest derivative of a column.
const DIFFERENCES: f64 = 1e-7;

#[test]
fn jacobians_of_equations_agree_with_extrapolated_differences() {
    let file = golden("ode", "reference.json");
    let path =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/equations/reference.json");
    let plants: Plants = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let mut c = Comparison::new("ode/reference.json jacobians");
    for case in file["jacobians"].as_array().unwrap() {
        let plant = plants.cases.iter().find(|p| p.id == text(case, "case")).unwrap();
        let equations = plant.model.equations().unwrap();
        let (sample, mut workspace, p) =
            (count(case, "sample"), equations.workspace(), equations.nominal());
        let (t, x, u) = (plant.time_s[sample], &plant.x[sample], &plant.u[sample]);
        let n = x.len();
        for (key, wrt) in
            [("states", Wrt::States), ("inputs", Wrt::Inputs), ("parameters", Wrt::Parameters)]
        {
            let expected = matrix(&case[key]);
            let (mut f, mut g) = (
                DMatrix::zeros(n, expected.ncols()),
                DMatrix::zeros(expected.nrows() - n, expected.ncols()),
            );
            equations.derivatives_jacobian(wrt, t, x, u, &p, &mut workspace, f.as_mut_slice());
            equations.outputs_jacobian(wrt, t, x, u, &p, &mut workspace, g.as_mut_slice());
            for j in 0..expected.ncols() {
                let got: Vec<f64> = f.column(j).iter().chain(g.column(j).iter()).copied().collect();
                let column: Vec<f64> = expected.column(j).iter().copied().collect();
                c.check(
                    &format!("by {key}"),
                    &format!("{}, column {j}", text(case, "id")),
                    list_apart(&got, &column),
                    DIFFERENCES,
                );
            }
        }
    }
    c.finish();
}

/// dx/dt of the three problems of golden/ode, as its SOURCE.md writes them.
struct Classical<'a>(&'a str);

impl Rhs for Classical<'_> {
    fn dim(&self) -> usize {
        match self.0 {
            "arenstorf" => 4,
            "robertson" => 3,
            _ => 2,
        }
    }

    fn eval(&mut self, t: f64, x: &[f64], dx: &mut [f64]) {
        match self.0 {
            "arenstorf" => {
                let mu = 0.012_277_471;
                let nu = 1.0 - mu;
                let distance = |from: f64| ((x[0] - from).powi(2) + x[1] * x[1]).powf(1.5);
                let (earth, moon) = (distance(-mu), distance(nu));
                dx[0] = x[2];
                dx[1] = x[3];
                dx[2] = x[0] + 2.0 * x[3] - nu * (x[0] + mu) / earth - mu * (x[0] - nu) / moon;
                dx[3] = x[1] - 2.0 * x[2] - nu * x[1] / earth - mu * x[1] / moon;
            }
            "robertson" => {
                let (first, second) = (1e4 * x[1] * x[2], 3e7 * x[1] * x[1]);
                dx[0] = -0.04 * x[0] + first;
                dx[1] = 0.04 * x[0] - first - second;
                dx[2] = second;
            }
            _ => {
                let square = x[0] * x[0] * x[1];
                dx[0] = 1.0 + square - 4.0 * x[0] + 0.2 * (3.0 * t).sin();
                dx[1] = 3.0 * x[0] - square;
            }
        }
    }
}

#[test]
fn steppers_agree_with_scipy_on_stiff_and_other_problems() {
    let file = golden("ode", "reference.json");
    let mut c = Comparison::new("ode/reference.json");
    for case in file["cases"].as_array().unwrap() {
        let id = text(case, "id");
        let (mut rhs, mut x, expected) = (Classical(id), list(&case["x0"]), matrix(&case["x"]));
        // One step's error; a path's is so many times that as the problem amplifies it (Arenstorf's orbit passes the moon).
        let (rtol, within) = if id == "arenstorf" { (1e-12, 1e-6) } else { (1e-10, 1e-8) };
        let mut integrator = Integrator::with_tolerance(x.len(), rtol, 1e-4 * rtol);
        let mut t = 0.0;
        for (row, to) in list(&case["times"]).into_iter().enumerate() {
            integrator.advance(&mut rhs, t, to, &mut x).unwrap_or_else(|e| panic!("{id}: {e}"));
            t = to;
            let scale = expected.row(row).amax();
            let apart = x
                .iter()
                .zip(expected.row(row).iter())
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max)
                / scale;
            c.check(&format!("{id} x"), &format!("t {t}"), apart, within);
        }
        let stiff = integrator.method() == Method::Rosenbrock;
        assert_eq!(stiff, id == "robertson", "{id}: the method that its equations ask for");
    }
    c.finish();
}
