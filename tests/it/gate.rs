//! The gate: what it must find, what it must pass over, and how often it is wrong.

use crate::support::outside::skipped;
use deadtime::delay::{METHODS, Scope};
use deadtime::report::{gate, junit};
use deadtime::study::{Gate, GateReport, Measured, Plan, Study};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde_json::{Value, json};

/// How answers of a cell are distributed.
#[derive(Clone, Copy)]
struct Truth {
    kind: Kind,
    /// Factor on every error.
    scale: f64,
    flagged: f64,
    coverage: f64,
}

#[derive(Clone, Copy)]
enum Kind {
    Normal,
    /// Whole samples, mostly 0, sometimes 1, rarely many.
    Whole,
    Never,
    /// Nearly exact, 1 in 200 far off.
    Outliers,
    Cauchy,
}

const KINDS: [Kind; 5] = [Kind::Normal, Kind::Whole, Kind::Never, Kind::Outliers, Kind::Cauchy];

fn truth(kind: Kind) -> Truth {
    Truth { kind, scale: 1.0, flagged: 0.03, coverage: 0.95 }
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

fn error(kind: Kind, rng: &mut ChaCha8Rng) -> f64 {
    match kind {
        Kind::Normal => 0.3 * normal(rng),
        Kind::Whole => match rng.random::<f64>() {
            p if p < 0.9 => 0.0,
            p if p < 0.99 => 1.0,
            _ => rng.random_range(2..12_u8).into(),
        },
        Kind::Never => 0.0,
        Kind::Outliers => 0.05 * normal(rng) + if rng.random_bool(0.005) { 15.0 } else { 0.0 },
        Kind::Cauchy => (0.1 * normal(rng) / normal(rng)).clamp(-20.0, 20.0),
    }
}

/// A cell with the results that a study of so many records would show of it.
fn cell(method: &str, number: usize, t: Truth, trials: usize, rng: &mut ChaCha8Rng) -> Value {
    let (mut errors, mut flagged, mut held) = (Vec::new(), 0, 0);
    for _ in 0..trials {
        if rng.random_bool(t.flagged) {
            flagged += 1;
            continue;
        }
        errors.push(t.scale * error(t.kind, rng));
        held += usize::from(rng.random_bool(t.coverage));
    }
    let n = errors.len() as f64;
    let mean = |f: &dyn Fn(&f64) -> f64| errors.iter().map(f).sum::<f64>() / n;
    let square = mean(&|e| e * e);
    let std = ((mean(&|e| e.powi(4)) - square * square).max(0.0) / (n - 1.0)).sqrt();
    let unseen = if square == 0.0 { 3.69 / n } else { 0.0 };
    let some = |v: f64| if v.is_finite() { json!(v) } else { Value::Null };
    let mut cell = plain(method, number);
    for (key, value) in [
        ("snr", json!(100.0)),
        ("repeatable", json!(false)),
        ("trials", json!(trials)),
        ("scored", json!(errors.len())),
        ("intervals", json!(errors.len())),
        ("flagged", json!(flagged)),
        ("unflagged_wrong", json!(errors.iter().filter(|e| e.abs() > 1.0).count())),
        ("rms_samples", some(square.sqrt())),
        (
            "rms_ci95_samples",
            if errors.len() > 1 {
                json!([
                    (square - 1.96 * std).max(0.0).sqrt(),
                    (square + 1.959_963_984_540_054 * std + unseen).sqrt()
                ])
            } else {
                Value::Null
            },
        ),
        ("coverage95", some(held as f64 / n)),
    ] {
        cell[key] = value;
    }
    cell
}

/// A cell without noise, every answer right.
fn plain(method: &str, number: usize) -> Value {
    json!({
        "grid": "g", "plant": format!("plant{number}"), "input": "u", "output": "y", "c2d": "zoh", "excitation": "prbs", "snr": null, "noise": "white", "loop": "open",
        "place": "u", "delay_s": 3.0, "truth": "delay", "method": method, "options": {}, "definition": "d", "repeatable": true,
        "trials": 4, "scored": 4, "intervals": 4, "rms_samples": 0.0, "rms_ci95_samples": [0.0, 0.9], "bias_samples": 0.0, "flagged": 0, "unflagged_wrong": 0,
        "coverage95": 1.0, "bound_rms_samples": null, "time_per_estimate_s": 0.001
    })
}

fn study(seed: u64, cells: Vec<Value>) -> Study {
    serde_json::from_value(json!({ "format": "deadtime/study@1", "plan": "p", "seed": seed, "program": "deadtime", "cells": cells }))
        .unwrap()
}

fn compared(before: &[Value], after: &[Value]) -> GateReport {
    Gate::default().compare(&study(1, after.to_vec()), &study(1, before.to_vec())).unwrap()
}

/// What becomes of the truth of method m and cell c.
type Change = fn(usize, usize, Truth) -> Truth;

const DRAWN: usize = 6;
const CELLS: usize = 10;

/// Two studies of the same truths, but for what `change` does to those of the second.
fn drawn(
    pair: u64,
    trials: [usize; 2],
    change: &dyn Fn(usize, usize, Truth) -> Truth,
) -> [Study; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(pair);
    [0, 1].map(|side| {
        let cells = (0..DRAWN)
            .flat_map(|m| (0..CELLS).map(move |c| (m, c)))
            .map(|(m, c)| {
                let t = truth(KINDS[(m + c) % KINDS.len()]);
                cell(
                    &format!("m{m}"),
                    c,
                    if side == 1 { change(m, c, t) } else { t },
                    trials[side],
                    &mut rng,
                )
            })
            .collect();
        study(side as u64 + 1, cells)
    })
}

/// Sharper than the default: any growth counts.
fn without_margins() -> Gate {
    Gate { margin: 0.0, margin_samples: 0.0, margin_share: 0.0, ..Gate::default() }
}

/// Pairs of studies of which something was called worse.
fn alarms(
    pairs: u64,
    first: u64,
    trials: [usize; 2],
    change: &(dyn Fn(usize, usize, Truth) -> Truth + Sync),
) -> Vec<GateReport> {
    (0..pairs)
        .into_par_iter()
        .map(|pair| {
            let [before, after] = drawn(first + pair, trials, change);
            without_margins().compare(&after, &before).unwrap()
        })
        .filter(|r| !r.worse.is_empty())
        .collect()
}

fn false_alarms(sizes: &[[usize; 2]]) {
    let (mut all, mut false_alarms) = (0, 0);
    for (number, &trials) in sizes.iter().enumerate() {
        let found = alarms(400, 1_000_000 * number as u64, trials, &|_, _, t| t);
        println!("{trials:?}: {} of 400", found.len());
        for report in &found {
            report.worse.iter().for_each(|f| println!("  {}", gate::line(f)));
        }
        // A rate of 1 % makes more than 11 of 400 once in a thousand.
        assert!(found.len() <= 11, "{trials:?}: {} of 400", found.len());
        all += 400;
        false_alarms += found.len();
    }
    assert!(100 * false_alarms <= all, "{false_alarms} of {all}");
}

#[test]
fn equally_accurate_programs_fail_in_less_than_one_run_of_a_hundred() {
    false_alarms(&[[100, 100]]);
}

#[test]
#[ignore = "nightly: a rate over pairs of studies"]
fn equally_accurate_programs_fail_in_less_than_one_run_of_a_hundred_of_any_size() {
    false_alarms(&[[100, 100], [20, 20], [8, 8], [300, 20], [20, 300], [8, 200], [200, 8]]);
}

#[test]
fn a_method_that_lost_accuracy_or_coverage_is_found() {
    let changes: [(&str, &str, Change); 4] = [
        ("RMS doubled in all cells of a method", "m2", |m, _, t| Truth {
            scale: if m == 2 { 2.0 } else { 1.0 },
            ..t
        }),
        ("coverage 95 to 80 % in all cells of a method", "m2", |m, _, t| Truth {
            coverage: if m == 2 { 0.8 } else { t.coverage },
            ..t
        }),
        ("flagged 3 to 10 % in all cells of a method", "m2", |m, _, t| Truth {
            flagged: if m == 2 { 0.1 } else { t.flagged },
            ..t
        }),
        ("RMS tripled in one cell of normal errors", "m0", |m, c, t| Truth {
            scale: if (m, c) == (0, 0) { 3.0 } else { 1.0 },
            ..t
        }),
    ];
    for (number, (what, method, change)) in changes.into_iter().enumerate() {
        let found = alarms(200, 77_000_000 + 1_000_000 * number as u64, [100, 100], &change);
        let rate = found.iter().filter(|r| r.worse.iter().any(|f| f.method == method)).count()
            as f64
            / 200.0;
        println!("{what}: {rate}");
        assert!(rate >= 0.99, "{what}: {rate}");
    }
}

/// What may be expected of a single cell of 100 records among 60; printed, as no promise is made.
#[test]
fn what_is_found_in_a_single_cell() {
    let changes: [(&str, Change); 2] = [
        ("RMS doubled in one cell of normal errors", |m, c, t| Truth {
            scale: if (m, c) == (0, 0) { 2.0 } else { 1.0 },
            ..t
        }),
        ("coverage 95 to 80 % in one cell", |m, c, t| Truth {
            coverage: if (m, c) == (0, 0) { 0.8 } else { t.coverage },
            ..t
        }),
    ];
    for (number, (what, change)) in changes.into_iter().enumerate() {
        let found = alarms(200, 99_000_000 + 1_000_000 * number as u64, [100, 100], &change);
        let [right, wrong] = [true, false].map(|own| {
            found.iter().filter(|r| r.worse.iter().any(|f| (f.method == "m0") == own)).count()
        });
        println!("{what}: found in {right} of 200, others called worse in {wrong}");
        // Other methods stay as they were: a rate of 1 % makes more than 8 of 200 once in a thousand.
        assert!(wrong <= 8, "{what}: {wrong}");
    }
}

#[test]
fn a_trivial_change_does_not_fail_however_sure() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut of =
        |scale: f64| cell("m", 0, Truth { scale, ..truth(Kind::Normal) }, 200_000, &mut rng);
    let (before, grown, doubled) = (of(1.0), of(1.05), of(2.0));
    assert!(compared(std::slice::from_ref(&before), std::slice::from_ref(&grown)).worse.is_empty());
    let report =
        without_margins().compare(&study(2, vec![grown]), &study(1, vec![before.clone()])).unwrap();
    assert_eq!(report.worse[0].measured, Measured::RmsSamples);
    let report = compared(&[doubled], std::slice::from_ref(&before));
    assert!(
        report.worse.is_empty() && report.better.iter().any(|f| f.measured == Measured::RmsSamples)
    );
    assert!(
        compared(std::slice::from_ref(&before), std::slice::from_ref(&before)).worse.is_empty()
    );
}

