//! Two sequences of event times: delays that are known, events that are missed or seen twice, and files that are wrong.

use std::process::{Command, Output};

use crate::support::plants::{answer, rng, ts, white};
use deadtime::delay::DelayEstimator;
use deadtime::delay::{
    DelayError, DelayEstimate, EventCorrelation, Events, Experiment, METHODS, Method, Outcome,
    Scope, Search, Units,
};
use rand::RngExt;

fn between(events: Vec<Events>) -> Result<Experiment<'static>, DelayError> {
    Experiment::of_events(ts(1.0), ["a", "b"], events)
}

fn methods() -> impl Iterator<Item = &'static Method> {
    METHODS.iter().filter(|m| m.scope == Scope::Events)
}

/// Intervals of half a second and an exponential rest of another half.
fn times(count: usize, seed: u64) -> Vec<f64> {
    let mut rng = rng(seed);
    let mut time = 100.0;
    (0..count)
        .map(|_| {
            time += 0.5 - 0.5 * rng.random_range(1e-9_f64..1.0).ln();
            time
        })
        .collect()
}

fn shifted(times: &[f64], delay: f64, jitter: f64, seed: u64) -> Vec<f64> {
    times.iter().zip(white(times.len(), jitter, seed)).map(|(t, j)| t + delay + j).collect()
}

fn run(method: &Method, first: Vec<f64>, second: Vec<f64>) -> DelayEstimate {
    let events = vec![Events { first, second, ..Events::default() }];
    answer(method, &between(events).unwrap(), &Search { max_delay: 10, ..Search::default() })
}

#[test]
fn delays_longer_than_the_intervals_are_found_and_the_intervals_hold_them() {
    for method in methods() {
        let (mut found, mut held) = (0, 0);
        for seed in 0..200 {
            let delay = 0.04 * seed as f64;
            let first = times(60, seed);
            // The second place misses the last ones, and began to listen later or earlier.
            let second = shifted(&first, delay, 0.02, 700 + seed);
            let e = run(
                method,
                first[seed as usize % 4..].to_vec(),
                second[seed as usize % 3..55].to_vec(),
            );
            let Some([from, to]) = e.ci95_s else { continue };
            assert!(
                (e.delay_s.unwrap() - delay).abs() < 0.02,
                "{} seed {seed}: {e:?}",
                method.entry.name
            );
            found += 1;
            held += usize::from(from <= delay && delay <= to);
        }
        println!("{}: {found} of 200 found, {held} intervals hold the delay", method.entry.name);
        assert!(found >= 198 && held * 100 >= found * 92, "{}", method.entry.name);
    }
}

#[test]
fn missed_and_spurious_events_are_never_a_wrong_delay() {
    for method in methods() {
        let (mut right, mut wrong) = (0, 0);
        for seed in 0..100 {
            let first = times(100, seed);
            let mut second = shifted(&first, 1.3, 0.01, 300 + seed);
            let mut rng = rng(900 + seed);
            // One missed in the first half, one in the second, and one that is none.
            second.remove(rng.random_range(55..95));
            second.remove(rng.random_range(5..45));
            let extra = rng.random_range(second[50]..second[51]);
            second.insert(51, extra);
            let e = run(method, first, second);
            match e.delay_s {
                Some(d) if (d - 1.3).abs() < 0.02 => right += 1,
                Some(_) => wrong += 1,
                None => assert!(e.note.is_some()),
            }
        }
        println!(
            "{}: with missed and spurious events {right} of 100 right, {wrong} wrong",
            method.entry.name
        );
        assert_eq!(wrong, 0, "{}", method.entry.name);
    }
}

