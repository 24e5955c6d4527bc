//! Programs that flood their output, hold pipes open, or leave processes behind.

#![cfg(target_os = "linux")]

use std::sync::Arc;
use std::time::Duration;

use nalgebra::DMatrix;

use super::{Children, Program, Talk};
use crate::simulate::black_box::Face;
use crate::simulate::simulator::{Port, Simulator};

fn simulator(command: &str, talk: Talk, timeout_s: f64) -> (Arc<dyn Simulator>, Children) {
    let port = |name: &str| Port { name: name.to_owned(), unit: None };
    let face = Face {
        name: "other".to_owned(),
        inputs: vec![port("u")],
        outputs: vec![port("y")],
        states: Vec::new(),
        parameters: Vec::new(),
        restart: None,
    };
    let children = Children::default();
    let timeout = Duration::from_secs_f64(timeout_s);
    let program = Program { command: command.to_owned(), talk, timeout, folder: None };
    (program.simulator(&face, &children), children)
}

fn run(simulator: &dyn Simulator) -> Result<DMatrix<f64>, String> {
    let u = DMatrix::from_column_slice(3, 1, &[1.0, 2.0, 3.0]);
    simulator.simulate(&u, &[0.0, 0.1, 0.2], &[], &[])
}

/// The processes started by a command, found by a unique word in it.
fn left(word: &str) -> usize {
    let processes = std::fs::read_dir("/proc").unwrap().flatten();
    let command = |p: std::fs::DirEntry| std::fs::read(p.path().join("cmdline")).ok();
    let words = processes.filter_map(command);
    words.filter(|c| c.split(|b| *b == 0).any(|w| w == word.as_bytes())).count()
}

#[test]
fn an_answer_without_an_end_is_refused_before_it_takes_memory() {
    for (command, talk, says) in [
        ("yes y #", Talk::EachRun, "longer than 16 MiB"),
        ("yes > {out} & sleep 1; kill $! #", Talk::EachRun, "longer than 16 MiB"),
        ("mkfifo {out} #", Talk::EachRun, "it is no file"),
        ("head -c 90000000 /dev/zero #", Talk::Lines, "a line of its answer is longer than 64 KiB"),
        ("yes '# more' #", Talk::Lines, "within 1.5 s"),
    ] {
        let (simulator, children) =
            simulator(command, talk, if talk == Talk::Lines { 1.5 } else { 30.0 });
        let why = run(&*simulator).unwrap_err();
        assert!(why.contains(says), "{command}: {why}");
        drop(simulator);
        assert_eq!(children.running(), 0);
    }
}

#[test]
fn what_begins_a_session_of_its_own_is_ended_as_well() {
    for (at, talk) in [Talk::EachRun, Talk::Lines].into_iter().enumerate() {
        // Sleep durations that no other process uses.
        let [seconds, inner] = [731_000 + at, 732_000 + at].map(|s| s.to_string());
        let command = format!(
            "setsid sleep {seconds} & (setsid sh -c 'sleep {inner} & sleep {inner}' &) & sleep {seconds} #"
        );
        let (timed, _) = simulator(&command, talk, 0.7);
        assert!(run(&*timed).unwrap_err().contains("within 0.7 s"));
        assert_eq!((left(&seconds), left(&inner)), (0, 0), "{talk:?}");
        // The same with an interrupted caller.
        let (simulator, children) = simulator(&command, talk, 100.0);
        let ender = std::thread::spawn(move || {
            while children.running() == 0 {
                std::thread::sleep(Duration::from_millis(5));
            }
            std::thread::sleep(Duration::from_millis(300));
            children.end_all();
        });
        assert!(run(&*simulator).is_err());
        ender.join().unwrap();
        assert_eq!((left(&seconds), left(&inner)), (0, 0), "{talk:?}");
    }
}

#[test]
fn an_answer_counts_although_something_holds_the_output_open() {
    let command = "setsid sleep 733000 & printf 'y\\n1\\n2\\n3\\n' #";
    let (simulator, _) = simulator(command, Talk::EachRun, 30.0);
    for _ in 0..3 {
        assert_eq!(run(&*simulator).unwrap().as_slice(), [1.0, 2.0, 3.0]);
        assert_eq!(left("733000"), 0);
    }
}
