use approx::assert_abs_diff_eq;
use std::io::{Read, Write};

use proptest::prelude::*;

use super::error::Error;
use super::*;
use crate::csv::table::{read_from, read_records_from};
use deadtime_signal::time::SampleTime;

fn log(text: &str) -> Log {
    read_from("a.csv", text.as_bytes()).unwrap()
}

fn refusal(bytes: impl AsRef<[u8]>) -> LogError {
    match read_from("a.csv", bytes.as_ref()) {
        Err(Error::Log(error)) => error,
        other => panic!("expected a refusal, got {other:?}"),
    }
}

/// The message names all of these.
fn says(error: &impl std::fmt::Display, parts: &[&str]) {
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "`{message}` lacks `{part}`");
    }
    assert!(!message.ends_with('.'), "`{message}` ends in a full stop");
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

/// Time stamps on a grid of 0.01 s, alternately early and late by `jitter` samples.
fn jittered(samples: usize, jitter: f64) -> Log {
    let time_s = (0..samples)
        .map(|k| 0.01 * (k as f64 + if k % 2 == 0 { jitter } else { -jitter }))
        .collect();
    Log::new("a.csv", time_s, vec![]).unwrap()
}

// Accepted files.

#[test]
fn csv_reads_names_units_and_numbers() {
    let log = log(
        "\u{feff}time [s], heater [V] ,\"temp, inner [degC]\"\r\n0, 1e-3 ,5\r\n\r\n0.5,-2,\"6.5\"\r\n",
    );
    assert_eq!(log.source(), "a.csv");
    assert_eq!(log.names().collect::<Vec<_>>(), ["heater", "temp, inner"]);
    assert_eq!(
        (log.unit("heater"), log.unit("temp, inner"), log.unit("none")),
        (Some("V"), Some("degC"), None)
    );
    assert_eq!(log.time_s(), [0.0, 0.5]);
    assert_eq!(log.input("heater").unwrap(), [1e-3, -2.0]);
    assert_eq!(log.input("temp, inner").unwrap(), [5.0, 6.5]);
    assert_eq!((log.len(), log.duration_s(), log.is_empty()), (2, 0.5, false));
}

#[test]
fn rows_count_as_in_an_editor_behind_blank_lines_and_crlf() {
    let log = log("time,u\r\n0,1\r\n\r\n1,\r\n2,3\r\n");
    assert_eq!([0, 1, 2].map(|k| log.place(k)), [2, 4, 5].map(Place::Row));
    says(&log.input("u").unwrap_err(), &["a.csv", "row 4", "`u`", "at 1 s", "fill the cell"]);
    says(&log.window(Some(1.0), None).unwrap().input("u").unwrap_err(), &["row 4"]);
    assert_eq!(log.window(Some(2.0), None).unwrap().place(0), Place::Row(5));
}

#[test]
fn gzip_is_read_by_its_first_bytes_and_by_name() {
    let packed = gzip(b"time,u\n0,1\n1,2\n");
    assert_eq!(read_from("a.csv", packed.as_slice()).unwrap().input("u").unwrap(), [1.0, 2.0]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv.gz");
    std::fs::write(&path, &packed).unwrap();
    assert_eq!(read(&path).unwrap().len(), 2);
    let records = read_records(&path, "u").unwrap();
    assert_eq!(records[1].source(), format!("{}#2", path.display()));
}

#[test]
fn context_columns_of_text_load_and_are_refused_only_when_asked_for() {
    let log = log("time,mode,u,v\n0,hover,1,1\n1,land,2,inf\n");
    assert_eq!(log.names().collect::<Vec<_>>(), ["u"]);
    let text = log.channel("mode").unwrap_err();
    assert!(
        matches!(&text, LogError::NotANumber { place: Place::Row(2), text, .. } if text == "hover")
    );
    says(&text, &["a.csv", "row 2", "`mode`", "`hover`", "correct it"]);
    let nan = log.output("v").unwrap_err();
    assert!(
        matches!(&nan, LogError::NotFinite { place: Place::Row(3), text, .. } if text == "inf")
    );
    says(&nan, &["a.csv", "row 3", "`v`", "`inf`", "leave the cell empty"]);
}

// Refused files.

#[test]
fn a_missing_file_is_named_with_what_is_missing_of_its_path() {
    let error = read("/nowhere/a.csv".as_ref()).unwrap_err();
    assert!(
        matches!(&error, Error::File(deadtime_signal::file::FileError::Io { reason, .. }) if reason.kind() == std::io::ErrorKind::NotFound)
    );
    says(&error, &["/nowhere/a.csv", "no folder /nowhere"]);
}

#[test]
fn a_folder_without_a_bag_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(
        error.contains("a folder without files that end in .mcap or .db3; give a file"),
        "{error}"
    );
}

#[test]
fn empty_file_is_refused() {
    for text in ["", "\n \r\n", "\u{feff}"] {
        let error = refusal(text);
        assert!(matches!(error, LogError::Empty { .. }), "{error:?}");
        says(&error, &["a.csv", "empty", "header row"]);
    }
}

#[test]
fn header_only_is_refused() {
    for text in ["time,u", "time,u\n\n"] {
        let error = refusal(text);
        assert!(matches!(error, LogError::NoSamples { .. }));
        says(&error, &["a.csv", "no samples", "at least one row"]);
    }
}

#[test]
fn a_column_of_time_is_needed_in_a_known_unit() {
    let error = refusal("0,1\n1,1\n");
    assert!(matches!(error, LogError::NoHeader { row: 1, cells: 2, .. }));
    says(&error, &["a.csv", "row 1", "2 columns", "`columns`"]);
    for (text, found) in [("speed,t\n0,1\n", "`speed`"), ("u;v\n0;1\n", "`u`")] {
        let error = refusal(text);
        assert!(matches!(error, LogError::FirstColumn { .. }));
        says(&error, &["a.csv", "row 1", found, "`time`", "which it is with `time`"]);
    }
    let error = refusal("# made by hand\ntime [ticks],u\n0,1\n");
    assert!(matches!(&error, LogError::TimeUnit { unit, row: 2, .. } if unit == "ticks"));
    says(&error, &["a.csv", "row 2", "`ticks`", "convert it to seconds", "`time_unit`"]);
}

// Dialects.

