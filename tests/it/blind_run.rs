//! Blind diagnoses of many cases: what the diagnoser sees, resuming, and cases that fail.

use std::sync::Mutex;

use crate::support::blind::{Check, by_heart, perfect, write};
use deadtime::blind::{CaseFiles, Existing, Outcome, RunOptions, find, load, run, score};
use deadtime::diagnose::Diagnosis;

#[test]
fn run_gives_the_diagnoser_the_case_and_nothing_else() {
    let check = Check::new();
    write(&check.cases().join("README.md"), "no case");
    let seen = Mutex::new(Vec::<CaseFiles>::new());
    let diagnose = |case: &CaseFiles| {
        seen.lock().unwrap().push(case.clone());
        Ok(by_heart(case))
    };
    let summary = run(
        &check.cases(),
        &check.verdicts(),
        &RunOptions { jobs: 3, ..RunOptions::default() },
        &diagnose,
        &|_, _| {},
    )
    .unwrap();
    assert_eq!(
        summary.cases.iter().map(|c| c.0.as_str()).collect::<Vec<_>>(),
        ["k1", "n1", "n2", "p1", "s1", "s2", "s3", "s4"]
    );
    assert!(summary.failed().next().is_none());
    let seen = seen.into_inner().unwrap();
    let s1 = seen.iter().find(|c| c.id == "s1").unwrap();
    let names = |paths: &[std::path::PathBuf]| {
        paths
            .iter()
            .map(|p| p.file_name().unwrap().to_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(names(&s1.logs), ["train_1.csv", "train_2.csv", "train_10.csv"]);
    assert_eq!(names(&s1.holdout), ["holdout_1.csv"]);
    // Verdicts and labels are enough to score.
    let scores = score(&load(&check.verdicts(), &check.labels(), None).unwrap());
    assert_eq!(scores.get("right").unwrap().value, Some(1.0));
}

#[test]
fn run_resumes_and_redoes_only_what_was_asked_or_changed() {
    let check = Check::new();
    let calls = Mutex::new(Vec::<String>::new());
    let diagnose = |case: &CaseFiles| {
        calls.lock().unwrap().push(case.id.clone());
        Ok(by_heart(case))
    };
    let go = |existing| {
        calls.lock().unwrap().clear();
        run(
            &check.cases(),
            &check.verdicts(),
            &RunOptions { existing, ..RunOptions::default() },
            &diagnose,
            &|_, _| {},
        )
        .unwrap();
        calls.lock().unwrap().clone()
    };
    assert_eq!(go(Existing::Keep).len(), 8);
    assert!(go(Existing::Keep).is_empty());
    // Cut off before its run time was written; half a diagnosis; another case of the same name.
    std::fs::remove_file(check.verdicts().join("n1/run.json")).unwrap();
    write(&check.verdicts().join("p1/diagnosis.json"), "{ \"format\":");
    write(&check.cases().join("s3/commitment.txt"), &"1".repeat(64));
    assert_eq!(go(Existing::Keep), ["n1", "p1", "s3"]);
    assert!(go(Existing::Keep).is_empty());
    assert_eq!(go(Existing::Redo).len(), 8);
}

#[test]
fn failing_cases_are_reported_by_name_and_stop_no_other() {
    let check = Check::new();
    std::fs::remove_file(check.cases().join("n1/holdout_1.csv")).unwrap();
    std::fs::remove_file(check.cases().join("n2/model.toml")).unwrap();
    for train in ["train_1.csv", "train_2.csv", "train_10.csv"] {
        std::fs::remove_file(check.cases().join("s2").join(train)).unwrap();
    }
    let diagnose = |case: &CaseFiles| match case.id.as_str() {
        "s1" => Err(deadtime::study::Error::io(
            &case.model,
            std::io::Error::other("cannot be diagnosed"),
        )),
        "s3" => panic!("out of its depth"),
        _ => Ok(by_heart(case)),
    };
    // An earlier verdict of a case that fails now would be scored as today's.
    check.answer(perfect);
    std::fs::remove_file(check.verdicts().join("s1/run.json")).unwrap();
    std::fs::remove_file(check.verdicts().join("s3/run.json")).unwrap();
    let told = Mutex::new(0);
    let count = |_: &str, _: &Outcome| *told.lock().unwrap() += 1;
    let summary = run(
        &check.cases(),
        &check.verdicts(),
        &RunOptions { jobs: 2, ..RunOptions::default() },
        &diagnose,
        &count,
    )
    .unwrap();
    assert_eq!(told.into_inner().unwrap(), 8);
    let failed: Vec<(&str, String)> = summary.failed().map(|(id, e)| (id, e.to_string())).collect();
    let expected = [
        ("n1", vec!["n1: holdout_*.csv is missing"]),
        ("n2", vec!["n2: model.toml is missing"]),
        ("s1", vec!["cannot be diagnosed"]),
        ("s2", vec!["s2: train_*.csv is missing"]),
        ("s3", vec!["case s3", "out of its depth"]),
    ];
    assert_eq!(failed.len(), expected.len(), "{failed:?}");
    for ((id, message), (expected_id, parts)) in failed.iter().zip(expected) {
        assert_eq!(*id, expected_id);
        assert!(parts.iter().all(|p| message.contains(p)), "{message}");
        assert!(!check.verdicts().join(id).join("diagnosis.json").exists(), "{id}");
    }
    for id in ["k1", "p1", "s4"] {
        assert!(Diagnosis::read(&check.verdicts().join(id).join("diagnosis.json")).is_ok());
    }
}

#[test]
fn folders_without_cases_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    assert!(find(folder.path()).unwrap_err().to_string().contains("no case in it"));
    assert!(find(&folder.path().join("absent")).unwrap_err().to_string().contains("absent"));
}
