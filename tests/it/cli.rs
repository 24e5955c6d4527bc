//! The built program: files it writes, jobs that follow each other, and how it behaves in a pipe.

use approx::assert_abs_diff_eq;
use std::process::{Command, Stdio};

use crate::support::program::{Folder, deadtime, text};
use deadtime::delay::{METHODS, Scope};
use deadtime::diagnose::Criteria;
use deadtime::log::{Channel, Log, read};
use deadtime::model::c2d::{CONVERSIONS, Conversion, ZeroOrderHold};
use deadtime::model::uav::{self, Dynamics};
use deadtime::model::{self, ModelFile, State};
use deadtime::signal::EXCITATIONS;
use deadtime::simulate::{Options, lsim};
use deadtime::time::SampleTime;
use nalgebra::DMatrix;
use serde_json::Value;

/// The model file of one of the vehicle's dynamics, or of all.
fn vehicle(
    folder: &Folder,
    name: &str,
    which: &[Dynamics],
    delays_s: &[f64],
) -> std::path::PathBuf {
    let sys = if which.len() == 1 { which[0].model() } else { uav::model() };
    let sys = sys.with_input_delay(delays_s.to_vec()).unwrap();
    let channel = |name: &str, unit: &str| model::Channel::plain(name, Some(unit));
    let inputs = which.iter().map(|d| channel(d.input(), "1")).collect();
    let states = which
        .iter()
        .flat_map(|d| d.states())
        .map(|(n, u)| State { name: (*n).into(), unit: Some((*u).into()) })
        .collect();
    let outputs = which.iter().flat_map(|d| d.outputs()).map(|(n, u)| channel(n, u)).collect();
    let path = folder.path(name);
    ModelFile::from_continuous("vehicle", &sys, inputs, states, outputs)
        .unwrap()
        .write(&path)
        .unwrap();
    path
}

/// A log of random binary inputs under these names.
fn inputs(
    folder: &Folder,
    name: &str,
    channels: &[&str],
    samples: usize,
    ts_s: f64,
) -> std::path::PathBuf {
    let path = folder.path(name);
    let mut all = Vec::new();
    for (seed, channel) in (1..).zip(channels) {
        let one = folder.path("one.csv");
        let (seed, samples, ts_s) = (format!("{seed}"), format!("{samples}"), format!("{ts_s}"));
        deadtime(&[
            "excite",
            "rbs",
            "--samples",
            &samples,
            "--sample-time",
            &ts_s,
            "--seed",
            &seed,
            "--channel",
            channel,
            "--out",
            text(&one),
        ])
        .done();
        all.push(read(&one).unwrap());
        std::fs::remove_file(one).unwrap();
    }
    let columns = all
        .iter()
        .zip(channels)
        .map(|(log, c)| Channel::new(*c, None, log.input(c).unwrap().to_vec()))
        .collect();
    Log::new("inputs", all[0].time_s().to_vec(), columns).unwrap().write_csv(&path).unwrap();
    path
}

