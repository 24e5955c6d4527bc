//! Models and logs that do not fit each other, and data that cannot answer: each a clear error, or a caveat beside the answer.

use crate::support::program::{Folder, Run, deadtime, text};

const MODEL: &str = r#"
format = "deadtime/model@1"
name = "motor"
kind = "lti"
inputs = [{ name = "u", unit = "V" }, { name = "load", unit = "N m" }]
states = [{ name = "speed", unit = "rad/s" }]
outputs = [{ name = "y", unit = "rad/s" }, { name = "z" }]
A = [[-2.0]]
B = [[2.0, -1.0]]
C = [[1.0], [0.5]]
D = [[0.0, 0.0], [0.0, 0.0]]
"#;

/// A nonlinear model with one input and output, its derivative and output as given.
fn equations(initial: f64, derivative: &str, output: &str) -> String {
    format!(
        "format = \"deadtime/model@1\"\nname = \"m\"\nkind = \"equations\"\ninputs = [{{ name = \"u\" }}]\noutputs = [{{ name = \"y\" }}]\n\
         [states]\nx = {{ initial = {initial}, initial_std = 0.0 }}\n[parameters]\na = {{ value = 2.0 }}\n[derivatives]\nx = \"{derivative}\"\n[output_equations]\ny = \"{output}\"\n"
    )
}

/// A row of a log: time, u, load, y, z, as text.
type Row = [String; 5];

/// A log of the motor in the order time, u, load, y, z, with a little noise from this seed; `change` may spoil rows.
fn log(header: &str, samples: usize, seed: u64, change: impl Fn(usize, &mut Row)) -> String {
    let (mut out, mut speed, mut noise) = (format!("{header}\n"), 0.0_f64, seed);
    let levels = [0.6, -0.9, 0.2, 0.9, -0.4, -0.1, 0.7, -0.7];
    for k in 0..samples {
        let mut draw = || {
            noise = noise
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            0.02 * ((noise >> 40) as f64 / (1_u64 << 24) as f64 - 0.5)
        };
        let (u, load) = (levels[(k / 20) % 8], levels[(k / 33) % 8]);
        let numbers = [k as f64 * 0.02, u, load, speed + draw(), 0.5 * speed + draw()];
        let mut row = numbers.map(|v| v.to_string());
        change(k, &mut row);
        out += &(row.join(",") + "\n");
        speed = (-0.04_f64).exp() * speed + (1.0 - (-0.04_f64).exp()) * (u - 0.5 * load);
    }
    out
}

const HEADER: &str = "time,u,load,y,z";

fn as_is(_: usize, _: &mut Row) {}

