//! A spring that hardens: −c·x³ of one state on another's derivative.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::{Plan, Term};
use crate::simulate::system::System;

/// A spring that hardens with the cube of a state.
///
/// Assumes: a spring through its centre, hardening or softening with the cube.
/// Fails when: all deflections are of one size: a linear stiffness does nearly the same.
/// Source: Kovacic and Brennan (2011), The Duffing Equation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CubicStiffness;

impl Effect for CubicStiffness {
    fn name(&self) -> &'static str {
        "cubic_stiffness"
    }

    fn summary(&self) -> &'static str {
        "a spring that hardens with the cube of a state"
    }

    fn site(&self) -> Site {
        Site::Dynamics
    }

    fn rule(&self) -> &'static str {
        "`from->x`: one state on another"
    }

    fn channels(&self, system: &System) -> Vec<String> {
        let pairs =
            system.states.iter().flat_map(|from| system.states.iter().map(move |to| (from, to)));
        pairs
            .filter(|(from, to)| from.name != to.name)
            .map(|(from, to)| format!("{}->{}", from.name, to.name))
            .collect()
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let (from, to) = channel::arrow(self, system, channel, &system.states)?;
        let (derivative, unit) =
            (channel::per(&system.states[to], "s"), channel::unit(&system.states[from]));
        Ok(vec![channel::free(
            "coefficient",
            if unit == "1" { derivative } else { format!("({derivative})/({unit})^3") },
            0.0,
        )])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok((from, to)) = channel::arrow(self, system, channel, &system.states) else {
            return Vec::new();
        };
        let Some((size, derivative)) = scales.states.get(from).zip(scales.derivatives.get(to))
        else {
            return Vec::new();
        };
        channel::both_signs([0.2 * derivative / size.rms.powi(3).max(f64::MIN_POSITIVE)])
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let (from, to) = channel::arrow(self, system, channel, &system.states)?;
        let coefficient = values[0];
        plan.terms.push(Term::Function {
            to,
            from,
            f: Arc::new(move |x| -coefficient * x * x * x),
        });
        Ok(())
    }
}