#[test]
fn what_is_missing_is_named() {
    let before = [plain("a", 0), plain("a", 1), plain("b", 0), plain("b", 1)];
    let report = compared(&before, &before[..1]);
    let lines: Vec<String> = report.worse.iter().map(gate::line).collect();
    assert_eq!(lines.len(), 2, "{lines:?}");
    assert!(lines[0].contains("plant1") && lines[0].contains("missing"), "{lines:?}");
    assert!(lines[1].contains("b, all cells") && lines[1].contains("gone"), "{lines:?}");
    let report = compared(&before[..1], &before);
    assert!(report.worse.is_empty());
    assert_eq!(report.new_cells, 3);
    assert!(report.groups[1].new && !report.groups[0].new);
}

#[test]
fn records_without_noise_are_compared_exactly() {
    let with = |changes: &[(&str, Value)]| {
        let mut cell = plain("a", 0);
        changes.iter().for_each(|(k, v)| cell[*k] = v.clone());
        vec![cell]
    };
    let base = with(&[]);
    for (changes, measured) in [
        (vec![("rms_samples", json!(0.001))], Measured::RmsSamples),
        (
            vec![("flagged", json!(1)), ("scored", json!(3)), ("intervals", json!(3))],
            Measured::Flagged,
        ),
        (vec![("unflagged_wrong", json!(1))], Measured::UnflaggedWrong),
    ] {
        let changed = with(&changes);
        let worse = compared(&base, &changed).worse;
        assert_eq!((worse.len(), worse[0].measured, worse[0].p_value), (1, measured, None));
        let report = compared(&changed, &base);
        assert_eq!((report.worse.len(), report.better[0].measured), (0, measured));
    }
    // Rounding, other numbers of records, and whether an interval of no width holds the truth.
    for same in [
        vec![("rms_samples", json!(1e-6))],
        vec![("trials", json!(1)), ("scored", json!(1)), ("intervals", json!(1))],
        vec![("coverage95", json!(0.0))],
    ] {
        assert!(compared(&base, &with(&same)).worse.is_empty(), "{same:?}");
    }
    // Drawn excitations: exact with equal seeds and numbers of records; else one answer of four is no proof.
    let (before, after) = (
        with(&[("repeatable", json!(false))]),
        with(&[
            ("repeatable", json!(false)),
            ("flagged", json!(1)),
            ("scored", json!(3)),
            ("intervals", json!(3)),
        ]),
    );
    assert_eq!(compared(&before, &after).worse.len(), 1);
    assert!(Gate::default().compare(&study(2, after), &study(1, before)).unwrap().worse.is_empty());
}

