//! The actuator does more or less than commanded: gain·u.

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The actuator has another gain.
///
/// Assumes: a constant gain, which acts on the whole command.
/// Fails when: there is one input: a gain of all outputs, or of one column of B, is the same for a linear plant.
/// Source: Åström and Murray (2008), Feedback Systems.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InputGain;

impl Effect for InputGain {
    fn name(&self) -> &'static str {
        "input_gain"
    }

    fn summary(&self) -> &'static str {
        "the actuator has another gain"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::input(self, system, channel)?;
        Ok(vec![channel::free("gain", "1".to_owned(), 1.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let _ = (system, channel, scales);
        vec![vec![0.8], vec![1.25], vec![-1.0]]
    }

    fn of_factor(&self, factor: f64) -> Option<Vec<f64>> {
        Some(vec![1.0 / factor])
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
        plan.inputs[channel::input(self, system, channel)?].curve.get_or_insert_default().gain *=
            values[0];
        Ok(())
    }
}
