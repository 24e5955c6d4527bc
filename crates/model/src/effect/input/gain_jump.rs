//! The gain of the actuator steps at a time: gain·u until then, later·u from then on.

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Change, Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The gain of an actuator that steps, at the same time in every log: a motor that is lost, a load that drops.
///
/// Assumes: one step, at the same log time in every log; constant gains before and after.
/// Fails when: the step stands close to an end of the log, or the command hardly moves beside it: then one gain explains as much. A step of the entry of B through
/// which alone the input acts is the same.
/// Source: Zhang and Jiang (2008), Annual Reviews in Control 32, 229-252, doi:10.1016/j.arcontrol.2008.03.008 (abrupt loss of effectiveness).
#[derive(Debug, Clone, Copy)]
pub(crate) struct GainJump;

impl Effect for GainJump {
    fn name(&self) -> &'static str {
        "gain_jump"
    }

    fn summary(&self) -> &'static str {
        "the gain of the actuator steps at a time"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn elaborates(&self) -> Option<&'static str> {
        Some("input_gain")
    }

    fn changes(&self) -> Option<Change> {
        Some(Change::Jump)
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::input(self, system, channel)?;
        let gain = |name| channel::free(name, "1".to_owned(), 1.0);
        Ok(vec![gain("gain"), channel::instant(), gain("later")])
    }

    fn starts(&self, _: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        scales.scanned(self, channel)
    }

    fn is_identity(&self, values: &[f64], _: &[Parameter]) -> bool {
        values[0] == 1.0 && values[2] == 1.0
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::Amplitude)
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let (gain, time_s, later) = (values[0], values[1], values[2]);
        let stepped = move |signal: crate::simulate::piecewise::Piecewise| {
            signal.scaled_until(gain, time_s, later)
        };
        plan.inputs[channel::input(self, system, channel)?].maps.push(Arc::new(stepped));
        Ok(())
    }
}
