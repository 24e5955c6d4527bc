//! A simulator that is another program.

use super::child::Children;
use super::{command, persistent};
use crate::simulate::black_box::Face;
use crate::simulate::simulator::{Port, Simulator};
use nalgebra::DMatrix;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// The protocol of a program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Talk {
    /// One process for every run.
    #[default]
    EachRun,
    /// One process for all runs, which reads one request after the other.
    Lines,
}

/// A program that simulates.
#[derive(Debug, Clone)]
pub struct Program {
    /// The shell command. `{in}` and `{out}` are replaced by CSV files, `{NAME}` by the value of a parameter or an initial value.
    pub command: String,
    /// Its protocol.
    pub talk: Talk,
    /// The time-out of one run.
    pub timeout: Duration,
    /// Its working directory; `None`: the present one.
    pub folder: Option<PathBuf>,
}

impl Program {
    /// The simulator, with the names of its channels. `children` lists its processes, so that an interrupted caller can end them.
    #[must_use]
    pub fn simulator(self, face: &Face, children: &Children) -> Arc<dyn Simulator> {
        let names = Names::of(face);
        match self.talk {
            Talk::EachRun => {
                Arc::new(command::EachRun { program: self, names, children: children.clone() })
            }
            Talk::Lines => Arc::new(persistent::Lines::new(self, names, children.clone())),
        }
    }
}

/// The names of the columns, parameters and initial values.
#[derive(Debug, Clone)]
pub(super) struct Names {
    pub(super) inputs: Vec<String>,
    pub(super) outputs: Vec<String>,
    starts: Vec<String>,
    pub(super) parameters: Vec<String>,
}

impl Names {
    fn of(face: &Face) -> Self {
        let of = |ports: &[Port]| ports.iter().map(|p| p.name.clone()).collect();
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
pub(super) struct Asked<'a> {
    pub(super) u: &'a DMatrix<f64>,
    pub(super) time_s: &'a [f64],
    pub(super) x0: &'a [f64],
    pub(super) parameters: &'a [f64],
}

impl Asked<'_> {
    /// Parameters and initial values by name.
    pub(super) fn named<'n>(&self, names: &'n Names) -> Vec<(&'n str, f64)> {
        let parameters =
            names.parameters.iter().map(String::as_str).zip(self.parameters.iter().copied());
        parameters
            .chain(names.starts.iter().map(String::as_str).zip(self.x0.iter().copied()))
            .collect()
    }
}
