//! A program as the simulator: tables in and out, requests line by line, and everything that can go wrong with a process.

use std::time::Duration;

use deadtime::simulate::process::{Children, Program, Talk};
use deadtime::simulate::{Face, Port, Simulator, Start};
use nalgebra::DMatrix;

use crate::support::program::{Folder, deadtime};

fn port(name: &str) -> Port {
    Port { name: name.to_owned(), unit: None }
}

fn face() -> Face {
    Face {
        name: "program".to_owned(),
        inputs: vec![port("u")],
        outputs: vec![port("y")],
        states: vec![Start { port: port("x"), initial: 0.0, std: None }],
        parameters: vec![(port("k"), 2.0)],
        restart: None,
    }
}

fn call(command: &str, talk: Talk, timeout_s: f64) -> (std::sync::Arc<dyn Simulator>, Children) {
    let children = Children::default();
    let program = Program {
        command: command.to_owned(),
        talk,
        timeout: Duration::from_secs_f64(timeout_s),
        folder: None,
    };
    (program.simulator(&face(), &children), children)
}

fn run(simulator: &dyn Simulator, k: f64) -> Result<DMatrix<f64>, String> {
    simulator.simulate(
        &DMatrix::from_column_slice(3, 1, &[1.0, -2.5, 1e-7]),
        &[0.0, 0.5, 1.0],
        &[0.25],
        &[k],
    )
}

/// y = k·u + x, in awk, which every Unix has.
const EACH: &str = r#"awk -F, 'BEGIN { for (i = 1; i < ARGC; i++) { split(ARGV[i], p, "="); v[p[1]] = p[2]; ARGV[i] = "" } }
NR == 1 { print "time,y [V]"; next } { printf "%s,%.17g\n", $1, v["k"] * $2 + v["x"] }'"#;
/// The same kept running: a shell reads its requests byte by byte, which awk does not, and has awk calculate.
const LINES: &str = r#"while read -r word name value; do case $word in
  run) left=$name;;
  parameter | start) eval "v_$name=$value";;
  time*) i=0; while [ $i -lt $left ] && read -r row; do echo "$row"; i=$((i + 1)); done |
    awk -F, -v k=$v_k -v x=$v_x 'k < 0 { bad = 1; next } !n++ { print "y,time" } { printf "%.17g,%s\n", k * $2 + x, $1 } END { if (bad) print "error k is negative" }';;
esac; done"#;

fn expected(k: f64) -> DMatrix<f64> {
    DMatrix::from_column_slice(3, 1, &[k + 0.25, -2.5 * k + 0.25, 1e-7 * k + 0.25])
}

#[test]
fn a_program_is_called_with_a_table_and_answers_with_one() {
    let (simulator, children) = call(EACH, Talk::EachRun, 10.0);
    for k in [2.0, -0.125] {
        assert_eq!(run(&*simulator, k).unwrap(), expected(k));
    }
    assert_eq!(children.running(), 0);
}

#[test]
fn files_and_values_take_their_places_in_the_command() {
    let command = r#"awk -F, -v k={k} -v x={x} 'NR == 1 { print "y"; next } { print k * $2 + x }' {in} > {out}; echo banner"#;
    let (simulator, _) = call(command, Talk::EachRun, 10.0);
    let answer = run(&*simulator, 2.0).unwrap();
    assert!((answer - expected(2.0)).amax() < 1e-6);
}

#[test]
fn a_program_that_stays_answers_one_request_after_the_other_and_says_what_it_cannot() {
    let (simulator, children) = call(LINES, Talk::Lines, 10.0);
    assert_eq!(run(&*simulator, 2.0).unwrap(), expected(2.0));
    let why = run(&*simulator, -1.0).unwrap_err();
    assert!(why.contains("k is negative"), "{why}");
    assert_eq!(run(&*simulator, 3.0).unwrap(), expected(3.0));
    assert_eq!(children.running(), 1, "it is still the first one");
    drop(simulator);
    assert_eq!(children.running(), 0);
}

#[test]
fn failures_say_code_words_row_and_column() {
    let why = |command: &str, talk: Talk| run(&*call(command, talk, 10.0).0, 2.0).unwrap_err();
    let both = |command: &str, parts: &[&str]| {
        for talk in [Talk::EachRun, Talk::Lines] {
            let why = why(command, talk);
            assert!(parts.iter().all(|p| why.contains(p)), "{talk:?} {command}: {why}");
        }
    };
    both("echo 'no licence' >&2; exit 3 #", &["exit code 3", "no licence"]);
    both("no_such_program_here", &["exit code 127", "no_such_program_here"]);
    both("printf 'time,z\\n0,1\\n1,1\\n2,1\\n' #", &["no column `y`", "time, z"]);
    both("printf 'y\\n1\\ntwo\\n3\\n' #", &["row 2", "column `y`", "`two`"]);
    assert!(why("printf 'y\\n1\\n' #", Talk::EachRun).contains("1 rows of numbers where 3"));
    assert!(why("printf 'y\\n1\\n' #", Talk::Lines).contains("after 1 of 3 rows"));
}