fn json(path: &std::path::Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn keys(value: &Value) -> Vec<&str> {
    let mut keys: Vec<&str> = value.as_object().unwrap().keys().map(String::as_str).collect();
    keys.sort_unstable();
    keys
}

fn number_or_null(value: &Value) -> bool {
    value.is_null() || value.as_f64().is_some_and(f64::is_finite)
}

/// The keys and types of deadtime/estimate@1, all of them and no other.
fn assert_estimate_format(report: &Value) {
    assert_eq!(keys(report), ["format", "log", "max_delay_s", "pairs", "sample_time_s"]);
    assert_eq!(report["format"], "deadtime/estimate@1");
    assert!(
        report["log"].is_string()
            && report["sample_time_s"].as_f64().unwrap() > 0.0
            && report["max_delay_s"].as_f64().unwrap() > 0.0
    );
    for pair in report["pairs"].as_array().unwrap() {
        assert_eq!(keys(pair), ["estimates", "input", "output", "verdict"]);
        assert!(pair["input"].is_string() && pair["output"].is_string());
        let verdict = &pair["verdict"];
        assert_eq!(keys(verdict), ["ci95_s", "delay_s", "why"]);
        assert!(
            number_or_null(&verdict["delay_s"]) && verdict["why"].as_str().unwrap().len() > 10,
            "{verdict}"
        );
        assert_eq!(verdict["delay_s"].is_null(), verdict["ci95_s"].is_null(), "{verdict}");
        for e in pair["estimates"].as_array().unwrap() {
            let names = [
                "ci95_s",
                "degree_bias_samples",
                "delay_s",
                "method",
                "note",
                "outcome",
                "predicted_std_s",
                "raw_delay_s",
                "std_s",
                "time_s",
            ];
            assert_eq!(keys(e), names);
            assert!(METHODS.iter().any(|m| e["method"] == m.entry.name), "{e}");
            let outcome = e["outcome"].as_str().unwrap();
            let outcomes = [
                "found",
                "at_edge",
                "not_visible",
                "not_rich_enough",
                "singular",
                "not_converged",
                "flat",
                "not_applicable",
            ];
            assert!(outcomes.contains(&outcome), "{e}");
            assert_eq!(e["delay_s"].is_f64(), ["found", "at_edge"].contains(&outcome), "{e}");
            for key in ["delay_s", "std_s", "raw_delay_s"] {
                assert!(number_or_null(&e[key]), "{key}: {e}");
            }
            match &e["ci95_s"] {
                Value::Null => {}
                Value::Array(ends) => assert!(
                    ends.len() == 2 && ends[0].as_f64().unwrap() <= ends[1].as_f64().unwrap(),
                    "{e}"
                ),
                other => panic!("{other}"),
            }
            assert!(
                e["degree_bias_samples"].is_u64() && (e["note"].is_null() || e["note"].is_string()),
                "{e}"
            );
            assert!(e["time_s"].as_f64().unwrap() >= 0.0, "{e}");
        }
    }
}

#[test]
fn the_estimate_file_has_the_keys_of_its_format_and_a_pair_for_every_input_and_output() {
    estimate_file(&["oestruc", "arxstruc", "p1d"]);
}

#[test]
#[ignore = "nightly: every method for four pairs"]
fn the_estimate_file_has_every_method() {
    estimate_file(&[]);
}

/// Of these methods, or without any, of all.
fn estimate_file(methods: &[&str]) {
    let folder = Folder::new();
    let model = vehicle(&folder, "vehicle.toml", &[Dynamics::Directional], &[0.3]);
    let log = inputs(&folder, "in.csv", &["delta_dir"], 400, 0.1);
    let flight = folder.path("flight.csv");
    deadtime(&[
        "simulate",
        text(&model),
        text(&log),
        "--states",
        "--snr",
        "1e4",
        "--out",
        text(&flight),
    ])
    .done();
    let read_back = read(&flight).unwrap();
    // A second input and a second output that have nothing to do with the first.
    let noise = inputs(&folder, "noise.csv", &["x", "idle", "hum"], 400, 0.1);
    let noise = read(&noise).unwrap();
    let with = |name: &str| Channel::new(name, None, noise.input(name).unwrap().to_vec());
    let columns = read_back.channels().cloned().chain([with("idle"), with("hum")]).collect();
    Log::new("wide", read_back.time_s().to_vec(), columns).unwrap().write_csv(&flight).unwrap();
    let file = folder.path("out.json");
    let two = ["--input", "delta_dir", "--input", "idle", "--output", "r", "--output", "hum"];
    let run = |more: &[&str]| {
        let arguments =
            [&["estimate", text(&flight)], &two[..], more, &["--json", text(&file)]].concat();
        let out = deadtime(&arguments).done();
        let report = json(&file);
        assert_estimate_format(&report);
        (out, report)
    };
    let named = |report: &Value| -> Vec<(String, String)> {
        let name = |p: &Value, key: &str| p[key].as_str().unwrap().to_owned();
        report["pairs"]
            .as_array()
            .unwrap()
            .iter()
            .map(|p| (name(p, "input"), name(p, "output")))
            .collect()
    };
    let product = [("delta_dir", "r"), ("idle", "r"), ("delta_dir", "hum"), ("idle", "hum")]
        .map(|(a, b)| (a.to_owned(), b.to_owned()));
    let chosen: Vec<&str> = methods.iter().flat_map(|m| ["--method", m]).collect();
    let (out, report) = run(&chosen);
    let mut pairs = named(&report);
    pairs.sort();
    let mut expected = product.to_vec();
    expected.sort();
    assert_eq!(pairs, expected);
    assert!(
        out.split_whitespace().collect::<Vec<_>>().join(" ").contains("assumed relative degree 1"),
        "{out}"
    );
    let all = METHODS.iter().filter(|m| m.scope == Scope::Pair).map(|m| m.entry.name);
    let of_pairs: Vec<&str> =
        all.filter(|name| methods.is_empty() || methods.contains(name)).collect();
    for pair in report["pairs"].as_array().unwrap() {
        let methods: Vec<&str> = pair["estimates"]
            .as_array()
            .unwrap()
            .iter()
            .map(|e| e["method"].as_str().unwrap())
            .collect();
        assert_eq!(methods, of_pairs);
        let real = pair["input"] == "delta_dir" && pair["output"] == "r";
        let delay_s = pair["verdict"]["delay_s"].as_f64();
        assert_eq!(delay_s.is_some(), real, "{pair}");
        assert!(delay_s.is_none_or(|d| (d - 0.3).abs() < 0.01), "{pair}");
    }
    let (_, report) =
        run(&["--model", text(&model), "--method", "arxstruc", "--method", "state_least_squares"]);
    let mut pairs = named(&report);
    assert_eq!(pairs.pop(), Some(("delta_dir".to_owned(), "*".to_owned())));
    assert_eq!(pairs.len(), 4);
    let states = report["pairs"].as_array().unwrap().last().unwrap();
    assert_eq!(states["estimates"][0]["method"], "state_least_squares");
    assert!((states["verdict"]["delay_s"].as_f64().unwrap() - 0.3).abs() < 0.01, "{states}");
    let (_, report) = run(&[
        "--method",
        "arxstruc",
        "--method",
        "threshold",
        "--degree-bias",
        "0",
        "--max-delay",
        "1.15",
    ]);
    assert!(
        (report["max_delay_s"].as_f64().unwrap() - 1.2).abs() < 1e-12,
        "rounded up to whole samples"
    );
    assert_eq!(report["pairs"][0]["estimates"][0]["degree_bias_samples"], 0);
    assert_abs_diff_eq!(
        report["pairs"][0]["verdict"]["delay_s"].as_f64().unwrap(),
        0.4,
        epsilon = 1e-9
    );
}

#[test]
fn simulate_writes_what_lsim_computes_and_compares_it_with_what_was_measured() {
    let folder = Folder::new();
    let delays = [0.05, 0.0, 0.13, 0.2];
    let file = vehicle(&folder, "vehicle.toml", &Dynamics::ALL, &delays);
    let names = Dynamics::ALL.map(Dynamics::input);
    let log = inputs(&folder, "in.csv", &names, 40, 0.05);
    let out = folder.path("out.csv");
    let says =
        deadtime(&["simulate", text(&file), text(&log), "--states", "--out", text(&out)]).done();
    assert!(
        says.contains("40 samples") && !says.contains("nrmse"),
        "nothing measured, nothing compared: {says}"
    );
    let (input, output) = (read(&log).unwrap(), read(&out).unwrap());
    let u = DMatrix::from_fn(40, 4, |k, j| input.input(names[j]).unwrap()[k]);
    let sys = uav::model().with_input_delay(delays.to_vec()).unwrap();
    let expected = lsim(&sys, &u, SampleTime::new(0.05).unwrap(), &Options::default()).unwrap();
    let outputs = Dynamics::ALL.iter().flat_map(|d| d.outputs()).map(|(n, _)| *n);
    for (i, name) in outputs.enumerate() {
        assert_eq!(
            output.input(name).unwrap(),
            expected.y.column(i).as_slice(),
            "{name}: to the bit"
        );
    }
    let states = Dynamics::ALL.iter().flat_map(|d| d.states()).map(|(n, _)| *n);
    for (i, name) in states.enumerate().filter(|(_, n)| !["p", "q", "r"].contains(n)) {
        assert_eq!(
            output.input(name).unwrap(),
            expected.x.column(i).as_slice(),
            "{name}: to the bit"
        );
    }
    assert_eq!(output.unit("ay"), Some("m/s^2"));
    // The result measured, then simulated again: no difference; with another delay: one.
    let again = folder.path("again.csv");
    let same = deadtime(&["simulate", text(&file), text(&out), "--out", text(&again)]).done();
    assert_eq!(same.matches("nrmse 0.0000").count(), 6, "{same}");
    let other = deadtime(&[
        "simulate",
        text(&file),
        text(&out),
        "--delay",
        "delta_dir=0.1",
        "--out",
        text(&again),
    ])
    .done();
    assert_eq!(other.matches("nrmse 0.0000").count(), 5, "only r changes: {other}");
    deadtime(&["simulate", text(&file), text(&out), "--delay", "delta=0.1", "--out", text(&again)])
        .refused(&["--delay delta=0.1", "delta_lat"]);
}

#[test]
fn a_sampled_model_goes_through_files_unchanged() {
    let folder = Folder::new();
    let file = vehicle(&folder, "m.toml", &[Dynamics::Vertical], &[0.13]);
    for name in ["d.toml", "d.json"] {
        let sampled = folder.path(name);
        let says =
            deadtime(&["c2d", text(&file), "--sample-time", "0.1", "--out", text(&sampled)]).done();
        assert!(says.contains("zoh") && says.contains(name), "{says}");
        let sys = Dynamics::Vertical.model().with_input_delay(vec![0.13]).unwrap();
        let expected = ZeroOrderHold {}.c2d(&sys, SampleTime::new(0.1).unwrap()).unwrap();
        let back = ModelFile::read(&sampled).unwrap().sampled().unwrap();
        assert_eq!(back, expected, "to the bit");
        // The sampled model simulates as the continuous one does. (With a fraction of a sample it carries a state of its own for the held input, which starts at
        // 0 and not at u[0]: whole samples here.)
        let file = vehicle(&folder, "whole.toml", &[Dynamics::Vertical], &[0.2]);
        deadtime(&["c2d", text(&file), "--sample-time", "0.1", "--out", text(&sampled)]).done();
        let log = inputs(&folder, "in.csv", &["delta_ver"], 60, 0.1);
        let run = |model: &std::path::Path| {
            let out = folder.path("y.csv");
            deadtime(&["simulate", text(model), text(&log), "--out", text(&out)]).done();
            read(&out).unwrap().input("az").unwrap().to_vec()
        };
        let (a, b) = (run(&file), run(&sampled));
        let scale = a.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-12 * scale));
    }
    for entry in CONVERSIONS {
        let options: &[&str] =
            if entry.name == "impulse" { &["--set", "feedthrough=drop"] } else { &[] };
        let arguments =
            [&["c2d", text(&file), "--sample-time", "0.1", "--method", entry.name], options]
                .concat();
        let printed = deadtime(&arguments).done();
        let copy = folder.write("printed.toml", &printed);
        assert!(
            (ModelFile::read(&copy).unwrap().sample_time_s - 0.1).abs() < 1e-15,
            "{}: without --out it is printed",
            entry.name
        );
    }
}