#[test]
fn cells_of_one_record_count_as_one() {
    // Ten outputs of one record, each a little worse, in the very same way.
    let cells = |flagged: usize, shared: bool| -> Vec<Value> {
        (0..10)
            .map(|number| {
                let mut cell = plain("m", if shared { 0 } else { number });
                for (key, value) in [
                    ("output", json!(format!("y{number}"))),
                    ("snr", json!(100)),
                    ("repeatable", json!(false)),
                    ("trials", json!(100)),
                ] {
                    cell[key] = value;
                }
                for (key, value) in
                    [("flagged", flagged), ("scored", 100 - flagged), ("intervals", 100 - flagged)]
                {
                    cell[key] = json!(value);
                }
                cell
            })
            .collect()
    };
    assert!(!compared(&cells(5, false), &cells(12, false)).worse.is_empty());
    assert!(compared(&cells(5, true), &cells(12, true)).worse.is_empty());
}

#[test]
fn what_cannot_be_compared_is_refused_with_the_remedy() {
    let base = plain("a", 0);
    let refused = |results: &Study, gate: Gate| {
        gate.compare(results, &study(1, vec![base.clone()])).unwrap_err().to_string()
    };
    let with = |key: &str, value: Value| {
        let mut cell = base.clone();
        cell[key] = value;
        study(1, vec![cell])
    };
    let default = Gate::default();
    let other = Study { plan: "q".to_owned(), ..study(1, vec![base.clone()]) };
    for (results, gate, words) in [
        (other, default, vec!["plan `p`", "plan `q`", "`update`"]),
        (with("plant", json!("x")), default, vec!["none of the baseline's cells", "`update`"]),
        (with("truth", json!("raw")), default, vec!["truth = \"delay\"", "raw", "`update`"]),
        (with("definition", json!("e")), default, vec!["something else", "`update`"]),
        (
            with("flagged", json!(9)),
            default,
            vec!["the results", "counts above its trials", "run the study again"],
        ),
        (with("rms_samples", json!(-1.0)), default, vec!["out of range"]),
        (with("coverage95", json!(1.5)), default, vec!["out of range"]),
        (study(1, Vec::new()), default, vec!["no cells"]),
        (study(1, vec![base.clone(), base.clone()]), default, vec!["two cells"]),
        (study(1, vec![base.clone()]), Gate { alpha: 0.0, ..default }, vec!["alpha is 0"]),
        (study(1, vec![base.clone()]), Gate { margin: f64::NAN, ..default }, vec!["margin is NaN"]),
    ] {
        let text = refused(&results, gate);
        assert!(words.iter().all(|w| text.contains(w)), "{text}");
    }
}

