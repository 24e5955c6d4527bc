//! Small commands do nothing: sign(u)·max(|u| − width, 0).

use std::sync::Arc;

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::Parameter;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// Small commands do nothing.
///
/// Assumes: a dead zone that is symmetric about zero, before everything that has memory.
/// Fails when: all commands are far larger than the width: the loss is then an offset that changes sign with the command. Dry friction also swallows
/// small commands.
/// Source: Khalil (2002), Nonlinear Systems, 3rd edition, section 1.2.7 (common nonlinearities).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Deadband;

impl Effect for Deadband {
    fn name(&self) -> &'static str {
        "deadband"
    }

    fn summary(&self) -> &'static str {
        "small commands do nothing"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        let unit = channel::unit(&system.inputs[channel::input(self, system, channel)?]);
        Ok(vec![channel::not_negative("width", unit, 0.0)])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let Some(spread) =
            channel::input(self, system, channel).ok().and_then(|i| scales.inputs.get(i))
        else {
            return Vec::new();
        };
        [0.1, 0.25, 0.5, 0.75]
            .map(|share| vec![share * spread.quantiles[5]])
            .into_iter()
            .chain([vec![0.5 * spread.quantiles[2]]])
            .collect()
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
        let width = values[0];
        plan.inputs[channel::input(self, system, channel)?].maps.push(Arc::new(move |signal| {
            signal.map_with_kinks(&[-width, width], |u| {
                if u.abs() <= width { (0.0, 0.0) } else { (u - width * u.signum(), 1.0) }
            })
        }));
        Ok(())
    }
}
