//! Dry friction: −level·sign(x) on the derivative of the velocity x, which sticks at 0.

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::{Plan, Term};
use crate::simulate::system::System;

/// Dry friction that sticks.
///
/// Assumes: the state is a velocity and the level does not depend on it.
/// Fails when: the motion is fast and seldom turns: a constant push that follows the direction looks like drag. A dead band of the input also swallows
/// small commands.
/// Source: Armstrong-Hélouvry, Dupont and Canudas de Wit (1994), Automatica 30, 1083-1138, doi:10.1016/0005-1098(94)90209-7.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CoulombFriction;

impl Effect for CoulombFriction {
    fn name(&self) -> &'static str {
        "coulomb_friction"
    }

    fn summary(&self) -> &'static str {
        "dry friction that sticks"
    }

    fn site(&self) -> Site {
        Site::Dynamics
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.states)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::per(&system.states[channel::state(self, system, channel)?], "s");
        Ok(vec![channel::not_negative("level", unit, 0.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(size) =
            channel::state(self, system, channel).ok().and_then(|i| scales.derivatives.get(i))
        else {
            return Vec::new();
        };
        [0.05, 0.2, 0.6].map(|share| vec![share * size]).to_vec()
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::Amplitude)
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        plan.terms.push(Term::Friction {
            state: channel::state(self, system, channel)?,
            level: values[0],
        });
        Ok(())
    }
}
