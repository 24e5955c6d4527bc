//! The delay of a command changes with time: the plant holds at t what was commanded at t − (delay + rate·t).

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Change, Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// No delay grows or shrinks faster than this, in seconds per second: at 1 no later command would ever arrive.
const FASTEST: f64 = 0.9;

/// A dead time that drifts; never below zero.
///
/// Assumes: a rate that is the same in all logs; commands arrive in order.
/// Fails when: the drift over the log is small against a sample: one delay explains as much. Two clocks of different rates shift outputs in the same way.
/// Source: Normey-Rico and Camacho (2007), Control of Dead-time Processes, for the constant delay; its growth is that of two clocks, as `clock_skew`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DelayDrift;

impl Effect for DelayDrift {
    fn name(&self) -> &'static str {
        "delay_drift"
    }

    fn summary(&self) -> &'static str {
        "the command arrives late, by a delay that grows or shrinks with time"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn elaborates(&self) -> Option<&'static str> {
        Some("input_delay")
    }

    fn changes(&self) -> Option<Change> {
        Some(Change::Drift)
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::input(self, system, channel)?;
        let rate = Parameter {
            lower: -FASTEST,
            upper: FASTEST,
            ..channel::free("rate", "1".to_owned(), 0.0)
        };
        Ok(vec![channel::delay("delay"), rate])
    }

    fn starts(&self, _: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        scales.scanned(self, channel)
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
        let (delay_s, rate) = (values[0], values[1]);
        let drifted =
            move |signal: crate::simulate::piecewise::Piecewise| signal.drifting(delay_s, rate);
        plan.inputs[channel::input(self, system, channel)?].maps.push(Arc::new(drifted));
        Ok(())
    }
}