#[test]
fn a_conversion_that_rounds_a_delay_says_by_how_much_and_what_keeps_it() {
    let folder = Folder::new();
    let convert = |delay_s: f64, arguments: &[&str]| {
        let file = vehicle(&folder, "m.toml", &[Dynamics::Vertical], &[delay_s]);
        let all = [&["c2d", text(&file), "--sample-time", "0.1"], arguments].concat();
        let run = deadtime(&all);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        run.stderr
    };
    for method in ["tustin", "matched"] {
        let said = convert(0.25, &["--method", method]);
        for part in [method, "delta_ver", "0.25 s", "3 samples", "fractional_delay_order=1", "zoh"]
        {
            assert!(said.contains(part), "{part}: {said}");
        }
        // No filter delays by less than half a sample.
        let said = convert(0.04, &["--method", method]);
        assert!(said.contains("0 samples") && !said.contains("fractional_delay_order"), "{said}");
        for (delay_s, arguments) in [
            (0.3, vec!["--method", method]),
            (0.25, vec!["--method", method, "--set", "fractional_delay_order=2"]),
            (0.25, vec!["--method", method, "--quiet"]),
            (0.25, vec!["--method", "zoh"]),
        ] {
            assert_eq!(convert(delay_s, &arguments), "", "{arguments:?}");
        }
    }
}

