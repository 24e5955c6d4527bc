//! A simulator with the names and units of its channels: the content of a model file, of either kind.

use std::sync::Arc;

use super::simulator::{Port, Restart, Simulator};
use crate::equations::system::Equations;
use crate::error::Result;
use crate::file::candidate::Candidates;
use crate::file::channel::{Channel, Operating};
use crate::file::document::ModelDocument;
use crate::file::equations::EquationsFile;
use crate::file::lti::ModelFile;
use crate::matrices::Matrices;
use deadtime_signal::time::SampleTime;

/// A continuous or sampled affine model. ẋ = A x + B u + drift, y = C x + D u + level.
#[derive(Debug, Clone)]
pub(super) struct Affine {
    pub(super) matrices: Matrices,
    /// One per state.
    pub(super) drift: Vec<f64>,
    /// One per output.
    pub(super) level: Vec<f64>,
}

/// The dynamics of the state.
#[derive(Debug, Clone)]
pub enum Dynamics {
    /// A continuous linear model.
    Linear(Matrices),
    /// A sampled linear model.
    Sampled(Matrices, SampleTime),
    /// A nonlinear model and the values of its parameters.
    Equations(Arc<Equations>, Vec<f64>),
    /// A black-box simulator, and the values of its parameters.
    BlackBox(Arc<dyn Simulator>, Vec<f64>),
}

/// The position of a parameter in the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelNumber {
    /// A named parameter.
    Parameter(usize),
    /// An entry of A.
    A(usize, usize),
    /// An entry of B.
    B(usize, usize),
}

impl Dynamics {
    /// Sets the value of a parameter; no effect where the dynamics have no such parameter.
    pub fn set(&mut self, number: ModelNumber, value: f64) {
        match (self, number) {
            (
                Self::Equations(_, parameters) | Self::BlackBox(_, parameters),
                ModelNumber::Parameter(i),
            ) => parameters[i] = value,
            (Self::Linear(matrices) | Self::Sampled(matrices, _), ModelNumber::A(i, j)) => {
                matrices.a[(i, j)] = value
            }
            (Self::Linear(matrices) | Self::Sampled(matrices, _), ModelNumber::B(i, j)) => {
                matrices.b[(i, j)] = value
            }
            _ => {}
        }
    }
}

/// A simulator: dynamics, names, initial state and operating points.
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
    /// The named parameters; empty for a linear model.
    pub parameters: Vec<Port>,
    /// The names of exact parameters, such as a gain in firmware.
    pub known: Vec<String>,
    /// The dynamics.
    pub dynamics: Dynamics,
    /// One delay per input, seconds.
    pub input_delay_s: Vec<f64>,
    /// The state at the start of a log.
    pub initial: Vec<f64>,
    /// Its standard deviation; `None` for an unknown initial state.
    pub initial_std: Vec<Option<f64>>,
    /// Operating inputs: the matrices act on u minus these.
    pub input_operating: Vec<f64>,
    /// Operating outputs: the matrices give y minus these.
    pub output_operating: Vec<f64>,
    /// The equations with additional terms that may be missing.
    pub candidates: Option<Arc<Candidates>>,
    /// The restarts of a black-box simulator from the log; `None`: it runs freely from the start.
    pub restart: Option<Restart>,
}

impl System {
    /// The dynamics as matrices and constants; `None` where these are incomplete, or more expensive.
    pub(super) fn affine(&self, dynamics: &Dynamics) -> Option<Affine> {
        match dynamics {
            Dynamics::Linear(matrices) | Dynamics::Sampled(matrices, _) => {
                let drift = vec![0.0; matrices.a.nrows()];
                Some(Affine {
                    matrices: matrices.clone(),
                    drift,
                    level: self.output_operating.clone(),
                })
            }
            Dynamics::Equations(equations, parameters) if Affine::pays(equations) => {
                Affine::of(equations, parameters)
            }
            Dynamics::Equations(..) | Dynamics::BlackBox(..) => None,
        }
    }

    /// The model is sampled, not continuous.
    #[must_use]
    pub fn is_sampled(&self) -> bool {
        matches!(self.dynamics, Dynamics::Sampled(..))
    }

    /// The simulator is a black box: its internal dynamics are unknown.
    #[must_use]
    pub fn is_black_box(&self) -> bool {
        matches!(self.dynamics, Dynamics::BlackBox(..))
    }
}

