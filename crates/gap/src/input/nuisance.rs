//! Constants with a separate value in every log that are no cause of the gap, as the model file declares them.

use super::subject::Subject;
use crate::format::error::GapError;
use deadtime_log::Log;
use deadtime_model::NuisanceEntry;
use deadtime_model::effect::{Applied, EFFECTS, Effect, EffectError, Site, find};
use deadtime_model::simulate::System;

/// A constant of which every log has its own, with a normal prior about the value at which it does nothing.
#[derive(Debug, Clone)]
pub(crate) struct Nuisance {
    /// At the value at which it does nothing.
    applied: Applied,
    /// Standard deviation of its prior.
    pub(crate) std: f64,
    /// True if the model file declares it. Otherwise it is the offset of an output whose operating point is the logs' mean in the file.
    pub(crate) declared: bool,
}

impl Nuisance {
    fn of(entry: &NuisanceEntry, system: &System) -> Result<Self, String> {
        let effect = find(&entry.effect).ok().filter(|effect| effect.is_constant());
        let Some(effect) = effect else {
            return Err(format!(
                "{}; take one of: {}",
                not_constant(&entry.effect),
                constants().join(", ")
            ));
        };
        let remedy = |e: EffectError| format!("{e}; correct its `channel`, or leave it out");
        Ok(Self {
            applied: Applied::nominal(system, effect, &entry.channel).map_err(remedy)?,
            std: entry.std,
            declared: true,
        })
    }

    /// So far from the value at which it does nothing.
    pub(crate) fn at(&self, deviation: f64) -> Applied {
        let mut applied = self.applied.clone();
        applied.values.iter_mut().for_each(|value| *value += deviation);
        applied
    }

    /// Why it is no candidate for a cause.
    pub(crate) fn why_not_tried(&self) -> String {
        let channel = &self.applied.channel;
        match self.declared {
            true => format!("a nuisance of the model file on `{channel}`"),
            false => format!(
                "the operating point of `{channel}` is the mean of the logs, which takes a constant up"
            ),
        }
    }

    /// It is what this candidate is.
    pub(crate) fn is(&self, effect: &dyn Effect, channel: &str) -> bool {
        self.applied.effect.name() == effect.name() && self.applied.channel == channel
    }
}

fn constants() -> Vec<&'static str> {
    EFFECTS.iter().filter(|e| e.is_constant()).map(|e| e.name()).collect()
}

fn not_constant(name: &str) -> String {
    match find(name) {
        Ok(_) => format!(
            "`{name}` does more than add a constant of one number, so it is a cause and no nuisance"
        ),
        Err(_) => format!("there is no effect `{name}`"),
    }
}

/// The nuisances of a subject: those of the model file, then the levels of outputs whose operating point is `"mean"`.
///
/// A mean includes the noise and the model's motion about its operating point. The offset is therefore known to the output's spread at best, which is its
/// prior.
///
/// # Errors
/// [`GapError::Nuisance`]: an effect or channel that there is none, an effect that is no constant.
pub(crate) fn nuisances(
    subject: Subject<'_>,
    system: &System,
    logs: &[Log],
) -> Result<Vec<Nuisance>, GapError> {
    let wrong = |entry: &NuisanceEntry, why| GapError::Nuisance {
        model: subject.name().to_owned(),
        nuisance: entry.key(),
        why,
    };
    let declared = subject
        .nuisances()
        .iter()
        .map(|entry| Nuisance::of(entry, system).map_err(|why| wrong(entry, why)));
    let mut nuisances = declared.collect::<Result<Vec<_>, _>>()?;
    for (channel, std) in subject.unknown_levels(logs) {
        let level = EFFECTS.into_iter().find(|e| e.is_constant() && e.site() == Site::Output);
        let Some(applied) =
            level.and_then(|effect| Applied::nominal(system, effect, &channel).ok())
        else {
            continue;
        };
        if !nuisances.iter().any(|n| n.is(applied.effect, &channel)) {
            nuisances.push(Nuisance { applied, std, declared: false });
        }
    }
    Ok(nuisances)
}