#[test]
fn excite_simulate_and_estimate_find_an_injected_delay() {
    let folder = Folder::new();
    for (dynamics, output, delay_s) in [
        (Dynamics::Directional, "r", 0.7),
        (Dynamics::Vertical, "az", 1.3),
        (Dynamics::Vertical, "az", 0.0),
    ] {
        let model = vehicle(&folder, "m.toml", &[dynamics], &[0.0]);
        let log = folder.path("u.csv");
        deadtime(&[
            "excite",
            "prbs",
            "--samples",
            "500",
            "--sample-time",
            "0.1",
            "--channel",
            dynamics.input(),
            "--out",
            text(&log),
        ])
        .done();
        let flight = folder.path("y.csv");
        let delay = format!("{}={delay_s}", dynamics.input());
        deadtime(&[
            "simulate",
            text(&model),
            text(&log),
            "--delay",
            &delay,
            "--snr",
            "1e4",
            "--seed",
            "5",
            "--out",
            text(&flight),
        ])
        .done();
        let file = folder.path("out.json");
        let arguments = [
            "estimate",
            text(&flight),
            "--input",
            dynamics.input(),
            "--output",
            output,
            "--model",
            text(&model),
            "--json",
            text(&file),
        ];
        let says = deadtime(&arguments).done();
        let report = json(&file);
        let found = report["pairs"][0]["verdict"]["delay_s"].as_f64();
        // A fifth of a sample: the verdict is a mean of several methods.
        assert!(found.is_some_and(|d| (d - delay_s).abs() < 0.02), "{delay_s}: {says}");
    }
}

