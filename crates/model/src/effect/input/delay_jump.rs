//! The delay of a command changes at a time: u(t − delay) until then, u(t − later) from then on.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Change, Effect, Facts, OnChannel, Site, Telling};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::simulate::piecewise::Piecewise;
use crate::simulate::plan::Plan;

/// A dead time that jumps, at the same time in every log.
///
/// Assumes: one jump, at the same log time in every log; constant delays before and after.
/// Fails when: the jump is close to an end of the log, or the command moves too little on one side of it. One delay then explains as much.
/// Source: Normey-Rico and Camacho (2007), Control of Dead-time Processes, for the constant delay; the jump models a rerouted path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DelayJump;

impl Effect for DelayJump {
    fn facts(&self) -> Facts {
        Facts {
            elaborates: Some("input_delay"),
            changes: Some(Change::Jump),
            told_by: Some(Telling::Bandwidth),
            ..Facts::of(
                "delay_jump",
                Site::Input,
                "the command arrives late, from a time on by another delay",
            )
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.input()?;
        Ok(vec![channel::delay("delay"), channel::instant(), channel::delay("later")])
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (before_s, time_s, later_s) = (values[0], values[1], values[2]);
        let jumped = move |signal: Piecewise| signal.delayed_until(before_s, time_s, later_s);
        plan.inputs[on.input()?].maps.push(Arc::new(jumped));
        Ok(())
    }
}
