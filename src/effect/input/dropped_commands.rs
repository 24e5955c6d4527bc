//! Commands get lost on the way: the last one that arrived is held.
//!
//! Equation: v(k) = u(k) where the command of sample k arrives, else v(k − 1); lost with this probability, each sample for itself.

use crate::effect::channel;
use crate::effect::{Effect, EffectError, Lateness, Parameter, Scales, Site, Telling};
use crate::simulate::{Drops, Plan, System};

/// Each logged command is lost with this probability, independently; a plan holds the mean over all sequences until a seed draws one.
///
/// Assumes: each sample is lost with one probability, whatever was lost before it; the last command is held.
/// Fails when: commands change seldom: most losses then change nothing. Losses in bursts are not of this kind.
/// Source: Schenato, Sinopoli, Franceschetti, Poolla and Sastry (2007), Proceedings of the IEEE 95, 163-187, doi:10.1109/JPROC.2006.887306.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DroppedCommands;

impl Effect for DroppedCommands {
    fn name(&self) -> &'static str {
        "dropped_commands"
    }

    fn summary(&self) -> &'static str {
        "commands get lost, the last one is held"
    }

    fn site(&self) -> Site {
        Site::Input
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::names(&system.inputs)
    }

    fn parameters(&self, system: &System, channel: &str) -> Result<Vec<Parameter>, EffectError> {
        channel::input(self, system, channel)?;
        Ok(vec![Parameter { upper: 0.999, ..channel::not_negative("probability", "1".to_owned(), 0.0) }])
    }

    fn starts(&self, system: &System, channel: &str, scales: &Scales) -> Vec<Vec<f64>> {
        let _ = (system, channel, scales);
        vec![vec![0.1], vec![0.4], vec![0.8]]
    }

    fn lateness(&self) -> Option<Lateness> {
        Some(Lateness::Lost)
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::Bandwidth)
    }

    fn apply(&self, system: &System, channel: &str, values: &[f64], plan: &mut Plan) -> Result<(), EffectError> {
        plan.inputs[channel::input(self, system, channel)?].drops = Some(Drops::Mean(values[0]));
        Ok(())
    }
}