#[test]
fn lists_name_everything_there_is() {
    let list = |what: &str| deadtime(&["list", what]).done();
    let methods = list("methods");
    assert!(
        METHODS.iter().all(|m| methods.contains(m.entry.name) && methods.contains(m.entry.summary)),
        "{methods}"
    );
    let excitations = list("excitations");
    assert!(EXCITATIONS.iter().all(|e| excitations.contains(e.name)), "{excitations}");
    let conversions = list("conversions");
    assert!(CONVERSIONS.iter().all(|e| conversions.contains(e.name)), "{conversions}");
    let dynamics = list("dynamics");
    assert!(
        Dynamics::ALL.iter().all(|d| dynamics.contains(d.name()) && dynamics.contains(d.input())),
        "{dynamics}"
    );
    let thresholds: Criteria = toml::from_str(&list("criteria")).unwrap();
    assert_eq!(thresholds, Criteria::default());
    deadtime(&["list", "everything"]).refused(&["everything", "methods"]);
}

/// Runs the program, reads the first line and closes the pipe.
#[cfg(unix)]
fn first_line_only(arguments: &[&str]) -> (Option<i32>, String) {
    use std::io::{BufRead, BufReader, Read};
    let mut child = Command::new(env!("CARGO_BIN_EXE_deadtime"))
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::with_capacity(64, child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let mut stderr = String::new();
    child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
    assert!(!line.is_empty());
    (child.wait().unwrap().code(), stderr)
}

#[test]
#[cfg(unix)]
fn a_reader_that_has_seen_enough_is_no_error() {
    // More than a pipe holds, so that the program meets the closed pipe.
    let long = ["excite", "rbs", "--samples", "200000", "--sample-time", "0.1"];
    assert_eq!(first_line_only(&long), (Some(0), String::new()));
    assert_eq!(first_line_only(&["list", "methods"]), (Some(0), String::new()));
}

#[test]
#[cfg(unix)]
fn a_pipe_that_nobody_reads_is_no_error_for_any_command() {
    let folder = Folder::new();
    let model = vehicle(&folder, "m.toml", &[Dynamics::Directional], &[0.2]);
    let log = inputs(&folder, "u.csv", &["delta_dir"], 300, 0.1);
    let flight = folder.path("y.csv");
    deadtime(&["simulate", text(&model), text(&log), "--out", text(&flight)]).done();
    let (out, report) = (folder.path("out.csv"), folder.path("report.json"));
    let sampled = folder.path("sampled.toml");
    for arguments in [
        vec!["list", "methods"],
        vec!["estimate", text(&flight), "--input", "delta_dir", "--output", "r"],
        vec!["simulate", text(&model), text(&log), "--out", text(&out)],
        vec!["c2d", text(&model), "--sample-time", "0.1"],
        vec!["c2d", text(&model), "--sample-time", "0.1", "--out", text(&sampled)],
        vec!["excite", "rbs", "--samples", "9", "--sample-time", "0.1", "--out", text(&out)],
        vec![
            "estimate",
            text(&flight),
            "--input",
            "delta_dir",
            "--output",
            "r",
            "--json",
            text(&report),
        ],
    ] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = Command::new(env!("CARGO_BIN_EXE_deadtime"))
            .args(&arguments)
            .stdout(writer)
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.code() == Some(0) && stderr.is_empty(),
            "{arguments:?}: {:?} {stderr}",
            output.status
        );
    }
    assert_estimate_format(&json(&report));
}

