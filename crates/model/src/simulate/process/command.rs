//! A program started for every run.
//!
//! It reads a table from its standard input and writes one to its standard output, or to files for `{in}` or `{out}` in the command. Parameters and initial
//! values follow the command as `NAME=VALUE`; a `{NAME}` in the command is replaced by the value.

use std::fs::{File, write};
use std::io::{Read, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use nalgebra::DMatrix;

use super::child::{Children, Running, ended};
use super::program::{Asked, Names, Program};
use super::table;
use crate::simulate::simulator::Simulator;

#[derive(Debug)]
pub(super) struct EachRun {
    pub(super) program: Program,
    pub(super) names: Names,
    pub(super) children: Children,
}

/// A quoted shell word.
fn shell_word(text: &str) -> String {
    if cfg!(unix) { format!("'{}'", text.replace('\'', "'\\''")) } else { format!("\"{text}\"") }
}

impl EachRun {
    /// The command with all placeholders replaced.
    fn command(&self, asked: Asked<'_>, files: &[(&str, String); 2]) -> String {
        let mut command = self.program.command.clone();
        let mut arguments = String::new();
        for (name, value) in asked.named(&self.names) {
            let place = format!("{{{name}}}");
            if command.contains(&place) {
                command = command.replace(&place, &value.to_string());
            } else {
                arguments.push(' ');
                arguments.push_str(&shell_word(&format!("{name}={value}")));
            }
        }
        for (place, file) in files {
            command = command.replace(place, &shell_word(file));
        }
        command + &arguments
    }
}

impl EachRun {
    /// Ends a program after its time-out, and reports it.
    fn late(&self, running: &mut Running) -> String {
        running.end();
        let limit_s = self.program.timeout.as_secs_f64();
        format!("it did not answer within {limit_s} s{}", running.last_words())
    }
}

/// Wait for output after the end of a program: its children may keep the output open.
const HELD: Duration = Duration::from_millis(300);
/// Interval of the checks whether it has ended.
const LOOK: Duration = Duration::from_millis(20);

/// The output of a program, in parts.
struct Answer {
    parts: Receiver<std::io::Result<Vec<u8>>>,
    most: usize,
}

impl Answer {
    fn of(mut pipe: impl Read + Send + 'static, most: usize) -> Result<Self, String> {
        // A program that prints faster than the reader waits.
        let (sender, parts) = sync_channel(8);
        let listen = move || {
            let mut part = vec![0; 1 << 16];
            loop {
                let read = match pipe.read(&mut part) {
                    Ok(0) => break,
                    Ok(count) => Ok(part.get(..count).unwrap_or_default().to_vec()),
                    Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
                    Err(e) => Err(e),
                };
                let failed = read.is_err();
                if sender.send(read).is_err() || failed {
                    break;
                }
            }
        };
        on_thread("deadtime stdout", listen)?;
        Ok(Self { parts, most })
    }
}

impl EachRun {
    /// The whole output of a program until its end.
    fn printed(
        &self,
        running: &mut Running,
        answer: Answer,
        until: Instant,
    ) -> Result<Vec<u8>, String> {
        let (mut bytes, mut ended) = (Vec::new(), None);
        loop {
            match answer.parts.recv_timeout(LOOK) {
                Ok(part) => bytes.extend(
                    part.map_err(|e| format!("its standard output could not be read: {e}"))?,
                ),
                Err(RecvTimeoutError::Disconnected) => return Ok(bytes),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if bytes.len() > answer.most {
                running.end();
                return Err(too_much(answer.most));
            }
            let now = Instant::now();
            if running.has_ended() && now >= *ended.get_or_insert(now + HELD) {
                running.end_left();
                return Ok(bytes);
            }
            if now >= until {
                return Err(self.late(running));
            }
        }
    }
}

fn too_much(most: usize) -> String {
    format!(
        "its answer is longer than {} MiB, far more than the rows that were asked for take; print one row for every row that comes in",
        most >> 20
    )
}

/// The output file of a program.
fn written(path: &Path, most: usize) -> Result<String, String> {
    let there = std::fs::metadata(path).map_err(|e| e.to_string())?;
    if !there.is_file() {
        return Err("it is no file".to_owned());
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|e| e.to_string())?;
    file.take(most as u64 + 1).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    if bytes.len() > most {
        return Err(too_much(most));
    }
    String::from_utf8(bytes).map_err(|e| e.to_string())
}

/// Runs work on its own thread.
fn on_thread(name: &str, work: impl FnOnce() + Send + 'static) -> Result<(), String> {
    let thread = thread::Builder::new().name(name.to_owned());
    thread.spawn(work).map(drop).map_err(|e| e.to_string())
}

impl Simulator for EachRun {
    fn simulate(
        &self,
        u: &DMatrix<f64>,
        time_s: &[f64],
        x0: &[f64],
        parameters: &[f64],
    ) -> Result<DMatrix<f64>, String> {
        let asked = Asked { u, time_s, x0, parameters };
        let until = Instant::now() + self.program.timeout;
        let folder = tempfile::tempdir()
            .map_err(|e| format!("no folder for the tables that go in and out: {e}"))?;
        let [input, output] = ["in.csv", "out.csv"].map(|name| folder.path().join(name));
        let files =
            [("{in}", input.display().to_string()), ("{out}", output.display().to_string())];
        let [by_file, to_file] =
            ["{in}", "{out}"].map(|place| self.program.command.contains(place));
        let text = table::written(asked, &self.names);
        if by_file {
            write(&input, &text).map_err(|e| format!("{}: {e}", input.display()))?;
        }
        let mut running = Running::start(
            &self.command(asked, &files),
            self.program.folder.as_deref(),
            &self.children,
        )?;
        if let Some(mut pipe) = running.child.stdin.take().filter(|_| !by_file) {
            // A program may end without reading all its input; its output decides.
            on_thread("deadtime stdin", move || drop(pipe.write_all(text.as_bytes())))?;
        }
        let most = table::most(&self.names, time_s.len());
        let printed = match running.child.stdout.take() {
            Some(pipe) => self.printed(&mut running, Answer::of(pipe, most)?, until)?,
            None => Vec::new(),
        };
        let Some(status) = running.wait(until) else { return Err(self.late(&mut running)) };
        if !status.success() {
            return Err(format!("{}{}", ended(status), running.last_words()));
        }
        let answer = if to_file {
            written(&output, most).map_err(|e| {
                format!("it wrote no {{out}} that can be read: {e}{}", running.last_words())
            })?
        } else {
            String::from_utf8_lossy(&printed).into_owned()
        };
        table::read(&answer, &self.names, time_s.len())
            .map_err(|why| format!("{why}{}", running.last_words()))
    }
}