#[test]
fn every_criterion_stands_one_missed_event_and_none_gives_a_wrong_delay_when_many_are_missed() {
    // Of a hundred events at either place, so many missed at random.
    for missed in [1, 3, 6, 12] {
        let counts: Vec<(&str, usize)> = methods()
            .map(|method| {
                let right = (0..50_u64).filter(|&seed| {
                    let mut first = times(100, seed);
                    let mut second = shifted(&first, 1.3, 0.01, 300 + seed);
                    let mut rng = rng(40 + seed);
                    for i in 0..missed {
                        second.remove(rng.random_range(0..second.len()));
                        if i > 0 {
                            first.remove(rng.random_range(0..first.len()));
                        }
                    }
                    let e = run(method, first, second);
                    let right = e.delay_s.map(|d| (d - 1.3).abs() < 0.02);
                    assert_ne!(
                        right,
                        Some(false),
                        "{}, {missed} missed, seed {seed}: {e:?}",
                        method.entry.name
                    );
                    right == Some(true)
                });
                (method.entry.name, right.count())
            })
            .collect();
        println!("{missed} of 100 events missed at random: right of 50: {counts:?}");
        assert!(missed > 1 || counts.iter().all(|c| c.1 == 50), "{counts:?}");
    }
}

#[test]
fn unrelated_sequences_and_metronomes_show_no_delay() {
    for method in methods() {
        let name = method.entry.name;
        let fooled = (0..200)
            .filter(|&seed| {
                run(method, times(50, seed), times(50, 5000 + seed)).outcome.has_delay()
            })
            .count();
        println!("{name}: {fooled} of 200 unrelated sequences gave a delay");
        assert!(fooled <= 4, "{name}: {fooled}");
        let metronome: Vec<f64> = (0..50).map(f64::from).collect();
        let e = run(method, metronome.clone(), metronome.iter().map(|t| t + 0.3).collect());
        assert_eq!(e.outcome, Outcome::NotRichEnough, "{name}: {e:?}");
        let jittered = |seed| {
            metronome.iter().zip(white(50, 0.01, seed)).map(|(t, j)| t + j).collect::<Vec<_>>()
        };
        let e = run(method, jittered(1), shifted(&jittered(2), 0.3, 0.0, 3));
        assert!(!e.outcome.has_delay(), "{name}: {e:?}");
    }
}

#[test]
fn a_second_place_that_sees_the_events_first_is_no_delay() {
    for method in methods() {
        let first = times(60, 4);
        let e = run(method, shifted(&first, 3.0, 0.01, 5), first);
        assert!(!e.outcome.has_delay() && e.note.is_some(), "{}: {e:?}", method.entry.name);
    }
}

#[test]
fn several_recordings_are_all_used() {
    for method in methods() {
        let parts: Vec<Events> = (0..9)
            .map(|seed| {
                let first = times(40, seed);
                Events { second: shifted(&first, 2.2, 0.03, 60 + seed), first, ..Events::default() }
            })
            .collect();
        let one = run(method, parts[0].first.clone(), parts[0].second.clone());
        let all = answer(
            method,
            &between(parts).unwrap(),
            &Search { max_delay: 10, ..Search::default() },
        );
        assert!(
            all.std_s.unwrap() < 0.5 * one.std_s.unwrap(),
            "{}: {all:?} {one:?}",
            method.entry.name
        );
        // Four standard errors of a median of 360 differences, whose jitter is 0.03.
        let within = 4.0 * (0.5 * std::f64::consts::PI / 360.0).sqrt() * 0.03;
        assert!((all.delay_s.unwrap() - 2.2).abs() < within, "{}: {all:?}", method.entry.name);
    }
}

#[test]
fn different_units_are_refused_or_standardised_when_told_so() {
    let first = times(200, 8);
    let second: Vec<f64> = shifted(&first, 1.7, 0.005, 9).iter().map(|t| 1000.0 * t).collect();
    let experiment = between(vec![Events {
        first,
        second,
        units: [Some("s".into()), Some("ms".into())],
        ..Events::default()
    }])
    .unwrap();
    let refusal =
        EventCorrelation::default().estimate(&experiment, &Search::default()).unwrap_err();
    assert_eq!(refusal, DelayError::Units { first: "s".into(), second: "ms".into() });
    let e = EventCorrelation { units: Units::Standardise }
        .estimate(&experiment, &Search::default())
        .unwrap();
    let [from, to] = e.ci95_s.unwrap();
    assert!((e.delay_s.unwrap() - 1.7).abs() < 0.02 && from <= 1.7 && 1.7 <= to, "{e:?}");
}

