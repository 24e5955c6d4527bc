//! Commands are lost in transmission: the last one that arrived is held.
//!
//! Equation: v(k) = u(k) where the command of sample k arrives, else v(k − 1). Each sample is lost independently with this probability, or in runs of mean
//! length `burst`. A loss then continues with probability 1 − 1/burst, and begins with probability/(burst·(1 − probability)).

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, Lateness, OnChannel, Site, Telling};
use crate::effect::error::{EffectError, Result};
use crate::effect::parameter::{Parameter, Role};
use crate::effect::scales::Scales;
use crate::simulate::plan::{Drops, Losses, Plan, Realisation};

/// Each logged command is lost with this probability; a plan uses the mean over all sequences until a seed draws one.
///
/// Assumes: each sample is lost with one probability, independent of earlier losses, or dependent on the previous one only. The last command is held.
/// Fails when: commands change seldom: most losses then have no effect. If commands change less often than losses last, a burst resembles a delay.
/// Source: Schenato, Sinopoli, Franceschetti, Poolla and Sastry (2007), Proceedings of the IEEE 95, 163-187, doi:10.1109/JPROC.2006.887306. For bursts Gilbert
/// (1960), Bell System Technical Journal 39, 1253-1265, doi:10.1002/j.1538-7305.1960.tb03959.x.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DroppedCommands;

impl Effect for DroppedCommands {
    fn facts(&self) -> Facts {
        Facts {
            lateness: Some(Lateness::Lost),
            told_by: Some(Telling::Bandwidth),
            ..Facts::of("dropped_commands", Site::Input, "commands get lost, the last one is held")
        }
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.input()?;
        let probability =
            Parameter { upper: 0.999, ..channel::not_negative("probability", "1".to_owned(), 0.0) };
        // Unit: commands; default: the mean run length of independent losses.
        let burst = Parameter {
            role: Role::Shape,
            lower: 1.0,
            ..channel::free("burst", "1".to_owned(), f64::INFINITY)
        };
        Ok(vec![probability, burst])
    }

    fn starts(&self, _: OnChannel<'_>, _: &Scales) -> Vec<Vec<f64>> {
        [0.1, 0.4, 0.8].map(|probability| vec![probability, f64::INFINITY]).to_vec()
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (probability, burst) = (values[0], Some(values[1]).filter(|b| b.is_finite()));
        // The shortest mean burst: losses begin at once behind every command that arrives.
        let shortest = probability / (1.0 - probability);
        if let Some(value) = burst.filter(|b| *b < shortest) {
            let (effect, channel, parameter) =
                (self.name(), on.channel.to_owned(), "burst".to_owned());
            return Err(EffectError::Bounds {
                effect,
                channel,
                parameter,
                value,
                lower: shortest,
                upper: f64::INFINITY,
            });
        }
        let losses = Losses { probability, burst };
        plan.inputs[on.input()?].drops = Some(Drops { losses, lost: Realisation::Mean });
        Ok(())
    }
}
