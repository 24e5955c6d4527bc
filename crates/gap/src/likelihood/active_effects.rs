//! Active effects in a simulation, with the decoded part of their random behaviour.

use deadtime_model::effect::{Applied, Fates};

/// The latent sequence of each input's commands; `None` where all arrive.
pub(crate) type LostCommands = Vec<Option<Fates>>;

/// Effects at work, with the commands that were lost where that is known.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ActiveEffects<'e> {
    pub(crate) effects: &'e [Applied],
    /// One per record.
    pub(crate) lost: Option<&'e [LostCommands]>,
}

/// No effect at all.
pub(crate) const NO_EFFECT: ActiveEffects<'static> = ActiveEffects { effects: &[], lost: None };

impl<'e> From<&'e [Applied]> for ActiveEffects<'e> {
    fn from(effects: &'e [Applied]) -> Self {
        Self { effects, lost: None }
    }
}

impl<'e, const N: usize> From<&'e [Applied; N]> for ActiveEffects<'e> {
    fn from(effects: &'e [Applied; N]) -> Self {
        Self { effects, lost: None }
    }
}

impl<'e> From<&'e Vec<Applied>> for ActiveEffects<'e> {
    fn from(effects: &'e Vec<Applied>) -> Self {
        Self { effects, lost: None }
    }
}

impl<'e> ActiveEffects<'e> {
    /// With other values for the same effects.
    pub(crate) fn with(self, effects: &'e [Applied]) -> Self {
        Self { effects, ..self }
    }
}
