//! Logs that grow: every row is read once, whatever the file does meanwhile, and changes of the dead time are told.

use std::fs::{File, OpenOptions, rename};
use std::io::Write;
use std::path::Path;

use deadtime::delay::track::{Live, LiveOptions, Told, TrackerOptions};
use deadtime::log::{Follower, News, ReadOptions, Row, read};
use deadtime::rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

fn add(path: &Path, bytes: &[u8]) {
    OpenOptions::new().append(true).create(true).open(path).unwrap().write_all(bytes).unwrap();
}

fn follow(path: &Path) -> Follower {
    Follower::open(path, &["u", "y"], &ReadOptions::default()).unwrap()
}

/// All that is new until nothing is.
fn all(follower: &mut Follower) -> Vec<News> {
    let mut news = Vec::new();
    loop {
        let polled = follower.poll().unwrap();
        news.extend(polled.news);
        if !polled.grown {
            return news;
        }
    }
}

fn rows(news: &[News]) -> Vec<Row> {
    news.iter()
        .filter_map(|n| if let News::Row(row) = n { Some(row.clone()) } else { None })
        .collect()
}

fn times(news: &[News]) -> Vec<f64> {
    rows(news).iter().map(|r| r.time_s).collect()
}

/// Rows `from..to` of a log whose time is the row's number.
fn text(from: usize, to: usize) -> String {
    (from..to).map(|k| format!("{k},{},{}\n", k % 3, 10 * k)).collect()
}

#[test]
fn rows_that_come_in_any_pieces_are_those_of_the_whole_file() {
    let folder = tempfile::tempdir().unwrap();
    let files = [
        format!("time,u,y\n{}", text(0, 60)),
        // What other programs write: a byte order mark, comments, blank lines, CRLF, semicolons, decimal commas, quotes, more columns, missing cells.
        "\u{feff}# rig 7\r\n\r\ntime;y [m/s];note;u\r\n".to_owned()
            + &(0..60)
                .map(|k| {
                    format!(
                        "{k},25;{};\"a;b\";{k}\r\n",
                        if k == 7 { String::new() } else { format!("{k},5") }
                    )
                })
                .collect::<String>(),
        "# stamp_us u y\n".to_owned()
            + &(0..60)
                .map(|k| format!("{} {k} {}\n", 1_700_000_000_000_000_u64 + 2000 * k, k % 5))
                .collect::<String>(),
        "timestamp,u,y\n".to_owned()
            + &(0..60).map(|k| format!("2024-03-01T10:00:{k:02}Z,{k},1e-3\n")).collect::<String>(),
    ];
    for (n, file) in files.iter().enumerate() {
        let whole = folder.path().join(format!("whole{n}.csv"));
        std::fs::write(&whole, file).unwrap();
        let log = read(&whole).unwrap();
        for seed in 0..5 {
            let mut rng = rng(seed);
            let path = folder.path().join(format!("grows{n}-{seed}.csv"));
            File::create(&path).unwrap();
            let (mut follower, mut news, mut at) = (follow(&path), Vec::new(), 0);
            while at < file.len() {
                let next = (at + rng.random_range(1..120)).min(file.len());
                add(&path, &file.as_bytes()[at..next]);
                news.extend(all(&mut follower));
                at = next;
            }
            news.extend(follower.finish());
            let found = rows(&news);
            assert_eq!(
                found.iter().map(|r| r.time_s).collect::<Vec<_>>(),
                log.time_s(),
                "file {n}"
            );
            for (k, row) in found.iter().enumerate() {
                let there: Vec<Option<f64>> =
                    ["u", "y"].iter().map(|name| log.output(name).unwrap().get(k)).collect();
                assert_eq!(row.values, there, "file {n}, sample {k}");
                assert_eq!(format!("row {}", row.row), log.place(k).to_string(), "file {n}");
            }
            assert!(
                !news
                    .iter()
                    .any(|n| matches!(n, News::Bad(_) | News::Replaced | News::TimeBegins { .. })),
                "{news:?}"
            );
            assert_eq!(follower.unfinished(), None);
        }
    }
}

