//! What a terminal shows: the answer first, tables that fit, colours only where they are wanted, and the words about the program itself.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use crate::support::program::{Folder, deadtime, text};

/// Columns of a line; the names in these logs are one column a character.
fn widest(said: &str) -> usize {
    said.lines().map(|l| l.chars().count()).max().unwrap_or(0)
}

fn example(name: &str) -> String {
    format!("{}/examples/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// What the flight's estimate prints; the same words run once for all tests.
fn flight(more: &[&str]) -> String {
    static PRINTED: Mutex<BTreeMap<Vec<String>, String>> = Mutex::new(BTreeMap::new());
    let words = more.iter().map(|w| (*w).to_owned()).collect();
    // A run that failed says so in each test that asks for it.
    let mut printed = PRINTED.lock().unwrap_or_else(PoisonError::into_inner);
    printed.entry(words).or_insert_with(|| estimated(more)).clone()
}

fn estimated(more: &[&str]) -> String {
    let (log, model) = (example("uav_flight.csv"), example("uav_lateral_stabilised.toml"));
    deadtime(
        &[&["estimate", &log, "--input", "r", "--output", "ay", "--model", &model], more].concat(),
    )
    .done()
}

fn gap(folder: &Folder, more: &[&str]) -> String {
    let (log, model) = (example("uav_flight.csv"), example("uav_lateral_stabilised.toml"));
    let out = folder.path("out");
    deadtime(&[&["gap", "--model", &model, "--log", &log, "--out", text(&out)], more].concat())
        .done()
}

#[test]
fn no_line_of_an_estimate_is_wider_than_80_columns() {
    // The flight below shows what all methods print.
    within_80_columns(&["--method", "oestruc", "--method", "arxstruc", "--method", "p1d"]);
    assert!(widest(&flight(&[])) <= 80);
    // The wide tables are there for who asks.
    assert!(widest(&flight(&["--full"])) > 100);
}

#[test]
#[ignore = "nightly: every method on five logs"]
fn no_line_of_an_estimate_by_every_method_is_wider_than_80_columns() {
    within_80_columns(&[]);
}

fn within_80_columns(methods: &[&str]) {
    let logs: [(&str, &[&str]); 5] = [
        ("two_inputs.csv", &["--input", "heater", "--input", "fan", "--output", "temperature"]),
        ("unstable_loop.csv", &["--input", "torque", "--output", "rate"]),
        ("irregular.csv", &["--input", "valve", "--output", "pressure", "--resample", "0.05"]),
        ("missing.csv", &["--input", "pump", "--output", "level"]),
        ("moving.csv", &["--input", "command", "--output", "speed", "--track"]),
    ];
    for (log, words) in logs {
        let log = example(log);
        let said = deadtime(&[&["estimate", &log], words, methods].concat()).done();
        assert!(widest(&said) <= 80, "{said}");
    }
}

#[test]
fn the_answer_comes_first_and_alone_where_it_is_asked_for_alone() {
    let said = flight(&[]);
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines[0], "r → ay");
    assert!(
        lines[1].starts_with("Dead time 0.140 s (")
            && lines[1].ends_with(" s), 7 samples.")
            && lines[2].starts_with("Agreeing methods: ")
            && lines[3].starts_with("Differing: "),
        "{said}"
    );
    let brief = flight(&["--brief"]);
    let answers = brief.lines().filter(|l| l.contains("dead time 0.1")).count();
    assert!(
        brief.starts_with("r → ay: dead time 0.140 s (")
            && answers == 2
            && brief.lines().count() <= 6
            && widest(&brief) <= 80,
        "at most three lines of each of two pairs: {brief}"
    );
    assert_eq!(flight(&["--quiet"]), "");
}

#[test]
fn a_refusal_is_three_lines_at_most_where_the_answer_alone_is_asked_for() {
    let folder = Folder::new();
    let mut state = 7_u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1_u32 << 24) - 0.5
    };
    for (name, samples) in [("noise.csv", 600), ("short.csv", 19)] {
        let rows: String = (0..samples)
            .map(|k| format!("{},{},{}\n", f64::from(k) * 0.1, next(), next()))
            .collect();
        let log = folder.write(name, &format!("time,u,y\n{rows}"));
        let words = ["estimate", text(&log), "--input", "u", "--output", "y"];
        let brief = deadtime(&[&words[..], &["--brief"]].concat()).done();
        assert!(brief.lines().count() <= 3 && widest(&brief) <= 80, "{brief}");
        assert!(brief.contains("no trusted dead time"), "{brief}");
        let required = deadtime(&[&words[..], &["--brief", "--require"]].concat());
        assert_eq!(required.code, Some(3), "{}", required.stderr);
        assert!(required.stderr.contains("no trusted dead time for u → y"), "{}", required.stderr);
    }
    assert!(flight(&["--require", "--brief"]).contains("0.140 s"));
}