impl System {
    /// From a model file. `mean` gives the mean of a channel over the training logs, for an operating point of `"mean"`.
    ///
    /// # Errors
    /// [`crate::error::ModelError`] for an invalid model file; any error of `mean`.
    pub fn new(
        document: &ModelDocument,
        mut mean: impl FnMut(&str) -> Result<f64>,
    ) -> Result<Self> {
        let mut operating = |channels: &[Channel]| -> Result<Vec<f64>> {
            let value = |c: &Channel| match c.operating {
                Operating::Value(value) => Ok(value),
                Operating::Mean(_) => mean(&c.name),
            };
            channels.iter().map(value).collect()
        };
        let ports = |channels: &[Channel]| {
            channels.iter().map(|c| port(&c.name, c.unit.as_deref())).collect::<Vec<_>>()
        };
        let states: Vec<Port> = document.states().map(|(name, unit)| port(name, unit)).collect();
        let (inputs, outputs) = (ports(document.inputs()), ports(document.outputs()));
        let (input_operating, mut output_operating) =
            (operating(document.inputs())?, operating(document.outputs())?);
        let as_equations;
        let document = match document {
            // With a suspected term, a linear model becomes one of equations.
            ModelDocument::Lti(file) if !file.candidates.is_empty() => {
                as_equations = ModelDocument::Equations(file.to_equations([
                    &[],
                    &[],
                    &std::mem::take(&mut output_operating),
                ])?);
                output_operating = vec![0.0; outputs.len()];
                &as_equations
            }
            other => other,
        };
        let Plant { dynamics, parameters, candidates, initial, initial_std } = match document {
            ModelDocument::Lti(file) => Plant::linear(file, states.len())?,
            ModelDocument::Equations(file) => Plant::equations(file)?,
        };
        let input_delay_s = match document {
            ModelDocument::Lti(file) => &file.input_delay_s,
            ModelDocument::Equations(file) => &file.input_delay_s,
        };
        Ok(Self {
            name: document.name().to_owned(),
            input_delay_s: or_zero(input_delay_s, inputs.len()),
            inputs,
            states,
            outputs,
            parameters,
            known: match document {
                ModelDocument::Equations(file) => file.known_parameters(),
                ModelDocument::Lti(_) => Vec::new(),
            },
            dynamics,
            initial,
            initial_std,
            input_operating,
            output_operating,
            candidates,
            restart: None,
        })
    }
}

fn port(name: &str, unit: Option<&str>) -> Port {
    Port { name: name.to_owned(), unit: unit.map(str::to_owned) }
}

fn or_zero(list: &[f64], n: usize) -> Vec<f64> {
    if list.is_empty() { vec![0.0; n] } else { list.to_vec() }
}

/// The dynamics and the initial state in a file.
struct Plant {
    dynamics: Dynamics,
    parameters: Vec<Port>,
    candidates: Option<Arc<Candidates>>,
    initial: Vec<f64>,
    initial_std: Vec<Option<f64>>,
}

impl Plant {
    fn linear(file: &ModelFile, states: usize) -> Result<Self> {
        let known = file.initial_std.iter().map(|&v| Some(v));
        let initial_std =
            if file.initial_std.is_empty() { vec![None; states] } else { known.collect() };
        let dynamics = if file.is_sampled() {
            let sys = file.sampled()?;
            Dynamics::Sampled(Matrices::of(&sys), sys.sample_time())
        } else {
            Dynamics::Linear(Matrices::of(&file.continuous()?))
        };
        Ok(Self {
            dynamics,
            parameters: Vec::new(),
            candidates: None,
            initial: or_zero(&file.initial, states),
            initial_std,
        })
    }

    fn equations(file: &EquationsFile) -> Result<Self> {
        let equations = Arc::new(file.equations()?);
        let parameters =
            file.parameters.iter().map(|(name, p)| port(name, p.unit.as_deref())).collect();
        let initial_std = file.states.iter().map(|(_, s)| s.initial_std).collect();
        let (initial, nominal) = (equations.initial(), equations.nominal());
        let candidates = file.candidates()?.map(Arc::new);
        Ok(Self {
            dynamics: Dynamics::Equations(equations, nominal),
            parameters,
            candidates,
            initial,
            initial_std,
        })
    }
}

/// Evaluations of the derivatives per integration step.
const EVALUATIONS: usize = 7;

impl Affine {
    /// Affine equations, unless a sparse large model makes an integration step cheaper than one product with a full matrix.
    fn pays(equations: &Equations) -> bool {
        let states = equations.state_variables().len();
        equations.is_affine()
            && states * states <= EVALUATIONS * (equations.operations().0 + states)
    }

    /// For affine equations; `None` where one of their values is not finite.
    fn of(equations: &Equations, parameters: &[f64]) -> Option<Self> {
        let [x, u] = [equations.state_variables().len(), equations.input_symbols().len()]
            .map(|n| vec![0.0; n]);
        let (mut drift, mut level) = (x.clone(), vec![0.0; equations.output_variables().len()]);
        let mut workspace = equations.workspace();
        equations.derivatives(0.0, &x, &u, parameters, &mut workspace, &mut drift);
        equations.outputs(0.0, &x, &u, parameters, &mut workspace, &mut level);
        let matrices = equations.linearise(0.0, &x, &u, parameters);
        let finite = [&matrices.a, &matrices.b, &matrices.c, &matrices.d]
            .into_iter()
            .flat_map(|m| m.iter())
            .chain(&drift)
            .chain(&level)
            .all(|v| v.is_finite());
        finite.then_some(Self { matrices, drift, level })
    }
}
