//! `deadtime blind score` as a program: report, files, exit codes.

use crate::support::blind;
use crate::support::blind::{Check, always_input_delay, perfect};
use crate::support::program::{deadtime, text};
use serde_json::Value;

#[test]
fn report_json_and_markdown_carry_the_same_numbers() {
    let check = Check::new();
    check.answer(perfect);
    let (json, markdown) = (check.path("score.json"), check.path("out/score.md"));
    let (verdicts, labels) = (check.verdicts(), check.labels());
    let report = deadtime(&[
        "blind",
        "score",
        text(&verdicts),
        text(&labels),
        "--json",
        text(&json),
        "--markdown",
        text(&markdown),
    ])
    .done();
    assert!(
        report.contains(
            "8 cases (2 none, 1 pair, 4 single, 1 unknown); every label matches its commitment"
        ),
        "{report}"
    );
    let row = |text: &str, name: &str| -> Vec<String> {
        let line =
            text.lines().find(|l| l.trim_start_matches(['|', ' ']).starts_with(name)).unwrap();
        line.split(['|', ' ']).filter(|w| !w.is_empty()).map(str::to_owned).collect()
    };
    let markdown = std::fs::read_to_string(markdown).unwrap();
    assert_eq!(row(&report, "top1_class"), row(&markdown, "top1_class"));
    assert_eq!(row(&report, "top1_class")[1..5], ["1.000", "0.510", "…", "1.000"]);
    let json: Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    assert_eq!(
        (json["format"].as_str(), json["cases"].as_u64()),
        (Some("deadtime/blind-score@1"), Some(8))
    );
    let top1 = json["scores"].as_array().unwrap().iter().find(|s| s["name"] == "top1").unwrap();
    assert_eq!((top1["value"].as_f64(), top1["count"].as_u64()), (Some(1.0), Some(4)));
    assert_eq!(json["answers"].as_array().unwrap().len(), 8);
}

#[test]
fn a_quiet_score_says_nothing() {
    let check = Check::new();
    check.answer(perfect);
    let run =
        deadtime(&["blind", "score", text(&check.verdicts()), text(&check.labels()), "--quiet"]);
    assert_eq!((run.code, run.stdout.as_str(), run.stderr.as_str()), (Some(0), "", ""));
}

#[test]
fn exit_code_says_whether_a_limit_was_missed() {
    let check = Check::new();
    check.answer(|_| always_input_delay());
    let (verdicts, labels) = (check.verdicts(), check.labels());
    let run = |limits: &[&str]| {
        let mut arguments = vec!["blind", "score", text(&verdicts), text(&labels)];
        arguments.extend(limits.iter().flat_map(|l| ["--require", l]));
        deadtime(&arguments)
    };
    run(&["top1>=0.6", "false_alarm<=1"]).done();
    let missed = run(&["top1>=0.9", "false_alarm<=0.1", "top3>=0"]);
    assert_eq!(missed.code, Some(1), "{missed:?}");
    assert!(
        missed.stderr.contains("top1>=0.9 was not met")
            && missed.stderr.contains("false_alarm<=0.1"),
        "{}",
        missed.stderr
    );
    assert!(!missed.stderr.contains("top3") && missed.stdout.contains("truth and verdict"));
    run(&["topmost>=0.9"]).refused(&["no score `topmost`", "top1_class"]);
    run(&["top1>0.9"]).refused(&["NAME>=VALUE"]);
}

#[test]
fn changed_label_is_refused_by_name() {
    let check = Check::new();
    check.answer(perfect);
    let label = check.labels().join("n1.json");
    let changed = std::fs::read_to_string(&label).unwrap().replace("white", "pink");
    blind::write(&label, &changed);
    let run = deadtime(&["blind", "score", text(&check.verdicts()), text(&check.labels())]);
    run.refused(&["case n1", "does not match its commitment"]);
    assert!(run.stdout.is_empty());
}
