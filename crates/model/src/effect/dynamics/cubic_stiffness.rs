//! A spring that hardens: −c·x³ of one state on another's derivative.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
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
    fn facts(&self) -> Facts {
        Facts {
            rule: "`from->x`: one state on another",
            ..Facts::of(
                "cubic_stiffness",
                Site::Dynamics,
                "a spring that hardens with the cube of a state",
            )
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::arrows(&system.states)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let (from, to) = on.arrow(&on.system.states)?;
        let (derivative, unit) =
            (channel::per(&on.system.states[to], "s"), channel::unit(&on.system.states[from]));
        Ok(vec![channel::free(
            "coefficient",
            if unit == "1" { derivative } else { format!("({derivative})/({unit})^3") },
            0.0,
        )])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok((from, to)) = on.arrow(&on.system.states) else {
            return Vec::new();
        };
        let Some((size, derivative)) = scales.states.get(from).zip(scales.derivatives.get(to))
        else {
            return Vec::new();
        };
        channel::both_signs([0.2 * derivative / size.rms.powi(3).max(f64::MIN_POSITIVE)])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (from, to) = on.arrow(&on.system.states)?;
        let coefficient = values[0];
        plan.terms.push(Term::Function {
            to,
            from,
            f: Arc::new(move |x| -coefficient * x * x * x),
        });
        Ok(())
    }
}
