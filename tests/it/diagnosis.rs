//! The diagnosis file: what is written can be read, and is what the published schema says.

use deadtime::diagnose::{Diagnosis, DiagnosisFormat, RankingRow};
use serde_json::{Value, json};

use crate::support::schema::{accepts, violations};

/// A diagnosis with all its sections, written by hand.
const EXAMPLE: &str = include_str!("../../examples/diagnosis.json");

fn example() -> Value {
    serde_json::from_str(EXAMPLE).unwrap()
}

#[test]
fn example_survives_reading_and_writing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out/diagnosis.json");
    let diagnosis: Diagnosis = serde_json::from_str(EXAMPLE).unwrap();
    diagnosis.write(&path).unwrap();
    assert_eq!(Diagnosis::read(&path).unwrap(), diagnosis);
    let written: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    assert_eq!(written, example());
    accepts(&written);
    assert!(matches!(
        diagnosis.cause.ranking.as_slice(),
        [RankingRow::Single(_), RankingRow::Pair(_), RankingRow::Single(_), ..]
    ));
}

#[test]
fn the_earlier_formats_are_read_too() {
    let earlier = include_str!("../corpus/diagnosis/diagnosis.json");
    assert!(earlier.contains("diagnosis@1"));
    let diagnosis: Diagnosis = serde_json::from_str(earlier).unwrap();
    assert_eq!((diagnosis.format, diagnosis.cause.contributions.len()), (DiagnosisFormat::V1, 0));
    assert!(diagnosis.cause.explained.is_none() && diagnosis.cause.remainder.is_none());
    // What belongs to a later format must be there.
    let second = include_str!("../corpus/diagnosis/diagnosis-2.json");
    let read: Diagnosis = serde_json::from_str(second).unwrap();
    assert_eq!((read.format, read.cause.classes.len()), (DiagnosisFormat::V2, 0));
    let mut documents = vec![earlier.to_string(), second.to_string()];
    for (file, earlier, later) in [(earlier, "@1", "@2"), (second, "@2", "@3")] {
        documents.push(file.replace(&format!("diagnosis{earlier}"), &format!("diagnosis{later}")));
    }
    let documents: Vec<Value> =
        documents.iter().map(|d| serde_json::from_str(d).unwrap()).collect();
    if let Some(found) = violations(&documents) {
        let accepted: Vec<bool> = found.iter().map(Vec::is_empty).collect();
        assert_eq!(accepted, [true, true, false, false], "{found:?}");
    }
}

#[test]
fn nan_is_written_as_null_where_a_number_may_be_missing_and_refused_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("diagnosis.json");
    let mut diagnosis: Diagnosis = serde_json::from_str(EXAMPLE).unwrap();
    diagnosis.shrink.after = Some(f64::NAN);
    diagnosis.cause.effects[0].parameters[0].std = Some(f64::INFINITY);
    diagnosis.write(&path).unwrap();
    let read = Diagnosis::read(&path).unwrap();
    assert_eq!((read.shrink.after, read.cause.effects[0].parameters[0].std), (None, None));
    accepts(&serde_json::to_value(&read).unwrap());

    diagnosis.holdout[0].to_s = f64::NAN;
    let earlier = std::fs::read(&path).unwrap();
    let error = diagnosis.write(&path).unwrap_err().to_string();
    assert!(error.contains("diagnosis.json") && error.contains("NaN"), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), earlier);
}

#[test]
fn wrong_documents_are_refused_by_the_schema() {
    accepts(&example());
    let mut documents = Vec::new();
    let mut what = Vec::new();
    let changes: [(&str, Value); 12] = [
        ("/format", json!("deadtime/diagnosis@4")),
        ("/model", json!(null)),
        ("/gap/before", json!("0.49")),
        ("/gap/before", json!(-0.1)),
        ("/gap/more", json!(1)),
        ("/cause/verdict", json!("gremlins")),
        ("/cause/verdict", json!("none")), // with a channel and effects
        ("/cause/ranking/0/probability", json!(1.5)),
        ("/cause/ranking/1/effects", json!([["input_delay"], ["sensor_bias", "ay"]])),
        ("/cause/effects/0/parameters/0/ci95", json!([0.1])),
        ("/checks/0/check", json!("colour")),
        ("/prediction/mode", json!("guess")),
    ];
    for (pointer, value) in changes {
        let mut wrong = example();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match wrong.pointer_mut(parent).unwrap() {
            Value::Array(list) => list[key.parse::<usize>().unwrap()] = value.clone(),
            object => object[key] = value.clone(),
        }
        documents.push(wrong);
        what.push(format!("{pointer}: {value}"));
    }
    for section in ["holdout", "where", "shrink"] {
        let mut wrong = example();
        wrong.as_object_mut().unwrap().remove(section);
        assert!(serde_json::from_value::<Diagnosis>(wrong.clone()).is_err(), "{section}");
        documents.push(wrong);
        what.push(section.to_string());
    }
    for (what, found) in what.iter().zip(violations(&documents).unwrap_or_default()) {
        assert!(!found.is_empty(), "{what}");
    }
}

#[test]
fn none_and_unknown_have_no_channel() {
    for verdict in ["none", "unknown"] {
        let mut answer = example();
        answer["cause"]["verdict"] = json!(verdict);
        answer["cause"]["channel"] = json!(null);
        answer["cause"]["effects"] = json!([]);
        answer["cause"]["next_experiment"] = json!(null);
        accepts(&answer);
        let read: Diagnosis = serde_json::from_value(answer.clone()).unwrap();
        assert_eq!(serde_json::to_value(&read).unwrap(), answer);
    }
}

#[test]
fn unreadable_diagnosis_names_file_and_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("diagnosis.json");
    for text in [
        EXAMPLE.replace("diagnosis@3", "diagnosis@7"),
        EXAMPLE.replacen("\"logs\"", "\"lags\"", 1),
        EXAMPLE[..200].to_owned(),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = Diagnosis::read(&path).unwrap_err().to_string();
        assert!(error.contains("diagnosis.json") && error.contains("line"), "{error}");
    }
}