/// Names and attributes of the elements of an XML text whose tags balance.
fn elements(xml: &str) -> Vec<(String, Vec<(String, String)>)> {
    let unescape = |s: &str| {
        assert!(
            !s.contains('<')
                && s.split('&').skip(1).all(|e| ["amp;", "lt;", "gt;", "quot;", "apos;"]
                    .iter()
                    .any(|k| e.starts_with(k))),
            "{s}"
        );
        s.replace("&lt;", "<")
            .replace("&gt;", ">")
            .replace("&quot;", "\"")
            .replace("&apos;", "'")
            .replace("&amp;", "&")
    };
    let mut rest = xml.strip_prefix("<?xml version=\"1.0\" encoding=\"UTF-8\"?>").unwrap();
    let (mut open, mut found) = (Vec::new(), Vec::new());
    while let Some(at) = rest.find('<') {
        unescape(&rest[..at]);
        rest = &rest[at..];
        if let Some(comment) = rest.strip_prefix("<!--") {
            let (inside, after) = comment.split_once("-->").unwrap();
            assert!(!inside.contains("--"));
            rest = after;
            continue;
        }
        // No attribute holds a bare `>`.
        let (tag, after) = rest[1..].split_once('>').unwrap();
        rest = after;
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop().as_deref(), Some(name));
            continue;
        }
        let (tag, closed) = tag.strip_suffix('/').map_or((tag, false), |t| (t, true));
        let (name, mut attributes) = tag.split_once(' ').unwrap_or((tag, ""));
        let mut pairs = Vec::new();
        while let Some((key, more)) = attributes.trim_start().split_once("=\"") {
            let (value, more) = more.split_once('"').unwrap();
            pairs.push((key.to_owned(), unescape(value)));
            attributes = more;
        }
        assert!(attributes.trim().is_empty(), "{tag}");
        if !closed {
            open.push(name.to_owned());
        }
        found.push((name.to_owned(), pairs));
    }
    assert!(open.is_empty() && rest.trim().is_empty());
    found
}