#[test]
fn separators_decimal_commas_and_comments_are_found_out() {
    for text in [
        "time,u,y\n0,1,2.5\n0.5,-1e-3,\n",
        "time;u;y\n0;1;2,5\n0,5;-1e-3;\n",
        "sep=;\r\ntime;u;y\r\n0;1;2,5\r\n0,5;-0,001;\r\n",
        "time\tu\ty\n0\t1\t2.5\n0.5\t-1e-3\t\n",
        "time|u|y\n0|1|2.5\n0.5|-1e-3|\n",
        "# recorder 3\n# two, or more\ntime,u,y\n0,1,2.5\n# a pause\n0.5,-1e-3,\n",
        "% of a matrix\n# time u y\n0 1 2.5\n",
        "time  u y\n0 1 2.5\n",
    ] {
        let log = log(text);
        assert_eq!(log.names().collect::<Vec<_>>(), ["u", "y"], "{text}");
        assert_eq!(
            (log.input("u").unwrap()[0], log.output("y").unwrap().get(0)),
            (1.0, Some(2.5)),
            "{text}"
        );
        if log.len() > 1 {
            assert_eq!(
                (log.time_s(), log.input("u").unwrap()),
                ([0.0, 0.5].as_slice(), [1.0, -1e-3].as_slice()),
                "{text}"
            );
            assert_eq!(log.output("y").unwrap().get(1), None);
        }
    }
    let log = log("time [s] temp [degC] u\n0 20 1\n1 21 1\n");
    assert_eq!(
        (log.unit("temp"), log.input("temp").unwrap()),
        (Some("degC"), [20.0, 21.0].as_slice())
    );
    says(&refusal("# a\ntime;u\n0;1\n0,5;1,2;3\n"), &["row 4", "3 cells"]);
    let error = crate::csv::table::read_from("a.csv", "time;u\n0;1.234,5\n".as_bytes())
        .unwrap()
        .input("u")
        .unwrap_err();
    says(&error, &["`1.234,5`"]);
}

fn timed(text: &str, options: &ReadOptions) -> (Vec<f64>, String) {
    let recording = crate::csv::table::recording_from("a.csv", text.as_bytes(), options).unwrap();
    let notes = recording.notes.join("|");
    (recording.into_log().unwrap().time_s().to_vec(), notes)
}

#[test]
fn the_unit_of_time_is_guessed_and_said() {
    for (text, expected, said) in [
        ("time,u\n0,1\n4000,1\n8000,1\n", [0.0, 0.004, 0.008], "microseconds by the size"),
        ("time,u\n0,1\n10000000,1\n20000000,1\n", [0.0, 0.01, 0.02], "nanoseconds by the size"),
        ("timestamp,u\n0,1\n10,1\n20,1\n", [0.0, 0.01, 0.02], "milliseconds by the size"),
        ("time_ms,u\n0,1\n10,1\n20,1\n", [0.0, 0.01, 0.02], "milliseconds by its name"),
        ("time [us],u\n0,1\n10,1\n20,1\n", [0.0, 1e-5, 2e-5], "microseconds by its name"),
        (
            "%time,u\n1700000000000000000,1\n1700000000010000001,1\n1700000000020000000,1\n",
            [0.0, 0.010_000_001, 0.02],
            "nanoseconds",
        ),
        (
            "stamp,u\n1700000000123,1\n1700000000133,1\n1700000000143,1\n",
            [0.0, 0.01, 0.02],
            "counted from the first (1700000000123)",
        ),
        (
            "u;date\n1;2024-03-01T10:00:00Z\n1;2024-03-01T10:00:00,5Z\n1;2024-03-01T11:00:01+01:00\n",
            [0.0, 0.5, 1.0],
            "dates",
        ),
        (
            "time,u\n0,1\n10,1\n20,1\n",
            [0.0, 10.0, 20.0],
            "taken in seconds, a sample every 10 s; `time` and `time_unit`",
        ),
        ("time,u\n0,1\n3600,1\n7200,1\n", [0.0, 3600.0, 7200.0], "taken in seconds"),
        ("t,u\n0,1\n0.1,1\n0.2,1\n", [0.0, 0.1, 0.2], "column `t`, taken in seconds"),
        (
            "time,u\n1700000000.25,1\n1700000000.26,1\n1700000000.27,1\n",
            [0.25, 0.26, 0.27],
            "taken in seconds, counted from 1700000000",
        ),
        (
            "time;u\n1700000000,25;1\n1700000001,25;1\n1700000001,26;1\n",
            [0.25, 1.25, 1.26],
            "counted from 1700000000",
        ),
        (
            "stamp,u\n2024-03-01 10:00:00 UTC,1\n2024-03-01 10:00:00.5 UTC,1\n2024-03-01 10:00:01 UTC,1\n",
            [0.0, 0.5, 1.0],
            "dates",
        ),
    ] {
        let (time_s, notes) = timed(text, &ReadOptions::default());
        assert_eq!(time_s, expected, "{text}: {notes}");
        assert!(notes.contains(said), "{text}: {notes}");
    }
    for quiet in
        ["time,u\n0,1\n0.1,1\n", "time [s],u\n0,1\n4000,1\n8000,2\n", "time,u\n0,1\n1,1\n2,1\n"]
    {
        assert_eq!(timed(quiet, &ReadOptions::default()).1, "", "{quiet}");
    }
}

#[test]
fn the_callers_word_on_time_stands() {
    let said = |time: &str, unit| ReadOptions {
        time: Some(time.into()),
        time_unit: unit,
        ..ReadOptions::default()
    };
    let text = "a,time,b\n0,5,1\n4000,6,1\n8000,7,1\n";
    assert_eq!(timed(text, &said("a", Some(TimeUnit::S))).0, [0.0, 4000.0, 8000.0]);
    assert_eq!(timed(text, &said("a", Some(TimeUnit::Ms))).0, [0.0, 4.0, 8.0]);
    let (time_s, notes) = timed(text, &said("a", None));
    assert_eq!(time_s, [0.0, 0.004, 0.008]);
    assert!(notes.contains("`time` is left out"), "{notes}");
    let error =
        crate::csv::table::recording_from("a.csv", text.as_bytes(), &said("c", None)).unwrap_err();
    says(&error, &["`c`", "`a`, `time`, `b`"]);
    let error = crate::csv::table::recording_from(
        "a.csv",
        text.as_bytes(),
        &said("a", Some(TimeUnit::Iso)),
    )
    .unwrap_err();
    says(&error, &["row 2", "`a`", "`0`"]);
    let back = crate::csv::table::recording_from(
        "a.csv",
        "time_us,u\n4000,1\n2000,1\n".as_bytes(),
        &ReadOptions::default(),
    )
    .unwrap_err();
    says(&back, &["row 3", "0.004 s to 0.002 s"]);
}

#[test]
fn columns_need_names_of_their_own() {
    let error = refusal("time,u,\n0,1,2\n");
    assert!(matches!(error, LogError::UnnamedColumn { column: 3, .. }));
    says(&error, &["a.csv", "row 1", "column 3", "name it"]);
    for text in ["time,u,u [V]\n0,1,2\n", "time,time\n0,1\n"] {
        let error = refusal(text);
        assert!(matches!(error, LogError::DuplicateChannel { .. }));
        says(&error, &["a.csv", "two columns", "rename or delete"]);
    }
}

