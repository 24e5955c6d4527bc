//! The actuator is not straight: u + quadratic·u·|u|.

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The actuator has a quadratic characteristic.
///
/// Assumes: a static characteristic that bends alike on both sides of zero.
/// Fails when: the command has few levels: then gain and offset do the same. Small commands show no curve.
/// Source: Narendra and Gallman (1966), IEEE Transactions on Automatic Control 11, 546-550, doi:10.1109/TAC.1966.1098387, for a static curve before
/// linear dynamics.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InputCurve;

impl Effect for InputCurve {
    fn name(&self) -> &'static str {
        "input_curve"
    }

    fn summary(&self) -> &'static str {
        "the actuator has a quadratic characteristic"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::unit(&system.inputs[channel::input(self, system, channel)?]);
        Ok(vec![channel::free("quadratic", format!("1/({unit})"), 0.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) =
            channel::input(self, system, channel).ok().and_then(|i| scales.inputs.get(i))
        else {
            return Vec::new();
        };
        channel::both_signs([0.3 / spread.quantiles[5].max(f64::MIN_POSITIVE)])
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
        plan.inputs[channel::input(self, system, channel)?]
            .curve
            .get_or_insert_default()
            .quadratic += values[0];
        Ok(())
    }
}
