//! The crate against the golden files: numpy, scipy, python-control and Octave's control package (golden/SCHEMA.md).
//!
//! `cargo test --test golden -- --nocapture` prints the worst disagreement of every field of every file.

use crate::support::compare::{
    Comparison, apart, cases, complex_list, count, golden, list, list_apart, matrix, number,
    points_apart, relative, responses_apart, responses_apart_together, sets_apart, text, tolerance,
    vector,
};
use deadtime::delay::{Experiment, PlantModel, Recording, StateLeastSquares};
use deadtime::identify::{self, Initial, OutputError, Record};
use deadtime::model::c2d::{
    Conversion, Feedthrough, FirstOrderHold, ImpulseInvariant, LeastSquares, Tustin, ZeroOrderHold,
    ZeroPoleMatching,
};
use deadtime::model::{Continuous, ModelError, Sampled, StateSpace, TimeDomain, d2c, dlqr, nu_gap};
use deadtime::simulate::{Hold, Options, Prehistory, lsim};
use deadtime::time::SampleTime;
use nalgebra::{Complex, DMatrix};
use serde_json::Value;
use std::borrow::Cow;

/// The model that a case names, by `key` in `models`.
fn plant(file: &Value, models: &str, key: &str, name: &str) -> StateSpace<Continuous> {
    let plants = file[models].as_array().unwrap();
    let found = plants.iter().find(|p| p[key] == name).unwrap_or_else(|| panic!("no model {name}"));
    let [a, b, c, d] = ["A", "B", "C", "D"].map(|m| matrix(&found[m]));
    StateSpace::continuous(a, b, c, d).unwrap()
}

/// The tolerance of a file for a field, but never more than `ours`.
fn allowed(file: &Value, field: &str, ours: f64) -> f64 {
    let entry = file["tolerance"].get(field).unwrap_or(&file["tolerance"]["default"]);
    entry.as_f64().unwrap_or(ours).min(ours)
}

/// The continuous model of a case: its dynamics, one output if it names one, and its delay.
fn continuous(file: &Value, case: &Value) -> StateSpace<Continuous> {
    let dynamics = text(case, "dynamics");
    let mut sys = plant(file, "plants", "dynamics", dynamics);
    if let Some(output) = case["output"].as_str() {
        let plants = file["plants"].as_array().unwrap();
        let names = &plants.iter().find(|p| p["dynamics"] == dynamics).unwrap()["outputs"];
        let at = names.as_array().unwrap().iter().position(|n| n == output).unwrap();
        sys = sys.pair(at, 0).unwrap();
    }
    let delay_s = number(case, "delay_samples") * number(case, "sample_time_s");
    sys.with_input_delay(vec![delay_s]).unwrap()
}

fn sample_time(case: &Value) -> SampleTime {
    SampleTime::new(number(case, "sample_time_s")).unwrap()
}

/// Matrices where the file has them, the frequency response at all points, the response from rest.
fn compare_sampled(
    c: &mut Comparison,
    file: &Value,
    case: &Value,
    sys: &StateSpace<Sampled>,
    ours: f64,
) {
    let id = text(case, "id");
    for (key, got) in [("A", sys.a()), ("B", sys.b()), ("C", sys.c()), ("D", sys.d())] {
        if !case[key].is_null() {
            c.check(key, id, apart(got, &matrix(&case[key])), allowed(file, key, ours));
        }
    }
    compare_frequency_response(c, file, case, sys, ours);
    if let Some(rows) = case["y"].as_array() {
        let u = list(&file["u"]);
        let u = DMatrix::from_fn(rows.len(), 1, |k, _| u[k]);
        let options = Options { prehistory: Prehistory::Rest, ..Options::default() };
        let got = lsim(sys, &u, sys.sample_time(), &options).unwrap();
        c.check(
            "y (running maximum)",
            id,
            responses_apart(&got.y, &matrix(&case["y"])),
            allowed(file, "y", ours),
        );
    }
}

