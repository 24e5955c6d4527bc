//! A command reaches the plant later: u(t − delay).

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, Lateness, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// Dead time between the command and the plant; continuous, never rounded to samples.
///
/// Assumes: one delay for all samples of the input; commands held between their samples.
/// Fails when: all outputs have the same lag. A delay of all outputs and a shift of the sensors' clock then have the same effect on data that only commands
/// move. A short lag resembles a delay shorter than the fastest motion.
/// Source: Normey-Rico and Camacho (2007), Control of Dead-time Processes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InputDelay;

impl Effect for InputDelay {
    fn facts(&self) -> Facts {
        Facts {
            lateness: Some(Lateness::Fixed),
            told_by: Some(Telling::Bandwidth),
            ..Facts::of("input_delay", Site::Input, "the command arrives late")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.input()?;
        Ok(vec![channel::delay("delay")])
    }

    fn starts(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        channel::delays(scales)
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        plan.inputs[on.input()?].delay_s += values[0];
        Ok(())
    }
}
