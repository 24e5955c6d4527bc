//! Long work says how far it is: never less than before, and all of it at the end.

use std::path::Path;

use crate::structured::{PENDULUM, swing};
use deadtime::delay::{Feedback, Job, TakenOut, identify_behind_delays};
use deadtime::diagnose::{GapOptions, inspect, isolability};
use deadtime::effect::OnLog;
use deadtime::identify::structured::Structured;
use deadtime::identify::subspace::Recordings;
use deadtime::log::{ReadOptions, open};
use deadtime::model::{EquationsFile, ModelDocument};
use deadtime::progress::HowFar;
use deadtime::stop::Stop;

/// The reports of the work in their order: shares with their words.
fn told(work: impl FnOnce(&HowFar)) -> Vec<(f64, String)> {
    let (each, reports) = std::sync::mpsc::channel();
    let far = HowFar::sent(each);
    work(&far);
    reports.try_iter().collect()
}

fn advances(name: &str, told: &[(f64, String)], to: f64) {
    assert!(told.is_sorted_by(|a, b| a.0 <= b.0), "{name} falls back: {told:?}");
    let (last, words) = told.last().unwrap_or_else(|| panic!("{name} says nothing"));
    assert!(*last >= to && !words.is_empty(), "{name} ends at {last}: {told:?}");
}

fn document() -> ModelDocument {
    ModelDocument::from_toml(PENDULUM, Path::new("test.toml")).unwrap()
}

fn equations() -> EquationsFile {
    match document() {
        ModelDocument::Equations(file) => file,
        ModelDocument::Lti(_) => panic!("equations"),
    }
}

#[test]
#[ignore = "nightly: what lasts"]
fn what_lasts_says_how_far_it_is_to_its_end() {
    let logs: Vec<_> = (1..=2).map(|seed| swing(0.02, 0.9, 0.3, 0.01, 0.001, seed)).collect();
    let names = |list: [&str; 1]| list.map(str::to_owned).to_vec();
    let estimates = told(|far| {
        let methods = deadtime::delay::chosen(
            &["arxstruc", "threshold"].map(str::to_owned),
            &Default::default(),
            &[deadtime::delay::Scope::Pair],
        )
        .unwrap();
        let job = Job {
            methods,
            far: far.clone(),
            feedback: Feedback::Open,
            ..Job::new(logs.clone(), ["torque"], ["angle"])
        };
        job.run().unwrap();
    });
    advances("estimate", &estimates, 1.0);
    assert!(
        estimates
            .iter()
            .any(|(_, what)| what.starts_with("answers of methods on torque and angle")),
        "{estimates:?}"
    );
    advances(
        "check",
        &told(|far| drop(inspect(&document(), &logs, &Stop::default(), far).unwrap())),
        1.0,
    );
    advances(
        "isolability",
        &told(|far| drop(isolability(&document(), &logs, &GapOptions::default(), far).unwrap())),
        1.0,
    );
    let learnt = Recordings::from_logs(&logs, &names(["torque"]), &names(["angle"])).unwrap();
    let identified = told(|far| {
        identify_behind_delays(
            &learnt,
            &logs,
            "pbsidopt",
            &serde_json::json!({ "draws": 5 }),
            &TakenOut::Estimated,
            (&Stop::default(), far),
        )
        .unwrap();
    });
    advances("identify", &identified, 0.8);
    let fitted = told(|far| {
        let options = Structured {
            free: names(["gain"]),
            horizon: 25,
            far: far.clone(),
            ..Structured::default()
        };
        options.fit(&equations(), &logs, &[]).unwrap();
    });
    advances("identify --structure", &fitted, 0.9);
    let simulated = told(|far| {
        let (document, log) = (document(), &logs[0]);
        let mut simulation = OnLog::new(&document, log).unwrap();
        simulation.far = far.clone();
        simulation.response().unwrap();
    });
    assert!(simulated.iter().any(|(_, what)| what == "simulating"));
}

#[test]
fn reading_a_file_says_how_much_of_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    swing(0.02, 0.9, 0.3, 0.01, 0.001, 1).write_csv(&path).unwrap();
    let read = told(|far| {
        let options = ReadOptions { far: far.clone(), ..ReadOptions::default() };
        open(&path, &options).unwrap();
    });
    advances("a log of text", &read, 1.0);
    assert!(read.iter().all(|(_, what)| what.contains("log.csv")), "{read:?}");
}