#[test]
fn a_bar_stands_where_its_number_does() {
    let said = flight(&[
        "--method",
        "oestruc",
        "--method",
        "armaxstruc",
        "--method",
        "met1struc",
        "--method",
        "oedap",
    ]);
    let row = |name: &str| said.lines().find(|l| l.starts_with(&format!("  {name} "))).unwrap();
    let at = |name: &str| row(name).chars().position(|c| c == '●');
    assert!(at("oestruc").is_some() && at("oestruc") == at("verdict"), "{said}");
    for far in ["met1struc", "oedap"] {
        assert!(row(far).contains('›'), "what is far off is an arrow at the axis' end: {said}");
    }
}

#[test]
fn no_line_of_a_gap_is_wider_than_80_columns_and_the_cause_comes_first() {
    let folder = Folder::new();
    let said = gap(&folder, &[]);
    assert!(
        said.starts_with("Cause: input delay of `r`, 0.129")
            && said.lines().take(4).any(|l| l.starts_with("Shrink: ")),
        "{said}"
    );
    // The folder's name is a test's and may be long.
    let printed = said.replace(text(&folder.path("out")), "out");
    assert!(widest(&printed) <= 80, "{said}");
    let brief = gap(&folder, &["--brief"]);
    assert!(said.starts_with(&brief) && brief.lines().count() <= 5, "{brief}");
    let full = gap(&folder, &["--full"]);
    assert!(full.starts_with("Cause: input delay") && full.contains("nrmse alone"), "{full}");
    let (log, model) = (example("uav_flight.csv"), example("uav_lateral_stabilised.toml"));
    assert!(
        widest(&deadtime(&["gap", "--model", &model, "--log", &log, "--isolability"]).done()) <= 80
    );
}

#[test]
fn long_and_wide_names_do_not_widen_the_tables() {
    let folder = Folder::new();
    let (input, output) = ("コマンド".repeat(15), "y".repeat(120));
    let mut log = format!("time,{input},{output}\n");
    let (mut past, mut state) = ([0.0; 3], 7_u32);
    for k in 0..400 {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let u = if state >> 31 == 0 { 1.0 } else { -1.0 };
        let noise = f64::from(state >> 8 & 1023) / 10_230.0;
        log += &format!("{},{u},{}\n", f64::from(k) * 0.1, past[0] + noise);
        past = [past[1], past[2], u];
    }
    let log = folder.write("log.csv", &log);
    let methods = ["--method", "arxstruc", "--method", "threshold", "--method", "p1d"];
    let said = deadtime(
        &[&["estimate", text(&log), "--input", &input, "--output", &output], &methods[..]].concat(),
    )
    .done();
    // Each of the script's characters takes two columns.
    let columns = |line: &str| {
        line.chars()
            .map(|c| if c.len_utf8() == 3 && c >= '\u{3000}' { 2 } else { 1 })
            .sum::<usize>()
    };
    assert!(said.lines().all(|l| columns(l) <= 80), "{said}");
}

#[test]
fn colours_come_where_they_are_wanted_and_change_no_word() {
    let plain = flight(&["--method", "oestruc"]);
    assert!(!plain.contains('\u{1b}'), "a pipe is no terminal");
    let coloured = flight(&["--method", "oestruc", "--color", "always"]);
    let mut words = String::new();
    let mut rest = coloured.as_str();
    while let Some((before, after)) = rest.split_once('\u{1b}') {
        words += before;
        rest = after.split_once('m').unwrap().1;
    }
    assert!(coloured.contains("\u{1b}[1m"), "{coloured}");
    assert_eq!(words + rest, plain);
    assert_eq!(flight(&["--method", "oestruc", "--color", "never"]), plain);
}

#[test]
fn no_line_of_a_study_is_wider_than_100_columns() {
    let folder = Folder::new();
    let out = folder.path("out");
    let said =
        deadtime(&["study", &example("gate_plan.toml"), "--trials", "3", "--out", text(&out)])
            .done()
            .replace(text(&out), "out");
    assert!(widest(&said) <= 100 && said.contains("RMS/bound"), "{said}");
}

#[test]
fn shells_and_man_know_every_command() {
    let folder = Folder::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let said = deadtime(&["completions", shell]).done();
        assert!(said.contains("estimate") && said.contains("isolability"), "{shell}");
    }
    let man = folder.path("man");
    deadtime(&["man", text(&man)]).done();
    for (page, holds) in [
        ("deadtime.1", "estimate"),
        ("deadtime-gap.1", "isolability"),
        ("deadtime-blind-run.1", "jobs"),
        ("deadtime-estimate.1", "Examples"),
    ] {
        let page = std::fs::read_to_string(man.join(page)).unwrap();
        assert!(page.starts_with(".ie") || page.contains(".TH"), "{page}");
        assert!(page.contains(holds), "{holds}: {page}");
    }
}