#[test]
fn junit_is_well_formed_and_counts_a_case_per_method() {
    let named = |method: &str, number: usize| {
        let mut cell = plain(method, number);
        cell["options"] = json!({ "which": "a<b & \"c\" | -- 'd'\u{1}" });
        cell
    };
    let before = [named("a", 0), named("a", 1), named("b", 0), named("gone", 0)];
    let mut after = [named("a", 0), named("a", 1), named("b", 0), named("new", 0)];
    after[0]["flagged"] = json!(2);
    after[1]["unflagged_wrong"] = json!(3);
    let report = compared(&before, &after);
    let xml = junit::xml(&report);
    let all = elements(&xml);
    let count = |name: &str| all.iter().filter(|(n, _)| n == name).count();
    assert_eq!(
        ["testsuites", "testsuite", "testcase", "failure", "skipped"].map(count),
        [1, 1, 4, 2, 1],
        "{xml}"
    );
    let suite = &all[1].1;
    for (key, value) in [
        ("name", "g, from u"),
        ("tests", "4"),
        ("failures", "2"),
        ("errors", "0"),
        ("skipped", "1"),
    ] {
        assert!(suite.contains(&(key.to_owned(), value.to_owned())), "{suite:?}");
    }
    let names: Vec<&str> =
        all.iter().filter(|(n, _)| n == "testcase").map(|(_, a)| a[1].1.as_str()).collect();
    assert!(names[0].starts_with("a which=a<b & \"c\""), "{names:?}");
    let page = gate::markdown(&report);
    assert!(
        page.contains("## Worse") && page.contains("the cell")
            || page.contains("records without an answer"),
        "{page}"
    );
    // A bar in a name is escaped, once.
    assert!(page.contains("\"c\" \\| --") && !page.contains("\\\\\\|"), "{page}");
    let said = gate::text(&report);
    assert!(
        !said.contains("NaN") && said.lines().all(|line| line.chars().count() <= 100),
        "{said}"
    );
}

