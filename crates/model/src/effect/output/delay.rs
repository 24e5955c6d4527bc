//! A measurement is recorded late: y(t − delay).

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// Dead time between the plant and the log; continuous, never rounded to samples.
///
/// Assumes: one delay for all samples of the output.
/// Fails when: it acts on all outputs. A delay of the only input and a shift of the sensors' clock then have the same effect on motion caused by commands.
/// Source: Normey-Rico and Camacho (2007), Control of Dead-time Processes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OutputDelay;

impl Effect for OutputDelay {
    fn facts(&self) -> Facts {
        Facts {
            rule: "an output, or `*`: all outputs",
            told_by: Some(Telling::Bandwidth),
            ..Facts::of("output_delay", Site::Output, "the measurement arrives late")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::shared(system)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.outputs()?;
        Ok(vec![channel::delay("delay")])
    }

    fn starts(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        channel::delays(scales)
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        for i in on.outputs()? {
            plan.outputs[i].delay_s += values[0];
        }
        Ok(())
    }
}
