//! A simulator with the names and units of its channels: what a model file describes, of either kind.

use std::sync::Arc;

use nalgebra::DMatrix;

use crate::model::Equations;
use crate::time::SampleTime;

/// The name and unit of an input, state, output or parameter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Port {
    /// Its name in the model file and the log.
    pub name: String,
    /// Its unit, where the file gives one.
    pub unit: Option<String>,
}

/// The matrices of ẋ = A x + B u or x(k+1) = A x(k) + B u(k), y = C x + D u.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrices {
    /// n×n.
    pub a: DMatrix<f64>,
    /// n×m.
    pub b: DMatrix<f64>,
    /// p×n.
    pub c: DMatrix<f64>,
    /// p×m.
    pub d: DMatrix<f64>,
}

/// What moves the state.
#[derive(Debug, Clone)]
pub enum Dynamics {
    /// A continuous linear model.
    Linear(Matrices),
    /// A sampled linear model.
    Sampled(Matrices, SampleTime),
    /// A nonlinear model and the values of its parameters.
    Equations(Arc<Equations>, Vec<f64>),
}

/// A simulator: dynamics, names, start and operating points.
#[derive(Debug, Clone)]
pub struct System {
    /// The model's name.
    pub name: String,
    /// The inputs.
    pub inputs: Vec<Port>,
    /// The states.
    pub states: Vec<Port>,
    /// The outputs.
    pub outputs: Vec<Port>,
    /// The named parameters; none for a linear model.
    pub parameters: Vec<Port>,
    /// What moves the state.
    pub dynamics: Dynamics,
    /// One delay per input, seconds.
    pub input_delay_s: Vec<f64>,
    /// The state when a log starts.
    pub initial: Vec<f64>,
    /// Its standard deviation; `None` where the start is unknown.
    pub initial_std: Vec<Option<f64>>,
    /// The matrices act on u − this.
    pub input_operating: Vec<f64>,
    /// The matrices give y − this.
    pub output_operating: Vec<f64>,
}

impl System {
    /// The model is sampled, not continuous.
    #[must_use]
    pub fn is_sampled(&self) -> bool {
        matches!(self.dynamics, Dynamics::Sampled(..))
    }
}
