//! Models without states (gains, ideal actuators, equations whose outputs follow their inputs at once): answers, or refusals in words; never a panic.

use deadtime::diagnose::{GapOptions, Mode, diagnose, inspect};
use deadtime::log::{Channel, Log};
use deadtime::model::c2d::CONVERSIONS;
use deadtime::model::{ModelDocument, ModelError, StateSpace, d2c, dlqr, nu_gap};
use deadtime::progress::HowFar;
use deadtime::simulate::{Options, System, lsim};
use deadtime::stop::Stop;
use deadtime::time::SampleTime;
use nalgebra::{Complex, DMatrix};
use proptest::prelude::*;

use crate::gap_hard::document;

const STEP_S: f64 = 0.02;

/// A model file without states, and the gain of its first output for its first input.
#[derive(Debug, Clone)]
struct Drawn {
    text: String,
    inputs: usize,
    gain: f64,
    late: usize,
}

fn names(letter: char, count: usize) -> String {
    let one = |i: usize| format!("{{ name = \"{letter}{i}\" }}");
    (0..count).map(one).collect::<Vec<_>>().join(", ")
}

/// A transfer function that is a constant, empty matrices, or equations with or without empty tables of states.
fn drawn() -> impl Strategy<Value = Drawn> {
    let sign = prop::bool::ANY.prop_map(|up| if up { 1.0 } else { -1.0 });
    (0..6usize, 1..=2usize, 1..=2usize, 0.3..3.0f64, sign, 0..5usize, 0.05..0.5f64).prop_map(|(kind, m, p, size, sign, late, other)| {
        let (m, p) = if kind < 2 { (1, 1) } else { (m, p) };
        let gain = sign * size;
        let head = |kind: &str| {
            let (inputs, outputs, delays) = (names('u', m), names('y', p), vec![format!("{:?}", late as f64 * STEP_S); m].join(", "));
            format!("format = \"deadtime/model@1\"\nname = \"m\"\nkind = \"{kind}\"\ninputs = [{inputs}]\noutputs = [{outputs}]\ninput_delay_s = [{delays}]\n")
        };
        let of = |i: usize, j: usize| if (i, j) == (0, 0) { gain } else { other * (1.0 + i as f64 - j as f64) };
        let sampled = if kind % 2 == 1 { format!("sample_time_s = {STEP_S:?}\n") } else { String::new() };
        let text = match kind {
            0 | 1 => format!("{}{sampled}transfer = [{{ numerator = [{:?}], denominator = [2.0] }}]\n", head("tf"), 2.0 * gain),
            2 | 3 => {
                let row = |i: usize| format!("[{}]", (0..m).map(|j| format!("{:?}", of(i, j))).collect::<Vec<_>>().join(", "));
                let (c, d) = (vec!["[]"; p].join(", "), (0..p).map(row).collect::<Vec<_>>().join(", "));
                format!("{}{sampled}states = []\nA = []\nB = []\nC = [{c}]\nD = [{d}]\n", head("lti"))
            }
            _ => {
                let sum = |i: usize| (0..m).map(|j| format!("({:?})*u{j}", of(i, j))).collect::<Vec<_>>().join(" + ");
                let bent = if kind == 5 { " + 0.1*u0^3" } else { "" };
                let outputs = (0..p).map(|i| format!("y{i} = \"{}{bent}\"\n", sum(i))).collect::<String>();
                let tables = if kind == 5 { "[states]\n[derivatives]\n" } else { "" };
                format!("{}{tables}[output_equations]\n{outputs}", head("equations"))
            }
        };
        Drawn { text, inputs: m, gain, late }
    })
}

