//! Something pushes all the time: a level on a state's derivative.

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::{Plan, Term};
use crate::simulate::system::System;

/// Something pushes all the time.
///
/// Assumes: a push that does not change, in all logs.
/// Fails when: an offset of the input does the same wherever that input moves the state. A sensor's offset parts from it only while the plant settles.
/// Source: Åström and Murray (2008), Feedback Systems.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ConstantDisturbance;

impl Effect for ConstantDisturbance {
    fn name(&self) -> &'static str {
        "constant_disturbance"
    }

    fn summary(&self) -> &'static str {
        "something pushes all the time"
    }

    fn site(&self) -> Site {
        Site::Dynamics
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.states)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::per(&system.states[channel::state(self, system, channel)?], "s");
        Ok(vec![channel::free("level", unit, 0.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(size) =
            channel::state(self, system, channel).ok().and_then(|i| scales.derivatives.get(i))
        else {
            return Vec::new();
        };
        channel::both_signs([0.1 * size])
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::OperatingPoint)
    }

    fn is_constant(&self) -> bool {
        true
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        plan.terms
            .push(Term::Constant { to: channel::state(self, system, channel)?, level: values[0] });
        Ok(())
    }
}
