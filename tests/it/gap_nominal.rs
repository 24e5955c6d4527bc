//! What is said of the nominal model before any cause: levels that are not the model's, models that a constant would beat.

use deadtime::diagnose::{Caveat, Diagnosed, GapOptions, diagnose};
use deadtime::log::Log;
use deadtime::report::diagnosis::summary;

use super::gap_hard::{as_log, document, log, servo};

fn diagnosed(logs: &[Log]) -> Diagnosed {
    let model = document(&servo(", initial_std = 0.02", ""));
    diagnose(&model, &logs[..1], &logs[1..], &GapOptions::default(), &|_| ()).unwrap()
}

fn served(seed: u64) -> Log {
    let machine = document(&servo(", initial_std = 0.02", ""));
    log(&machine, &[("input_delay", "u", &[0.1])], 900, seed, &[0.0, 0.0])
}

fn values(log: &Log, name: &str) -> Vec<f64> {
    log.input(name).unwrap().to_vec()
}

#[test]
fn a_level_that_is_not_the_models_is_the_first_sentence() {
    let moved = |seed: u64| {
        let log = served(seed);
        let angle: Vec<f64> = values(&log, "angle").iter().map(|v| v + 20.0).collect();
        as_log(log.source(), log.time_s().to_vec(), &values(&log, "u"), &[angle, values(&log, "rate")])
    };
    let found = diagnosed(&[moved(810), moved(811)]);
    let Caveat::OtherOperatingPoint { levels } = &found.caveats[0] else { panic!("{:?}", found.caveats) };
    assert!(levels.contains("`angle`") && !levels.contains("`rate`"), "{levels}");
    assert!(summary(&found).starts_with("First: `angle` is ") && summary(&found).contains("operating = \"mean\""));
    // An offset of the size of the motion is an effect like any other, and a good model is not spoken of.
    let near = |seed: u64| {
        let log = served(seed);
        let angle: Vec<f64> = values(&log, "angle").iter().map(|v| v + 0.5).collect();
        as_log(log.source(), log.time_s().to_vec(), &values(&log, "u"), &[angle, values(&log, "rate")])
    };
    for logs in [[near(810), near(811)], [served(810), served(811)]] {
        let found = diagnosed(&logs);
        assert!(!found.caveats.iter().any(Caveat::comes_first), "{:?}", found.caveats);
    }
}

#[test]
fn a_model_that_a_constant_beats_is_called_poor_where_nothing_mends_it() {
    // The outputs of another flight.
    let mixed = |seed: u64| {
        let (log, other) = (served(seed), served(seed + 50));
        let channels: Vec<Vec<f64>> = ["angle", "rate"].map(|name| values(&other, name)).to_vec();
        as_log(log.source(), log.time_s().to_vec(), &values(&log, "u"), &channels)
    };
    let found = diagnosed(&[mixed(820), mixed(821)]);
    let poor = found.caveats.iter().find(|c| matches!(c, Caveat::PoorModel { .. }));
    assert!(poor.is_some(), "{:?} {:?}", found.caveats, found.diagnosis.shrink);
    assert!(summary(&found).starts_with("First: "), "{}", summary(&found));
}
