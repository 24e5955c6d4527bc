//! A measurement is written down late: y(t − delay).

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// Dead time between the plant and the log; continuous, never rounded to samples.
///
/// Assumes: one delay for all samples of the output.
/// Fails when: it acts on all outputs: a delay of the only input and a shift of the sensors' clock then do the same to what commands move.
/// Source: Normey-Rico and Camacho (2007), Control of Dead-time Processes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OutputDelay;

impl Effect for OutputDelay {
    fn name(&self) -> &'static str {
        "output_delay"
    }

    fn summary(&self) -> &'static str {
        "the measurement arrives late"
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
        Ok(vec![channel::delay("delay")])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let _ = (system, channel);
        channel::delays(scales)
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
            plan.outputs[i].delay_s += values[0];
        }
        Ok(())
    }
}
