//! A simulator that is a program: called afresh for every run with CSV in and CSV out, or kept running and asked over its standard input, line by line.
//!
//! How it can be wrong: a program that waits for more while we wait for its answer (every pipe has a thread of its own), one that never ends (a time-out for
//! every call), one that leaves children behind (it runs in a process group of its own, which is ended as a whole), and one that prints banners between
//! its numbers (everything but a row of numbers under the named columns is an error that quotes the line).

mod child;
mod command;
mod persistent;
mod table;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::DMatrix;

pub use child::Children;

use super::black_box::{Face, Simulator};

/// How a program is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Talk {
    /// It is started for every run.
    #[default]
    EachRun,
    /// It is started once, and reads one request after the other.
    Lines,
}

/// A program that simulates.
#[derive(Debug, Clone)]
pub struct Program {
    /// The command, as the shell reads it. `{in}` and `{out}` stand for files of CSV, `{NAME}` for the value of a parameter or a start.
    pub command: String,
    /// How it is asked.
    pub talk: Talk,
    /// The longest that one run may take.
    pub timeout: Duration,
    /// Where it runs; `None`: where we do.
    pub folder: Option<PathBuf>,
}

impl Program {
    /// The simulator, with the names of its channels. Its processes are listed in `children`, so that whoever is interrupted can end them.
    #[must_use]
    pub fn simulator(self, face: &Face, children: &Children) -> Arc<dyn Simulator> {
        let names = Names::of(face);
        match self.talk {
            Talk::EachRun => Arc::new(command::EachRun { program: self, names, children: children.clone() }),
            Talk::Lines => Arc::new(persistent::Lines::new(self, names, children.clone())),
        }
    }
}

/// What the columns, parameters and starts are called.
#[derive(Debug, Clone)]
struct Names {
    inputs: Vec<String>,
    outputs: Vec<String>,
    starts: Vec<String>,
    parameters: Vec<String>,
}

impl Names {
    fn of(face: &Face) -> Self {
        let of = |ports: &[super::Port]| ports.iter().map(|p| p.name.clone()).collect();
        Self {
            inputs: of(&face.inputs),
            outputs: of(&face.outputs),
            starts: face.states.iter().map(|s| s.port.name.clone()).collect(),
            parameters: face.parameters.iter().map(|p| p.0.name.clone()).collect(),
        }
    }
}

/// One run, as numbers.
#[derive(Clone, Copy)]
struct Asked<'a> {
    u: &'a DMatrix<f64>,
    time_s: &'a [f64],
    x0: &'a [f64],
    parameters: &'a [f64],
}

impl Asked<'_> {
    /// Parameters and starts by name.
    fn named<'n>(&self, names: &'n Names) -> Vec<(&'n str, f64)> {
        let parameters = names.parameters.iter().map(String::as_str).zip(self.parameters.iter().copied());
        parameters.chain(names.starts.iter().map(String::as_str).zip(self.x0.iter().copied())).collect()
    }
}
