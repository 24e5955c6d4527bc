//! What a run leaves behind: parts that are checked before they count, one writer at a time, nothing half-written.

use std::path::{Path, PathBuf};

use deadtime::blind::{CaseFiles, Existing, Outcome, RunOptions, run};
use deadtime::file::Lock;
use deadtime::stop::Stop;
use deadtime::study::{Plan, Runner, Study};

use crate::support::blind::{Check, by_heart};

const SMALL: &str = r#"
format = "deadtime/plan@1"
name = "small"
seed = 3
trials = 100
samples = 60
max_delay = 8
plant = ["slow2"]
excitation = ["rbs"]
snr = [100]
delay_s = [4]
method = ["crosscorr", "cusum"]
"#;

fn plan() -> Plan {
    Plan::parse("small", SMALL, Path::new(".")).unwrap()
}

/// A study that was stopped in the middle: the first parts, with so many estimates. One thread, so that they are the first and not all are made before the stop is seen.
fn stopped(runner: &Runner, out: &Path, estimates: usize) -> Vec<PathBuf> {
    let stop = Stop::default();
    let enough = |p: deadtime::study::Progress| {
        if p.now >= estimates {
            stop.set();
        }
    };
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert!(matches!(
        one_thread.install(|| runner.run(out, false, &stop, &enough)),
        Err(deadtime::study::Error::Stopped(_))
    ));
    parts(out)
}

fn parts(out: &Path) -> Vec<PathBuf> {
    let all = std::fs::read_dir(out.join("parts")).unwrap().flatten().map(|f| f.path());
    let mut parts: Vec<PathBuf> =
        all.filter(|p| p.extension().is_some_and(|e| e == "csv")).collect();
    parts.sort();
    parts
}

fn without_times(mut study: Study) -> Study {
    study.cells.iter_mut().for_each(|c| c.time_per_estimate_s = None);
    study
}

#[test]
fn a_part_that_is_damaged_in_any_way_is_found_made_again_and_told() {
    let folder = tempfile::tempdir().unwrap();
    let runner = Runner::new(&plan()).unwrap();
    let whole = without_times(
        runner.run(&folder.path().join("whole"), false, &Stop::default(), &|_| ()).unwrap(),
    );
    let out = folder.path().join("out");
    let made = stopped(&runner, &out, 100);
    let (part, other) = (&made[0], std::fs::read(&made[1]).unwrap());
    let bytes = std::fs::read(part).unwrap();
    let row = bytes.iter().position(|b| *b == b'\n').unwrap() + 1;
    let digit = row + bytes[row..].iter().position(u8::is_ascii_digit).unwrap();
    let changed = |at: usize| {
        let mut bytes = bytes.clone();
        bytes[at] = if bytes[at] == b'1' { b'2' } else { b'1' };
        bytes
    };
    let rows_end = bytes[..bytes.len() - 1].iter().rposition(|b| *b == b'\n').unwrap();
    let before_last_row = bytes[..rows_end].iter().rposition(|b| *b == b'\n').unwrap() + 1;
    for (damage, what) in [
        (Vec::new(), "empty"),
        (vec![0; bytes.len()], "zeros"),
        (bytes[..before_last_row].to_vec(), "cut at a row's end"),
        ([&bytes[..before_last_row], &bytes[rows_end + 1..]].concat(), "a row taken out"),
        (other, "another part"),
        (changed(digit), "a digit"),
        (changed(bytes.len() - 2), "a digit of the digest"),
    ] {
        std::fs::write(part, damage).unwrap();
        let begun = runner.begin(&out, true, &Stop::default()).unwrap();
        let damaged: Vec<String> = begun.damaged().iter().map(ToString::to_string).collect();
        assert!(
            damaged.len() == 1
                && damaged[0].contains("00000000.csv")
                && damaged[0].contains("made again"),
            "{what}: {damaged:?}"
        );
    }
    let resumed = runner.run(&out, true, &Stop::default(), &|_| ()).unwrap();
    assert!(resumed.cells.iter().all(|c| c.trials == 100));
    assert_eq!(without_times(resumed), whole);
}