#[test]
fn a_half_written_line_waits_and_bad_rows_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    std::fs::write(&path, "time,u,y\n0,1,2\n1,1,").unwrap();
    let mut follower = follow(&path);
    let first = all(&mut follower);
    assert_eq!(follower.unfinished(), Some(3));
    assert!(rows(&first).is_empty(), "the unit of time is not known by one row: {first:?}");
    add(&path, b"2\n2,x,2\n3,1\n2.5,1,2\n2.7,\"1,2\n4,inf,2\n5,1,2\n1,1,2\n,1,2\n6,,\n6.5,\0,1\n");
    add(&path, text(7, 30).as_bytes());
    let mut news = all(&mut follower);
    news.extend(follower.finish());
    let mut expected = vec![0.0, 1.0, 2.5, 5.0, 6.0];
    expected.extend((7..30).map(f64::from));
    assert_eq!(times(&news), expected);
    let said: Vec<String> = news
        .iter()
        .filter_map(|n| if let News::Bad(e) = n { Some(e.to_string()) } else { None })
        .collect();
    let parts = [
        ("row 4", "`u` holds `x`"),
        ("row 5", "2 cells"),
        ("row 7", "quote"),
        ("row 8", "`u` holds `inf`"),
        ("row 11", "empty"),
    ];
    let more = [("row 13", "text"), ("row 10", "runs back from 5 s to 1 s")];
    for (row, why) in parts.into_iter().chain(more) {
        assert!(
            said.iter().any(|s| s.contains(&format!("{row}:")) && s.contains(why)),
            "{row} {why}: {said:#?}"
        );
    }
    assert_eq!(said.len(), parts.len() + more.len(), "{said:#?}");
}

#[test]
fn a_file_that_is_rotated_cut_or_written_over_is_read_from_its_beginning() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let header = "time,u,y\n";
    std::fs::write(&path, header.to_owned() + &text(0, 40)).unwrap();
    let mut follower = follow(&path);
    assert_eq!(times(&all(&mut follower)).len(), 40);
    // Rotated: the rows that were still written to the old file come first, and time goes on.
    add(&path, text(40, 45).as_bytes());
    rename(&path, folder.path().join("a.csv.1")).unwrap();
    let news = all(&mut follower);
    assert_eq!(times(&news), [40.0, 41.0, 42.0, 43.0, 44.0]);
    assert!(all(&mut follower).is_empty(), "the file is away for a while");
    std::fs::write(&path, "time,y,u\n45,450,7\n46,460,8\n").unwrap();
    let news = all(&mut follower);
    assert_eq!(news[0], News::Replaced);
    assert_eq!(
        news[1..],
        [(2, 45.0, 7.0), (3, 46.0, 8.0)].map(|(row, time_s, u)| News::Row(Row {
            row,
            time_s,
            values: vec![Some(u), Some(10.0 * time_s)]
        }))
    );
    // Cut, and time begins anew.
    std::fs::write(&path, header.to_owned() + &text(0, 1)).unwrap();
    let news = all(&mut follower);
    assert_eq!(news[..2], [News::Replaced, News::TimeBegins { row: 2 }]);
    assert_eq!(times(&news), [0.0]);
    // Written over with more bytes than were read before.
    std::fs::write(&path, header.to_owned() + &text(100, 140)).unwrap();
    let news = all(&mut follower);
    assert_eq!(news[0], News::Replaced);
    assert_eq!(times(&news), (100..140).map(f64::from).collect::<Vec<_>>());
    // The recorder begins again in the same file, below a second header.
    add(&path, (header.to_owned() + &text(0, 10)).as_bytes());
    let news = all(&mut follower);
    assert!(matches!(&news[0], News::Bad(e) if e.to_string().contains("row 42")), "{news:?}");
    assert_eq!(news[1], News::TimeBegins { row: 43 });
    assert_eq!(times(&news), (0..10).map(f64::from).collect::<Vec<_>>());
}

