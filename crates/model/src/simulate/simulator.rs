//! What a simulator that can only be called is asked for.

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

/// A simulator of which nothing is known but what it answers.
pub trait Simulator: Send + Sync + fmt::Debug {
    /// The outputs (samples × outputs) at the time stamps, from the start `x0`.
    ///
    /// `u` (samples × inputs) holds from its own stamp to the next; `time_s` counts from the log's
    /// first sample and may be uneven. The same call must give the same answer.
    ///
    /// # Errors
    /// What went wrong, as a phrase.
    fn simulate(
        &self,
        u: &DMatrix<f64>,
        time_s: &[f64],
        x0: &[f64],
        parameters: &[f64],
    ) -> Result<DMatrix<f64>, String>;
}

/// Where a simulator's states stand in logs, so that it can be started again on the way: multiple
/// shooting, for simulators whose free run says nothing.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Restart {
    /// Per state, the log's channel that holds it; `None`: it begins at its initial value every
    /// time.
    pub channels: Vec<Option<String>>,
    /// Seconds between two starts; `None`: chosen by how fast a perturbation grows.
    pub every_s: Option<f64>,
}
