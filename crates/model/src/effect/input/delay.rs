//! A command reaches the plant later: u(t − delay).

use crate::effect::channel;
use crate::effect::definition::{Effect, Lateness, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// Dead time between the command and the plant; continuous, never rounded to samples.
///
/// Assumes: one delay for all samples of the input; commands held between their samples.
/// Fails when: all outputs lag alike: a delay of all outputs and a shift of the sensors' clock do the same to data that only commands move. A short lag
/// resembles a delay shorter than the fastest motion.
/// Source: Normey-Rico and Camacho (2007), Control of Dead-time Processes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InputDelay;

impl Effect for InputDelay {
    fn name(&self) -> &'static str {
        "input_delay"
    }

    fn summary(&self) -> &'static str {
        "the command arrives late"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::input(self, system, channel)?;
        Ok(vec![channel::delay("delay")])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let _ = (system, channel);
        channel::delays(scales)
    }

    fn lateness(&self) -> Option<Lateness> {
        Some(Lateness::Fixed)
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
        plan.inputs[channel::input(self, system, channel)?].delay_s += values[0];
        Ok(())
    }
}
