//! The interface of a black-box simulator.

use std::fmt;

use nalgebra::DMatrix;

/// The name and unit of an input, state, output or parameter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Port {
    /// Its name in the model file and the log.
    pub name: String,
    /// Its unit, where the file gives one.
    pub unit: Option<String>,
}

/// A simulator known only by its outputs.
pub trait Simulator: Send + Sync + fmt::Debug {
    /// The outputs (samples × outputs) at the time stamps, from the initial state `x0`.
    ///
    /// `u` (samples × inputs) holds from its own stamp to the next; `time_s` starts at the log's first sample and may be uneven. The same call must return the
    /// same outputs.
    ///
    /// # Errors
    /// The failure, as a phrase.
    fn simulate(
        &self,
        u: &DMatrix<f64>,
        time_s: &[f64],
        x0: &[f64],
        parameters: &[f64],
    ) -> Result<DMatrix<f64>, String>;
}

/// The log channels of a simulator's states, for restarts within a log: multiple shooting, for simulators whose free run is uninformative.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Restart {
    /// Per state, its log channel; `None`: it starts at its initial value every time.
    pub channels: Vec<Option<String>>,
    /// Seconds between two starts; `None`: from the growth rate of a perturbation.
    pub every_s: Option<f64>,
}
