//! A sensor has a limited range: y between lower and upper.
//!
//! Equation: v = min(max(y, lower), upper).

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The sensor has a limited range.
///
/// Assumes: hard, constant limits.
/// Fails when: no value reaches a limit, or all do.
/// Source: Khalil (2002), Nonlinear Systems, 3rd edition, section 1.2.7 (common nonlinearities).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorSaturation;

impl Effect for SensorSaturation {
    fn facts(&self) -> Facts {
        Facts::of("sensor_saturation", Site::Output, "the sensor has an end to its range")
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::unit(&on.system.outputs[on.output()?]);
        Ok(vec![
            channel::free("lower", unit.clone(), f64::NEG_INFINITY),
            channel::free("upper", unit, f64::INFINITY),
        ])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.output_spread(scales) else { return Vec::new() };
        channel::limits(spread)
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (lower, upper) = (values[0], values[1]);
        plan.outputs[on.output()?].maps.push(Arc::new(move |_, y| y.clamp(lower, upper)));
        Ok(())
    }
}
