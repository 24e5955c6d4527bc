//! The standard benchmark: what must come out whatever the estimators' details.

use std::collections::BTreeMap;

use deadtime::stop::Stop;
use deadtime::study::{Loop, Place, Plan, Runner, Study};

/// A part of a shipped plan with other trials and another seed than its own.
fn part(plan: &str, grids: &[&str], methods: &[&str], trials: usize) -> Plan {
    let owned = |list: &[&str]| list.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
    let mut plan = Plan::open(plan).unwrap();
    plan.only(&owned(grids), &owned(methods)).unwrap();
    plan.grids.iter_mut().for_each(|g| g.trials = trials);
    plan.seed = 5;
    plan
}

fn run(plan: &Plan) -> (Study, Vec<BTreeMap<String, String>>) {
    let folder = tempfile::tempdir().unwrap();
    let study =
        Runner::new(plan).unwrap().run(folder.path(), false, &Stop::default(), &|_| ()).unwrap();
    let mut csv = csv::Reader::from_path(folder.path().join("estimates.csv")).unwrap();
    (study, csv.deserialize().collect::<Result<_, _>>().unwrap())
}

fn score(study: &Study, grid: &str, place: Place, method: &str, kept: f64) -> f64 {
    let fits = |s: &&deadtime::study::Score| {
        s.grid == grid && s.place == place && s.method_text() == method && s.kept_percent == kept
    };
    study
        .scores
        .iter()
        .find(fits)
        .unwrap_or_else(|| panic!("{grid} {method}"))
        .mean_rms_samples
        .unwrap()
}

#[test]
#[ignore = "nightly: a study"]
fn the_open_loop_cells_come_out_as_published() {
    let (study, _) = run(&part(
        "bjorklund",
        &["open", "open, raw"],
        &["oestruc", "arxstruc", "elnaggar", "cusum"],
        25,
    ));
    assert_eq!(
        study.cells.iter().filter(|c| c.grid == "open" && c.method == "oestruc").count(),
        24
    );
    // Published: 1.66 with all answers kept, 1.4 with 95 %. Another implementation had 1.76 and 1.51; the mean over 24 cells of 25 records is known to 0.1.
    for (kept, published) in [(100.0, 1.66), (95.0, 1.4)] {
        let ours = score(&study, "open, raw", Place::U, "arxstruc", kept);
        assert!((ours - published).abs() < 0.4, "arxstruc, {kept} %: {ours}");
        // What the program answers is no worse than what the source's rule returns.
        assert!(score(&study, "open", Place::U, "arxstruc", kept) < ours + 0.1);
    }
    // With random inputs the published means are .0001, .44, .063 and .45, and no answer is missing at SNR 100.
    for (excitation, snr, published) in [
        ("rbs_10_30", 100.0, 0.0),
        ("rbs_10_30", 1.0, 0.44),
        ("rbs_0_100", 100.0, 0.063),
        ("rbs_0_100", 1.0, 0.45),
    ] {
        let cells: Vec<_> = study
            .cells
            .iter()
            .filter(|c| c.method == "oestruc" && c.excitation == excitation && c.snr == Some(snr))
            .collect();
        let mean = cells.iter().map(|c| c.rms_samples.unwrap()).sum::<f64>() / 4.0;
        assert!(cells.len() == 4 && mean < published + 0.3, "{excitation} {snr}: {mean}");
        assert!(snr < 2.0 || cells.iter().all(|c| c.flagged == 0));
    }
    // The order of the published table: one model fitted for every delay, adding up a response, increments.
    let of = |method: &str| score(&study, "open", Place::U, method, 100.0);
    assert!(of("arxstruc") < of("cusum") && of("cusum") < of("elnaggar"));
}

#[test]
#[ignore = "nightly: a study"]
fn loops_are_estimated_from_their_input_better_than_from_their_reference() {
    let (study, _) = run(&part("bjorklund", &["closed"], &["oestruc", "arxstruc"], 6));
    assert!(
        study.cells.iter().all(|c| c.loops == Loop::Closed && c.samples == 2000 && c.trials == 6)
    );
    assert_eq!(
        study.cells.iter().filter(|c| c.method == "oestruc" && c.place == Place::U).count(),
        18
    );
    // Published: 0.73 from u, 3.2 from r.
    let of = |place| score(&study, "closed", place, "oestruc", 95.0);
    assert!(of(Place::U) < 1.0 && of(Place::R) > 2.0, "{} {}", of(Place::U), of(Place::R));
}