#[test]
fn row_of_another_length_is_refused() {
    for (text, cells) in [("time,u\n0,1\n1\n2,3\n", 1), ("time,u\n0,1\n0,5,1\n", 3)] {
        let error = refusal(text);
        assert_eq!(
            error,
            LogError::RowLength { file: "a.csv".into(), row: 3, expected: 2, found: cells }
        );
        says(&error, &["a.csv", "row 3", "header has 2", "complete or delete", "decimal point"]);
    }
}

#[test]
fn text_in_time_is_refused() {
    let error = refusal("time,u\n0,1\n12:30:01,2\n");
    assert!(matches!(error, LogError::NotATime { row: 3, half: false, .. }));
    says(&error, &["a.csv", "row 3", "`time`", "`12:30:01`", "a number of seconds"]);
}

#[test]
fn nan_and_infinity_in_time_are_refused() {
    for text in ["NaN", "nan", "inf", "-Infinity", "1e999"] {
        let error = refusal(format!("time,u\n0,1\n{text},2\n"));
        assert!(matches!(error, LogError::NotFinite { place: Place::Row(3), .. }), "{error:?}");
        says(&error, &["a.csv", "row 3", "`time`", text]);
    }
    let error = refusal("time,u\n0,1\n1e200,2\n");
    assert!(matches!(error, LogError::TimeRange { place: Place::Row(3), .. }));
    says(&error, &["a.csv", "row 3", "`time`", "1e200", "correct it"]);
}

#[test]
fn infinity_in_a_channel_is_refused() {
    for text in ["inf", "-Infinity", "-1e999"] {
        let error = log(&format!("time,u\n0,1\n1,{text}\n")).input("u").unwrap_err();
        assert!(matches!(error, LogError::NotFinite { place: Place::Row(3), .. }), "{error:?}");
        says(&error, &["a.csv", "row 3", "`u`", text, "leave the cell empty"]);
    }
}

#[test]
fn text_in_a_number_column_is_refused_and_shown_shortened() {
    let error = log(&format!("time,u\n0,1\n1,{}\n", "x".repeat(500))).input("u").unwrap_err();
    assert!(matches!(error, LogError::NotANumber { place: Place::Row(3), .. }));
    says(&error, &["a.csv", "row 3", "`u`", "xxx…", "leave the cell empty"]);
    assert!(error.to_string().len() < 250);
}

#[test]
fn empty_time_is_refused() {
    let error = refusal("time,u\n0,1\n ,2\n");
    assert_eq!(error, LogError::EmptyTime { file: "a.csv".into(), row: 3 });
    says(&error, &["a.csv", "row 3", "`time`", "delete the row"]);
}

#[test]
fn time_standing_still_is_refused() {
    let error = refusal("time,u\n0,1\n0.5,2\n0.50,3\n");
    assert_eq!(
        error,
        LogError::TimeStandsStill { file: "a.csv".into(), place: Place::Row(4), time_s: 0.5 }
    );
    says(&error, &["a.csv", "row 4", "`time`", "0.5 s", "more digits"]);
}

#[test]
fn time_running_back_is_refused_and_offers_records() {
    let error = refusal("time,u\n0,1\n0.5,2\n0.25,3\n");
    assert_eq!(
        error,
        LogError::TimeRunsBack {
            file: "a.csv".into(),
            place: Place::Row(4),
            before_s: 0.5,
            time_s: 0.25
        }
    );
    says(&error, &["a.csv", "row 4", "`time`", "0.5 s", "0.25 s", "`read_records`"]);
}

#[test]
fn binary_is_refused() {
    for bytes in [b"\x89PNG\r\n\x1a\n\0\0".as_slice(), b"time,\x01\n", b"time,\x93C\n0,1\n"] {
        let error = refusal(bytes);
        assert!(matches!(error, LogError::NotText { row: 1, .. }), "{error:?}");
        says(&error, &["a.csv", "row 1", "not text", "UTF-8"]);
    }
    for bytes in [
        b"time,u\n0,1\n\0\0\n2,1\n".as_slice(),
        b"time,u\n0,1\n1,\x002\n2,1\n",
        b"time,u\n0,1\n\0\0\n",
        b"\0\0\0\0",
    ] {
        assert!(matches!(refusal(bytes), LogError::NotText { row: 1 | 3, .. }), "{bytes:?}");
    }
    let endless = read_from("a.csv", std::io::repeat(b'x')).unwrap_err();
    assert!(matches!(endless, Error::Log(LogError::NotText { row: 1, .. })));
}

fn squares(rows: i32) -> String {
    (0..rows).fold("time,u\n".to_owned(), |text, k| text + &format!("{k},{}\n", k * k % 977))
}

#[test]
fn damaged_gzip_is_refused() {
    let whole = gzip(squares(20_000).as_bytes());
    // The checksum: the file is whole, and a part differs from the written one.
    let mut damaged = whole.clone();
    let checksum = whole.len() - 8;
    damaged[checksum] ^= 1;
    let error = refusal(&damaged);
    assert!(matches!(error, LogError::Gzip { row, .. } if row > 1000), "{error:?}");
    // Nonsense after unpacking is refused, by any of the checks.
    let mut damaged = whole.clone();
    let middle = whole.len() / 2;
    damaged[middle..middle + 40].iter_mut().for_each(|byte| *byte ^= 0x5a);
    says(&refusal(&damaged), &["a.csv"]);
    says(&error, &["a.csv", "damaged or cut off", "row", "again"]);
    assert!(matches!(refusal(b"\x1f\x8bgarbage and more garbage"), LogError::Gzip { row: 0, .. }));
    assert!(matches!(refusal(&whole[..12]), LogError::Gzip { .. }), "nothing of it can be read");
}

// Files that break off.

fn cut(bytes: &[u8]) -> (Log, String) {
    let recording =
        crate::csv::table::recording_from("a.csv", bytes, &ReadOptions::default()).unwrap();
    let notes = recording.notes.join("|");
    (recording.into_log().unwrap(), notes)
}

/// However many bytes there are, the rows are those of the whole file, and no other.
#[test]
fn a_gzip_stream_that_is_cut_off_is_read_up_to_there() {
    let whole = log(&squares(20_000));
    let packed = gzip(squares(20_000).as_bytes());
    for left in [packed.len() / 2, packed.len() * 9 / 10, packed.len() - 9, packed.len() - 4] {
        let (log, notes) = cut(&packed[..left]);
        assert!(log.len() > 1000 && log.len() <= 20_000, "{}", log.len());
        assert_eq!(log.time_s(), &whole.time_s()[..log.len()]);
        assert_eq!(log.input("u").unwrap(), &whole.input("u").unwrap()[..log.len()]);
        assert!(
            notes.contains("cut off")
                && notes.contains(&format!("read up to row {}", log.len() + 1)),
            "{notes}"
        );
    }
    let records = read_records_from("a.csv", &packed[..packed.len() - 4], "u").unwrap();
    assert_eq!(records.iter().map(Log::len).sum::<usize>(), 20_000);
    // A reader of events has no place for a note on the missing rows, so it fails.
    let error = crate::csv::events::read_events_from(
        "a.csv",
        &packed[..packed.len() - 4],
        ["time", "time"],
    )
    .unwrap_err();
    assert!(matches!(error, Error::Log(LogError::Gzip { .. })), "{error:?}");
}

