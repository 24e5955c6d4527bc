//! Studies as a whole: what is scored, what survives a stop, what is refused.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use deadtime::stop::Stop;
use deadtime::study::{Plan, Runner, Study};

pub(crate) const SMALL: &str = r#"
format = "deadtime/plan@1"
name = "small"
seed = 3
trials = 60
samples = 200
max_delay = 20
plant = ["slow2", "fast1"]
excitation = ["rbs"]
snr = [100, 1]
delay_s = [4, { uniform_s = [2, 9] }]
method = ["arxstruc", "oestruc", "crosscorr"]
[scoring]
kept_percent = [100, 90]
"#;

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_deadtime"))
}

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path.display().to_string()
}

/// The lines of `estimates.csv` without the run times, which are no part of a result.
fn estimates(folder: &Path) -> Vec<Vec<String>> {
    let mut csv = csv::Reader::from_path(folder.join("estimates.csv")).unwrap();
    let columns = csv.headers().unwrap().clone();
    let time = columns.iter().position(|c| c == "time_s").unwrap();
    let line = |r: csv::StringRecord| {
        r.iter().enumerate().filter(|(c, _)| *c != time).map(|(_, v)| v.to_owned()).collect()
    };
    csv.records().map(|r| line(r.unwrap())).collect()
}

/// study.json without the run times.
pub(crate) fn results(folder: &Path) -> Study {
    let mut study = Study::read(folder).unwrap();
    study.cells.iter_mut().for_each(|c| c.time_per_estimate_s = None);
    study
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let plan = write(folder.path(), "small.toml", SMALL);
    let run = |threads: &str| {
        let out = folder.path().join(threads);
        let done = program()
            .args(["study", &plan, "--threads", threads, "--out"])
            .arg(&out)
            .output()
            .unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        (estimates(&out), results(&out))
    };
    let one = run("1");
    assert_eq!(one.0.len(), 2 * 2 * 2 * 60 * 3);
    assert!(one == run("2") && one == run("5"));
}

#[test]
fn a_run_that_is_killed_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    // Enough work that the program is killed in the middle of it.
    let long = SMALL.replace("trials = 60", "trials = 200");
    let plan = write(folder.path(), "small.toml", &long);
    let out = folder.path().join("killed");
    let parts = out.join("parts");
    let finished = || {
        std::fs::read_dir(&parts).map_or(0, |d| {
            d.flatten().filter(|f| f.path().extension().is_some_and(|e| e == "csv")).count()
        })
    };
    let mut running =
        program().args(["study", &plan, "--out"]).arg(&out).stdout(Stdio::null()).spawn().unwrap();
    while finished() < 3 && running.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(5));
    }
    // SIGKILL on Unix: the program has no chance to tidy up.
    running.kill().unwrap();
    running.wait().unwrap();
    let done = finished();
    assert!(done >= 3 && !out.join("study.json").exists(), "it finished too soon to be killed");
    let before: Vec<_> = std::fs::read_dir(&parts)
        .unwrap()
        .flatten()
        .map(|f| (f.path(), f.metadata().unwrap().modified().unwrap()))
        .collect();

    let refused = program().args(["study", &plan, "--out"]).arg(&out).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--resume"));
    let other = program()
        .args(["study", &plan, "--resume", "--seed", "9", "--out"])
        .arg(&out)
        .output()
        .unwrap();
    assert_eq!(other.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&other.stderr).contains("another plan"));
    for (path, time) in before {
        assert_eq!(
            path.metadata().unwrap().modified().unwrap(),
            time,
            "{} was touched",
            path.display()
        );
    }

    let resumed = program().args(["study", &plan, "--resume", "--out"]).arg(&out).output().unwrap();
    assert!(resumed.status.success(), "{}", String::from_utf8_lossy(&resumed.stderr));
    assert!(!parts.exists());
    let whole = folder.path().join("whole");
    assert!(
        program().args(["study", &plan, "--out"]).arg(&whole).output().unwrap().status.success()
    );
    assert!(estimates(&out) == estimates(&whole) && results(&out) == results(&whole));
}