#[test]
fn what_is_no_log_of_text_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    for (bytes, says) in [
        (&b"\x1f\x8b\x08junk\n"[..], "row 1"),
        (b"a,u,y\n1,2,3\n", "no column is called `time`"),
        (b"time,u,why\n1,2,3\n", "`y`"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let mut follower = follow(&path);
        let refused = follower.poll().unwrap_err().to_string();
        assert!(refused.contains(says), "{refused}");
    }
    assert!(
        Follower::open(&folder.path().join("none.csv"), &["u"], &ReadOptions::default()).is_err()
    );
}

/// A lag behind a dead time in samples, at 100 Hz: (time_s, u, y).
fn machine(samples: usize, seed: u64, late: impl Fn(usize) -> usize) -> Vec<(f64, f64, f64)> {
    let mut rng = rng(seed);
    let (mut u, mut y) = (Vec::new(), 0.0);
    (0..samples)
        .map(|k| {
            u.push(if k % 2 == 1 {
                u[k - 1]
            } else if rng.random() {
                1.0
            } else {
                -1.0
            });
            let d = late(k) + 1;
            y = 0.8 * y
                + if k >= d { 0.2 * u[k - d] } else { 0.0 }
                + 0.02 * rng.random_range(-1.0..1.0);
            (0.01 * k as f64, u[k], y)
        })
        .collect()
}

fn told(
    live: &mut Live,
    rows: impl IntoIterator<Item = (f64, Option<f64>, Option<f64>)>,
) -> Vec<Told> {
    rows.into_iter().flat_map(|(t, u, y)| live.push(t, u, y).unwrap()).collect()
}

fn there(rows: Vec<(f64, f64, f64)>) -> impl Iterator<Item = (f64, Option<f64>, Option<f64>)> {
    rows.into_iter().map(|(t, u, y)| (t, Some(u), Some(y)))
}

#[test]
fn a_change_is_told_once_with_its_time_and_nothing_else_is() {
    for seed in 0..5 {
        let mut live = Live::new(LiveOptions::default());
        let said = told(&mut live, there(machine(3000, seed, |k| if k < 1500 { 4 } else { 9 })));
        let [
            Told::Learning { sample_time_s, .. },
            Told::Delay { delay_s, ci95_s: [low, high], .. },
            Told::DelayChanged { from_s, to_s, since_s, time_s },
        ] = said[..]
        else {
            panic!("{said:?}")
        };
        assert!(
            (sample_time_s - 0.01).abs() < 1e-12
                && low <= 0.04
                && 0.04 <= high
                && (delay_s - 0.04).abs() < 0.005,
            "{said:?}"
        );
        assert!((from_s - 0.04).abs() < 1e-9 && (to_s - 0.09).abs() < 1e-9, "{said:?}");
        let since_s = since_s.unwrap();
        assert!(
            (since_s - 15.0).abs() < 0.1 && (since_s..since_s + 1.0).contains(&time_s),
            "{said:?}"
        );
    }
}

#[test]
fn missing_rows_late_stamps_and_a_fast_clock_are_no_change_of_the_dead_time() {
    for seed in 0..4 {
        let mut live = Live::new(LiveOptions::default());
        let mut rng = rng(100 + seed);
        // A fifth of the rows are gone in bursts, stamps jitter by 2 ms, the clock comes to be 0.3 % fast, cells are missing, and an hour is.
        let rows: Vec<_> = machine(6000, seed, |_| 4)
            .into_iter()
            .enumerate()
            .filter(|(k, _)| k % 1000 > 200 || *k < 1000)
            .map(|(k, (t, u, y))| {
                let t = t
                    + 0.003 * (t - 10.0).max(0.0)
                    + 0.002 * rng.random_range(-1.0..1.0)
                    + if k > 4000 { 3600.0 } else { 0.0 };
                (t, (k % 97 != 0).then_some(u), (k % 31 != 0).then_some(y))
            })
            .collect();
        let said = told(&mut live, rows);
        let news: Vec<&Told> =
            said.iter().filter(|t| !matches!(t, Told::RowsMissing { .. })).collect();
        assert!(matches!(news[..], [Told::Learning { .. }, Told::Delay { .. }]), "{news:?}");
        assert_eq!(said.len() - news.len(), 5, "{said:?}");
        assert_eq!(live.extra(), 0);
    }
}