fn compare_frequency_response(
    c: &mut Comparison,
    file: &Value,
    case: &Value,
    sys: &StateSpace<Sampled>,
    ours: f64,
) {
    let (re, im) = (matrix(&case["h_re"]), matrix(&case["h_im"]));
    let responses: Vec<_> =
        list(&case["omega_rad_s"]).into_iter().map(|w| sys.frequency_response(w)).collect();
    assert_eq!(responses.len(), re.nrows());
    for output in 0..sys.outputs() {
        let got: Vec<_> = responses.iter().map(|h| h[(output, 0)]).collect();
        let expected: Vec<_> =
            (0..re.nrows()).map(|i| Complex::new(re[(i, output)], im[(i, output)])).collect();
        c.check(
            "H (point by point)",
            text(case, "id"),
            points_apart(&got, &expected),
            allowed(file, "h_re", ours),
        );
    }
}

/// Every case of `golden/<name>/reference.json` through one conversion, and octave.json where it is there.
fn conversion(
    name: &str,
    convert: impl Fn(&Value, &StateSpace<Continuous>) -> Result<StateSpace<Sampled>, ModelError>,
) {
    let reference = golden(name, "reference.json");
    let mut c = Comparison::new(&format!("{name}/reference.json"));
    for case in cases(&reference) {
        let converted = convert(case, &continuous(&reference, case));
        if case["h_re"].is_null() {
            // Undefined: the reference says so in a note, ours in an error.
            assert!(
                matches!(converted, Err(ModelError::ImpulseBetweenSamples { .. })),
                "{}",
                text(case, "id")
            );
            continue;
        }
        compare_sampled(&mut c, &reference, case, &converted.unwrap(), tolerance::RELATIVE);
    }
    c.finish();
}

/// octave.json of one conversion; `align` maps Octave's realisation to ours (identity but for Tustin).
fn octave(
    name: &str,
    convert: impl Fn(&Value, &StateSpace<Continuous>) -> StateSpace<Sampled>,
    align: impl Fn(&Value, &str) -> f64,
) {
    let (reference, file) = (golden(name, "reference.json"), golden(name, "octave.json"));
    let mut c = Comparison::new(&format!("{name}/octave.json"));
    for case in cases(&file) {
        let sys = convert(case, &continuous(&reference, case));
        for (key, got) in [("A", sys.a()), ("B", sys.b()), ("C", sys.c()), ("D", sys.d())] {
            if let Some(expected) = case.get(key).filter(|v| !v.is_null()) {
                let expected = matrix(expected) * align(case, key);
                c.check(
                    key,
                    text(case, "id"),
                    apart(got, &expected),
                    allowed(&file, key, tolerance::RELATIVE),
                );
            }
        }
        if case.get("gain").is_some() {
            compare_zeros_poles_gain(&mut c, &file, case, &sys, tolerance::RELATIVE);
        }
        compare_frequency_response(&mut c, &file, case, &sys, tolerance::RELATIVE);
    }
    c.finish();
}

fn compare_zeros_poles_gain(
    c: &mut Comparison,
    file: &Value,
    case: &Value,
    sys: &StateSpace<Sampled>,
    ours: f64,
) {
    let id = text(case, "id");
    let tf = sys.transfer_function(0, 0).unwrap();
    c.check(
        "zeros",
        id,
        sets_apart(tf.zeros(), &complex_list(&case["zeros"])),
        allowed(file, "zeros", ours),
    );
    c.check(
        "poles",
        id,
        sets_apart(tf.poles(), &complex_list(&case["poles"])),
        allowed(file, "poles", ours),
    );
    let gain = number(case, "gain");
    c.check("gain", id, relative(tf.gain() - gain, gain), allowed(file, "gain", ours));
}

#[test]
fn zero_order_hold_agrees_with_scipy_and_with_the_exact_solution_under_delay() {
    conversion("c2d_zoh", |case, sys| ZeroOrderHold {}.c2d(sys, sample_time(case)));
}

#[test]
fn zero_order_hold_agrees_with_octave() {
    octave(
        "c2d_zoh",
        |case, sys| ZeroOrderHold {}.c2d(sys, sample_time(case)).unwrap(),
        |_, _| 1.0,
    );
}

