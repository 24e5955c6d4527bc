//! A sensor is quantised: step·round(y/step).

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The sensor is quantised.
///
/// Assumes: equal steps about zero, rounded to the nearest.
/// Fails when: the step is small compared with the noise, which then hides it.
/// Source: Widrow and Kollár (2008), Quantization Noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorQuantisation;

impl Effect for SensorQuantisation {
    fn facts(&self) -> Facts {
        Facts {
            leaves_residual: true,
            ..Facts::of("sensor_quantisation", Site::Output, "the sensor has steps")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        let unit = channel::unit(&on.system.outputs[on.output()?]);
        Ok(vec![channel::not_negative("step", unit, 0.0)])
    }

    fn starts(&self, on: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) = on.output_spread(scales) else { return Vec::new() };
        // Raw values reveal their step exactly; without a lattice there is none.
        spread.lattice.into_iter().map(|step| vec![step]).collect()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let step = values[0];
        plan.outputs[on.output()?].maps.push(Arc::new(move |_, y| step * (y / step).round()));
        Ok(())
    }
}