#[test]
fn half_a_last_row_is_left_out_and_named() {
    let rows = "time,u,y\n0,1,2\n1,1,2\n";
    for (rest, why) in [
        ("2", "1 of 3 cells"),
        ("2,1", "2 of 3 cells"),
        ("2,1,-", "`y` is `-`"),
        ("2,1,", "`y` is ``"),
        ("2,1,1e", "`y` is `1e`"),
        ("2,-,5", ""),
        ("0", "1 of 3 cells"),
        ("0.5,1,2", "its time is `0.5`"),
        ("2,1,\"5", "0 of 3 cells"),
    ] {
        let (log, notes) = cut(format!("{rows}{rest}").as_bytes());
        if why.is_empty() {
            // A whole row: the input's sample is missing, as in any other.
            assert_eq!((log.len(), notes.as_str()), (3, ""), "{rest}");
            continue;
        }
        assert_eq!(
            (log.len(), log.input("u").unwrap(), log.output("y").unwrap().values),
            (2, [1.0, 1.0].as_slice(), [2.0, 2.0].as_slice())
        );
        assert!(
            notes.contains("row 4, the last one, is cut off") && notes.contains(why),
            "{rest}: {notes}"
        );
    }
    // A row that is whole needs no end of the line, and a column that misses samples may miss the last one.
    assert_eq!(cut(format!("{rows}2,1,2").as_bytes()).0.len(), 3);
    assert_eq!(cut(b"time,u,y\n0,1,\n1,1,").0.len(), 2);
    // A row of too few cells that has an end is damage of another kind, and so is one in the middle.
    for text in [format!("{rows}2,1\n"), format!("{rows}2\n3,1,2")] {
        says(&refusal(text), &["a.csv", "row 4", "header has 3", "complete or delete the row"]);
    }
    assert_eq!(
        read_records_from("a.csv", "time,r\n0,1\n1,1\n0,2".as_bytes(), "r").unwrap().len(),
        2,
        "a whole row begins another record"
    );
    assert_eq!(
        read_records_from("a.csv", "time,r,u\n0,1,1\n1,1,1\n0,2".as_bytes(), "r").unwrap().len(),
        1
    );
}

#[test]
fn zero_bytes_at_the_end_are_left_out_and_named() {
    for (rest, rows) in [("", 2), ("2,1", 2), ("2", 2)] {
        let bytes =
            [b"time,u\n0,1\n1,1\n".as_slice(), rest.as_bytes(), &vec![0; 40_000_000]].concat();
        let (log, notes) = cut(&bytes);
        assert_eq!(log.len(), rows);
        assert!(
            notes.contains("zero bytes stand from row 4") && notes.contains("read up to row 3"),
            "{notes}"
        );
    }
}

// Files of other programs.

#[test]
fn tables_of_pandas_loggers_and_spreadsheets_are_read() {
    let expected = (vec![0.0, 0.5], vec![1.0, -1.0], vec![Some(2.5), None]);
    for (text, said) in [
        (",time,u,y\n0,0,1,2.5\n1,0.5,-1,NaN\n", "column 1 has no name and counts the rows"),
        (",time,u,y\n17,0,1,2.5\n25,0.5,-1,\n", "column 1 has no name"),
        ("time,u,y,\n0,1,2.5,\n0.5,-1,nan,\n", ""),
        ("time,u,y,\n0,1,2.5\n0.5,-1,-\n", ""),
        ("time;u;y\n0;1;2,5;\n0,5;-1;--;\n", ""),
        ("time,u,y\ns,V,deg\n0,1,2.5\n0.5,-1,N/A\n", "holds the units"),
        ("time;u;y\n[s];[V];[deg]\n0;1;2,5\n0,5;-1;null\n", "holds the units"),
        ("time,u,y\n(ms),1,(deg)\n0,1,2.5\n500,-1,None\n", "milliseconds"),
        ("time,u,y\n\"0,0\",\"1\",\"2,5\"\n\"0,5\",\"-1\",\"\"\n", ""),
        ("time,u,y\n\"0,000\",\"1,000\",\"2,500\"\n\"0,500\",\"-1,000\",NaN\n", ""),
        ("time,u,y\n0,True,2.5\n0.5,-1,\n", ""),
        ("time,u,y\n0,TRUE,2.5\n0.5,-1,-nan\n", ""),
    ] {
        let (log, notes) = cut(text.as_bytes());
        let y = log.output("y").unwrap();
        let found = (
            log.time_s().to_vec(),
            log.input("u").unwrap().to_vec(),
            (0..2).map(|k| y.get(k)).collect::<Vec<_>>(),
        );
        assert_eq!(found, expected, "{text}: {notes}");
        assert!(notes.contains(said) && (!said.is_empty() || notes.is_empty()), "{text}: {notes}");
    }
    let (log, _) = cut(b"time,u [A],y,m\n[s],[V],(m/s^2),-\n0,1,2,3\n0.1,1,2,3\n");
    assert_eq!((log.unit("u"), log.unit("y"), log.unit("m")), (Some("A"), Some("m/s^2"), None));
    let (log, notes) = cut(b",u\n2024-03-01 10:00:00+00:00,False\n2024-03-01 10:00:00.5+00:00,1\n");
    assert_eq!(
        (log.time_s(), log.input("u").unwrap()),
        ([0.0, 0.5].as_slice(), [0.0, 1.0].as_slice())
    );
    assert!(notes.contains("taken as the time"), "{notes}");
    let events =
        crate::csv::events::read_events_from("a.csv", "a,b\n1,2\nNaN,3\n".as_bytes(), ["a", "b"])
            .unwrap();
    assert_eq!(
        (events[0].times.as_slice(), events[1].times.as_slice()),
        ([1.0].as_slice(), [2.0, 3.0].as_slice())
    );
}