/// The shipped plan and the committed baseline go together, and no method is left out of them. What they say is compared by scripts/gate.
#[test]
fn the_projects_own_baseline_is_of_its_plan_and_has_every_method() {
    let plan = Plan::open("ci").unwrap();
    // It sees what a user can have: every method that needs no model of the states, events, several inputs, loops, missing samples and uneven stamps.
    let named: Vec<&str> =
        plan.grids.iter().flat_map(|g| g.method.iter().map(String::as_str)).collect();
    assert!(
        ["all", "all_events", "state_least_squares"].iter().all(|m| named.contains(m)),
        "{named:?}"
    );
    let grid = |sees: &dyn Fn(&deadtime::study::Grid) -> bool| {
        plan.grids.iter().any(|g| g.method.contains(&"all".to_owned()) && sees(g))
    };
    assert!(
        grid(&|g| g.loops.contains(&deadtime::study::Loop::Closed))
            && grid(&|g| g.plant.contains(&"mixer".to_owned()))
    );
    let logged = |of: &dyn Fn(&deadtime::study::Logging) -> bool| {
        grid(&|g| g.logging.iter().filter_map(|l| plan.loggings.get(l)).any(of))
    };
    assert!(logged(&|l| l.missing > 0.0) && logged(&|l| l.jitter > 0.0));
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/study_ci");
    if !std::path::Path::new(path).exists() {
        return skipped("golden/study_ci, which the published crate lacks");
    }
    let baseline = Study::read(path.as_ref()).unwrap();
    assert_eq!((&baseline.plan, baseline.seed), (&plan.name, plan.seed));
    let has = |grid: &str, method: &str| {
        baseline.cells.iter().any(|c| c.grid == grid && c.method == method)
    };
    for grid in &plan.grids {
        let trials: Vec<usize> =
            baseline.cells.iter().filter(|c| c.grid == grid.name).map(|c| c.trials).collect();
        assert!(
            !trials.is_empty() && trials.iter().all(|t| *t == grid.trials),
            "{}: {trials:?}",
            grid.name
        );
        if grid.method == ["all"] {
            METHODS.iter().filter(|m| m.scope == Scope::Pair).for_each(|m| {
                assert!(has(&grid.name, m.entry.name), "{}: {}", grid.name, m.entry.name)
            });
        }
    }
    assert!(has("states", "state_least_squares"));
    // Repeatable cells, all of those that are meant to be.
    assert!(baseline.cells.iter().all(|c| c.repeatable == c.grid.starts_with("exact")));
    assert!(baseline.cells.iter().all(|c| c.time_per_estimate_s.is_none()));
}

#[cfg(feature = "cli")]
mod program {
    use std::path::Path;
    use std::process::{Command, Output};

    fn deadtime(folder: &Path, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_deadtime"))
            .args(arguments)
            .current_dir(folder)
            .output()
            .unwrap()
    }

    const PLAN: &str = "format = \"deadtime/plan@1\"\nname = \"small\"\nsamples = 120\nmax_delay = 10\ntrials = 6\nplant = \"fast1\"\ndelay_s = [4]\n\
        excitation = \"prbs\"\nsnr = [\"inf\", 100]\nmethod = [\"arxstruc\", \"threshold\"]\n";

    #[test]
    fn exit_codes_files_and_baselines() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let write = |name: &str, text: &str| std::fs::write(at.join(name), text).unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        write("plan.toml", PLAN);
        assert!(deadtime(at, &["study", "plan.toml", "--out", "now"]).status.success());

