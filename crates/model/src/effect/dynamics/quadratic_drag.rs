//! Drag that grows with the square of a velocity: −c·x·|x| on its derivative.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::{Plan, Term};
use crate::simulate::system::System;

/// Drag that grows with the square of a velocity.
///
/// Assumes: the state is a velocity relative to a medium at rest.
/// Fails when: all motion is of one speed: a linear damping does the same.
/// Source: Batchelor (1967), An Introduction to Fluid Dynamics (drag at high Reynolds number).
#[derive(Debug, Clone, Copy)]
pub(crate) struct QuadraticDrag;

impl Effect for QuadraticDrag {
    fn name(&self) -> &'static str {
        "quadratic_drag"
    }

    fn summary(&self) -> &'static str {
        "drag that grows with the square of a velocity"
    }

    fn site(&self) -> Site {
        Site::Dynamics
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.states)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let state = &system.states[channel::state(self, system, channel)?];
        let unit = channel::unit(state);
        let per = if unit == "1" { "1/s".to_owned() } else { format!("1/(({unit}) s)") };
        Ok(vec![channel::free("coefficient", per, 0.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Ok(i) = channel::state(self, system, channel) else { return Vec::new() };
        let Some((size, derivative)) = scales.states.get(i).zip(scales.derivatives.get(i)) else {
            return Vec::new();
        };
        channel::both_signs([0.2 * derivative / (size.rms * size.rms).max(f64::MIN_POSITIVE)])
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
        let state = channel::state(self, system, channel)?;
        let coefficient = values[0];
        plan.terms.push(Term::Function {
            to: state,
            from: state,
            f: Arc::new(move |x| -coefficient * x * x.abs()),
        });
        Ok(())
    }
}