#[test]
fn a_change_behind_missing_rows_is_told_by_the_stamps_of_the_log() {
    let mut live = Live::new(LiveOptions::default());
    let rows = machine(4000, 3, |k| if k < 2500 { 4 } else { 7 });
    let said = told(
        &mut live,
        there(rows).enumerate().filter(|(k, _)| !(1200..2000).contains(k)).map(|(_, row)| row),
    );
    let Some(Told::DelayChanged { to_s, since_s: Some(since_s), .. }) = said.last() else {
        panic!("{said:?}")
    };
    assert!((to_s - 0.07).abs() < 1e-9 && (since_s - 25.0).abs() < 0.1, "{said:?}");
}

#[test]
fn a_dead_time_that_drifts_is_told_step_by_step() {
    let mut live = Live::new(LiveOptions::default());
    let said = told(&mut live, there(machine(8000, 5, |k| 4 + k.saturating_sub(1000) / 1000)));
    let last = said.iter().rev().find_map(|t| match t {
        Told::DelayChanged { to_s, .. } => Some(*to_s),
        Told::DelayMoved { delay_s, .. } => Some(*delay_s),
        _ => None,
    });
    assert!(last.is_some_and(|d| (d - 0.1).abs() <= 0.011), "{said:?}");
    assert!(!said.iter().any(|t| matches!(t, Told::ResponseChanged { .. })), "{said:?}");
}

#[test]
fn options_out_of_range_are_refused_with_the_sample_time() {
    let mut live = Live::new(LiveOptions { max_delay_s: Some(50.0), ..LiveOptions::default() });
    let refused = there(machine(100, 0, |_| 4))
        .map(|(t, u, y)| live.push(t, u, y))
        .find_map(Result::err)
        .unwrap()
        .to_string();
    assert!(refused.contains("max_delay") && refused.contains("from 1 to 1000"), "{refused}");
    // A longer window needs more rows to learn from: it gets them.
    let options = LiveOptions { max_delay_s: Some(4.0), tracker: TrackerOptions::default() };
    let said = told(&mut Live::new(options), there(machine(1500, 0, |_| 90)));
    assert!(
        matches!(said[..], [Told::Learning { .. }, Told::Delay { delay_s, .. }] if (delay_s - 0.9).abs() < 0.01),
        "{said:?}"
    );
}

