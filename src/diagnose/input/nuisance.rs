//! What is unknown anew in every log and no cause of the gap, as the model file declares it.

use super::subject::Subject;
use crate::diagnose::format::error::GapError;
use crate::effect::{Applied, EFFECTS, Effect, EffectError, find};
use crate::model::NuisanceEntry;
use crate::simulate::System;

/// A constant of which every log has its own, with a normal prior about the value at which it does nothing.
#[derive(Debug, Clone)]
pub(in crate::diagnose) struct Nuisance {
    /// At the value at which it does nothing.
    applied: Applied,
    /// Standard deviation of its prior.
    pub(in crate::diagnose) std: f64,
}

impl Nuisance {
    fn of(entry: &NuisanceEntry, system: &System) -> Result<Self, String> {
        let effect = find(&entry.effect).ok().filter(|effect| effect.is_constant());
        let Some(effect) = effect else { return Err(format!("{}; take one of: {}", not_constant(&entry.effect), constants().join(", "))) };
        let remedy = |e: EffectError| format!("{e}; correct its `channel`, or leave it out");
        Ok(Self { applied: Applied::nominal(system, effect, &entry.channel).map_err(remedy)?, std: entry.std })
    }

    /// So far from the value at which it does nothing.
    pub(in crate::diagnose) fn at(&self, deviation: f64) -> Applied {
        let mut applied = self.applied.clone();
        applied.values.iter_mut().for_each(|value| *value += deviation);
        applied
    }

    /// It is what this candidate is.
    pub(in crate::diagnose) fn is(&self, effect: &dyn Effect, channel: &str) -> bool {
        self.applied.effect.name() == effect.name() && self.applied.channel == channel
    }
}

fn constants() -> Vec<&'static str> {
    EFFECTS.iter().filter(|e| e.is_constant()).map(|e| e.name()).collect()
}

fn not_constant(name: &str) -> String {
    match find(name) {
        Ok(_) => format!("`{name}` does more than add a constant of one number, so it is a cause and no nuisance"),
        Err(_) => format!("there is no effect `{name}`"),
    }
}

/// The nuisances of a subject.
///
/// # Errors
/// [`GapError::Nuisance`]: an effect or channel that there is none, an effect that is no constant.
pub(in crate::diagnose) fn nuisances(subject: Subject<'_>, system: &System) -> Result<Vec<Nuisance>, GapError> {
    let wrong = |entry: &NuisanceEntry, why| GapError::Nuisance { model: subject.name().to_owned(), nuisance: entry.key(), why };
    subject.nuisances().iter().map(|entry| Nuisance::of(entry, system).map_err(|why| wrong(entry, why))).collect()
}
