//! A sensor lags: z′ = (y − z)/time_constant.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The sensor follows with a first-order lag.
///
/// Assumes: one pole, settled at the start.
/// Fails when: it acts on all outputs and there is one input: a lag of the actuator is an alias for a linear plant. A short lag resembles a delay.
/// Source: Åström and Murray (2008), Feedback Systems.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorLag;

impl Effect for SensorLag {
    fn facts(&self) -> Facts {
        Facts {
            rule: "an output, or `*`: all outputs",
            told_by: Some(Telling::Bandwidth),
            ..Facts::of("sensor_lag", Site::Output, "the sensor follows with a first-order lag")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::shared(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.outputs()?;
        Ok(vec![channel::time_constant("time_constant")])
    }

    fn starts(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        channel::times(scales)
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        for i in on.outputs()? {
            plan.outputs[i].lags_s.push(values[0]);
        }
        Ok(())
    }
}