#[test]
fn first_order_hold_agrees_with_scipy_and_with_the_exact_solution_under_delay() {
    conversion("c2d_foh", |case, sys| FirstOrderHold {}.c2d(sys, sample_time(case)));
}

#[test]
fn first_order_hold_agrees_with_octave() {
    octave(
        "c2d_foh",
        |case, sys| FirstOrderHold {}.c2d(sys, sample_time(case)).unwrap(),
        |_, _| 1.0,
    );
}

#[test]
fn impulse_invariance_agrees_with_scipy_with_feedthrough_kept_and_dropped() {
    conversion("c2d_impulse", |case, sys| {
        let feedthrough =
            if text(case, "feedthrough") == "keep" { Feedthrough::Keep } else { Feedthrough::Drop };
        ImpulseInvariant { feedthrough }.c2d(sys, sample_time(case))
    });
}

fn tustin(case: &Value) -> Tustin {
    Tustin {
        prewarp_rad_s: case["prewarp_rad_s"].as_f64(),
        fractional_delay_order: case
            .get("thiran_order")
            .filter(|v| !v.is_null())
            .map_or(0, |_| count(case, "thiran_order")),
    }
}

#[test]
fn tustin_agrees_with_scipy_prewarped_and_with_thiran_delays() {
    conversion("c2d_tustin", |case, sys| tustin(case).c2d(sys, sample_time(case)));
}

/// Octave's B and C are 1/√Ts and √Ts of ours; with prewarping, Ts is the warped one.
#[test]
fn tustin_agrees_with_octave_up_to_the_scale_of_the_state() {
    octave(
        "c2d_tustin",
        |case, sys| tustin(case).c2d(sys, sample_time(case)).unwrap(),
        |case, key| {
            let ts = number(case, "sample_time_s");
            let warped =
                case["prewarp_rad_s"].as_f64().map_or(ts, |w| 2.0 * (w * ts / 2.0).tan() / w);
            match key {
                "B" => warped.sqrt(),
                "C" => 1.0 / warped.sqrt(),
                _ => 1.0,
            }
        },
    );
}

#[test]
fn zero_pole_matching_agrees_with_exact_zeros_poles_and_gain() {
    conversion("c2d_matched", |case, sys| ZeroPoleMatching::default().c2d(sys, sample_time(case)));
    let file = golden("c2d_matched", "reference.json");
    let mut c = Comparison::new("c2d_matched/reference.json");
    for case in cases(&file).iter().filter(|case| !case["gain"].is_null()) {
        let sys =
            ZeroPoleMatching::default().c2d(&continuous(&file, case), sample_time(case)).unwrap();
        compare_zeros_poles_gain(&mut c, &file, case, &sys, tolerance::RELATIVE);
    }
    c.finish();
}

#[test]
fn zero_pole_matching_agrees_with_octave() {
    octave(
        "c2d_matched",
        |case, sys| ZeroPoleMatching::default().c2d(sys, sample_time(case)).unwrap(),
        |_, _| 1.0,
    );
}

#[test]
fn least_squares_reaches_the_smallest_minimum_known() {
    let file = golden("c2d_least_squares", "reference.json");
    let mut c = Comparison::new("c2d_least_squares/reference.json");
    for case in cases(&file) {
        let id = text(case, "id");
        let plant = continuous(&file, case);
        let converted = LeastSquares::default().c2d(&plant, sample_time(case));
        if case["attained"] == false {
            if !matches!(converted, Err(ModelError::NotConverged { .. })) {
                c.fail(format!("{id}: the infimum is not attained, but a model came back"));
            }
            continue;
        }
        match converted {
            Err(error) => c.fail(format!("{id}: {error}")),
            Ok(sys) => {
                c.check(
                    "J",
                    id,
                    relative(cost(&plant, &sys) - number(case, "J"), number(case, "J")),
                    allowed(&file, "J", tolerance::RELATIVE),
                );
                compare_sampled(&mut c, &file, case, &sys, tolerance::RELATIVE);
                compare_zeros_poles_gain(&mut c, &file, case, &sys, tolerance::RELATIVE);
            }
        }
    }
    c.finish();
}