#[test]
fn the_twin_has_every_delay_as_often_as_any_other() {
    let (study, rows) = run(&part("twin", &[], &["threshold"], 50));
    let mut counts = [0_usize; 20];
    for row in &rows {
        let delay: f64 = row["true_delay_s"].parse().unwrap();
        assert!(delay.fract() == 0.0 && (0.0..=19.0).contains(&delay), "{delay}");
        counts[delay as usize] += 1;
    }
    let expected = rows.len() as f64 / 20.0;
    let chi_square: f64 = counts.iter().map(|&n| (n as f64 - expected).powi(2) / expected).sum();
    // 19 degrees of freedom: below 43.8 in 99.9 % of all draws.
    assert!(rows.len() == 1200 && chi_square < 43.8, "{chi_square} {counts:?}");
    // A missing answer counts as 10 samples off, whatever the delay.
    assert!(rows.iter().filter(|r| r["delay_s"].is_empty()).all(|r| r["error_samples"] == "10"));
    assert!(study.cells.iter().any(|c| c.flagged > 0));
}

#[test]
fn a_missing_answer_counts_as_twenty_on_the_published_scale() {
    let (_, rows) = run(&part("bjorklund", &["open", "open, raw"], &["cusum"], 5));
    let missing = |r: &&BTreeMap<String, String>| r["delay_s"].is_empty();
    assert!(rows.iter().filter(missing).count() > 10);
    // The truth is 10: nine seconds and the sample of the hold.
    assert!(rows.iter().filter(missing).all(|r| r["error_samples"] == "10"));
    assert!(rows.iter().all(|r| r["error_samples"].parse::<f64>().unwrap().abs() <= 10.0));
}

#[test]
fn unrelated_channels_are_flagged_by_correlation() {
    let (study, rows) = run(&part("unrelated", &[], &["crosscorr"], 40));
    let flagged: usize = study.cells.iter().map(|c| c.flagged).sum();
    // 1 % of needless answers are allowed: 3.6 of 360, with three standard deviations above 9.3.
    assert!(rows.len() == 360 && flagged >= 350, "{flagged}");
}

#[test]
#[ignore = "nightly: accuracy of all cells"]
fn every_published_number_and_every_aim_finds_its_cells() {
    for name in ["bjorklund", "twin", "subsample", "unrelated"] {
        let whole = Plan::open(name).unwrap();
        let mut wanted: Vec<String> =
            whole.published.iter().filter_map(|p| p.cells.method.clone()).collect();
        wanted.extend(whole.aims.iter().flat_map(|a| a.method.clone()));
        wanted.sort();
        wanted.dedup();
        // One record of every setting is enough to have the cells; the slowest have no published number.
        let (study, _) =
            run(&part(name, &[], &wanted.iter().map(String::as_str).collect::<Vec<_>>(), 1));
        for p in &whole.published {
            let beside = p
                .beside(&study)
                .unwrap_or_else(|| panic!("{name}: no cells of {} {}", p.source, p.cells));
            assert!(beside.ours.is_some(), "{name}: nothing of {} {}", p.source, p.cells);
        }
        for aim in &whole.aims {
            assert_eq!(
                aim.reached(&study).len(),
                if aim.best { 1 } else { aim.method.len() },
                "{name}: {}",
                aim.aim
            );
        }
    }
}

#[test]
fn a_part_of_a_plan_makes_the_same_records_as_the_whole() {
    let (alone, _) = run(&part("bjorklund", &["open"], &["arxstruc"], 2));
    let (beside, _) =
        run(&part("bjorklund", &["open", "open, raw"], &["threshold", "arxstruc"], 2));
    let of = |study: &Study| {
        let cells = study.cells.iter().filter(|c| c.grid == "open" && c.method == "arxstruc");
        cells.map(|c| (c.key(), c.rms_samples)).collect::<Vec<_>>()
    };
    assert!(of(&alone).len() == 24 && of(&alone) == of(&beside));
}

#[test]
fn grids_and_methods_that_a_plan_does_not_have_are_refused_with_those_that_it_has() {
    let only = |grids: &[&str], methods: &[&str]| {
        let owned = |list: &[&str]| list.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
        Plan::open("bjorklund")
            .unwrap()
            .only(&owned(grids), &owned(methods))
            .unwrap_err()
            .to_string()
    };
    let told = only(&["opne"], &[]);
    assert!(told.contains("`opne`") && told.contains("closed, means off"), "{told}");
    let told = only(&["open"], &["armaxstruc"]);
    assert!(told.contains("`armaxstruc`") && told.contains("threshold h_std=3"), "{told}");
    // A name stands for the method with any options, `all` for every one of its methods.
    let plan = part("bjorklund", &["open"], &["threshold"], 1);
    assert_eq!(plan.grids[0].method, ["threshold", "threshold h_std=3"]);
    let mut all = Plan::open("bjorklund").unwrap();
    all.grids[0].method = vec!["all".to_owned()];
    all.only(&[], &["phase_slope".to_owned()]).unwrap();
    assert_eq!(all.grids[0].method, ["phase_slope"]);
}