#[test]
fn what_could_mean_two_things_is_refused_with_a_remedy() {
    // Numbers in a column that has no name.
    says(&refusal("time,u,\n0,1,2\n"), &["a.csv", "row 1", "column 3", "name it"]);
    says(&refusal("time,u,\n0,1,\n1,1,2\n"), &["a.csv", "row 1", "column 3", "name it"]);
    says(&refusal(",time,u\n0.5,0,1\n1.5,1,1\n"), &["a.csv", "row 1", "column 1", "name it"]);
    // A cell too many that holds something.
    says(&refusal("time,u\n0,1\n1,1,2\n"), &["row 3", "3 cells"]);
    // Thousands, or a decimal comma.
    let error = log("time,u\n0,\"1,234\"\n1,\"1,5\"\n").input("u").unwrap_err();
    assert!(matches!(error, LogError::Comma { place: Place::Row(2), .. }), "{error:?}");
    says(&error, &["a.csv", "row 2", "`u`", "`1,234`", "thousands", "decimal point", "semicolons"]);
    // Words that are no units.
    says(&refusal("time,u\nstart,V\n0,1\n"), &["a.csv", "row 2", "`time`", "`start`"]);
    says(&refusal("time,u\ns,5\n0,1\n"), &["a.csv", "row 2", "`time`", "`s`"]);
    // A missing input names its row.
    for nothing in ["NaN", "nan", "-", "N/A"] {
        let error = log(&format!("time,u\n0,1\n1,{nothing}\n2,1\n")).input("u").unwrap_err();
        assert!(matches!(error, LogError::MissingInput { place: Place::Row(3), .. }), "{error:?}");
        says(&error, &["a.csv", "row 3", "input `u`", "only outputs may miss"]);
    }
}

#[test]
fn text_of_windows_is_read() {
    let text = "time;Größe [°C]\r\n0;1,5\r\n0,5;2\r\n";
    let le: Vec<u8> =
        "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    let be: Vec<u8> =
        "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(u16::to_be_bytes).collect();
    let latin1: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    for (bytes, said) in [
        (le.clone(), ""),
        (be, ""),
        (gzip(&le), ""),
        (latin1, "row 1 is no UTF-8: its names are read as Latin-1"),
    ] {
        let (log, notes) = cut(&bytes);
        assert_eq!(
            (log.time_s(), log.input("Größe").unwrap()),
            ([0.0, 0.5].as_slice(), [1.5, 2.0].as_slice())
        );
        assert_eq!((log.unit("Größe"), notes.as_str()), (Some("°C"), said));
    }
    assert_eq!(cut(&le[..le.len() - 3]).0.len(), 2);
}

#[test]
fn plain_text_called_gz_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv.gz");
    std::fs::write(&path, "time,u\n0,1\n").unwrap();
    let error = read(&path).unwrap_err();
    assert!(matches!(error, Error::Log(LogError::NotGzip { .. })));
    says(&error, &["a.csv.gz", "not compressed", "rename it"]);
    std::fs::write(&path, "").unwrap();
    assert!(matches!(read(&path), Err(Error::Log(LogError::Empty { .. }))));
}

#[test]
fn open_quote_is_refused() {
    let error = refusal("time,u\n0,\"1\n1,2\"\n");
    assert_eq!(error, LogError::OpenQuote { file: "a.csv".into(), row: 2 });
    says(&error, &["a.csv", "row 2", "close the quote"]);
}

#[test]
fn unknown_channel_lists_what_exists_and_suggests_the_nearest() {
    let error = log("time,heater,temperature,mode\n0,1,2,on\n").input("temprature").unwrap_err();
    assert!(
        matches!(&error, LogError::UnknownChannel { closest: Some(name), .. } if name == "temperature")
    );
    says(
        &error,
        &[
            "a.csv",
            "`temprature`",
            "did you mean `temperature`?",
            "`heater`, `temperature`, `mode`",
        ],
    );
    says(
        &log("time\n0\n").input("u").unwrap_err(),
        &["a.csv", "`u`", "no channels besides `time`"],
    );
    let many = (0..50).map(|i| Channel::new(format!("c{i}"), None, vec![0.0])).collect();
    says(
        &Log::new("a.csv", vec![0.0], many).unwrap().input("speed").unwrap_err(),
        &["`c39` and 10 more"],
    );
}

#[test]
fn log_from_memory_is_checked() {
    let new = |time_s: &[f64], channels| Log::new("mem", time_s.to_vec(), channels).unwrap_err();
    let u = |values: &[f64]| Channel::new("u", None, values.to_vec());
    assert!(matches!(new(&[], vec![]), LogError::Nothing { .. }));
    assert!(matches!(
        new(&[0.0, f64::NAN], vec![]),
        LogError::NotFinite { place: Place::Sample(1), .. }
    ));
    assert!(matches!(
        new(&[0.0, 0.0], vec![]),
        LogError::TimeStandsStill { place: Place::Sample(1), .. }
    ));
    assert!(matches!(
        new(&[0.0, 1.0], vec![u(&[1.0])]),
        LogError::Length { expected: 2, found: 1, .. }
    ));
    assert!(matches!(
        new(&[0.0], vec![Channel::partial("u", None, vec![1.0], vec![])]),
        LogError::Length { found: 0, .. }
    ));
    assert!(matches!(
        new(&[0.0], vec![u(&[f64::INFINITY])]),
        LogError::NotFinite { place: Place::Sample(0), .. }
    ));
    assert!(matches!(new(&[0.0], vec![u(&[1.0]), u(&[1.0])]), LogError::DuplicateChannel { .. }));
    for name in ["", "time", " u", "u [V]", "u\n", "u\r"] {
        let error = new(&[0.0], vec![Channel::new(name, None, vec![1.0])]);
        assert!(matches!(error, LogError::BadName { .. }), "{name:?}: {error:?}");
        says(&error, &["mem", "choose a name"]);
    }
}

#[test]
fn errors_of_a_log_from_memory_count_samples_through_windows_and_resampling() {
    let time_s = (0..6).map(f64::from).collect();
    let gap = Channel::partial("u", None, vec![1.0; 6], vec![true, true, true, true, false, true]);
    let log = Log::new("mem", time_s, vec![gap]).unwrap();
    let cut = log.window(Some(2.0), None).unwrap();
    for log in [&log, &cut] {
        let error = log.input("u").unwrap_err();
        assert!(
            matches!(error, LogError::MissingInput { place: Place::Sample(4), .. }),
            "{error:?}"
        );
        says(&error, &["mem, sample 4", "`window`"]);
        assert!(!error.to_string().contains("row"), "{error}");
    }
    let fine = cut.resample(SampleTime::new(0.5).unwrap(), &[]).unwrap();
    assert_eq!([0, 1, 2].map(|k| fine.place(k)), [2, 2, 3].map(Place::Sample));
    says(
        &Log::new("mem", vec![0.0, 1.0, 0.5], vec![]).unwrap_err(),
        &["mem, sample 2", "a log of each"],
    );
    says(
        &Log::new("mem", vec![0.0, 1.0, 2.0, 4.0], vec![]).unwrap().even_grid().unwrap_err(),
        &["sample ", "`resample(sample_time)`", "`resample(1"],
    );
}

// Missing samples.