/// The mean of |G − H|² over 200 frequencies.
fn cost(plant: &StateSpace<Continuous>, sys: &StateSpace<Sampled>) -> f64 {
    let nyquist = sys.sample_time().nyquist_rad_s();
    let squares = (0..200).map(|i| (f64::from(i) + 0.5) * nyquist / 200.0);
    squares
        .map(|w| {
            (plant.frequency_response(w)[(0, 0)] - sys.frequency_response(w)[(0, 0)]).norm_sqr()
        })
        .sum::<f64>()
        / 200.0
}

#[test]
fn d2c_finds_the_continuous_model_behind_a_zero_order_hold() {
    let file = golden("d2c_zoh", "reference.json");
    let mut c = Comparison::new("d2c_zoh/reference.json");
    for case in cases(&file) {
        let [a, b, cm, d] =
            ["sampled_A", "sampled_B", "sampled_C", "sampled_D"].map(|m| matrix(&case[m]));
        let sys = d2c(&StateSpace::sampled(a, b, cm, d, sample_time(case)).unwrap()).unwrap();
        for (key, got) in [("A", sys.a()), ("B", sys.b()), ("C", sys.c()), ("D", sys.d())] {
            c.check(key, text(case, "id"), apart(got, &matrix(&case[key])), tolerance::RELATIVE);
        }
    }
    c.finish();
}

/// What a simulation case asks for.
fn simulation(case: &Value) -> Options {
    Options {
        initial: Some(vector(&case["x0"])),
        hold: if case["hold"] == "linear" { Hold::Linear } else { Hold::Zero },
        prehistory: if text(case, "prehistory") == "rest" {
            Prehistory::Rest
        } else {
            Prehistory::Held
        },
    }
}

#[test]
fn simulations_agree_with_scipy_and_with_the_exact_solution_under_delay() {
    let file = golden("lsim", "reference.json");
    let mut c = Comparison::new("lsim/reference.json");
    for case in cases(&file) {
        let (id, u, options) = (text(case, "id"), matrix(&case["u"]), simulation(case));
        let (x, y) = (matrix(&case["x"]), matrix(&case["y"]));
        // The reference's matrix exponential couples blocks that have nothing to do with each other by 1e-17 (golden/lsim/SOURCE.md): beside
        // unstable states that reach 1e12, the stable ones of the whole vehicle are compared with the largest of all states up to the sample.
        let whole = text(case, "model") == "uav";
        let far = |got: &DMatrix<f64>, expected: &DMatrix<f64>| {
            if whole {
                responses_apart_together(got, expected)
            } else {
                responses_apart(got, expected)
            }
        };
        let mut compare = |how: &str, response: deadtime::simulate::Response| {
            let how = format!("{how}{}", if whole { " uav" } else { "" });
            c.check(
                &format!("{how} y (running maximum)"),
                id,
                far(&response.y, &y),
                allowed(&file, "y", tolerance::RELATIVE),
            );
            c.check(
                &format!("{how} x (running maximum)"),
                id,
                far(&response.x, &x),
                allowed(&file, "x", tolerance::RELATIVE),
            );
        };
        if text(case, "time") == "sampled" {
            let [a, b, cm, d] =
                ["sampled_A", "sampled_B", "sampled_C", "sampled_D"].map(|m| matrix(&case[m]));
            let delays = list(&case["delay_samples"]).into_iter().map(|d| d as usize).collect();
            let sys = StateSpace::sampled(a, b, cm, d, sample_time(case))
                .unwrap()
                .with_input_delay(delays)
                .unwrap();
            compare(
                "lsim of a sampled model",
                lsim(&sys, &u, sample_time(case), &options).unwrap(),
            );
        } else {
            let sys = plant(&file, "models", "dynamics", text(case, "model"))
                .with_input_delay(list(&case["delay_s"]))
                .unwrap();
            compare("lsim", lsim(&sys, &u, sample_time(case), &options).unwrap());
            let time_s: Vec<f64> =
                (0..u.nrows()).map(|k| k as f64 * number(case, "sample_time_s")).collect();
            compare("lsim at uneven times", lsim(&sys, &u, time_s.as_slice(), &options).unwrap());
        }
    }
    c.finish();
}