#[test]
fn tables_are_what_the_estimates_say() {
    let folder = tempfile::tempdir().unwrap();
    let plan = write(folder.path(), "small.toml", SMALL);
    assert!(
        program()
            .args(["study", &plan, "--out"])
            .arg(folder.path().join("out"))
            .output()
            .unwrap()
            .status
            .success()
    );
    let out = folder.path().join("out");
    let study = results(&out);
    let mut csv = csv::Reader::from_path(out.join("estimates.csv")).unwrap();
    let names = csv.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = csv.records().map(Result::unwrap).collect();
    let at = |r: &csv::StringRecord, name: &str| {
        r[names.iter().position(|n| n == name).unwrap()].to_owned()
    };
    let number = |r: &csv::StringRecord, name: &str| at(r, name).parse::<f64>().ok();
    for cell in &study.cells {
        let snr = cell.snr.unwrap().to_string();
        let mine: Vec<_> = rows
            .iter()
            .filter(|r| {
                at(r, "plant") == cell.plant
                    && at(r, "snr") == snr
                    && at(r, "injected") == cell.delay_s.to_string()
                    && at(r, "method") == cell.method
            })
            .collect();
        assert_eq!(mine.len(), 60);
        let errors: Vec<f64> = mine
            .iter()
            .filter_map(|r| Some(number(r, "delay_s")? - number(r, "true_delay_s")?))
            .collect();
        assert_eq!(cell.flagged, 60 - errors.len());
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        assert!(
            (cell.rms_samples.unwrap_or(f64::NAN) - rms).abs() < 1e-9 || errors.is_empty(),
            "{}",
            cell.key()
        );
        let held = mine.iter().filter(|r| {
            let (lo, hi, truth) =
                (number(r, "lo_s"), number(r, "hi_s"), number(r, "true_delay_s").unwrap());
            lo.is_some_and(|lo| lo - 1e-9 <= truth) && hi.is_some_and(|hi| truth <= hi + 1e-9)
        });
        assert!(
            errors.is_empty()
                || (cell.coverage95.unwrap() - held.count() as f64 / errors.len() as f64).abs()
                    < 1e-12
        );
        // White noise, an open loop and few poles: the bound is known, and no unbiased estimate of a fraction is better.
        assert!(cell.bound_rms_samples.unwrap() > 0.0);
    }
    // Seeds of records do not depend on the method, and differ from record to record.
    let mut seeds: Vec<String> = rows.iter().map(|r| at(r, "seed")).collect();
    seeds.sort_unstable();
    seeds.dedup();
    assert_eq!(seeds.len(), 2 * 2 * 2 * 60);
    let drawn: Vec<f64> = rows
        .iter()
        .filter(|r| at(r, "injected") == "2..9")
        .filter_map(|r| number(r, "true_delay_s"))
        .collect();
    assert!(drawn.iter().all(|d| (2.0..9.0).contains(d)) && drawn.iter().any(|d| d.fract() > 0.1));
    #[cfg(unix)]
    for name in ["study.json", "estimates.csv", "tables.md", "report.html"] {
        use std::os::unix::fs::PermissionsExt;
        assert_eq!(
            out.join(name).metadata().unwrap().permissions().mode() & 0o777,
            0o644,
            "{name}"
        );
    }
    let tables = std::fs::read_to_string(out.join("tables.md")).unwrap();
    for heading in [
        "RMS error (samples)",
        "95 % interval",
        "bias (samples)",
        "no answer",
        "wrong unflagged",
        "truth in 95 % interval",
        "RMS/bound",
        "time",
    ] {
        assert!(tables.contains(heading), "{heading}");
    }
}

