//! The actuator lags: w′ = (u − w)/time_constant.

use crate::effect::channel;
use crate::effect::definition::{Effect, Lateness, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The actuator follows with a first-order lag.
///
/// Assumes: one pole, which starts settled.
/// Fails when: the lag is short against the motion: a delay of the same length does nearly the same. On one input a lag of all sensors is the same.
/// Source: Åström and Murray (2008), Feedback Systems.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ActuatorLag;

impl Effect for ActuatorLag {
    fn name(&self) -> &'static str {
        "actuator_lag"
    }

    fn summary(&self) -> &'static str {
        "the actuator follows with a first-order lag"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::input(self, system, channel)?;
        Ok(vec![channel::time_constant("time_constant")])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let _ = (system, channel);
        channel::times(scales)
    }

    fn lateness(&self) -> Option<Lateness> {
        Some(Lateness::Lag)
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
        plan.inputs[channel::input(self, system, channel)?].lags_s.push(values[0]);
        Ok(())
    }
}
