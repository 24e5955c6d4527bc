//! A sensor has an end to its range: y between lower and upper.
//!
//! Equation: v = min(max(y, lower), upper).

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The sensor has an end to its range.
///
/// Assumes: hard ends of the range that do not move.
/// Fails when: no value reaches an end, or all do.
/// Source: Khalil (2002), Nonlinear Systems, 3rd edition, section 1.2.7 (common nonlinearities).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorSaturation;

impl Effect for SensorSaturation {
    fn name(&self) -> &'static str {
        "sensor_saturation"
    }

    fn summary(&self) -> &'static str {
        "the sensor has an end to its range"
    }

    fn site(&self) -> Site {
        Site::Output
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.outputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::unit(&system.outputs[channel::output(self, system, channel)?]);
        Ok(vec![
            channel::free("lower", unit.clone(), f64::NEG_INFINITY),
            channel::free("upper", unit, f64::INFINITY),
        ])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) =
            channel::output(self, system, channel).ok().and_then(|i| scales.outputs.get(i))
        else {
            return Vec::new();
        };
        channel::limits(spread)
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let (lower, upper) = (values[0], values[1]);
        plan.outputs[channel::output(self, system, channel)?]
            .maps
            .push(Arc::new(move |_, y| y.clamp(lower, upper)));
        Ok(())
    }
}