/// What the golden file cannot show of the whole vehicle: its stable states beside the unstable ones, digit by digit.
#[test]
fn the_whole_vehicle_moves_as_its_four_dynamics_do() {
    use deadtime::model::uav::{self, Dynamics};
    let file = golden("lsim", "reference.json");
    let mut c = Comparison::new("lsim of the whole vehicle against its parts");
    for case in
        cases(&file).iter().filter(|case| case["model"] == "uav" && case["time"] == "continuous")
    {
        let (id, u, options, ts) =
            (text(case, "id"), matrix(&case["u"]), simulation(case), sample_time(case));
        let delay_s = list(&case["delay_s"]);
        let whole =
            lsim(&uav::model().with_input_delay(delay_s.clone()).unwrap(), &u, ts, &options)
                .unwrap();
        let mut at = 0;
        for (input, dynamics) in Dynamics::ALL.into_iter().enumerate() {
            let n = dynamics.states().len();
            let part = dynamics.model().with_input_delay(vec![delay_s[input]]).unwrap();
            let initial = options.initial.as_ref().map(|x| x.rows(at, n).into_owned());
            let alone = lsim(
                &part,
                &u.columns(input, 1).into_owned(),
                ts,
                &Options { initial, ..options.clone() },
            )
            .unwrap();
            c.check(
                "x (running maximum)",
                id,
                responses_apart(&whole.x.columns(at, n).into_owned(), &alone.x),
                tolerance::RELATIVE,
            );
            at += n;
        }
    }
    c.finish();
}

/// K, S and E of every case; `problems` holds A, B, Q, R, N under the same ids.
fn regulators(name: &str, answers: &str) {
    let (problems, file) = (golden(name, "reference.json"), golden(name, answers));
    let mut c = Comparison::new(&format!("{name}/{answers}"));
    for (case, problem) in cases(&file).iter().zip(cases(&problems)) {
        let id = text(case, "id");
        assert_eq!(id, text(problem, "id"));
        let [a, b, q, r, n] = ["A", "B", "Q", "R", "N"].map(|m| matrix(&problem[m]));
        let solution = dlqr(&a, &b, &q, &r, Some(&n)).unwrap_or_else(|e| panic!("{id}: {e}"));
        c.check(
            "K",
            id,
            apart(&solution.k, &matrix(&case["K"])),
            allowed(&file, "K", tolerance::RELATIVE),
        );
        c.check(
            "S",
            id,
            apart(&solution.x, &matrix(&case["S"])),
            allowed(&file, "S", tolerance::RELATIVE),
        );
        let poles = sets_apart(&solution.poles, &complex_list(&case["E"]));
        c.check("E", id, poles, allowed(&file, "E", tolerance::RELATIVE));
        if n.amax() == 0.0 {
            let without = dlqr(&a, &b, &q, &r, None).unwrap();
            c.check("K without N", id, apart(&without.k, &solution.k), 1e-14);
        }
    }
    c.finish();
}

#[test]
fn regulators_of_the_four_dynamics_agree_with_scipy() {
    regulators("dlqr", "reference.json");
}

#[test]
fn regulators_of_the_four_dynamics_agree_with_octave() {
    regulators("dlqr", "octave.json");
}

#[test]
fn regulators_of_200_random_systems_agree_with_scipy() {
    regulators("dlqr_random", "reference.json");
}

