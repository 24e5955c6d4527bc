//! The delay of a command changes at a time: u(t − delay) until then, u(t − later) from then on.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Change, Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// A dead time that jumps, at the same time in every log.
///
/// Assumes: one jump, at the same log time in every log; constant delays before and after.
/// Fails when: the jump stands close to an end of the log, or the command hardly moves beside it: then one delay explains as much.
/// Source: Normey-Rico and Camacho (2007), Control of Dead-time Processes, for the constant delay; the jump is that of a path that is routed anew.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DelayJump;

impl Effect for DelayJump {
    fn name(&self) -> &'static str {
        "delay_jump"
    }

    fn summary(&self) -> &'static str {
        "the command arrives late, from a time on by another delay"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn elaborates(&self) -> Option<&'static str> {
        Some("input_delay")
    }

    fn changes(&self) -> Option<Change> {
        Some(Change::Jump)
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::input(self, system, channel)?;
        Ok(vec![channel::delay("delay"), channel::instant(), channel::delay("later")])
    }

    fn starts(&self, _: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        scales.scanned(self, channel)
    }

    fn is_identity(&self, values: &[f64], _: &[Parameter]) -> bool {
        values[0] == 0.0 && values[2] == 0.0
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
        let (before_s, time_s, later_s) = (values[0], values[1], values[2]);
        let jumped = move |signal: crate::simulate::piecewise::Piecewise| {
            signal.delayed_until(before_s, time_s, later_s)
        };
        plan.inputs[channel::input(self, system, channel)?].maps.push(Arc::new(jumped));
        Ok(())
    }
}
