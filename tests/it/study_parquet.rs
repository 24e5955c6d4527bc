//! Studies as Parquet: the same as CSV, parts of many tasks that make one, parts that are damaged.

use std::path::Path;
use std::process::Command;

use deadtime::stop::Stop;
use deadtime::study::{Budget, Plan, Runner, Tasks, columns};

use crate::study::{SMALL, results};

/// One setting of a hundred records.
const SHORT: &str = r#"
format = "deadtime/plan@1"
name = "short"
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

#[test]
fn parquet_holds_what_the_csv_holds() {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;
    let folder = tempfile::tempdir().unwrap();
    let plan = folder.path().join("small.toml");
    std::fs::write(&plan, SMALL).unwrap();
    let out = folder.path().join("out");
    assert!(
        Command::new(env!("CARGO_BIN_EXE_deadtime"))
            .arg("study")
            .arg(&plan)
            .arg("--out")
            .arg(&out)
            .output()
            .unwrap()
            .status
            .success()
    );
    let mut csv = csv::Reader::from_path(out.join("estimates.csv")).unwrap();
    let names = csv.headers().unwrap().clone();
    let reader =
        SerializedFileReader::new(std::fs::File::open(out.join("estimates.parquet")).unwrap())
            .unwrap();
    let mut rows = 0;
    for (line, row) in csv.records().map(Result::unwrap).zip(reader.get_row_iter(None).unwrap()) {
        for ((name, text), (column, field)) in
            names.iter().zip(line.iter()).zip(row.unwrap().get_column_iter())
        {
            assert_eq!(name, column);
            let same = match field {
                Field::Str(s) => s == text,
                Field::Long(v) => v.to_string() == text,
                Field::Double(v) => v.to_string() == text,
                Field::Null => text.is_empty(),
                other => panic!("{name}: {other:?}"),
            };
            assert!(same, "{name}: {text} {field:?}");
        }
        rows += 1;
    }
    assert_eq!(rows, 2 * 2 * 2 * 60 * 3);
}

#[test]
fn parts_of_many_tasks_say_what_one_run_says() {
    let missing = |tasks: &Tasks| tasks.missing(&Stop::default()).unwrap().0;
    let folder = tempfile::tempdir().unwrap();
    let plan = Plan::parse("small", SMALL, Path::new(".")).unwrap();
    let runner = Runner::new(&plan).unwrap();
    let whole = folder.path().join("whole");
    runner.run(&whole, false, &Stop::default(), &|_| ()).unwrap();
    let out = folder.path().join("parts");
    assert!(Tasks::open(&runner, &out, false).unwrap().is_none());
    // Eight settings of 60 records, three blocks each: tasks of two blocks never straddle settings.
    let tasks = Tasks::new(&runner, &out, runner.tasks_of(2)).unwrap();
    assert_eq!((runner.blocks(), tasks.len()), (24, 16));
    assert_eq!(
        (0..tasks.len()).map(|t| runner.estimates_of(tasks.blocks(t))).sum::<usize>(),
        runner.estimates()
    );
    // Whoever comes first, and twice.
    for task in (0..tasks.len()).rev().chain([3]) {
        assert!(task == 3 || missing(&tasks).contains(&task));
        tasks.keep(task, &runner.part(tasks.blocks(task), &Stop::default()).unwrap()).unwrap();
    }
    assert!(missing(&tasks).is_empty());
    tasks.gather(&runner, &Stop::default()).unwrap();
    assert!(results(&out) == results(&whole));
    let [mut ours, mut theirs] = [tasks.paths(), vec![whole.join("estimates.parquet")]]
        .map(|paths| columns(&paths, &Stop::default()).unwrap());
    for columns in [&mut ours, &mut theirs] {
        columns.retain(|(name, _)| name != "time_s");
    }
    // NaN, where there is nothing, is not equal to itself.
    assert_eq!(format!("{ours:?}"), format!("{theirs:?}"));

    // What is damaged is missing; what belongs to another plan is refused.
    std::fs::write(tasks.path(5), "no part").unwrap();
    assert_eq!(missing(&tasks), [5]);
    assert!(
        tasks
            .gather(&runner, &Stop::default())
            .unwrap_err()
            .to_string()
            .contains("part-00000005.parquet")
    );
    let again = Tasks::open(&runner, &out, true).unwrap().unwrap();
    assert_eq!(again, tasks);
    assert!(Tasks::open(&runner, &out, false).unwrap_err().to_string().contains("resume"));
    let mut other = plan.clone();
    other.seed += 1;
    let other = Runner::untried(&other, &Budget::default()).unwrap();
    assert!(Tasks::open(&other, &out, true).unwrap_err().to_string().contains("another study"));
    assert!(Tasks::new(&runner, &folder.path().join("gaps"), vec![3, 3, 24]).is_err());
}

#[test]
fn a_byte_of_a_parquet_part_that_is_flipped_or_cut_is_found() {
    flipped_or_cut(11);
}

#[test]
#[ignore = "nightly: every byte"]
fn any_byte_of_a_parquet_part_that_is_flipped_or_cut_is_found() {
    flipped_or_cut(1);
}

/// Of a part, every so manieth byte is flipped.
fn flipped_or_cut(step: usize) {
    let folder = tempfile::tempdir().unwrap();
    let runner = Runner::new(&Plan::parse("short", SHORT, Path::new(".")).unwrap()).unwrap();
    let tasks = Tasks::new(&runner, folder.path(), runner.tasks_of(2)).unwrap();
    let made: Vec<Vec<u8>> =
        (0..2).map(|task| runner.part(tasks.blocks(task), &Stop::default()).unwrap()).collect();
    (0..2).for_each(|task| tasks.keep(task, &made[task]).unwrap());
    let state = || tasks.missing(&Stop::default()).unwrap();
    assert!(state().0.is_empty());
    for at in (0..made[0].len()).step_by(step) {
        let mut flipped = made[0].clone();
        flipped[at] ^= 1 << (at % 8);
        std::fs::write(tasks.path(0), flipped).unwrap();
        let (missing, damaged) = state();
        assert_eq!((missing.as_slice(), damaged.len()), ([0].as_slice(), 1), "byte {at}");
        if (at / step).is_multiple_of(50 / step) {
            std::fs::write(tasks.path(0), &made[0][..at]).unwrap();
            assert_eq!(state().0, [0], "cut at {at}");
        }
    }
    std::fs::write(tasks.path(0), &made[1]).unwrap();
    assert!(state().1[0].to_string().contains("another task"), "{:?}", state().1);
    assert!(
        tasks
            .gather(&runner, &Stop::default())
            .unwrap_err()
            .to_string()
            .contains("part-00000000.parquet")
    );
    tasks.keep(0, &made[0]).unwrap();
    assert!(state().0.is_empty() && tasks.gather(&runner, &Stop::default()).is_ok());
}