/// The stored A and B of a regulator case are those of our own conversions.
#[test]
fn the_realisations_of_the_regulator_cases_are_ours() {
    let (file, models) = (golden("dlqr", "reference.json"), golden("c2d_zoh", "reference.json"));
    let mut c = Comparison::new("dlqr/reference.json");
    for case in cases(&file) {
        let sys = plant(&models, "plants", "dynamics", text(case, "dynamics"));
        let ts = sample_time(case);
        let sampled = match text(case, "method") {
            "zoh" => ZeroOrderHold {}.c2d(&sys, ts),
            "foh" => FirstOrderHold {}.c2d(&sys, ts),
            "tustin" => Tustin::default().c2d(&sys, ts),
            "impulse" => ImpulseInvariant::default().c2d(&sys, ts),
            other => panic!("{other}"),
        };
        let sampled = sampled.unwrap();
        let id = text(case, "id");
        c.check(
            "A",
            id,
            apart(sampled.a(), &matrix(&case["A"])),
            allowed(&file, "A", tolerance::RELATIVE),
        );
        c.check(
            "B",
            id,
            apart(sampled.b(), &matrix(&case["B"])),
            allowed(&file, "B", tolerance::RELATIVE),
        );
    }
    c.finish();
}

fn record(file: &Value) -> [Record<'static>; 1] {
    [Record::new(list(&file["u"]), list(&file["y"]))]
}

#[test]
fn arx_losses_and_coefficients_agree_with_numpy_for_every_delay() {
    let file = golden("regression", "reference.json");
    let mut c = Comparison::new("regression/reference.json arx");
    let arx = &file["arx"];
    let (na, nb) = (count(arx, "na"), count(arx, "nb"));
    let entries = arx["scan"].as_array().unwrap();
    let scan = identify::arx_scan(&record(&file), na, nb, entries.len() - 1);
    assert_eq!(scan.rows, count(arx, "rows"));
    for (nk, entry) in entries.iter().enumerate() {
        let id = format!("nk {nk}");
        let coefficients = &scan.coefficients[nk];
        let a: Vec<f64> = coefficients[..na].iter().map(|v| -v).collect();
        c.check(
            "loss",
            &id,
            relative(scan.loss[nk] - number(entry, "loss"), number(entry, "loss")),
            tolerance::RELATIVE,
        );
        c.check("a", &id, list_apart(&a, &list(&entry["a"])), tolerance::RELATIVE);
        c.check("b", &id, list_apart(&coefficients[na..], &list(&entry["b"])), tolerance::RELATIVE);
    }
    c.finish();
}

#[test]
fn the_impulse_response_and_its_standard_deviation_agree_with_numpy() {
    let file = golden("regression", "reference.json");
    let mut c = Comparison::new("regression/reference.json fir");
    let expected = &file["fir"];
    let taps = list(&expected["taps"]);
    let fir = identify::fir(&record(&file), taps.len()).unwrap();
    assert_eq!(fir.rows, count(expected, "rows"));
    c.check("taps", "", list_apart(fir.coefficients.as_slice(), &taps), tolerance::RELATIVE);
    let variance = number(expected, "variance");
    c.check("variance", "", relative(fir.variance - variance, variance), tolerance::RELATIVE);
    let deviation: Vec<f64> = fir.covariance.diagonal().iter().map(|v| v.sqrt()).collect();
    c.check(
        "standard_deviation",
        "",
        list_apart(&deviation, &list(&expected["standard_deviation"])),
        tolerance::RELATIVE,
    );
    c.finish();
}