#[test]
fn missing_output_sample_is_marked_and_never_nan() {
    let log = log("time,u,y,z\n0,1,,\n1,2,5,\n");
    let y = log.output("y").unwrap();
    assert_eq!((y.values, y.present), ([0.0, 5.0].as_slice(), Some([false, true].as_slice())));
    assert_eq!((y.get(0), y.get(1), y.get(2), y.present_count()), (None, Some(5.0), None, 1));
    assert_eq!(log.output("u").unwrap().present, None);
    let error = log.output("z").unwrap_err();
    assert_eq!(error, LogError::MissingThroughout { file: "a.csv".into(), channel: "z".into() });
    says(&error, &["a.csv", "`z`", "any row", "choose another"]);
    let error = log.input("y").unwrap_err();
    assert_eq!(
        error,
        LogError::MissingInput {
            file: "a.csv".into(),
            place: Place::Row(2),
            channel: "y".into(),
            time_s: 0.0
        }
    );
}

#[test]
fn placeholder_of_a_missing_sample_is_zero_and_a_full_mask_goes() {
    let channels = vec![
        Channel::partial("y", None, vec![f64::NAN, 1.0], vec![false, true]),
        Channel::partial("u", None, vec![1.0, 2.0], vec![true, true]),
    ];
    let log = Log::new("mem", vec![0.0, 1.0], channels).unwrap();
    assert_eq!(log.output("y").unwrap().values, [0.0, 1.0]);
    assert_eq!(log.output("u").unwrap().present, None);
}

// Even grids.

#[test]
fn even_grid_accepts_jitter_of_0_049_samples_and_refuses_0_06() {
    assert_abs_diff_eq!(jittered(1000, 0.049).even_grid().unwrap().seconds(), 0.01, epsilon = 1e-6);
    let error = jittered(1000, 0.06).even_grid().unwrap_err();
    assert!(
        matches!(error, LogError::UnevenTime { deviation_samples, .. } if (deviation_samples.abs() - 0.06).abs() < 1e-3)
    );
    says(&error, &["a.csv", "sample ", "samples from the straight line", "`resample(0.0"]);
}

#[test]
fn even_grid_names_the_worst_row_and_offers_the_median_step() {
    let time_s =
        (0..101).map(|k| 0.01 * (f64::from(k) + if k == 50 { 0.4 } else { 0.0 })).collect();
    let error = Log::new("a.csv", time_s, vec![]).unwrap().even_grid().unwrap_err();
    let LogError::UnevenTime { place, time_s, deviation_samples, suggested_s, .. } = &error else {
        panic!("{error:?}")
    };
    assert_eq!((*place, *suggested_s), (Place::Sample(50), 0.01));
    assert_abs_diff_eq!(*time_s, 0.504, epsilon = 1e-12);
    assert_abs_diff_eq!(*deviation_samples, 0.4, epsilon = 0.01);
    says(&error, &["a.csv", "sample 50", "0.504 s", "0.396", "`resample(0.01)`"]);
}

#[test]
fn even_grid_keeps_round_sample_times_round() {
    for ts in [0.08, 0.01, 0.1, 0.004, 1.0, 2.0] {
        for start_s in [0.0, 3.7, 1.7e9] {
            let time_s = (0..2000).map(|k| start_s + f64::from(k) * ts).collect();
            assert_eq!(
                Log::new("a.csv", time_s, vec![]).unwrap().even_grid().unwrap().seconds(),
                ts
            );
        }
    }
    let third = (0..2000).map(|k| f64::from(k) / 3.0).collect();
    let third = Log::new("a.csv", third, vec![]).unwrap().even_grid().unwrap().seconds();
    assert_abs_diff_eq!(third, 1.0 / 3.0, epsilon = 1e-15);
}

#[test]
fn even_grid_is_the_least_squares_slope() {
    let t = [0.0, 1.02, 1.98, 3.01, 4.0];
    let slope = (-2.0 * t[0] - t[1] + t[3] + 2.0 * t[4]) / 10.0;
    let found = Log::new("a.csv", t.to_vec(), vec![]).unwrap().even_grid().unwrap().seconds();
    assert_abs_diff_eq!(found, slope, epsilon = 1e-14);
}

#[test]
fn even_grid_sees_one_lost_row_and_a_clock_that_drifts() {
    let lost = (0..1000).filter(|k| *k != 500).map(|k| f64::from(k) * 0.01).collect();
    assert!(matches!(
        Log::new("a.csv", lost, vec![]).unwrap().even_grid(),
        Err(LogError::UnevenTime { .. })
    ));
    let drift = (0..1000).map(|k| f64::from(k) * 0.01 + 1e-8 * f64::from(k * k)).collect();
    assert!(matches!(
        Log::new("a.csv", drift, vec![]).unwrap().even_grid(),
        Err(LogError::UnevenTime { .. })
    ));
}

#[test]
fn even_grid_of_one_sample_is_refused() {
    let error = log("time,u\n0,1\n").even_grid().unwrap_err();
    assert_eq!(error, LogError::TooShort { file: "a.csv".into(), needed: 2, found: 1 });
    says(&error, &["a.csv", "1 samples", "at least 2", "longer log"]);
}

// Windows.

#[test]
fn window_counts_from_the_first_sample_and_includes_both_ends() {
    let log = log("time,u,y,m\n10.1,1,,a\n10.2,2,5,b\n10.3,3,6,c\n10.4,4,,d\n");
    let cut = log.window(Some(0.1), Some(0.2)).unwrap();
    assert_eq!(cut.time_s(), [10.2, 10.3]);
    assert_eq!(cut.input("u").unwrap(), [2.0, 3.0]);
    assert_eq!(cut.output("y").unwrap().present, None);
    assert_eq!((cut.place(0), cut.source()), (Place::Row(3), "a.csv"));
    assert!(matches!(cut.channel("m"), Err(LogError::NotANumber { .. })));
    assert_eq!(log.window(None, None).unwrap(), log);
    assert_eq!(log.window(Some(0.25), None).unwrap().len(), 1);
    assert_eq!(log.window(None, Some(0.25)).unwrap().len(), 3);
}

#[test]
fn empty_window_says_the_logs_span() {
    let log = log("time,u\n10,1\n11,2\n12,3\n");
    for (from, to) in [
        (Some(5.0), None),
        (Some(1.5), Some(1.4)),
        (None, Some(-1.0)),
        (Some(0.2), Some(0.3)),
        (Some(f64::NAN), None),
    ] {
        let error = log.window(from, to).unwrap_err();
        assert!(matches!(error, LogError::EmptyWindow { duration_s: 2.0, .. }), "{error:?}");
        says(&error, &["a.csv", "0 s to 2 s", "`window`"]);
    }
}

// Resampling.

#[test]
fn resample_holds_inputs_and_interpolates_outputs() {
    let log = log("time,u,y\n1,10,0\n2,20,1\n4,30,3\n");
    let even = log.resample(SampleTime::new(0.5).unwrap(), &["u"]).unwrap();
    assert_eq!(even.time_s(), [1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]);
    assert_eq!(even.input("u").unwrap(), [10.0, 10.0, 20.0, 20.0, 20.0, 20.0, 30.0]);
    assert_eq!(even.input("y").unwrap(), [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]);
    assert_eq!([0, 3, 6].map(|k| even.place(k)), [2, 3, 4].map(Place::Row));
    assert_eq!(even.even_grid().unwrap().seconds(), 0.5);
}

