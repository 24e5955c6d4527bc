//! The sensors' clock has an offset: it reads t + offset. Positive: outputs appear late.

use crate::effect::channel;
use crate::effect::definition::{ALL, Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::{Parameter, Role};
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;

/// The sensors' clock has an offset.
///
/// Assumes: both clocks run at one rate; the offset is the same in all logs.
/// Fails when: only commands move the plant: a delay of the input, or of all outputs, has the same effect. Motion of another origin, such as a release from a
/// displaced start, distinguishes them.
/// Source: Mills, Martin, Burbank and Kasch (2010), RFC 5905 (Network Time Protocol version 4: offset and frequency of a clock).
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClockOffset;

impl Effect for ClockOffset {
    fn facts(&self) -> Facts {
        Facts {
            is_constant: true,
            ..Facts::of("clock_offset", Site::Clock, "the sensors' clock is set differently")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        if on.channel != ALL {
            return Err(on.unknown());
        }
        Ok(vec![Parameter { role: Role::Clock, ..channel::free("offset", "s".to_owned(), 0.0) }])
    }

    fn starts(&self, _: OnChannel<'_>, scales: &Scales) -> Vec<Vec<f64>> {
        channel::delays(scales).into_iter().flat_map(|t| [t.clone(), vec![-t[0]]]).collect()
    }

    fn apply(&self, _: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        plan.clock.offset_s += values[0];
        Ok(())
    }
}