#[cfg(feature = "cli")]
mod program {
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};

    use serde_json::Value;

    use super::*;
    use crate::support::program::{Folder, deadtime};

    fn csv(rows: &[(f64, f64, f64)]) -> String {
        rows.iter().map(|(t, u, y)| format!("{t:.3},{u},{y:.5}\n")).collect()
    }

    fn watched(log: &str, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_deadtime"));
        command.args(["watch", log, "--input", "u", "--output", "y"]).args(more);
        command
    }

    #[test]
    fn a_change_is_printed_while_the_log_grows() {
        let folder = Folder::new();
        let log = folder.path("rig.csv");
        let rows = machine(2000, 1, |k| if k < 1000 { 4 } else { 9 });
        std::fs::write(&log, "time,u,y\n".to_owned() + &csv(&rows[..700])).unwrap();
        let mut child =
            watched(log.to_str().unwrap(), &["--every", "0.01", "--quiet", "--json", "-"])
                .stdout(Stdio::piped())
                .spawn()
                .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap())
            .lines()
            .map(|l| serde_json::from_str::<Value>(&l.unwrap()).unwrap());
        let mut until = |event: &str| lines.find(|l| l["event"] == event).unwrap();
        assert_eq!(until("started")["format"], "deadtime/watch@1");
        assert!((until("delay")["delay_s"].as_f64().unwrap() - 0.04).abs() < 0.005);
        // The file grows only now: what follows was read from what was added.
        let more = csv(&rows[700..]);
        let half = more.len() / 2 + 3;
        add(&log, &more.as_bytes()[..half]);
        add(&log, &more.as_bytes()[half..]);
        let changed = until("delay_changed");
        assert!(
            (changed["to_s"].as_f64().unwrap() - 0.09).abs() < 1e-9
                && (changed["since_s"].as_f64().unwrap() - 10.0).abs() < 0.1,
            "{changed}"
        );
        add(&log, b"19.995,x,0\n");
        assert!(until("row_skipped")["why"].as_str().unwrap().contains("row 2002"));
        #[cfg(unix)]
        {
            Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
            assert_eq!(child.wait().unwrap().code(), Some(130));
        }
        #[cfg(not(unix))]
        child.kill().unwrap();
    }

    #[test]
    fn once_reads_what_is_there_and_says_what_was_left_out() {
        let folder = Folder::new();
        let rows = machine(1500, 2, |k| if k < 1000 { 4 } else { 9 });
        let log = folder.write(
            "rig.csv",
            &format!("time,u,y\n{}oops\n{}99,1", csv(&rows[..500]), csv(&rows[500..])),
        );
        let log = log.to_str().unwrap();
        let run = watched(log, &["--once"]).output().unwrap();
        let (out, err) =
            (String::from_utf8(run.stdout).unwrap(), String::from_utf8(run.stderr).unwrap());
        assert!(run.status.success(), "{err}");
        assert!(
            out.contains("dead time 0.04")
                && out.contains("changed from 0.0400 s to 0.0900 s, since ")
                && err.contains("row 502:"),
            "{out}{err}"
        );
        assert!(
            out.ends_with("1500 rows read, 1 skipped; row 1503 has no end yet and was left out\n"),
            "{out}"
        );
        let file = folder.path("lines.jsonl");
        watched(log, &["--until-idle", "0.01", "--json", file.to_str().unwrap()]).output().unwrap();
        let lines: Vec<Value> = std::fs::read_to_string(&file)
            .unwrap()
            .lines()
            .map(|l| serde_json::from_str(l).unwrap())
            .collect();
        let events: Vec<&str> = lines.iter().filter_map(|l| l["event"].as_str()).collect();
        assert_eq!(
            events,
            ["started", "learning", "row_skipped", "delay", "delay_changed", "ended"]
        );
        assert_eq!(lines[5]["rows"], 1500);
    }

    /// 1/(0.0448 s·s + 1): the plant of [`machine`] without its dead time.
    const LAG: &str = r#"format = "deadtime/model@1"