/// A log in which every output is the first input times `gain`, so many samples late, with a little noise.
fn log(
    model: &ModelDocument,
    inputs: usize,
    gain: f64,
    late: usize,
    samples: usize,
    seed: u64,
) -> Log {
    let mut state = seed | 1;
    let mut draw = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let mut held = |_| {
        let mut value = 0.0;
        (0..samples)
            .map(|k| {
                if k % 7 == 0 {
                    value = draw();
                }
                value
            })
            .collect::<Vec<f64>>()
    };
    let u: Vec<Vec<f64>> = (0..inputs).map(&mut held).collect();
    let outputs = System::new(model, |_| Ok(0.0)).unwrap().outputs.len();
    let mut channels: Vec<Channel> =
        u.iter().enumerate().map(|(j, u)| Channel::new(format!("u{j}"), None, u.clone())).collect();
    for i in 0..outputs {
        let y = (0..samples).map(|k| gain * u[0][k.saturating_sub(late)] + 0.01 * draw()).collect();
        channels.push(Channel::new(format!("y{i}"), None, y));
    }
    Log::new("drawn", (0..samples).map(|k| STEP_S * k as f64).collect(), channels).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn a_check_answers(model in drawn(), seed in any::<u64>()) {
        let file = document(&model.text);
        let logs = [log(&file, model.inputs, model.gain, model.late, 300, seed)];
        let found = inspect(&file, &logs, &Stop::default(), &HowFar::default());
        prop_assert!(found.is_ok(), "{}: {:?}", model.text, found.err());
    }

    #[test]
    fn what_is_asked_of_matrices_without_rows_or_columns_is_answered_or_refused(
        (n, m, p) in (0..=1usize, 0..=2usize, 0..=2usize), gain in -3.0..3.0f64, method in 0..CONVERSIONS.len(),
    ) {
        let [a, b, c, d] = [(n, n, -1.0), (n, m, 1.0), (p, n, 1.0), (p, m, gain)].map(|(rows, columns, v)| DMatrix::from_element(rows, columns, v));
        let sys = StateSpace::continuous(a, b.clone(), c, d).unwrap();
        prop_assert_eq!(sys.poles(), vec![Complex::new(-1.0, 0.0); n]);
        prop_assert!(sys.is_stable() && sys.zeros().len() <= n);
        prop_assert_eq!(sys.frequency_response(3.0).shape(), (p, m));
        prop_assert_eq!(sys.dc_gain().shape(), (p, m));
        let (norm, within) = (sys.norm_hinf().gain, sys.norm_linf([0.1, 5.0]).unwrap().gain);
        prop_assert!(norm.is_finite() && within <= norm * (1.0 + 1e-8), "{} {}", norm, within);
        let apart = nu_gap(&sys, &sys).unwrap();
        prop_assert!(apart.value < 1e-7, "{:?}", apart);
        match sys.transfer_function(0, 0) {
            Ok(pair) => prop_assert_eq!(pair.poles().len(), n),
            Err(e) => prop_assert!(m * p == 0 || matches!(e, ModelError::ZeroTransfer { .. }), "{}", e),
        }
        let weight = |size: usize| DMatrix::<f64>::identity(size, size);
        let regulated = dlqr(sys.a(), &b, &weight(n), &weight(m), None);
        prop_assert!(regulated.is_ok() || n == 1, "{:?}", regulated.err());
        let conversion = CONVERSIONS[method].with(serde_json::json!({})).unwrap();
        let ts = SampleTime::new(STEP_S).unwrap();
        let u = DMatrix::from_element(5, m, 1.0);
        prop_assert_eq!(lsim(&sys, &u, ts, &Options::default()).unwrap().y.shape(), (5, p));
        if let Ok(sampled) = conversion.c2d(&sys, ts) {
            prop_assert!(sampled.is_stable() && sampled.with_delays_as_states().is_ok());
            prop_assert!((sampled.norm_hinf().gain.is_finite()) && nu_gap(&sampled, &sampled).unwrap().value < 1e-7);
            prop_assert_eq!(lsim(&sampled, &u, ts, &Options::default()).unwrap().y.shape(), (5, p));
            prop_assert!(d2c(&sampled).is_ok() || n == 1);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, ..ProptestConfig::default() })]

    #[test]
    #[ignore = "nightly: a diagnosis in every mode"]
    fn a_gap_is_diagnosed_in_every_mode(model in drawn(), seed in any::<u64>(), late in 3..8usize) {
        let file = document(&model.text);
        let logs = [log(&file, model.inputs, model.gain, model.late + late, 240, seed)];
        for (prediction, horizon) in [(None, None), (Some(Mode::Predictor), None), (None, Some(10))] {
            let options = GapOptions { prediction, horizon, ..GapOptions::default() };
            let found = diagnose(&file, &logs, &[], &options, &|_| ());
            prop_assert!(found.is_ok(), "{:?} {:?} {}: {:?}", prediction, horizon, model.text, found.err().map(|e| e.to_string()));
        }
    }
}

/// Every command that takes a model does its work, or names what it needs.
#[cfg(feature = "cli")]
#[test]
fn every_command_of_the_program_answers_or_refuses_in_words() {
    use crate::support::program::{Folder, deadtime, text};
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;

    let mut runner = TestRunner::deterministic();
    let (mut linear, mut nonlinear) = (0, 0);
    for _ in 0..5 {
        let model = drawn().new_tree(&mut runner).unwrap().current();
        let file = document(&model.text);
        let folder = Folder::new();
        let path = folder.write("model.toml", &model.text);
        let (first, second, out) =
            (folder.path("first.csv"), folder.path("second.csv"), folder.path("gap"));
        for (path, seed) in [(&first, 1), (&second, 2)] {
            log(&file, model.inputs, model.gain, model.late + 5, 240, seed)
                .write_csv(path)
                .unwrap();
        }
        let [path, first, second, out] = [&path, &first, &second, &out].map(|p| text(p));
        deadtime(&["check", "--model", path, "--log", first]).done();
        deadtime(&["list", "effects", "--model", path]).done();
        deadtime(&["simulate", path, first, "--out", text(&folder.path("simulated.csv"))]).done();
        deadtime(&["gap", "--model", path, "--log", first, "--holdout", second, "--out", out])
            .done();
        deadtime(&["compare", out, out]).done();
        // Refused or not, the words are the program's own.
        let answered = |arguments: &[&str]| {
            let run = deadtime(arguments);
            assert!(matches!(run.code, Some(0 | 2)), "{arguments:?}: {run:?}");
            if run.code == Some(2) {
                run.refused(&["deadtime: "]);
            }
            run.code == Some(0)
        };
        for target in ["domain-randomisation", "transfer-function", "isaaclab", "mujoco"] {
            answered(&["export", out, "--to", target]);
        }
        let converted = CONVERSIONS.iter().filter(|c| {
            answered(&[
                "c2d",
                path,
                "--sample-time",
                "0.02",
                "--method",
                c.name,
                "--input",
                "u0",
                "--output",
                "y0",
            ])
        });
        let converted = converted.count();
        let estimated =
            answered(&["estimate", first, "--model", path, "--input", "u0", "--output", "y0"]);
        answered(&["identify", first, "--structure", path]);
        answered(&["identify", "--structure", path, "--match", path]);
        answered(&["response", first, "--input", "u0", "--output", "y0"]);
        if model.text.contains("equations") {
            nonlinear += 1;
        } else {
            linear += 1;
            assert!(
                estimated && (converted > 0 || model.text.contains("sample_time_s")),
                "{}",
                model.text
            );
        }
    }
    assert!(linear > 0 && nonlinear > 0, "{linear} {nonlinear}");
}
