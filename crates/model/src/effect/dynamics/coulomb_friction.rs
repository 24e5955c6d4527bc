//! Dry friction: −level·sign(x) on the derivative of the velocity x, which sticks at 0.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::{Plan, Term};

/// Dry friction that sticks.
///
/// Assumes: the state is a velocity, and the level is independent of it.
/// Fails when: the motion is fast and seldom changes direction: a constant force against the direction resembles drag. A dead band of the input also swallows
/// small commands.
/// Source: Armstrong-Hélouvry, Dupont and Canudas de Wit (1994), Automatica 30, 1083-1138, doi:10.1016/0005-1098(94)90209-7.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CoulombFriction;

impl Effect for CoulombFriction {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::Amplitude),
            ..Facts::of("coulomb_friction", Site::Dynamics, "dry friction that sticks")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::per(&on.system.states[on.state()?], "s");
        Ok(vec![channel::not_negative("level", unit, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(size) = on.derivative(scales) else { return Vec::new() };
        [0.05, 0.2, 0.6].map(|share| vec![share * size]).to_vec()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        plan.terms.push(Term::Friction { state: on.state()?, level: values[0] });
        Ok(())
    }
}
