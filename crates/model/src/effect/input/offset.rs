//! The actuator is off centre: u + offset.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The actuator is off centre.
///
/// Assumes: a constant offset in all logs.
/// Fails when: a constant push on a state, or a sensor's offset, has the same effect once a linear plant has settled; only how it starts tells them
/// apart.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (errors of sensors), for a constant error; here it is the
/// actuator's.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InputOffset;

impl Effect for InputOffset {
    fn name(&self) -> &'static str {
        "input_offset"
    }

    fn summary(&self) -> &'static str {
        "the actuator is off centre"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::unit(&system.inputs[channel::input(self, system, channel)?]);
        Ok(vec![channel::free("offset", unit, 0.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) =
            channel::input(self, system, channel).ok().and_then(|i| scales.inputs.get(i))
        else {
            return Vec::new();
        };
        channel::both_signs([0.2 * spread.rms.max(f64::MIN_POSITIVE)])
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
        let offset = values[0];
        plan.inputs[channel::input(self, system, channel)?]
            .maps
            .push(Arc::new(move |signal| signal.map(|p| (p.value + offset, p.slope))));
        Ok(())
    }
}