        let out = deadtime(at, &["gate", "now", "--baseline", "kept"]);
        assert_eq!(out.status.code(), Some(2));
        assert!(text(&out.stderr).contains("--update"), "{}", text(&out.stderr));
        assert!(deadtime(at, &["gate", "now", "--baseline", "kept", "--update"]).status.success());
        let baseline = std::fs::read_to_string(at.join("kept/study.json")).unwrap();
        assert!(!baseline.contains("time_per_estimate_s") && !baseline.contains("null"));

        // What was kept equals what was run, also from another seed, and with other records.
        for more in [vec![], vec!["--seed", "7"], vec!["--trials", "9"]] {
            let mut arguments = vec!["study", "plan.toml", "--out", "again"];
            arguments.extend(more);
            assert!(deadtime(at, &arguments).status.success());
            let out = deadtime(
                at,
                &[
                    "gate",
                    "again/study.json",
                    "--baseline",
                    "kept/study.json",
                    "--junit",
                    "j.xml",
                    "--markdown",
                    "m.md",
                    "--json",
                    "g.json",
                ],
            );
            assert_eq!(out.status.code(), Some(0), "{}{}", text(&out.stdout), text(&out.stderr));
        }
        super::elements(&std::fs::read_to_string(at.join("j.xml")).unwrap());
        let report: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(at.join("g.json")).unwrap()).unwrap();
        assert_eq!(
            (&report["format"], &report["cells"], &report["exact_cells"]),
            (&"deadtime/gate@1".into(), &4.into(), &2.into())
        );
        assert!(std::fs::read_to_string(at.join("m.md")).unwrap().contains("| arxstruc |"));

        // A method that finds the baseline's exact answers no more: its window ends before the delay.
        let study = std::fs::read_to_string(at.join("again/study.json")).unwrap();
        let mut worse: serde_json::Value = serde_json::from_str(&study).unwrap();
        let cell = worse["cells"]
            .as_array_mut()
            .unwrap()
            .iter_mut()
            .find(|c| c["repeatable"] == true)
            .unwrap();
        cell["rms_samples"] = 3.0.into();
        write("worse.json", &worse.to_string());
        let out = deadtime(at, &["gate", "worse.json", "--baseline", "kept", "--junit", "w.xml"]);
        assert_eq!(out.status.code(), Some(1));
        let said = text(&out.stdout);
        let words: Vec<&str> = said.split_whitespace().collect();
        assert!(
            words.windows(4).any(|w| w == ["0", "6", "3.00", "9"]) && words.contains(&"exact"),
            "{said}"
        );
        assert!(said.lines().all(|line| line.chars().count() <= 100), "{said}");
        assert!(std::fs::read_to_string(at.join("w.xml")).unwrap().contains("<failure"));

        for (name, content, word) in [
            ("other.json", "{ \"format\": \"deadtime/study@9\" }", "other.json"),
            ("no.json", "nothing", "no.json"),
        ] {
            write(name, content);
            let out = deadtime(at, &["gate", name, "--baseline", "kept"]);
            assert_eq!(out.status.code(), Some(2));
            assert!(text(&out.stderr).contains(word), "{}", text(&out.stderr));
        }
        assert_eq!(deadtime(at, &["gate", "nowhere", "--baseline", "kept"]).status.code(), Some(2));
        assert_eq!(
            deadtime(at, &["gate", "now", "--baseline", "kept", "--alpha", "2"]).status.code(),
            Some(2)
        );
    }

    /// So many pairs of a bench, the new program so many times as slow as the old one.
    fn pairs(bench: &str, count: usize, times: f64) -> String {
        (0..count)
            .map(|k| {
                format!(
                    "{bench},{k},{},{}\n",
                    1e-6 * (1.0 + 0.01 * k as f64),
                    times * 1e-6 * (1.0 + 0.01 * k as f64)
                )
            })
            .collect()
    }

    #[test]
    fn timings_are_judged_with_exit_codes_and_files() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let write = |name: &str, text: String| std::fs::write(at.join(name), text).unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        const HEAD: &str = "bench,round,before_s,after_s\n";
        let judged = |more: &[&str]| {
            let mut arguments = vec![
                "gate",
                "--timings",
                "t.csv",
                "--junit",
                "j.xml",
                "--markdown",
                "m.md",
                "--json",
                "g.json",
            ];
            arguments.extend(more);
            let out = deadtime(at, &arguments);
            (out.status.code(), text(&out.stdout), text(&out.stderr))
        };
        let files = || {
            ["j.xml", "m.md", "g.json"].map(|name| std::fs::read_to_string(at.join(name)).unwrap())
        };
        let failures =
            |xml: &str| super::elements(xml).iter().filter(|(name, _)| name == "failure").count();

        // Nothing is slower: another 5 % is within the margin. Two benches at 1 % need 8 pairs: 2⁻⁸ < 0.01/2 < 2⁻⁷.
        write(
            "t.csv",
            HEAD.to_owned() + &pairs("scan/fast", 8, 1.0) + &pairs("scan/slow", 8, 1.05),
        );
        let (code, said, _) = judged(&[]);
        assert!(code == Some(0) && said.contains("nothing is slower"), "{said}");
        let [xml, page, json] = files();
        assert_eq!((failures(&xml), xml.matches("<testcase").count()), (0, 2), "{xml}");
        assert!(page.contains("nothing is slower") && page.contains("| scan/slow |"), "{page}");
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(
            (&json["format"], &json["benches"][1]["speed"]),
            (&"deadtime/timings@1".into(), &"same".into())
        );

        // Without a margin the same pairs are slower, and so is what takes half as long again.
        assert_eq!(judged(&["--margin", "0"]).0, Some(1));
        write("t.csv", HEAD.to_owned() + &pairs("scan/fast", 8, 1.0) + &pairs("scan/slow", 8, 1.5));
        let (code, said, told) = judged(&[]);
        assert_eq!(code, Some(1), "{said}{told}");
        assert!(
            said.contains("slower: scan/slow: ")
                && said.contains("1.50 times")
                && !said.contains("slower: scan/fast"),
            "{said}"
        );
        assert!(told.contains("1 of 2 benches are slower"), "{told}");
        let [xml, page, json] = files();
        assert_eq!(failures(&xml), 1, "{xml}");
        assert!(
            page.lines().any(|line| line.contains("| scan/slow |") && line.contains("slower")),
            "{page}"
        );
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(
            (&json["benches"][0]["speed"], &json["benches"][1]["speed"]),
            (&"same".into(), &"slower".into())
        );

        // What cannot be judged is no pass: a bench that one program lacks, too few pairs, no timings at all.
        let cut = pairs("scan/fast", 8, 1.0);
        for (content, words) in [
            (HEAD.to_owned() + &cut + "scan/gone,0,1e-6,\n", ["t.csv", "line: 10"]),
            (HEAD.to_owned() + &cut + &pairs("scan/new", 3, 1.0), ["scan/new", "fewer than 8"]),
            (HEAD.to_owned() + "scan/fast,0,0,1e-6\n", ["line 2", "before_s is 0"]),
            (HEAD.to_owned() + "scan/fast,0,soon,1e-6\n", ["t.csv", "before_s and after_s"]),
            ("name,old,new\na,1,2\n".to_owned(), ["t.csv", "columns bench"]),
            (String::new(), ["t.csv", "no pairs"]),
        ] {
            write("t.csv", content.clone());
            let (code, said, told) = judged(&[]);
            assert_eq!(code, Some(2), "{content}: {said}{told}");
            assert!(words.iter().all(|word| told.contains(word)), "{content}: {told}");
        }
        for wrong in [
            vec!["gate", "--timings", "nowhere.csv"],
            vec!["gate", "now", "--timings", "t.csv"],
            vec!["gate"],
        ] {
            assert_eq!(deadtime(at, &wrong).status.code(), Some(2), "{wrong:?}");
        }
    }
}