/// Every delay of an output-error scan; where the minimum is clear its loss, b, F and start, elsewhere that the loss is as small as any found.
fn output_error(key: &str, initial: Initial) {
    let file = golden("regression", "reference.json");
    let mut c = Comparison::new(&format!("regression/reference.json {key}"));
    let entries = file[key].as_array().unwrap();
    let orders = OutputError { nb: 1, nf: 2, initial };
    let records = record(&file);
    let scan = orders.scan(&records, entries.len() - 1);
    for (nk, entry) in entries.iter().enumerate() {
        let id = format!("nk {nk}");
        let fit = scan[nk].as_ref().unwrap();
        if entry["determined"] == false {
            let excess = fit.loss / number(entry, "loss_bound") - 1.0;
            c.check("loss above the bound", &id, excess.max(0.0), tolerance::OE_LOSS_BOUND);
            continue;
        }
        let loss = number(entry, "loss");
        c.check("loss", &id, relative(fit.loss - loss, loss), tolerance::RELATIVE);
        c.check(
            "b",
            &id,
            relative(fit.b[0] - number(entry, "b"), number(entry, "b")),
            tolerance::OE_DENOMINATOR,
        );
        c.check("f", &id, list_apart(&fit.f, &list(&entry["f"])), tolerance::OE_DENOMINATOR);
        if initial == Initial::Estimated {
            // F(q) applied to the model's output without the input's part leaves the start.
            let residual = orders.residuals(&records, nk, &fit.f).unwrap();
            let model: Vec<f64> = records[0].y.iter().zip(&residual).map(|(y, e)| y - e).collect();
            let input = |t: usize| if t >= nk { fit.b[0] * records[0].u[t - nk] } else { 0.0 };
            let start = [model[0] - input(0), model[1] + fit.f[0] * model[0] - input(1)];
            c.check(
                "initial",
                &id,
                list_apart(&start, &list(&entry["initial"])),
                tolerance::OE_INITIAL,
            );
        }
    }
    c.finish();
}

#[test]
fn output_error_fits_from_rest_agree_with_the_polished_global_search() {
    output_error("oe_zero", Initial::Zero);
}

#[test]
fn output_error_fits_with_estimated_start_agree_with_the_polished_global_search() {
    output_error("oe_estimated", Initial::Estimated);
}

#[test]
fn state_least_squares_coefficients_agree_with_numpy() {
    let file = golden("regression", "reference.json");
    let expected = &file["state_least_squares"];
    let mut c = Comparison::new("regression/reference.json state_least_squares");
    let (a, b, u, x) = (
        matrix(&expected["A"]),
        matrix(&expected["B"]),
        matrix(&expected["u"]),
        matrix(&expected["x"]),
    );
    let (n, m) = b.shape();
    let ts = SampleTime::new(1.0).unwrap();
    let columns = |m: &DMatrix<f64>| {
        m.column_iter()
            .map(|c| c.iter().copied().collect::<Vec<f64>>().into())
            .collect::<Vec<Cow<'static, [f64]>>>()
    };
    let states = columns(&x);
    let recording =
        Recording { inputs: columns(&u), outputs: vec![states[0].clone().into()], states };
    let inputs = (0..m).map(|j| format!("u{j}")).collect();
    let plant =
        StateSpace::sampled(a, b, DMatrix::identity(n, n), DMatrix::zeros(n, m), ts).unwrap();
    let experiment = Experiment::new(ts, inputs, vec!["x0".into()], vec![recording])
        .unwrap()
        .with_model(PlantModel::Sampled(plant));
    let lags = count(expected, "lags");
    let found = StateLeastSquares::default().coefficients(&experiment, lags - 1).unwrap();
    assert_eq!(found.rows, count(expected, "rows"));
    c.check("gamma", "", apart(&found.gamma, &matrix(&expected["gamma"])), tolerance::RELATIVE);
    c.check(
        "sse",
        "",
        relative(found.residual - number(expected, "sse"), number(expected, "sse")),
        tolerance::RELATIVE,
    );
    for (input, delay) in list(&expected["delay_samples"]).into_iter().enumerate() {
        let largest = found.gamma.row(input).transpose().argmax().0 as f64;
        assert_eq!(largest, delay, "input {input}");
    }
    c.finish();
}

