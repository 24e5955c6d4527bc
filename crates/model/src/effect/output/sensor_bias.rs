//! A sensor has an offset: y + offset.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The sensor has a constant offset.
///
/// Assumes: a constant error in all logs.
/// Fails when: the plant has a constant gain from the input: an offset of the input has the same effect on the settled plant.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (errors of sensors).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorBias;

impl Effect for SensorBias {
    fn facts(&self) -> Facts {
        Facts {
            is_constant: true,
            told_by: Some(Telling::OperatingPoint),
            ..Facts::of("sensor_bias", Site::Output, "the sensor is off by a constant")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::unit(&on.system.outputs[on.output()?]);
        Ok(vec![channel::free("offset", unit, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.output_spread(scales) else { return Vec::new() };
        channel::both_signs([0.2 * spread.std.max(f64::MIN_POSITIVE)])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let offset = values[0];
        plan.outputs[on.output()?].maps.push(Arc::new(move |_, y| y + offset));
        Ok(())
    }
}