/// `deadtime gap` with these files in a folder; the arguments name them.
fn gap(model: &str, logs: &[(&str, &str)], arguments: &[&str]) -> Run {
    let folder = Folder::new();
    let model = folder.write("model.toml", model);
    let mut all: Vec<String> = vec!["gap".into(), "--model".into(), text(&model).into()];
    for (name, content) in logs {
        folder.write(name, content);
    }
    all.extend(arguments.iter().map(|a| {
        if a.ends_with(".csv") { text(&folder.path(a)).to_owned() } else { (*a).to_owned() }
    }));
    all.extend(["--out".into(), text(&folder.path("out")).into()]);
    let run = deadtime(&all.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(
        run.code == Some(0),
        folder.path("out").join("diagnosis.json").is_file(),
        "a diagnosis is written exactly where one was reached"
    );
    run
}

fn one(model: &str, log: &str) -> Run {
    gap(model, &[("a.csv", log)], &["--log", "a.csv"])
}

#[test]
fn names_that_do_not_fit() {
    let wrong = log("time,command,load,y,z", 400, 1, as_is);
    one(MODEL, &wrong).refused(&[
        "a.csv",
        "no channel is called `u`",
        "`command`",
        "--map u=COLUMN",
    ]);
    // The remedy is one.
    gap(MODEL, &[("a.csv", &wrong)], &["--log", "a.csv", "--map", "u=command"]).done();
    // Also where the operating point is asked for first, and in a held-out log.
    let mean = MODEL.replace(
        "unit = \"rad/s\" }, { name = \"z\"",
        "unit = \"rad/s\", operating = \"mean\" }, { name = \"z\"",
    );
    assert_ne!(mean, MODEL);
    one(&mean, &log("time,u,load,angle,z", 400, 1, as_is))
        .refused(&["no channel is called `y`", "--map y=COLUMN"]);
    let files = [("a.csv", log(HEADER, 400, 1, as_is)), ("b.csv", wrong)];
    gap(
        MODEL,
        &files.each_ref().map(|(n, l)| (*n, l.as_str())),
        &["--log", "a.csv", "--holdout", "b.csv"],
    )
    .refused(&["b.csv", "--map u=COLUMN"]);
}

#[test]
fn units_that_do_not_fit() {
    one(MODEL, &log("time,u [mV],load,y,z", 400, 1, as_is)).refused(&[
        "a.csv",
        "`u` is in mV here and in V in the model",
        "convert",
    ]);
    one(MODEL, &log("time,u [V],load [N m],y [deg/s],z", 400, 1, as_is))
        .refused(&["`y` is in deg/s here and in rad/s"]);
    let fine = one(MODEL, &log("time,u [V],load [N m],y [rad/s],z [m]", 400, 1, as_is)).words();
    assert!(!fine.contains("Caveat"), "{fine}");
}

#[test]
fn a_sampled_model_and_a_log_of_another_sample_time() {
    let sampled = MODEL
        .replace("kind = \"lti\"", "kind = \"lti\"\nsample_time_s = 0.05")
        .replace("A = [[-2.0]]", "A = [[0.9]]");
    one(&sampled, &log(HEADER, 400, 1, as_is)).refused(&["a.csv", "0.02 s", "0.05 s", "resample"]);
}

#[test]
fn an_output_without_samples() {
    let missing = log(HEADER, 400, 1, |_, row| row[3].clear());
    one(MODEL, &missing).refused(&["a.csv", "`y` has no sample in any row", "another channel"]);
    // Only in what is held out, or only in what is learnt from: an answer, with a caveat.
    let late = one(
        MODEL,
        &log(HEADER, 400, 1, |k, row| {
            if k > 200 {
                row[3].clear()
            }
        }),
    )
    .words();
    assert!(
        late.contains("Caveat: `y` has no sample in what is held out")
            && !late.contains("`z` has no sample"),
        "{late}"
    );
    let early = one(
        MODEL,
        &log(HEADER, 400, 1, |k, row| {
            if k < 300 {
                row[3].clear()
            }
        }),
    )
    .words();
    assert!(early.contains("Caveat: `y` has no sample in the training logs"), "{early}");
}

#[test]
fn an_input_without_a_sample_names_its_row() {
    one(
        MODEL,
        &log(HEADER, 400, 1, |k, row| {
            if k == 9 {
                row[1].clear()
            }
        }),
    )
    .refused(&["a.csv, row 11", "input `u`", "0.18 s"]);
}

#[test]
fn a_constant_input() {
    let still = one(MODEL, &log(HEADER, 400, 1, |_, row| row[2] = "0.3".into())).words();
    assert!(
        still.contains("Caveat: `load` never changes in the training logs")
            && !still.contains("`u` never changes"),
        "{still}"
    );
    // One that only moves after what is learnt from is as blind.
    let late = one(
        MODEL,
        &log(HEADER, 400, 1, |k, row| row[2] = if k < 350 { "0.3" } else { "0.7" }.into()),
    )
    .words();
    assert!(late.contains("Caveat: `load` never changes"), "{late}");
}

#[test]
fn a_model_that_explodes() {
    let unstable = MODEL.replace("A = [[-2.0]]", "A = [[40.0]]");
    let ordinary = log(HEADER, 400, 1, as_is);
    let run =
        gap(&unstable, &[("a.csv", &ordinary)], &["--log", "a.csv", "--prediction", "simulation"]);
    run.refused(&["a.csv", "cannot be simulated", "`y` runs away", "prediction mode"]);
    // In finite time.
    let run = gap(
        &equations(5.0, "x^3 + u", "x"),
        &[("a.csv", &ordinary)],
        &["--log", "a.csv", "--prediction", "simulation"],
    );
    run.refused(&["a.csv", "cannot be simulated"]);
    // A wrong unit is not an explosion, but a finding.
    let milli = MODEL.replace("C = [[1.0], [0.5]]", "C = [[1000.0], [0.5]]");
    assert!(one(&milli, &ordinary).done().contains("sensor gain of"));
}

#[test]
fn an_expression_that_divides_by_zero() {
    let ordinary = log(HEADER, 400, 1, as_is);
    one(&equations(0.0, "u/x", "x"), &ordinary).refused(&[
        "a.csv",
        "derivatives.x",
        "divides by zero",
        "t = 0 s",
    ]);
    one(&equations(0.0, "a*u - a*x", "1/(x - x)"), &ordinary).refused(&[
        "a.csv",
        "output_equations.y",
        "divides by zero",
    ]);
}

#[test]
fn logs_too_short_empty_or_no_numbers() {
    one(MODEL, &log(HEADER, 2, 1, as_is)).refused(&["a.csv", "2 samples are too few", "at least"]);
    one(MODEL, "").refused(&["a.csv", "the file is empty"]);
    one(MODEL, "time,u,load,y,z\n").refused(&["a.csv", "no samples below the header"]);
    one(
        MODEL,
        &log(HEADER, 400, 1, |k, row| {
            if k == 7 {
                row[3] = "inf".into()
            }
        }),
    )
    .refused(&["a.csv, row 9", "`y`", "`inf`", "empty"]);
    let files = [("a.csv", log(HEADER, 400, 1, as_is)), ("b.csv", log(HEADER, 2, 2, as_is))];
    gap(
        MODEL,
        &files.each_ref().map(|(n, l)| (*n, l.as_str())),
        &["--log", "a.csv", "--holdout", "b.csv"],
    )
    .refused(&["b.csv", "2 samples are too few"]);
}

#[test]
fn what_is_held_out_was_learnt_from() {
    let (first, other) = (log(HEADER, 400, 1, as_is), log(HEADER, 400, 2, as_is));
    let files =
        [("a.csv", first.as_str()), ("renamed.csv", first.as_str()), ("other.csv", other.as_str())];
    let caveat = "holds the same samples as";
    let said = gap(MODEL, &files, &["--log", "a.csv", "--holdout", "a.csv"]).words();
    assert!(said.contains(caveat) && said.contains("not measured on unseen data"), "{said}");
    let said =
        gap(MODEL, &files, &["--log", "other.csv", "--log", "a.csv", "--holdout", "renamed.csv"])
            .words();
    assert!(
        said.contains(caveat)
            && said.contains("renamed.csv")
            && said.contains("a.csv, a training log"),
        "{said}"
    );
    let said = gap(MODEL, &files, &["--log", "a.csv", "--log", "renamed.csv"]).words();
    assert!(said.contains("they count twice"), "{said}");
    // The same commands with other noise are another log.
    let said = gap(MODEL, &files, &["--log", "a.csv", "--holdout", "other.csv"]).words();
    assert!(!said.contains(caveat), "{said}");
}

#[test]
fn a_file_that_is_not_there_is_said_once() {
    let run = gap(MODEL, &[], &["--log", "nowhere.csv"]);
    run.refused(&["nowhere.csv"]);
    assert_eq!(run.stderr.matches("no such file").count(), 1, "{}", run.stderr);
    let run =
        deadtime(&["gap", "--model", "nowhere.toml", "--log", "nowhere.csv", "--out", "nowhere"]);
    run.refused(&["nowhere.toml"]);
    assert_eq!(run.stderr.matches("no such file").count(), 1, "{}", run.stderr);
}

#[test]
fn other_thresholds_change_the_verdict_and_must_be_known_and_positive() {
    // The actuator has half the gain.
    let logged =
        log(HEADER, 600, 1, |_, row| row[1] = (2.0 * row[1].parse::<f64>().unwrap()).to_string());
    let folder = Folder::new();
    let (model, csv, out) =
        (folder.write("model.toml", MODEL), folder.write("a.csv", &logged), folder.path("out"));
    let with = |thresholds: &str| {
        let file = folder.write("thresholds.toml", thresholds);
        deadtime(&[
            "gap",
            "--model",
            text(&model),
            "--log",
            text(&csv),
            "--out",
            text(&out),
            "--criteria",
            text(&file),
        ])
    };
    assert!(with("").done().contains("Cause: input gain of `u`"));
    assert!(!with("inexact_gap = 1e3").done().contains("Cause: input gain"));
    with("selection = 3.0").refused(&["thresholds.toml", "selection", "selection_penalty"]);
    with("equals = -1.0").refused(&["thresholds.toml", "equals is -1", "above 0"]);
    with("windows = [20, 60]").refused(&["thresholds.toml", "windows"]);
}
