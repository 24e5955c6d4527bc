//! Commands get lost on the way: the last one that arrived is held.

use crate::effect::channel;
use crate::effect::{Effect, EffectError, Parameter, Scales, Site, Telling};
use crate::simulate::{Drops, Plan, System};

/// Each logged command is lost with this probability, independently; a plan holds the mean over all sequences until a seed draws one.
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

    fn loses_commands(&self) -> bool {
        true
    }

    fn told_by(&self) -> Option<Telling> {
        Some(Telling::Bandwidth)
    }

    fn apply(&self, system: &System, channel: &str, values: &[f64], plan: &mut Plan) -> Result<(), EffectError> {
        plan.inputs[channel::input(self, system, channel)?].drops = Some(Drops::Mean(values[0]));
        Ok(())
    }
}