#[test]
fn resample_onto_its_own_grid_changes_no_value() {
    let text = (0..500).fold("time,u,y\n".to_owned(), |text, k| {
        text + &format!("{},{k},{}\n", f64::from(k) / 10.0, k * 7 % 11)
    });
    let log = log(&text);
    let even = log.resample(SampleTime::new(0.1).unwrap(), &["u"]).unwrap();
    assert_eq!(even.len(), 500);
    assert_eq!(even.input("u").unwrap(), log.input("u").unwrap());
    assert_eq!(even.input("y").unwrap(), log.input("y").unwrap());
}

#[test]
fn resample_leaves_missing_what_needs_a_missing_neighbour() {
    let log = log("time,u,y\n0,1,1\n1,,\n2,3,3\n3,4,4\n");
    let even = log.resample(SampleTime::new(0.5).unwrap(), &["u"]).unwrap();
    let there = |name| even.output(name).unwrap().present.unwrap().to_vec();
    assert_eq!(there("y"), [true, false, false, false, true, true, true]);
    assert_eq!(there("u"), [true, true, false, false, true, true, true]);
    says(&even.input("u").unwrap_err(), &["row 3", "at 1 s"]);
}

#[test]
fn resample_refuses_unknown_channels_and_absurd_sample_times() {
    let log = log("time,u\n0,1\n100,2\n");
    assert!(matches!(
        log.resample(SampleTime::new(1.0).unwrap(), &["v"]),
        Err(LogError::UnknownChannel { .. })
    ));
    let error = log.resample(SampleTime::new(1e-9).unwrap(), &[]).unwrap_err();
    assert!(matches!(error, LogError::TooFine { .. }));
    says(&error, &["a.csv", "0.000000001 s", "100 s", "`resample(sample_time)`", "larger"]);
}

// Names.

#[test]
fn rename_gives_columns_the_models_names_and_may_swap_them() {
    let map = |pairs: &[(&str, &str)]| {
        pairs.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect::<Vec<_>>()
    };
    let log = log("time,a [V],b,m\n0,1,2,x\n");
    let swapped = log.clone().rename(&map(&[("a", "b"), ("b", "a")])).unwrap();
    assert_eq!((swapped.input("a").unwrap(), swapped.unit("b")), ([2.0].as_slice(), Some("V")));
    let error = log.clone().rename(&map(&[("u", "c")])).unwrap_err();
    assert!(matches!(error, LogError::UnknownChannel { .. }));
    says(&error, &["a.csv", "`c`", "`a`, `b`"]);
    let error = log.clone().rename(&map(&[("u", "a"), ("v", "a")])).unwrap_err();
    assert!(matches!(error, LogError::MappedTwice { .. }));
    says(&error, &["a.csv", "`a`", "`u`", "`v`", "`rename`"]);
    for taken in [map(&[("b", "a")]), map(&[("m", "a")]), map(&[("x", "a"), ("x", "b")])] {
        let error = log.clone().rename(&taken).unwrap_err();
        assert!(matches!(error, LogError::NameTaken { .. }));
        says(&error, &["a.csv", "new names", "two columns", "a name of its own"]);
    }
    assert!(matches!(log.clone().rename(&map(&[("time", "a")])), Err(LogError::BadName { .. })));
    assert!(matches!(log.rename(&map(&[("u", "m")])), Err(LogError::NotANumber { .. })));
}

// Records.

const SERVO: &str =
    "time,rollout,action,angle\n0.00,0,1,0\n0.02,0,1,0.5\n0.04,0,1,\n0.00,1,2,0\n0.02,1,2,0.7\n";

#[test]
fn records_split_where_the_column_changes_and_time_may_start_afresh() {
    let records = read_records_from("servo.csv", SERVO.as_bytes(), "rollout").unwrap();
    assert_eq!(records.iter().map(Log::source).collect::<Vec<_>>(), ["servo.csv#0", "servo.csv#1"]);
    let [first, second] = records.as_slice() else { panic!("{records:?}") };
    assert_eq!(
        (first.time_s(), second.time_s()),
        ([0.0, 0.02, 0.04].as_slice(), [0.0, 0.02].as_slice())
    );
    assert_eq!(
        (first.output("angle").unwrap().present_count(), second.input("angle").unwrap()),
        (2, [0.0, 0.7].as_slice())
    );
    assert_eq!([first.place(0), second.place(0), second.place(1)], [2, 5, 6].map(Place::Row));
    assert_eq!(second.input("rollout").unwrap(), [1.0, 1.0]);
    assert!(matches!(refusal(SERVO), LogError::TimeRunsBack { place: Place::Row(5), .. }));
}

#[test]
fn records_may_be_named_by_text_and_come_back() {
    let text = "time,phase,u\n0,up,1\n1,up,2\n2,down,3\n3,up,4\n";
    let records = read_records_from("a.csv", gzip(text.as_bytes()).as_slice(), "phase").unwrap();
    assert_eq!(
        records.iter().map(Log::source).collect::<Vec<_>>(),
        ["a.csv#up", "a.csv#down", "a.csv#up"]
    );
}

#[test]
fn records_refuse_what_names_no_record() {
    let refused = |text: &str, column| match read_records_from("a.csv", text.as_bytes(), column) {
        Err(Error::Log(error)) => error,
        other => panic!("expected a refusal, got {other:?}"),
    };
    let error = refused(SERVO, "rolout");
    assert!(matches!(error, LogError::UnknownChannel { .. }));
    says(&error, &["a.csv", "`rolout`", "did you mean `rollout`?"]);
    let error = refused("time,r\n0,\n", "r");
    assert!(matches!(error, LogError::EmptyRecord { row: 2, .. }));
    says(&error, &["a.csv", "row 2", "`r`", "fill it"]);
    assert!(matches!(refused("time,r\n", "r"), LogError::NoSamples { .. }));
    assert!(matches!(refused("time,r\n0\n", "r"), LogError::RowLength { .. }));
    let error = refused("time,r\n1,7\n0,7\n", "r");
    assert!(matches!(error, LogError::TimeRunsBack { place: Place::Row(3), .. }));
    says(&error, &["a.csv#7", "row 3"]);
}

// Writing.