name = "lag"
kind = "lti"
inputs = [{ name = "u" }]
outputs = [{ name = "y" }]
states = [{ name = "x" }]
A = [[-22.3143551]]
B = [[22.3143551]]
C = [[1.0]]
D = [[0.0]]
initial = [0.0]
initial_std = [0.0]
"#;

    #[test]
    fn the_gap_to_a_model_is_told_stretch_by_stretch_and_printed_where_it_changes() {
        let folder = Folder::new();
        let rows = machine(3050, 5, |k| if k < 2000 { 4 } else { 9 });
        let log = folder.write("rig.csv", &format!("time,u,y\n{}", csv(&rows)));
        let (model, file) = (folder.write("lag.toml", LAG), folder.path("lines.jsonl"));
        let more = [
            "--once",
            "--model",
            model.to_str().unwrap(),
            "--window",
            "10",
            "--json",
            file.to_str().unwrap(),
        ];
        let out = String::from_utf8(watched(log.to_str().unwrap(), &more).output().unwrap().stdout)
            .unwrap();
        assert!(
            out.contains("0.000 to 9.990 s: gap ") && out.contains("input_delay on u (delay 0.0"),
            "{out}"
        );
        assert!(
            !out.contains("10.000 to 19.990 s") && out.contains("20.000 to 29.990 s: gap "),
            "{out}"
        );
        let lines: Vec<Value> = std::fs::read_to_string(&file)
            .unwrap()
            .lines()
            .map(|l| serde_json::from_str(l).unwrap())
            .collect();
        let gaps: Vec<&Value> = lines.iter().filter(|l| l["event"] == "gap").collect();
        // The half second behind the last stretch is too short to be one.
        assert_eq!(gaps.len(), 3, "{gaps:?}");
        for (gap, (delay, changed)) in gaps.iter().zip([(0.04, true), (0.04, false), (0.09, true)])
        {
            assert_eq!(
                (&gap["verdict"], gap["changed"].as_bool()),
                (&Value::from("input_delay"), Some(changed)),
                "{gap}"
            );
            let found = gap["effects"][0]["parameters"][0]["value"].as_f64().unwrap();
            assert!((found - delay).abs() < 0.003, "{gap}");
            assert!(gap["error"].as_f64().unwrap() > gap["floor"].as_f64().unwrap(), "{gap}");
        }
    }

    #[test]
    fn a_stretch_that_cannot_be_diagnosed_is_told_and_the_next_one_is() {
        let folder = Folder::new();
        let rows = machine(2000, 6, |_| 4);
        // A command is missing in the first stretch: what acted there is not known.
        let hole = |(k, row): (usize, &(f64, f64, f64))| {
            if k == 400 { format!("{:.3},,{:.5}\n", row.0, row.2) } else { csv(&[*row]) }
        };
        let text: String = rows.iter().enumerate().map(hole).collect();
        let log = folder.write("rig.csv", &format!("time,u,y\n{text}"));
        let model = folder.write("lag.toml", LAG);
        let more = ["--once", "--model", model.to_str().unwrap(), "--window", "10"];
        let out = String::from_utf8(watched(log.to_str().unwrap(), &more).output().unwrap().stdout)
            .unwrap();
        assert!(out.contains("0.000 to 9.990 s: no diagnosis: ") && out.contains("`u`"), "{out}");
        assert!(
            out.contains("10.000 to 19.990 s: gap ") && out.contains("input_delay on u"),
            "{out}"
        );
        deadtime(&[
            "watch",
            log.to_str().unwrap(),
            "--input",
            "u",
            "--output",
            "y",
            "--window",
            "5",
        ])
        .refused(&["--model"]);
        let of_nothing = [
            "watch",
            log.to_str().unwrap(),
            "--input",
            "u",
            "--output",
            "y",
            "--model",
            model.to_str().unwrap(),
            "--window",
            "0",
        ];
        deadtime(&of_nothing).refused(&["--window 0"]);
    }

    #[test]
    fn what_cannot_be_watched_is_said() {
        let folder = Folder::new();
        let log = folder.write("rig.csv", "time,u,y\n0,1,2\n1,1,2\n");
        let log = log.to_str().unwrap();
        let watch = |more: &[&str]| deadtime(&[&["watch", log, "--input", "u"], more].concat());
        watch(&["--output", "yy", "--once"]).refused(&["yy", "did you mean `y`"]);
        watch(&["--output", "y", "--once", "--every", "0"]).refused(&["--every 0"]);
        watch(&["--output", "y", "--once", "--max-delay", "nan"]).refused(&["--max-delay NaN"]);
        let said = watch(&["--output", "y", "--once"]).done();
        assert!(said.contains("not fitted yet"), "{said}");
        let packed = folder.write_bytes("rig.csv.gz", b"\x1f\x8b");
        deadtime(&["watch", packed.to_str().unwrap(), "--input", "u", "--output", "y"])
            .refused(&["only plain text"]);
        deadtime(&[
            "watch",
            folder.path("none.csv").to_str().unwrap(),
            "--input",
            "u",
            "--output",
            "y",
        ])
        .refused(&["none.csv"]);
    }
}