#[test]
fn a_program_that_hangs_is_ended_with_what_it_started() {
    for talk in [Talk::EachRun, Talk::Lines] {
        // The shell's own child sleeps, and holds the pipes open: were it not ended, this would not end either.
        let (simulator, children) = call("sleep 100000 & sleep 100000 #", talk, 0.3);
        let why = run(&*simulator, 2.0).unwrap_err();
        assert!(why.contains("within 0.3 s"), "{why}");
        drop(simulator);
        assert_eq!(children.running(), 0);
    }
}

#[test]
fn whoever_is_interrupted_ends_what_runs() {
    let (simulator, children) = call("sleep 100 #", Talk::EachRun, 100.0);
    let other = children.clone();
    let ender = std::thread::spawn(move || {
        while other.running() == 0 {
            std::thread::sleep(Duration::from_millis(5));
        }
        other.end_all();
    });
    let why = run(&*simulator, 2.0).unwrap_err();
    ender.join().unwrap();
    assert!(why.contains("ended") || why.contains("signal"), "{why}");
}

/// A first-order lag with a gain, exact between samples, from rest.
const SERVO: &str = r#"
function step(t, u) { if (n++) y = k * held + (y - k * held) * exp(-5 * (t - last)); else y = 0; last = t; held = u; printf "%.12g\n", y }
BEGIN { FS = ","; for (i = 1; i < ARGC; i++) { split(ARGV[i], p, "="); k = p[2]; ARGV[i] = "" } }
NR == 1 { print "speed"; next }
{ step($1, $2) }
"#;
/// The same kept running.
const KEPT: &str = r#"while read -r word name value; do case $word in
  run) left=$name;;
  parameter) gain=$value;;
  time*) i=0; { echo header; while [ $i -lt $left ] && read -r row; do echo "$row"; i=$((i + 1)); done; } | awk -f "$1" -- "gain=$gain";;
esac; done
"#;

fn servo(folder: &Folder) -> [String; 2] {
    [("servo.awk", SERVO), ("servo.sh", KEPT)]
        .map(|(name, text)| folder.write(name, text).display().to_string())
}

/// Machine: the same lag, 0.08 s late.
fn log(folder: &Folder) -> String {
    let mut text = "time,voltage [V],speed [rad/s]\n".to_owned();
    let (mut y, mut seed) = (0.0_f64, 12345_u64);
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
    };
    let (mut commands, mut u) = (Vec::new(), 0.0);
    for k in 0..300 {
        if k % 12 == 0 {
            u = 4.0 * random();
        }
        commands.push(u);
        let late = commands[usize::try_from(k - 4).unwrap_or(0)];
        text.push_str(&format!("{},{u},{}\n", f64::from(k) * 0.02, y + 0.02 * random()));
        y = 2.0 * late + (y - 2.0 * late) * (-0.1_f64).exp();
    }
    folder.write("run.csv", &text).display().to_string()
}

#[test]
fn the_command_line_diagnoses_a_program_either_way_of_asking() {
    let folder = Folder::new();
    let [each, kept] = servo(&folder);
    let log = log(&folder);
    let mut found = Vec::new();
    for (command, more) in
        [(format!("awk -f {each} --"), None), (format!("sh {kept} {each}"), Some("--persistent"))]
    {
        let out = folder.path("gap");
        let mut words = vec![
            "gap",
            "--simulator",
            &command,
            "--log",
            &log,
            "--input",
            "voltage [V]",
            "--output",
            "speed [rad/s]",
        ];
        words.extend([
            "--parameter",
            "gain=2 [rad/s/V]",
            "--max-delay",
            "0.2",
            "--out",
            out.to_str().unwrap(),
        ]);
        words.extend(more);
        let said = deadtime(&words).words();
        assert!(said.contains("Cause: input delay of"), "{said}");
        let text = std::fs::read_to_string(out.join("diagnosis.json")).unwrap();
        found.push(serde_json::from_str::<serde_json::Value>(&text).unwrap());
    }
    assert_eq!(found[0]["cause"]["effects"], found[1]["cause"]["effects"]);
    let delay = &found[0]["cause"]["effects"][0]["parameters"][0];
    let [value, low, high] =
        [&delay["value"], &delay["ci95"][0], &delay["ci95"][1]].map(|v| v.as_f64().unwrap());
    assert!(
        low <= 0.08 && 0.08 <= high && (value - 0.08).abs() < 0.01,
        "4 samples of 0.02 s: {delay}"
    );
}

#[test]
fn the_command_line_says_what_a_program_said() {
    let folder = Folder::new();
    let log = log(&folder);
    let with = |command: &str, more: &[&str]| {
        let words = [
            "gap",
            "--log",
            &log,
            "--out",
            "gap",
            "--simulator",
            command,
            "--input",
            "voltage",
            "--output",
            "speed",
        ];
        deadtime(&[&words, more].concat())
    };
    with("echo no licence >&2; exit 3 #", &[]).refused(&["run.csv", "exit code 3", "no licence"]);
    with("sleep 50 #", &["--timeout", "0.2"]).refused(&["within 0.2 s"]);
    with("true", &["--timeout", "0"]).refused(&["--timeout 0"]);
    with("true", &["--parameter", "gain"]).refused(&["--parameter gain", "NAME=VALUE"]);
    with("true", &["--parameter", "gain=two"]).refused(&["`two` is no number"]);
}
