//! A program that is started for every run.
//!
//! It reads a table from its standard input and writes one to its standard output, or to files where the command has `{in}` or `{out}`. Parameters and starts follow the
//! command as `NAME=VALUE`; where it has `{NAME}`, the value takes that place.

use std::fs::{read_to_string, write};
use std::io::{Read, Write};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Instant;

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

/// A word that the shell takes as it is.
fn shell_word(text: &str) -> String {
    if cfg!(unix) { format!("'{}'", text.replace('\'', "'\\''")) } else { format!("\"{text}\"") }
}

impl EachRun {
    /// The command with everything in its place.
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
    /// Ends a program that takes too long, and says so.
    fn late(&self, running: &mut Running) -> String {
        running.end();
        let limit_s = self.program.timeout.as_secs_f64();
        format!("it did not answer within {limit_s} s{}", running.last_words())
    }
}

/// Work on a thread of its own.
fn beside(name: &str, work: impl FnOnce() + Send + 'static) -> Result<(), String> {
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
            // A program that ends without reading all has its reasons; what it answers tells them.
            beside("deadtime stdin", move || drop(pipe.write_all(text.as_bytes())))?;
        }
        let (sender, answers) = sync_channel(1);
        if let Some(mut pipe) = running.child.stdout.take() {
            let listen = move || {
                let mut bytes = Vec::new();
                let read = pipe.read_to_end(&mut bytes).map(|_| bytes);
                let _ = sender.send(read);
            };
            beside("deadtime stdout", listen)?;
        }
        let printed = match answers.recv_timeout(until.saturating_duration_since(Instant::now())) {
            Ok(read) => read.map_err(|e| format!("its standard output could not be read: {e}"))?,
            Err(RecvTimeoutError::Timeout) => return Err(self.late(&mut running)),
            Err(RecvTimeoutError::Disconnected) => Vec::new(),
        };
        let Some(status) = running.wait(until) else { return Err(self.late(&mut running)) };
        if !status.success() {
            return Err(format!("{}{}", ended(status), running.last_words()));
        }
        let answer = if to_file {
            read_to_string(&output).map_err(|e| {
                format!("it wrote no readable file {{out}}: {e}{}", running.last_words())
            })?
        } else {
            String::from_utf8_lossy(&printed).into_owned()
        };
        table::read(&answer, &self.names, time_s.len())
            .map_err(|why| format!("{why}{}", running.last_words()))
    }
}