#[test]
fn events_that_run_back_are_refused_by_their_number() {
    let mut first = times(30, 1);
    first.swap(10, 11);
    let refusal = between(vec![Events { first, second: times(30, 2), ..Events::default() }]);
    assert!(
        matches!(refusal, Err(DelayError::EventOrder { ref channel, event: 11, .. }) if channel == "a"),
        "{refusal:?}"
    );
}

fn deadtime(file: &str, more: &[&str]) -> (Output, String, String) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("gates.csv"), file).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_deadtime"))
        .args(["estimate", "gates.csv", "--events", "entry,exit"])
        .args(more)
        .current_dir(folder.path())
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    (output, out, err)
}

fn file() -> String {
    let first = times(40, 3);
    let second = shifted(&first, 2.5, 0.01, 4);
    let mut text = "note,entry [s],exit [s]\n".to_owned();
    for i in 0..40 {
        let exit = if i < 38 { second[i].to_string() } else { String::new() };
        text.push_str(&format!("x,{},{exit}\n", first[i]));
    }
    text
}

#[test]
fn the_command_line_reads_two_columns_of_event_times() {
    let (output, out, err) = deadtime(&file(), &["--json", "answer.json"]);
    assert!(output.status.success(), "{err}");
    let out = out.split_whitespace().collect::<Vec<_>>().join(" ");
    for method in methods() {
        assert!(out.contains(method.entry.name), "{out}");
    }
    assert!(
        out.contains("40 events of `entry` and 38 of `exit`") && out.contains("Dead time 2.5"),
        "{out}"
    );
    assert!(!out.contains("oestruc"), "{out}");
}

#[test]
fn wrong_event_files_are_refused_with_file_column_and_row() {
    let good = file();
    let row = |line: usize, cell: &str| {
        let mut lines: Vec<String> = good.lines().map(str::to_owned).collect();
        lines[line - 1] = cell.to_owned();
        lines.join("\n")
    };
    for (text, said) in [
        (row(5, "x,1.0,110"), vec!["gates.csv, row 5", "entry", "must increase"]),
        (row(7, "x,,now"), vec!["gates.csv", "row 7", "exit", "now"]),
        (row(7, "x,,inf"), vec!["gates.csv", "row 7", "exit", "inf"]),
        (row(7, "x,1"), vec!["gates.csv", "row 7"]),
        (good.replace("exit [s]", "exti"), vec!["gates.csv", "exit", "exti"]),
        ("entry,exit\n1,\n2,\n".into(), vec!["gates.csv", "exit"]),
        (String::new(), vec!["gates.csv", "empty"]),
    ] {
        let (output, _, err) = deadtime(&text, &[]);
        assert_eq!(output.status.code(), Some(2), "{err}");
        assert!(said.iter().all(|s| err.contains(s)), "{said:?}: {err}");
    }
    let (output, out, err) = deadtime(&good.replace("exit [s]", "exit [ms]"), &[]);
    assert!(output.status.success() && out.contains("event times in s and in ms"), "{out}{err}");
    let (output, _, err) = deadtime(&good, &["--method", "oestruc"]);
    assert!(output.status.code() == Some(2) && err.contains("--input"), "{err}");
    let (output, _, err) = deadtime(&good, &["--from", "3"]);
    assert!(output.status.code() == Some(2) && err.contains("--from"), "{err}");
}