#[test]
fn any_byte_of_a_part_that_is_flipped_or_cut_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let runner = Runner::new(&plan()).unwrap();
    let out = folder.path().join("out");
    let part = stopped(&runner, &out, 50).swap_remove(0);
    let bytes = std::fs::read(&part).unwrap();
    let damaged = || runner.begin(&out, true, &Stop::default()).unwrap().damaged().len();
    assert_eq!(damaged(), 0);
    // Every place of the whole file is looked at in the reader's own test; here a hundred of them the whole way.
    for at in (0..bytes.len()).step_by(bytes.len() / 100) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 1 << (at % 8);
        std::fs::write(&part, flipped).unwrap();
        assert_eq!(damaged(), 1, "byte {at}");
        std::fs::write(&part, &bytes[..at]).unwrap();
        assert_eq!(damaged(), 1, "cut at {at}");
    }
}

#[test]
fn a_folder_is_written_by_one_run_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let runner = Runner::new(&plan()).unwrap();
    let out = folder.path().join("out");
    stopped(&runner, &out, 50);
    let begun = runner.begin(&out, true, &Stop::default()).unwrap();
    let refused = runner.run(&out, true, &Stop::default(), &|_| ()).unwrap_err().to_string();
    assert!(refused.contains(&std::process::id().to_string()), "{refused}");
    begun.run(&Stop::default(), &|_| ()).unwrap();
    let left: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .flatten()
        .map(|f| f.file_name().to_string_lossy().into_owned())
        .collect();
    assert!(left.iter().all(|f| f == "study.json" || f.starts_with("estimates.")), "{left:?}");
}

#[test]
fn what_dead_runs_left_half_written_is_swept() {
    let folder = tempfile::tempdir().unwrap();
    let runner = Runner::new(&plan()).unwrap();
    let out = folder.path().join("out");
    stopped(&runner, &out, 50);
    let left = [out.join(".deadtime-abc.tmp"), out.join("parts/.deadtime-def.tmp")];
    let foreign = out.join(".tmpXYZ");
    left.iter().chain([&foreign]).for_each(|p| std::fs::write(p, "half").unwrap());
    runner.run(&out, true, &Stop::default(), &|_| ()).unwrap();
    assert!(left.iter().all(|p| !p.exists()) && foreign.exists());
    // Killed before a run had said what it was: nothing is lost by beginning anew.
    let fresh = folder.path().join("fresh");
    std::fs::create_dir_all(fresh.join("parts")).unwrap();
    runner.run(&fresh, false, &Stop::default(), &|_| ()).unwrap();
}

#[test]
fn a_verdict_that_is_damaged_is_made_again_and_others_are_kept() {
    let check = Check::new();
    let diagnose = |case: &CaseFiles| Ok(by_heart(case));
    let go = || {
        let options = RunOptions { existing: Existing::Keep, ..RunOptions::default() };
        run(&check.cases(), &check.verdicts(), &options, &diagnose, &|_, _| {}).unwrap()
    };
    go();
    assert!(go().cases.iter().all(|(_, outcome)| matches!(outcome, Outcome::Kept)));
    let folder = check.verdicts().join("s1");
    for file in ["run.json", "diagnosis.json", "commitment.txt"] {
        let path = folder.join(file);
        let length = std::fs::read(&path).unwrap().len();
        for at in (0..length).step_by(1 + length / 12) {
            let mut bytes = std::fs::read(&path).unwrap();
            let at = at.min(bytes.len() - 1);
            bytes[at] ^= 1;
            std::fs::write(&path, bytes).unwrap();
            for (id, outcome) in go().cases {
                match outcome {
                    Outcome::Done { damage: Some(_), .. } => assert_eq!(id, "s1"),
                    Outcome::Kept => assert_ne!(id, "s1", "{file}, byte {at}"),
                    other => panic!("{id}: {other:?}"),
                }
            }
        }
    }
    let held = Lock::of(&check.verdicts()).unwrap();
    let refused =
        run(&check.cases(), &check.verdicts(), &RunOptions::default(), &diagnose, &|_, _| {})
            .unwrap_err();
    assert!(refused.to_string().contains(&std::process::id().to_string()), "{refused}");
    drop(held);
}
