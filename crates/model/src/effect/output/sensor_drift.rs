//! A sensor drifts: y + rate·t, t from the log's first sample.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The sensor drifts with time.
///
/// Assumes: an error linear in log time, relative to each log's own start.
/// Fails when: the log is short, or a state of the plant integrates: a constant disturbance then gives the same ramp.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (errors of sensors).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorDrift;

impl Effect for SensorDrift {
    fn facts(&self) -> Facts {
        Facts {
            told_by: Some(Telling::OperatingPoint),
            ..Facts::of("sensor_drift", Site::Output, "the sensor drifts with time")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::per(&on.system.outputs[on.output()?], "s");
        Ok(vec![channel::free("rate", unit, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.output_spread(scales) else { return Vec::new() };
        channel::both_signs([
            0.3 * spread.std.max(f64::MIN_POSITIVE) / scales.duration_s.max(f64::MIN_POSITIVE)
        ])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let rate = values[0];
        plan.outputs[on.output()?].maps.push(Arc::new(move |t, y| y + rate * t));
        Ok(())
    }
}