#[test]
fn poles_zeros_transfer_functions_and_relative_degrees_agree_with_exact_arithmetic() {
    let file = golden("zeros", "reference.json");
    let mut c = Comparison::new("zeros/reference.json");
    for case in cases(&file) {
        let id = text(case, "id");
        let [a, b, cm, d] = ["A", "B", "C", "D"].map(|m| matrix(&case[m]));
        let sys = StateSpace::continuous(a, b, cm, d).unwrap();
        c.check(
            "poles",
            id,
            sets_apart(&sys.poles(), &complex_list(&case["poles"])),
            allowed(&file, "poles", tolerance::RELATIVE),
        );
        c.check(
            "zeros",
            id,
            sets_apart(&sys.zeros(), &complex_list(&case["zeros"])),
            allowed(&file, "zeros", tolerance::RELATIVE),
        );
        for output in 0..sys.outputs() {
            for input in 0..sys.inputs() {
                let degree = case["relative_degree"][output][input]
                    .as_u64()
                    .map(|d| usize::try_from(d).unwrap());
                assert_eq!(sys.relative_degree(output, input), degree, "{id} {output} {input}");
                if degree.is_none() {
                    continue;
                }
                let tf = sys.transfer_function(output, input).unwrap();
                let denominator = list(&case["denominator"]);
                c.check(
                    "denominator",
                    id,
                    list_apart(&tf.denominator(), &denominator),
                    allowed(&file, "denominator", tolerance::RELATIVE),
                );
                let mut numerator = tf.numerator();
                while numerator.len() < denominator.len() {
                    numerator.insert(0, 0.0);
                }
                let expected = list(&case["numerators"][output][input]);
                c.check(
                    "numerator",
                    id,
                    list_apart(&numerator, &expected),
                    allowed(&file, "numerators", tolerance::RELATIVE),
                );
            }
        }
    }
    c.finish();
}

#[test]
fn largest_gains_and_nu_gaps_agree_with_slycot_and_with_dense_grids() {
    let file = golden("norms", "reference.json");
    let mut c = Comparison::new("norms/reference.json");
    let (mut apart_by_turns, mut unstable) = (0, 0);
    for case in cases(&file) {
        let [a, b, cm, d] = ["A", "B", "C", "D"].map(|m| [&case[m], &case["other"][m]].map(matrix));
        let pair = |k: usize| (a[k].clone(), b[k].clone(), cm[k].clone(), d[k].clone());
        let ts = number(case, "sample_time_s");
        if ts > 0.0 {
            let model = |(a, b, c, d)| {
                StateSpace::sampled(a, b, c, d, SampleTime::new(ts).unwrap()).unwrap()
            };
            unstable += norms(&file, &mut c, case, [model(pair(0)), model(pair(1))]);
        } else {
            let model = |(a, b, c, d)| StateSpace::continuous(a, b, c, d).unwrap();
            unstable += norms(&file, &mut c, case, [model(pair(0)), model(pair(1))]);
        }
        apart_by_turns +=
            usize::from(case["winds_alike"] == false && number(case, "pointwise") < 0.99);
    }
    assert!(apart_by_turns > 2 && unstable > 10, "{apart_by_turns} {unstable}");
    c.finish();
}

/// Whether the model is unstable, as a number.
fn norms<T: TimeDomain>(
    file: &Value,
    c: &mut Comparison,
    case: &Value,
    [sys, other]: [StateSpace<T>; 2],
) -> usize {
    let id = text(case, "id");
    let band = list(&case["band_rad_s"]);
    let gain = |band: [f64; 2]| sys.norm_linf(band).unwrap().gain;
    let against =
        |value: f64, key: &str| relative((value - number(case, key)).abs(), number(case, key));
    c.check("gain", id, against(gain([0.0, f64::INFINITY]), "gain"), allowed(file, "gain", 1e-9));
    c.check(
        "gain_in_band",
        id,
        against(gain([band[0], band[1]]), "gain_in_band"),
        allowed(file, "gain_in_band", 1e-8),
    );
    for (one, two) in [(&sys, &other), (&other, &sys)] {
        c.check(
            "nu_gap",
            id,
            against(nu_gap(one, two).unwrap().value, "nu_gap"),
            allowed(file, "nu_gap", 1e-8),
        );
    }
    let whole = if sys.is_stable() { number(case, "gain") } else { f64::INFINITY };
    assert!(
        (sys.norm_hinf().gain / whole - 1.0).abs() < 1e-9 || sys.norm_hinf().gain == whole,
        "{id}"
    );
    usize::from(!sys.is_stable())
}
