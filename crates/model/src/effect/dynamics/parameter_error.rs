//! A parameter of the model is wrong: a named one, or an entry of A or B that is not 0.
//!
//! Equation: x′ = f(x, u; p) with p = value instead of its nominal value; for an entry, A[x,from] = value or B[x,from] = value.

use nalgebra::DMatrix;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, names};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;
use crate::simulate::simulator::Port;
use crate::simulate::system::{Dynamics, ModelNumber, System};

/// A parameter of the model is wrong.
///
/// Assumes: the structure of the model is correct, and a single parameter is not.
/// Fails when: another parameter moves the outputs in the same direction: an entry of B and a gain of its input are aliases.
/// Source: Ljung (1999), System Identification: Theory for the User, 2nd edition (grey-box models).
#[derive(Debug, Clone, Copy)]
pub(crate) struct ParameterError;

impl Effect for ParameterError {
    fn facts(&self) -> Facts {
        Facts {
            rule: RULE,
            needs_equations: false,
            corrects_model: true,
            ..Facts::of("parameter_error", Site::Dynamics, "a parameter of the model is wrong")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channels(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let (_, unit, nominal) = number(on)?;
        Ok(vec![channel::free("value", unit, nominal)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let _ = scales;
        let Ok((_, _, nominal)) = number(on) else { return Vec::new() };
        let size = if nominal == 0.0 { 1.0 } else { nominal };
        vec![vec![nominal + 0.1 * size], vec![nominal - 0.1 * size]]
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (number, ..) = number(on)?;
        plan.dynamics.set(number, values[0]);
        Ok(())
    }
}

/// The channels for parameters of the model, in words.
pub(super) const RULE: &str = "a parameter, or an entry of A or B that is not 0: `A[x,from]`";

/// Every parameter of the model.
pub(super) fn channels(system: &System) -> Vec<String> {
    match &system.dynamics {
        Dynamics::Equations(..) | Dynamics::BlackBox(..) => names(&system.parameters),
        Dynamics::Linear(matrices) | Dynamics::Sampled(matrices, _) => {
            let entries = |letter: &'static str, matrix: &DMatrix<f64>, columns: &[Port]| {
                let place = |(i, j): (usize, usize)| {
                    format!("{letter}[{},{}]", system.states[i].name, columns[j].name)
                };
                let all =
                    (0..matrix.nrows()).flat_map(|i| (0..matrix.ncols()).map(move |j| (i, j)));
                all.filter(|&at| matrix[at] != 0.0).map(place).collect::<Vec<_>>()
            };
            [entries("A", &matrices.a, &system.states), entries("B", &matrices.b, &system.inputs)]
                .concat()
        }
    }
}

/// The parameter that a channel names, its unit and its value.
pub(super) fn number(on: OnChannel<'_>) -> Result<(ModelNumber, String, f64)> {
    let (system, channel, unknown) = (on.system, on.channel, || on.unknown());
    let at = |ports: &[Port], name: &str| channel::position(ports, name).ok_or_else(unknown);
    match &system.dynamics {
        Dynamics::Equations(_, parameters) | Dynamics::BlackBox(_, parameters) => {
            let i = at(&system.parameters, channel)?;
            Ok((ModelNumber::Parameter(i), channel::unit(&system.parameters[i]), parameters[i]))
        }
        Dynamics::Linear(matrices) | Dynamics::Sampled(matrices, _) => {
            let inside = |letter: &str| {
                channel.strip_prefix(letter)?.strip_prefix('[')?.strip_suffix(']')?.split_once(',')
            };
            let derivative = |i: usize, from: &Port| {
                let unit = channel::unit(from);
                if unit == "1" {
                    channel::per(&system.states[i], "s")
                } else {
                    format!("({})/({unit})", channel::per(&system.states[i], "s"))
                }
            };
            if let Some((row, column)) = inside("A") {
                let (i, j) = (at(&system.states, row)?, at(&system.states, column)?);
                return Ok((
                    ModelNumber::A(i, j),
                    derivative(i, &system.states[j]),
                    matrices.a[(i, j)],
                ));
            }
            let (row, column) = inside("B").ok_or_else(unknown)?;
            let (i, j) = (at(&system.states, row)?, at(&system.inputs, column)?);
            Ok((ModelNumber::B(i, j), derivative(i, &system.inputs[j]), matrices.b[(i, j)]))
        }
    }
}