/// Packets sent every 0.1 s, one row each: nothing but the row pairs them, and slow ones are overtaken.
#[test]
fn rows_pair_events_whose_intervals_hardly_vary() {
    use deadtime::delay::EventsJob;
    for seed in 0..20 {
        let mut rng = rng(900 + seed);
        let (least, scatter) = (rng.random_range(0.005..0.35), rng.random_range(0.005..0.08));
        let (mut rows, mut sum, count) = (String::from("sent,received\n"), 0.0, 400);
        for k in 0..count {
            let sent = 0.1 * f64::from(k) + rng.random_range(-2e-4..2e-4);
            let delay = least - scatter * rng.random_range(1e-9_f64..1.0).ln();
            sum += delay;
            rows += &format!("{sent:.6},{:.6}\n", sent + delay);
        }
        let folder = crate::support::program::Folder::new();
        let path = folder.write("packets.csv", &rows);
        let events = deadtime::log::read_events(&path, ["sent", "received"]).unwrap();
        let job = EventsJob::new("packets.csv", ["sent", "received"], events);
        let pair = job.run().unwrap().pairs.remove(0);
        let [from, to] =
            pair.verdict.ci95_s.unwrap_or_else(|| panic!("{seed} {least} {scatter}: {pair:?}"));
        let truth = sum / f64::from(count);
        assert!(from <= truth && truth <= to, "{seed}: {truth} {:?}", pair.verdict);
        assert!(to - from < scatter, "{seed}: {:?}", pair.verdict);
        assert_eq!(pair.jitter.unwrap().events, 400);
        // An event that is lost at each place, at other times: the rows between hold two events.
        let mut lines: Vec<Vec<&str>> = rows.lines().map(|l| l.split(',').collect()).collect();
        let lost: Vec<&str> = lines.iter().map(|l| l[1]).collect();
        for row in 100..lines.len() - 101 {
            lines[row][1] = lost[row + 3];
        }
        let shifted: Vec<String> = lines.iter().map(|l| l.join(",")).collect();
        let path = folder.write("lost.csv", &shifted.join("\n"));
        let events = deadtime::log::read_events(&path, ["sent", "received"]).unwrap();
        let pair =
            EventsJob::new("lost.csv", ["sent", "received"], events).run().unwrap().pairs.remove(0);
        assert!(
            !pair.verdict.why.contains("rows")
                && pair
                    .estimates
                    .iter()
                    .all(|e| { e.note.as_deref().is_none_or(|n| !n.contains("rows pair")) })
        );
    }
    // One row without its partner: the columns are sequences of their own, and must increase.
    let folder = crate::support::program::Folder::new();
    let path = folder.write("gap.csv", "a,b\n1,5\n2,\n3,4\n");
    assert!(
        deadtime::log::read_events(&path, ["a", "b"]).unwrap_err().to_string().contains("row 4")
    );
}

/// The second place missed the first events and saw others later: every row holds two events, by a constant shift. The intervals show it.
#[test]
fn rows_that_contradict_the_intervals_pair_nothing() {
    use deadtime::delay::EventsJob;
    for seed in 0..10 {
        let first = times(200, 40 + seed);
        let second = shifted(&first, 0.3, 0.01, 60 + seed);
        let shift = 1 + seed as usize % 3;
        let rows: Vec<String> =
            first.iter().zip(&second[shift..]).map(|(a, b)| format!("{a:.6},{b:.6}")).collect();
        let folder = crate::support::program::Folder::new();
        let path = folder.write("late.csv", &format!("a,b\n{}\n", rows.join("\n")));
        let events = deadtime::log::read_events(&path, ["a", "b"]).unwrap();
        let pair = EventsJob::new("late.csv", ["a", "b"], events).run().unwrap().pairs.remove(0);
        let delay_s = pair.verdict.delay_s.unwrap();
        assert!((delay_s - 0.3).abs() < 0.01, "{seed}: {:?}", pair.verdict);
        let median_s = pair.jitter.unwrap().quantiles[1].delay_s;
        assert!((median_s - 0.3).abs() < 0.01, "{seed}: {median_s}");
    }
}
