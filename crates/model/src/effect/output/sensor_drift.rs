//! A sensor drifts: y + rate·t, t from the log's first sample.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The sensor drifts with time.
///
/// Assumes: an error that grows evenly with log time, in every log from its own start.
/// Fails when: the log is short, or a state of the plant integrates: a constant push then makes the same ramp.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (errors of sensors).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorDrift;

impl Effect for SensorDrift {
    fn name(&self) -> &'static str {
        "sensor_drift"
    }

    fn summary(&self) -> &'static str {
        "the sensor drifts with time"
    }

    fn site(&self) -> Site {
        Site::Output
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.outputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::per(&system.outputs[channel::output(self, system, channel)?], "s");
        Ok(vec![channel::free("rate", unit, 0.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) =
            channel::output(self, system, channel).ok().and_then(|i| scales.outputs.get(i))
        else {
            return Vec::new();
        };
        channel::both_signs([
            0.3 * spread.std.max(f64::MIN_POSITIVE) / scales.duration_s.max(f64::MIN_POSITIVE)
        ])
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::OperatingPoint)
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let rate = values[0];
        plan.outputs[channel::output(self, system, channel)?]
            .maps
            .push(Arc::new(move |t, y| y + rate * t));
        Ok(())
    }
}
