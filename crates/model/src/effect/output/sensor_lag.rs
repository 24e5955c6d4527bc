//! A sensor lags: z′ = (y − z)/time_constant.

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The sensor follows with a first-order lag.
///
/// Assumes: one pole, which starts settled.
/// Fails when: it acts on all outputs and there is one input: a lag of the actuator is the same for a linear plant. A short lag looks like a delay.
/// Source: Åström and Murray (2008), Feedback Systems.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorLag;

impl Effect for SensorLag {
    fn name(&self) -> &'static str {
        "sensor_lag"
    }

    fn summary(&self) -> &'static str {
        "the sensor follows with a first-order lag"
    }

    fn site(&self) -> Site {
        Site::Output
    }

    fn rule(&self) -> &'static str {
        "an output, or `*`: all outputs"
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::shared(system)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::outputs(self, system, channel)?;
        Ok(vec![channel::time_constant("time_constant")])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let _ = (system, channel);
        channel::times(scales)
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::Bandwidth)
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        for i in channel::outputs(self, system, channel)? {
            plan.outputs[i].lags_s.push(values[0]);
        }
        Ok(())
    }
}
