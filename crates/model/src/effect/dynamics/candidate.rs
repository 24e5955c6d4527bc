//! A term that the user suspects to be missing, from the model file or the command line.
//!
//! Equation: x′ = f(x, u; p) + g(x, u, t; k). The user's expression g has the free parameters k; g = 0 at k = 0.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::{Parameter, Role};
use crate::effect::scales::{Scales, Spread};
use crate::file::candidate::CandidateParameter;
use crate::file::candidate::{Candidate as Suspected, Candidates};
use crate::simulate::plan::Plan;
use crate::simulate::system::{Dynamics, System};

/// Size of a term's initial value, relative to the rms of its state's derivative.
const FIRST_GUESS: f64 = 0.2;

/// The derivative x′ has an additional expression, written by the user for the state x.
///
/// Assumes: its free parameters are constants, and the term vanishes where they are 0.
/// Fails when: another term of the catalogue moves the outputs in the same way; both are then in one alias class.
/// Source: Ljung (1999), System Identification: Theory for the User, section 4.3, grey-box models.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CandidateTerm;

impl Effect for CandidateTerm {
    fn facts(&self) -> Facts {
        Facts {
            rule: "a candidate of the model file or of `--candidate`: `state += expression`",
            is_declared: true,
            ..Facts::of("candidate", Site::Dynamics, "a term that the user suspects to be missing")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        system.candidates.iter().flat_map(|all| &all.list).map(|c| c.name.clone()).collect()
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let (_, suspected) = named(on)?;
        let parameter = |(name, said): &(String, CandidateParameter)| {
            let free = channel::free(
                name.clone(),
                said.unit.clone().unwrap_or_else(|| "1".to_owned()),
                said.value,
            );
            Parameter {
                role: if said.value == 0.0 { Role::Size } else { Role::Shape },
                lower: said.lower.unwrap_or(free.lower),
                upper: said.upper.unwrap_or(free.upper),
                ..free
            }
        };
        Ok(suspected.parameters.iter().map(parameter).collect())
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok((all, suspected)) = named(on) else { return Vec::new() };
        let moved = scales.derivatives.get(suspected.state).copied().unwrap_or(0.0);
        let sizes: Vec<usize> = (0..suspected.parameters.len())
            .filter(|&i| suspected.parameters[i].1.value == 0.0)
            .collect();
        let nominal: Vec<f64> = suspected.parameters.iter().map(|(_, p)| p.value).collect();
        let mut starts = Vec::new();
        for &i in &sizes {
            let unit = term_of_one(all, suspected, i, scales);
            let size = if unit > 0.0 && moved > 0.0 { FIRST_GUESS * moved / unit } else { 1.0 };
            for sign in [1.0, -1.0] {
                let (lower, upper) =
                    (suspected.parameters[i].1.lower, suspected.parameters[i].1.upper);
                let mut start = nominal.clone();
                start[i] = (sign * size)
                    .clamp(lower.unwrap_or(f64::NEG_INFINITY), upper.unwrap_or(f64::INFINITY));
                if start[i] != 0.0 && !starts.contains(&start) {
                    starts.push(start);
                }
            }
        }
        starts
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (all, suspected) = named(on)?;
        let Dynamics::Equations(equations, parameters) = &mut plan.dynamics else { return Ok(()) };
        let nominal = all.equations.nominal();
        if let Some(added) = nominal.get(parameters.len()..) {
            parameters.extend_from_slice(added);
            *equations = Arc::clone(&all.equations);
        }
        if let Some(own) = parameters.get_mut(suspected.first..suspected.first + values.len()) {
            own.copy_from_slice(values);
        }
        Ok(())
    }
}

/// The term that a channel names, with the list of all terms.
fn named(on: OnChannel<'_>) -> Result<(&Candidates, &Suspected)> {
    let all = on.system.candidates.as_deref();
    let found = all.and_then(|all| Some((all, all.list.iter().find(|c| c.name == on.channel)?)));
    found.ok_or_else(|| on.unknown())
}

/// The largest magnitude of the term for a parameter of 1. States and inputs have the magnitudes of the nominal run, with either sign.
fn term_of_one(all: &Candidates, suspected: &Suspected, parameter: usize, scales: &Scales) -> f64 {
    let equations = &all.equations;
    let mut p = equations.nominal();
    let mut workspace = equations.workspace();
    let (states, inputs) = (equations.state_variables().len(), equations.input_symbols().len());
    let mut slope = |p: &[f64], turn: usize| {
        let signed = |list: &[Spread], count: usize, shift: usize| -> Vec<f64> {
            let sign = |i: usize| if (turn >> ((i + shift) % 4)) & 1 == 1 { -1.0 } else { 1.0 };
            (0..count).map(|i| sign(i) * list.get(i).map_or(0.0, |s| s.rms)).collect()
        };
        let (x, u) = (signed(&scales.states, states, 0), signed(&scales.inputs, inputs, 1));
        let mut dx = vec![0.0; states];
        equations.derivatives(0.0, &x, &u, p, &mut workspace, &mut dx);
        dx[suspected.state]
    };
    let own: Vec<f64> = (0..16).map(|turn| slope(&p, turn)).collect();
    p[suspected.first + parameter] = 1.0;
    (0..16)
        .map(|turn| (slope(&p, turn) - own[turn]).abs())
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max)
}
