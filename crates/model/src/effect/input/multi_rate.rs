//! Commands pass at certain times only and are held between them, as through a slower loop: at phase, phase + period, phase + 2·period and so on.

use crate::effect::channel;
use crate::effect::definition::{Effect, Lateness, Scales, Site, Telling};
use crate::effect::error::EffectError;
use crate::effect::parameter::{Parameter, Role};
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// A slower loop on the way of the commands.
///
/// Assumes: a strictly periodic slower loop, and commands that are held between its times.
/// Fails when: the commands themselves change more seldom than the slower loop runs; its mean delay, half a period, then looks like `input_delay`.
/// Source: Åström and Wittenmark (1997), Computer-Controlled Systems, 3rd edition (multirate sampling).
#[derive(Debug, Clone, Copy)]
pub(crate) struct MultiRate;

impl Effect for MultiRate {
    fn name(&self) -> &'static str {
        "multi_rate"
    }

    fn summary(&self) -> &'static str {
        "commands pass at the times of a slower loop only"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn elaborates(&self) -> Option<&'static str> {
        Some("input_delay")
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::input(self, system, channel)?;
        let period = Parameter { role: Role::Period, ..channel::delay("period") };
        // Any whole number of periods more is the same.
        let phase = Parameter { role: Role::Shape, ..channel::free("phase", "s".to_owned(), 0.0) };
        Ok(vec![period, phase])
    }

    fn starts(&self, _: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        scales.scanned(self, channel)
    }

    fn is_identity(&self, values: &[f64], _: &[Parameter]) -> bool {
        values[0] == 0.0
    }

    fn lateness(&self) -> Option<Lateness> {
        Some(Lateness::SlowerLoop)
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::Bandwidth)
    }

    /// The first passing time at or after the log's first sample.
    fn canonical(&self, values: Vec<f64>) -> Vec<f64> {
        let (period, phase) = (values[0], values[1]);
        if period > 0.0 && !(0.0..period).contains(&phase) {
            vec![period, phase.rem_euclid(period)]
        } else {
            values
        }
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        plan.inputs[channel::input(self, system, channel)?].passing = Some((values[0], values[1]));
        Ok(())
    }
}