#[test]
fn the_number_of_threads_changes_no_answer() {
    let folder = Folder::new();
    let model = vehicle(&folder, "m.toml", &[Dynamics::Directional], &[0.4]);
    let log = inputs(&folder, "u.csv", &["delta_dir"], 400, 0.1);
    let flight = folder.path("y.csv");
    deadtime(&["simulate", text(&model), text(&log), "--snr", "50", "--out", text(&flight)]).done();
    let run = |threads: &str| {
        let file = folder.path("out.json");
        let arguments = [
            "estimate",
            text(&flight),
            "--input",
            "delta_dir",
            "--output",
            "r",
            "--json",
            text(&file),
            "--threads",
            threads,
        ];
        deadtime(&arguments).done();
        let mut report = json(&file);
        for pair in report["pairs"].as_array_mut().unwrap() {
            for estimate in pair["estimates"].as_array_mut().unwrap() {
                // Run times are no part of a result.
                estimate["time_s"] = Value::Null;
            }
        }
        report
    };
    let one = run("1");
    assert!(one["pairs"][0]["verdict"]["delay_s"].is_f64(), "{one}");
    assert_eq!(one, run("2"));
    assert_eq!(one, run("7"));
}

#[test]
fn help_and_version_succeed_and_nothing_typed_is_refused() {
    assert!(deadtime(&["--help"]).done().contains("estimate"));
    assert!(deadtime(&["--version"]).done().contains(env!("CARGO_PKG_VERSION")));
    for command in ["estimate", "simulate", "c2d", "excite", "list"] {
        assert!(deadtime(&[command, "--help"]).done().contains("Usage"), "{command}");
    }
    assert_eq!(deadtime(&[]).code, Some(2));
    deadtime(&["estimat"]).refused(&["estimat", "estimate"]);
    deadtime(&["estimate", "log.csv"]).refused(&["--input", "--output"]);
}

#[test]
fn what_the_user_knows_of_feedback_overrides_what_the_log_shows() {
    let log = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/unstable_loop.csv");
    let said = |more: &[&str]| {
        deadtime(&[&["estimate", log, "--input", "torque", "--output", "rate"], more].concat())
            .words()
    };
    assert!(said(&[]).contains("feedback (later inputs explain"));
    assert!(said(&["--loop", "closed"]).contains("feedback (--loop closed)"));
    assert!(!said(&["--loop", "open"]).contains("feedback"));
}

#[test]
fn many_methods_fold_to_those_that_count_and_full_shows_all() {
    let log = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/missing.csv");
    let said = |more: &[&str]| {
        deadtime(&[&["estimate", log, "--input", "pump", "--output", "level"], more].concat())
            .done()
    };
    let rows = |text: &str, word: &str| {
        text.lines().filter(|l| l.starts_with("  ") && l.contains(word)).count()
    };
    let (folded, full) = (said(&[]), said(&["--full"]));
    let pairs = METHODS.iter().filter(|m| m.scope == Scope::Pair);
    assert!(
        rows(&folded, " yes") == rows(&full, " yes ") && rows(&folded, "not visible") == 0,
        "{folded}"
    );
    assert!(
        folded.contains(&format!("No answer: {} not visible", rows(&full, " not visible "))),
        "what is folded is counted: {folded}"
    );
    for method in pairs {
        assert!(full.contains(&format!("  {} ", method.entry.name)), "{full}");
    }
}

#[test]
#[ignore = "nightly: through the program"]
fn two_inputs_that_move_together_are_told_apart() {
    let log = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/two_inputs.csv");
    let folder = Folder::new();
    let file = folder.path("out.json");
    deadtime(&[
        "estimate",
        log,
        "--input",
        "heater",
        "--input",
        "fan",
        "--output",
        "temperature",
        "--json",
        text(&file),
    ])
    .done();
    for (pair, truth_s) in json(&file)["pairs"].as_array().unwrap().iter().zip([0.35, 0.8]) {
        let ends: Vec<f64> = pair["verdict"]["ci95_s"]
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_f64().unwrap())
            .collect();
        assert!(
            ends[0] <= truth_s && truth_s <= ends[1] && ends[1] - ends[0] < 0.4,
            "{truth_s}: {}",
            pair["verdict"]
        );
    }
}

#[test]
#[ignore = "nightly: a study of all methods"]
fn the_study_of_all_methods_prints_and_writes_every_one() {
    let folder = Folder::new();
    let page = folder.path("methods.md");
    let said =
        deadtime(&["methods", "--trials", "2", "--samples", "300", "--out", text(&page)]).done();
    let written = std::fs::read_to_string(&page).unwrap();
    for method in METHODS {
        let name = method.entry.name;
        assert!(
            said.contains(&format!("  {name} "))
                && written.matches(&format!("| `{name}` |")).count() == 1,
            "{name}"
        );
    }
    deadtime(&["methods", "--trials", "0"]).refused(&["--trials 0", "at least 1"]);
}