#[test]
fn every_input_has_a_delay_of_its_own() {
    let text = r#"
        format = "deadtime/plan@1"
        name = "inputs"
        trials = 5
        samples = 300
        sample_time_s = 0.1
        plant = "vehicle"
        loop = ["stabilised", "closed"]
        excitation = "rbs"
        delay_s = [[0.2, 0.9, 0.0, 0.35]]
        method = "state_least_squares"
    "#;
    let plan = Plan::parse("inputs", text, Path::new(".")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let study = Runner::new(&plan)
        .unwrap()
        .run(&folder.path().join("out"), false, &Stop::default(), &|_| ())
        .unwrap();
    assert_eq!(study.cells.len(), 8);
    for cell in &study.cells {
        // Without noise whole samples are exact, and so is the half sample where the model is continuous.
        let limit = if cell.delay_s.to_string() == "0.35" { 0.3 } else { 1e-6 };
        assert!(
            cell.flagged == 0 && cell.rms_samples.unwrap() < limit,
            "{}: {:?}",
            cell.key(),
            cell.rms_samples
        );
    }
}

/// A plan of one grid, run in memory's stead in a folder of its own.
fn run(text: &str) -> Study {
    let plan = Plan::parse("here", text, Path::new(".")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    Runner::new(&plan)
        .unwrap()
        .run(&folder.path().join("out"), false, &Stop::default(), &|_| ())
        .unwrap()
}

#[test]
fn missing_samples_and_uneven_stamps_are_those_of_the_same_plant() {
    let study = run(r#"
        format = "deadtime/plan@1"
        name = "logging"
        trials = 5
        samples = 400
        max_delay = 15
        plant = "fast1"
        excitation = "rbs"
        delay_s = [6]
        logging = ["plain", "gaps", "uneven"]
        method = ["oestruc", "arxstruc nb=2"]
        [loggings]
        gaps = { missing = 0.2 }
        uneven = { jitter = 0.4 }
    "#);
    let of = |method: &str, logging: Option<&str>| {
        study.cells.iter().find(|c| c.method == method && c.logging.as_deref() == logging).unwrap()
    };
    // Without noise and with every sample the answer is exact; it stays so where samples are missing.
    assert_eq!(of("arxstruc", None).rms_samples, Some(0.0));
    assert_eq!(of("arxstruc", Some("gaps")).rms_samples, Some(0.0));
    // Commands that are held from stamp to stamp look up to a sample later on the grid than they were, so that the response looks that much sooner; never later.
    for method in ["oestruc", "arxstruc"] {
        let bias = of(method, Some("uneven")).bias_samples.unwrap();
        assert!((-1.0..=0.0).contains(&bias), "{method}: {bias}");
    }
    assert!(
        study
            .cells
            .iter()
            .filter(|c| c.logging.is_some())
            .all(|c| c.key().contains(" gaps:") || c.key().contains(" uneven:"))
    );
}

#[test]
fn the_five_event_criteria_are_studied_like_any_method() {
    let study = run(r#"
        format = "deadtime/plan@1"
        name = "events"
        trials = 20
        samples = 60
        sample_time_s = 0.01
        max_delay = 1000
        plant = "gain"
        excitation = "events"
        snr = ["inf", 100]
        delay_s = [2.7]
        logging = ["plain", "losses"]
        method = "all_events"
        scoring = { wrong_samples = 5 }
        [loggings]
        losses = { missing = 0.01 }
    "#);
    assert_eq!(study.cells.len(), 20);
    for cell in &study.cells {
        assert_eq!(
            (cell.input.as_str(), cell.output.as_str(), cell.unflagged_wrong),
            ("u", "y", 0),
            "{}",
            cell.key()
        );
        // Errors of 5 hundredths over the root of 60 events, and what a lost one may add.
        let limit = if cell.snr.is_none() { 1e-6 } else { 2.0 };
        assert!(
            cell.flagged < 12 && cell.rms_samples.unwrap() < limit,
            "{}: {:?} {}",
            cell.key(),
            cell.rms_samples,
            cell.flagged
        );
    }
}

#[test]
#[ignore = "nightly: a study of loops"]
fn a_closed_loop_is_estimated_from_its_input_and_from_its_reference() {
    let text = r#"
        format = "deadtime/plan@1"
        name = "loop"
        trials = 10
        samples = 600
        plant = "slow2b"
        loop = "closed"
        controller = "pi"
        excitation = "rbs"
        noise = "slow"
        place = ["u", "r"]
        delay_s = [3]
        method = ["armaxstruc", "oestruc"]
        [controllers]
        pi = { numerator = [0.612, -0.6], denominator = [1.0, -1.0] }
        [noises]
        slow = { ar = [-0.7], innovation_std = 0.05 }
    "#;
    let plan = Plan::parse("loop", text, Path::new(".")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let study = Runner::new(&plan)
        .unwrap()
        .run(&folder.path().join("out"), false, &Stop::default(), &|_| ())
        .unwrap();
    let of = |place: &str| {
        study.cells.iter().find(|c| c.place.name() == place && c.method == "armaxstruc").unwrap()
    };
    assert!(of("u").flagged <= 1 && of("u").rms_samples.unwrap() < 1.0, "{:?}", of("u"));
    // The reference acts through the controller at once and through the loop later; an answer is not as sharp, but it is one about the same delay.
    assert!(of("r").trials == 10);
    assert!(study.cells.iter().all(|c| c.snr.is_none() && c.controller.as_deref() == Some("pi")));
}

#[test]
fn plans_that_cannot_be_are_refused_with_key_and_remedy() {
    let small = |from: &str, to: &str| SMALL.replace(from, to);
    let cases = [
        (
            "format = \"deadtime/plan@9\"".to_owned(),
            small("format = \"deadtime/plan@1\"", "format = \"deadtime/plan@9\""),
            "deadtime/plan@1",
        ),
        ("unknown key".into(), small("seed = 3", "sede = 3"), "sede"),
        ("unknown plant".into(), small("\"slow2\"", "\"slow3\""), "slow2"),
        ("unknown method".into(), small("\"oestruc\"", "\"oestruct\""), "oestruc"),
        ("unknown option".into(), small("\"oestruc\"", "\"oestruc ord=2\""), "oestruc"),
        ("unknown excitation".into(), small("\"rbs\"", "\"rsb\""), "prbs"),
        ("unknown conversion".into(), small("seed = 3", "seed = 3\nc2d = \"zho\""), "zoh"),
        ("unknown noise".into(), small("seed = 3", "seed = 3\nnoise = \"pink\""), "white"),
        (
            "unknown controller".into(),
            small("seed = 3", "seed = 3\nloop = \"closed\"\ncontroller = \"f9\""),
            "dlqr",
        ),
        (
            "reference of an open loop".into(),
            small("seed = 3", "seed = 3\nplace = \"r\""),
            "closed",
        ),
        ("ratio".into(), small("snr = [100, 1]", "snr = [-1]"), "snr"),
        ("ratio as a word".into(), small("snr = [100, 1]", "snr = \"none\""), "inf"),
        ("delay".into(), small("delay_s = [4,", "delay_s = [-4,"), "delay_s"),
        ("delays of two inputs".into(), small("delay_s = [4,", "delay_s = [[4, 5],"), "inputs"),
        (
            "a fraction that Tustin rounds".into(),
            small("seed = 3", "seed = 3\nc2d = \"tustin\""),
            "fractional_delay_order",
        ),
        ("too short for the window".into(), small("samples = 200", "samples = 15"), "max_delay"),
        ("unknown logging".into(), small("seed = 3", "seed = 3\nlogging = \"gaps\""), "plain"),
        (
            "too little logged".into(),
            small("[scoring]", "[loggings.gaps]\nmissing = 0.95\n[scoring]"),
            "loggings.gaps",
        ),
        (
            "stamps that change places".into(),
            small("[scoring]", "[loggings.late]\njitter = 0.5\n[scoring]"),
            "0.45",
        ),
        (
            "uneven stamps in a loop".into(),
            small("seed = 3", "seed = 3\nloop = \"stabilised\"\nlogging = \"late\"")
                .replace("[scoring]", "[loggings.late]\njitter = 0.2\n[scoring]"),
            "open loop",
        ),
        (
            "events through a plant".into(),
            small("\"rbs\"", "\"events\"")
                .replace("[\"arxstruc\", \"oestruc\", \"crosscorr\"]", "\"all_events\""),
            "gain",
        ),
        ("methods of samples on events".into(), small("\"rbs\"", "\"events\""), "arxstruc"),
        (
            "methods of events on samples".into(),
            small("\"oestruc\"", "\"event_correlation\""),
            "event_correlation",
        ),
        ("no trials".into(), small("trials = 60", "trials = 0"), "trials"),
        ("no plant".into(), small("plant = [\"slow2\", \"fast1\"]", ""), "plant"),
        ("share".into(), small("kept_percent = [100, 90]", "kept_percent = [0]"), "kept_percent"),
        ("no TOML".into(), "plan".into(), "plan"),
        ("grids are tables".into(), small("seed = 3", "seed = 3\ngrids = 7"), "[[grids]]"),
        (
            "twins".into(),
            small("[scoring]", "[[grids]]\ngrid = \"a\"\n[[grids]]\ngrid = \"a\"\n[scoring]"),
            "two grids",
        ),
    ];
    let folder = tempfile::tempdir().unwrap();
    for (what, text, told) in cases {
        let plan = write(folder.path(), "plan.toml", &text);
        let out = folder.path().join("out");
        let refused = program().args(["study", &plan, "--out"]).arg(&out).output().unwrap();
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{what}: {said}");
        assert!(said.contains(told), "{what}: {said}");
        assert!(!out.exists(), "{what} left something behind");
    }
    let refused =
        program().args(["study", "bjorkland"]).current_dir(folder.path()).output().unwrap();
    assert!(String::from_utf8_lossy(&refused.stderr).contains("bjorklund"));
}

#[test]
fn a_model_file_is_a_plant() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/uav_lateral_stabilised.toml"),
        folder.path().join("uav.toml"),
    )
    .unwrap();
    let text = SMALL
        .replace("\"slow2\", \"fast1\"", "\"uav.toml\"")
        .replace("trials = 60", "trials = 2\nsample_time_s = 0.02\noutput = \"p\"")
        .replace("delay_s = [4, { uniform_s = [2, 9] }]", "delay_s = [0.06]");
    let plan = write(folder.path(), "plan.toml", &text);
    let done =
        program().args(["study", &plan, "--out"]).arg(folder.path().join("out")).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let study = results(&folder.path().join("out"));
    assert!(study.cells.iter().all(|c| c.output == "p" && c.input == "r"), "{:?}", study.cells[0]);
}

#[test]
fn a_study_that_is_no_longer_wanted_stops_and_goes_on_later() {
    let folder = tempfile::tempdir().unwrap();
    let plan = Plan::parse("small", SMALL, Path::new(".")).unwrap();
    let runner = Runner::new(&plan).unwrap();
    let out = folder.path().join("out");
    let stop = Stop::default();
    let enough = |p: deadtime::study::Progress| {
        if p.now > 200 {
            stop.set();
        }
    };
    assert!(matches!(
        runner.run(&out, false, &stop, &enough),
        Err(deadtime::study::Error::Stopped(_))
    ));
    let done = std::fs::read_dir(out.join("parts")).unwrap().count();
    assert!(done > 2 && done < 25, "{done}");
    let study = runner.run(&out, true, &Stop::default(), &|_| ()).unwrap();
    let whole = runner.run(&folder.path().join("whole"), false, &Stop::default(), &|_| ()).unwrap();
    let without_time = |mut s: Study| {
        s.cells.iter_mut().for_each(|c| c.time_per_estimate_s = None);
        s
    };
    assert!(without_time(study) == without_time(whole));
}
