//! A sensor has steps: step·round(y/step).

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The sensor has steps.
///
/// Assumes: even steps about zero, rounded to the nearest.
/// Fails when: the step is small against the noise, which then hides it.
/// Source: Widrow and Kollár (2008), Quantization Noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorQuantisation;

impl Effect for SensorQuantisation {
    fn name(&self) -> &'static str {
        "sensor_quantisation"
    }

    fn summary(&self) -> &'static str {
        "the sensor has steps"
    }

    fn site(&self) -> Site {
        Site::Output
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.outputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::unit(&system.outputs[channel::output(self, system, channel)?]);
        Ok(vec![channel::not_negative("step", unit, 0.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) =
            channel::output(self, system, channel).ok().and_then(|i| scales.outputs.get(i))
        else {
            return Vec::new();
        };
        // Raw values show their step exactly; without a lattice there is none.
        spread.lattice.into_iter().map(|step| vec![step]).collect()
    }

    fn leaves_residual(&self) -> bool {
        true
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let step = values[0];
        plan.outputs[channel::output(self, system, channel)?]
            .maps
            .push(Arc::new(move |_, y| step * (y / step).round()));
        Ok(())
    }
}