#[test]
fn write_csv_keeps_units_gaps_and_bits_plain_and_compressed() {
    let channels = vec![
        Channel::new("a, \"b\"", Some("m/s^2"), vec![-0.0, f64::MIN_POSITIVE / 3.0]),
        Channel::partial("y", None, vec![0.1 + 0.2, 0.0], vec![true, false]),
    ];
    let folder = tempfile::tempdir().unwrap();
    for name in ["deep/a.csv", "a.csv.gz"] {
        let path = folder.path().join(name);
        let log =
            Log::new(path.display().to_string(), vec![-1e-7, 1e20], channels.clone()).unwrap();
        log.write_csv(&path).unwrap();
        let back = read(&path).unwrap();
        assert_eq!(back, log);
        assert_eq!(
            bits(back.channel("a, \"b\"").unwrap().samples().values),
            bits(&[-0.0, f64::MIN_POSITIVE / 3.0])
        );
    }
    let text = std::fs::read_to_string(folder.path().join("deep/a.csv")).unwrap();
    assert!(
        text.starts_with("time,\"a, \"\"b\"\" [m/s^2]\",y\n-1e-7,-0,0.30000000000000004\n1e20,"),
        "{text}"
    );
}

#[test]
fn stamps_that_look_like_another_unit_are_written_with_theirs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let steps = [1e-3, 0.5, 1.0, 7.0, 60.0, 900.0, 1234.0, 3600.0, 1e6, 2.5e8];
    for (step_s, start_s) in steps.into_iter().flat_map(|s| [0.0, -3.0, 4.0e4].map(|t| (s, t))) {
        let time_s: Vec<f64> = (0..5).map(|k| start_s + step_s * f64::from(k)).collect();
        let log = Log::new("a.csv", time_s, vec![Channel::new("u", None, vec![1.0; 5])]).unwrap();
        log.write_csv(&path).unwrap();
        let back = read(&path).unwrap();
        assert_eq!(back.time_s(), log.time_s(), "{step_s} from {start_s}");
    }
}

// Any input at all.

fn number() -> impl Strategy<Value = f64> {
    any::<u64>().prop_map(f64::from_bits).prop_filter("finite", |x| x.is_finite())
}

proptest! {
    #[test]
    fn any_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let _ = read_from("a.csv", bytes.as_slice());
        let _ = read_from("a.csv", [b"\x1f\x8b".as_slice(), &bytes].concat().as_slice());
        let _ = read_from("a.csv", [b"time,u\n".as_slice(), &bytes].concat().as_slice());
    }

    #[test]
    fn anything_like_csv_never_panics_and_nothing_but_numbers_leaves(
        text in "(time( \\[s\\])?(,[a-c\" \\[\\]]{0,4}){0,3}\r?\n)?([-0-9.,eE\"na inf\r\n]{0,12}\n?){0,12}",
        ts in 1e-3..1e3_f64, from in -10.0..10.0_f64, to in -10.0..10.0_f64,
    ) {
        let _ = read_records_from("a.csv", text.as_bytes(), "a");
        if let Ok(log) = read_from("a.csv", text.as_bytes()) {
            let _ = log.even_grid();
            let ts = SampleTime::new(ts).unwrap();
            let others = [log.window(Some(from), Some(to)), log.resample(ts, &[]), log.rename(&[("x".into(), "a".into())])];
            for log in others.into_iter().flatten() {
                prop_assert!(log.time_s().windows(2).all(|pair| pair[0] < pair[1]));
                prop_assert!(log.channels().all(|channel| channel.samples().values.iter().all(|x| x.is_finite())));
            }
        }
    }

    #[test]
    fn write_then_read_gives_the_same_bits(
        steps in proptest::collection::vec(1e-6..1e3_f64, 1..40),
        start_s in -1e6..1e6_f64,
        seeds in proptest::collection::vec((number(), number(), any::<bool>()), 40),
    ) {
        let time_s: Vec<f64> = steps.iter().scan(start_s, |t, step| { *t += step; Some(*t) }).collect();
        let pick = seeds.iter().take(time_s.len());
        let channels = vec![
            Channel::new("u", Some("N m"), pick.clone().map(|s| s.0).collect()),
            Channel::partial("y", None, pick.clone().map(|s| s.1).collect(), pick.map(|s| s.2).collect()),
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let log = Log::new(path.display().to_string(), time_s, channels).unwrap();
        log.write_csv(&path).unwrap();
        let back = read(&path).unwrap();
        prop_assert_eq!(&back, &log);
        prop_assert_eq!(bits(back.time_s()), bits(log.time_s()));
        prop_assert_eq!(bits(back.input("u").unwrap()), bits(log.input("u").unwrap()));
        prop_assert_eq!(
            bits(back.channel("y").unwrap().samples().values),
            bits(log.channel("y").unwrap().samples().values)
        );
    }

    #[test]
    fn interpolated_values_lie_between_their_neighbours(a in number(), b in number(), ts in 0.01..0.99_f64) {
        let log = Log::new("a.csv", vec![0.0, 1.0], vec![Channel::new("y", None, vec![a, b])]).unwrap();
        let even = log.resample(SampleTime::new(ts).unwrap(), &[]).unwrap();
        let slack = 1e-15 * a.abs().max(b.abs());
        prop_assert!(even.input("y").unwrap().iter().all(|y| *y >= a.min(b) - slack && *y <= a.max(b) + slack));
    }
}

// Size.

/// A log of `rows` rows that is made while it is read.
struct Endless {
    rows: u64,
    made: u64,
    text: Vec<u8>,
    read: usize,
}

impl Read for Endless {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        if self.read == self.text.len() {
            self.text.clear();
            self.read = 0;
            for k in self.made..(self.made + 1000).min(self.rows) {
                writeln!(self.text, "{}.{:03},{},{}.{}", k / 1000, k % 1000, k % 7, k % 5, k % 10)?;
            }
            self.made = (self.made + 1000).min(self.rows);
        }
        let n = into.len().min(self.text.len() - self.read);
        into[..n].copy_from_slice(&self.text[self.read..self.read + n]);
        self.read += n;
        Ok(n)
    }
}

#[test]
fn ten_million_rows_load_and_keep_an_exact_grid() {
    let rows = 10_000_000;
    let log =
        read_from("big.csv", Endless { rows, made: 0, text: b"time,u,y\n".to_vec(), read: 0 })
            .unwrap();
    assert_eq!(log.len() as u64, rows);
    assert_eq!(log.even_grid().unwrap().seconds(), 0.001);
    assert_eq!(log.place(9_999_999), Place::Row(10_000_001));
    assert_eq!(log.input("y").unwrap()[9_999_999], 4.9);
}

#[test]
fn samples_closer_than_any_recorder_takes_them_are_refused() {
    for (step, fine) in [
        (5e-324, false),
        (1e-300, false),
        (1e-20, false),
        (1e-13, false),
        (1e-11, true),
        (1e-9, true),
    ] {
        let stamps: Vec<f64> = (0..50).map(|k| f64::from(k) * step).collect();
        let channel = crate::Channel::new("u", None, vec![1.0; 50]);
        let log = crate::Log::new("a", stamps, vec![channel]);
        assert_eq!(log.is_ok(), fine, "{step}");
        assert!(fine || log.unwrap_err().to_string().contains("another unit"));
    }
}
