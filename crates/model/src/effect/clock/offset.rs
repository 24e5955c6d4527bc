//! The sensors' clock is set differently: it reads t + offset. Positive: outputs seem late.

use crate::effect::channel;
use crate::effect::definition::{Effect, Scales, Site};
use crate::effect::error::EffectError;
use crate::effect::parameter::{Parameter, Role};
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// The sensors' clock is set differently.
///
/// Assumes: both clocks run at one rate; the offset is the same in all logs.
/// Fails when: only commands move the plant: a delay of the input, or of all outputs, does the same. Motion of another origin, such as a release from a
/// displaced start, tells them apart.
/// Source: Mills, Martin, Burbank and Kasch (2010), RFC 5905 (Network Time Protocol version 4: offset and frequency of a clock).
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClockOffset;

impl Effect for ClockOffset {
    fn name(&self) -> &'static str {
        "clock_offset"
    }

    fn summary(&self) -> &'static str {
        "the sensors' clock is set differently"
    }

    fn site(&self) -> Site {
        Site::Clock
    }

    fn channels(&self, _: &System) -> Vec<String> {
        vec![channel::ALL.to_owned()]
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        if channel != channel::ALL {
            return Err(EffectError::Channel {
                effect: self.name(),
                channel: channel.to_owned(),
                known: self.channels(system),
            });
        }

        Ok(vec![Parameter { role: Role::Clock, ..channel::free("offset", "s".to_owned(), 0.0) }])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let _ = (system, channel);
        channel::delays(scales).into_iter().flat_map(|t| [t.clone(), vec![-t[0]]]).collect()
    }

    fn is_constant(&self) -> bool {
        true
    }

    fn apply(
        &self,
        system: &System,
        channel: &str,
        values: &[f64],
        plan: &mut Plan,
    ) -> Result<(), EffectError> {
        let _ = (system, channel);
        plan.clock.offset_s += values[0];
        Ok(())
    }
}
