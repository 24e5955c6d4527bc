//! Drag that grows with the square of a velocity: −c·x·|x| on its derivative.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::{Plan, Term};

/// Drag that grows with the square of a velocity.
///
/// Assumes: the state is a velocity relative to a medium at rest; drag dissipates energy, so its coefficient is not negative.
/// Fails when: all motion has one speed: a linear damping has the same effect.
/// Source: Batchelor (1967), An Introduction to Fluid Dynamics (drag at high Reynolds number).
#[derive(Debug, Clone, Copy)]
pub(crate) struct QuadraticDrag;

impl Effect for QuadraticDrag {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::Amplitude),
            ..Facts::of(
                "quadratic_drag",
                Site::Dynamics,
                "drag that grows with the square of a velocity",
            )
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let state = &on.system.states[on.state()?];
        let unit = channel::unit(state);
        let per = if unit == "1" { "1/s".to_owned() } else { format!("1/(({unit}) s)") };
        Ok(vec![channel::not_negative("coefficient", per, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok(i) = on.state() else { return Vec::new() };
        let Some((size, derivative)) = scales.states.get(i).zip(scales.derivatives.get(i)) else {
            return Vec::new();
        };
        vec![vec![0.2 * derivative / (size.rms * size.rms).max(f64::MIN_POSITIVE)]]
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let state = on.state()?;
        let coefficient = values[0];
        plan.terms.push(Term::Function {
            to: state,
            from: state,
            f: Arc::new(move |x| -coefficient * x * x.abs()),
        });
        Ok(())
    }
}
