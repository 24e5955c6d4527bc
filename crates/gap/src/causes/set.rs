//! A set of effects with jointly fitted parameters.

use crate::hypothesis::effects::Dropouts;
use crate::likelihood::active_effects::ActiveEffects;
use deadtime_model::effect::{Applied, row};

/// Effects that act together, fitted jointly.
#[derive(Debug, Clone)]
pub(crate) struct CauseSet {
    /// In the order of the table of effects.
    pub(crate) effects: Vec<Applied>,
    /// The relative size of the joint recalibration of all parameters, where it is part of the set.
    pub(crate) recalibration: Option<f64>,
    /// The decoded sequence, where an effect loses or delays single commands.
    pub(crate) lost: Option<Dropouts>,
    /// Parameters that act on the outputs, as effect and place.
    pub(crate) free: Vec<(usize, usize)>,
    /// The number of them that belong to single effects.
    pub(super) acting: usize,
    /// Per output, the sum of squared residuals.
    pub(super) squares: Vec<f64>,
    /// All that the priors cost.
    pub(super) priors: f64,
    /// Members that the fit predicts to be removable.
    pub(super) removals: Vec<Removal>,
}

/// A member that may be removed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Removal {
    /// The member's key.
    pub(super) key: String,
    /// Its parameters that act.
    pub(super) parameters: usize,
    /// The predicted rise of the misfit.
    pub(super) rise: f64,
}

/// The identity of a set: its single effects, and whether all parameters are recalibrated.
pub(crate) type SetKey = String;

impl<'e> From<&'e CauseSet> for ActiveEffects<'e> {
    fn from(set: &'e CauseSet) -> Self {
        Self { effects: &set.effects, lost: set.lost.as_ref().map(|l| l.sequences.as_slice()) }
    }
}

impl CauseSet {
    /// A set that is not fitted yet; a sequence without the effect that causes it is none.
    pub(super) fn begun(
        effects: Vec<Applied>,
        recalibration: Option<f64>,
        lost: Option<Dropouts>,
    ) -> Self {
        let lost = lost.filter(|_| effects.iter().any(|a| a.effect.loses_commands()));
        Self {
            effects,
            recalibration,
            lost,
            free: Vec::new(),
            acting: 0,
            squares: Vec::new(),
            priors: 0.0,
            removals: Vec::new(),
        }
    }

    /// The set with other effects, not fitted yet.
    pub(super) fn with(&self, effects: Vec<Applied>) -> Self {
        Self::begun(effects, self.recalibration, self.lost.clone())
    }

    /// The set without one of its effects, not fitted yet.
    pub(super) fn without(&self, out: &Applied) -> Self {
        self.without_key(&out.key())
    }

    /// The same by the effect's key.
    pub(super) fn without_key(&self, key: &str) -> Self {
        self.with(self.effects.iter().filter(|a| a.key() != key).cloned().collect())
    }

    /// Whether an effect belongs to the joint recalibration.
    pub(crate) fn recalibrates(&self, applied: &Applied) -> bool {
        self.recalibration.is_some() && applied.effect.corrects_model()
    }

    /// The effects aside from the joint recalibration.
    pub(crate) fn singly(&self) -> impl Iterator<Item = &Applied> {
        self.effects.iter().filter(|a| !self.recalibrates(a))
    }

    pub(crate) fn key(&self) -> SetKey {
        key(self.singly(), self.recalibration.is_some())
    }
}

/// The key of single effects with or without a joint recalibration.
pub(super) fn key<'e>(effects: impl Iterator<Item = &'e Applied>, recalibrated: bool) -> SetKey {
    let mut keys: Vec<String> = effects.map(Applied::key).collect();
    keys.sort();
    keys.extend(recalibrated.then(|| "*".to_owned()));
    keys.join(" + ")
}

/// Effects in the order of the table, in which they act.
pub(super) fn in_order(effects: impl Iterator<Item = Applied>) -> Vec<Applied> {
    let mut effects: Vec<Applied> = effects.collect();
    effects.sort_by_key(|a| (row(a.effect), a.channel.clone()));
    effects
}

/// A set without each of its effects, and without its joint recalibration.
pub(super) fn dropped(set: &CauseSet) -> impl Iterator<Item = CauseSet> {
    let alone = set
        .recalibration
        .map(|_| CauseSet::begun(set.singly().cloned().collect(), None, set.lost.clone()));
    set.singly().map(|out| set.without(out)).chain(alone)
}
