//! A sensor is off: y + offset.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The sensor is off by a constant.
///
/// Assumes: a constant error in all logs.
/// Fails when: the plant has a constant gain from the input: an offset there does the same once it has settled.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (errors of sensors).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorBias;

impl Effect for SensorBias {
    fn name(&self) -> &'static str {
        "sensor_bias"
    }

    fn summary(&self) -> &'static str {
        "the sensor is off by a constant"
    }

    fn site(&self) -> Site {
        Site::Output
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.outputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::unit(&system.outputs[channel::output(self, system, channel)?]);
        Ok(vec![channel::free("offset", unit, 0.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) =
            channel::output(self, system, channel).ok().and_then(|i| scales.outputs.get(i))
        else {
            return Vec::new();
        };
        channel::both_signs([0.2 * spread.std.max(f64::MIN_POSITIVE)])
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
        plan.outputs[channel::output(self, system, channel)?]
            .maps
            .push(Arc::new(move |_, y| y + offset));
        Ok(())
    }
}
