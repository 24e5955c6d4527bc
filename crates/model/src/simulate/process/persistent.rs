//! A program that keeps running and receives requests line by line.
//!
//! A request is a line `run N`, a line `parameter NAME VALUE` per parameter, `start NAME VALUE` per initial value. A header `time,INPUT,…` and N rows follow.
//! The response is a header and N rows, or one line `error WORDS`. The program ends when its standard input does.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Read, Write};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Instant;

use nalgebra::DMatrix;

use super::child::{Children, Running, ended};
use super::program::{Asked, Names, Program};
use super::table;
use crate::simulate::simulator::Simulator;

#[derive(Debug)]
pub(super) struct Lines {
    program: Program,
    names: Names,
    children: Children,
    /// The process; none before the first request, and after a failed one.
    talk: Mutex<Option<Talking>>,
}

/// A process with its pipes.
#[derive(Debug)]
struct Talking {
    requests: Sender<String>,
    /// `None` for a line that is too long.
    lines: Receiver<Option<String>>,
    // Last: the pipes are closed before the process is ended.
    running: Running,
}

impl Talking {
    fn start(program: &Program, children: &Children, longest: usize) -> Result<Self, String> {
        let mut running = Running::start(&program.command, program.folder.as_deref(), children)?;
        // A program that prints faster than the reader waits.
        let ((requests, asked), (sender, lines)) = (channel::<String>(), sync_channel(WAITING));
        let (Some(mut pipe), Some(out)) = (running.child.stdin.take(), running.child.stdout.take())
        else {
            return Err("its pipes could not be opened".to_owned());
        };
        let feed = move || {
            for text in asked {
                if pipe.write_all(text.as_bytes()).and_then(|()| pipe.flush()).is_err() {
                    break;
                }
            }
        };
        let listen = move || {
            let mut reader = BufReader::new(out);
            let mut bytes = Vec::new();
            while let Ok(count @ 1..) =
                reader.by_ref().take(longest as u64).read_until(b'\n', &mut bytes)
            {
                let line = String::from_utf8_lossy(&bytes).trim_end().to_owned();
                let whole = count < longest || bytes.ends_with(b"\n");
                bytes.clear();
                if sender.send(whole.then_some(line)).is_err() || !whole {
                    break;
                }
            }
        };
        let spawn = |name: &str, work: Box<dyn FnOnce() + Send>| {
            thread::Builder::new()
                .name(name.to_owned())
                .spawn(work)
                .map(drop)
                .map_err(|e| e.to_string())
        };
        spawn("deadtime stdin", Box::new(feed))?;
        spawn("deadtime stdout", Box::new(listen))?;
        Ok(Self { requests, lines, running })
    }
}

/// Number of buffered lines.
const WAITING: usize = 1000;
/// Bytes of a line that is no row.
const BANNER: usize = 64 << 10;

/// The longest accepted line, bytes.
fn longest(names: &Names) -> usize {
    BANNER + table::line(names)
}

/// The reason for a missing response.
enum Failed {
    /// The program reported an error, and continues.
    Said(String),
    /// The program is no longer usable.
    Broken(String),
}

impl Lines {
    pub(super) fn new(program: Program, names: Names, children: Children) -> Self {
        Self { program, names, children, talk: Mutex::new(None) }
    }

    fn request(&self, asked: Asked<'_>) -> String {
        let mut text = format!("run {}\n", asked.time_s.len());
        let named = asked.named(&self.names);
        for (at, (name, value)) in named.iter().enumerate() {
            let what = if at < self.names.parameters.len() { "parameter" } else { "start" };
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{what} {name} {value}");
        }
        text + &table::written(asked, &self.names)
    }

    fn ask(&self, talk: &mut Talking, asked: Asked<'_>) -> Result<DMatrix<f64>, Failed> {
        let until = Instant::now() + self.program.timeout;
        let broken = |why: String| Failed::Broken(why);
        // A closed pipe becomes visible as a missing response.
        let _ = talk.requests.send(self.request(asked));
        let samples = asked.time_s.len();
        let (mut columns, mut values) = (None, Vec::new());
        let mut rows = 0;
        while columns.is_none() || rows < samples {
            let line =
                match talk.lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
                    Ok(Some(line)) => line,
                    Ok(None) => {
                        talk.running.end();
                        return Err(broken(format!(
                            "a line of its answer is longer than {} KiB",
                            longest(&self.names) >> 10
                        )));
                    }
                    Err(RecvTimeoutError::Timeout) => {
                        talk.running.end();
                        let at = format!("after {rows} of {samples} rows");
                        return Err(broken(format!(
                            "it did not answer within {} s ({at}){}",
                            self.program.timeout.as_secs_f64(),
                            talk.running.last_words()
                        )));
                    }
                    Err(RecvTimeoutError::Disconnected) => {
                        let how = talk
                            .running
                            .wait(until)
                            .map_or_else(|| "it closed its standard output".to_owned(), ended);
                        return Err(broken(format!(
                            "{how} after {rows} of {samples} rows{}",
                            talk.running.last_words()
                        )));
                    }
                };
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            if let Some(words) = line.strip_prefix("error") {
                return Err(Failed::Said(format!(
                    "it answered: {}",
                    deadtime_signal::text::shown(words.trim())
                )));
            }
            match &columns {
                None => {
                    columns = Some(table::columns(&cells(&line), &self.names).map_err(broken)?);
                }
                Some(columns) => {
                    rows += 1;
                    let fields: Vec<&str> = line.split(',').collect();
                    values.extend(table::row(&fields, columns, &self.names, rows).map_err(broken)?);
                }
            }
        }
        Ok(DMatrix::from_row_slice(samples, self.names.outputs.len(), &values))
    }
}

/// The cells of a header, with or without quotes.
fn cells(line: &str) -> Vec<String> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(line.as_bytes());
    let record = reader.records().next().and_then(Result::ok).unwrap_or_default();
    record.iter().map(str::to_owned).collect()
}

impl Simulator for Lines {
    fn simulate(
        &self,
        u: &DMatrix<f64>,
        time_s: &[f64],
        x0: &[f64],
        parameters: &[f64],
    ) -> Result<DMatrix<f64>, String> {
        let mut slot = self.talk.lock().unwrap_or_else(PoisonError::into_inner);
        let mut talk = match slot.take() {
            Some(talk) => talk,
            None => Talking::start(&self.program, &self.children, longest(&self.names))?,
        };
        match self.ask(&mut talk, Asked { u, time_s, x0, parameters }) {
            Ok(answer) => {
                *slot = Some(talk);
                Ok(answer)
            }
            Err(Failed::Said(why)) => {
                *slot = Some(talk);
                Err(why)
            }
            // Data remaining in the pipe belongs to no later request: the program is restarted.
            Err(Failed::Broken(why)) => Err(why),
        }
    }
}
