//! Classes of effects that are indistinguishable on the training logs.

use deadtime_model::effect::Applied;

/// An effect of the best set, and what replaces it.
pub(crate) struct EffectClass {
    /// The effect; of the joint recalibration, its first parameter.
    pub(crate) effect: Applied,
    /// The replacements of the effect in a set as good as the best: one effect, or several together.
    pub(crate) instead: Vec<Vec<Applied>>,
    /// The rise of the score without any member of the class, in units of twice the log-likelihood.
    pub(crate) evidence: f64,
}

impl EffectClass {
    /// The effects that replace it alone.
    pub(crate) fn aliases(&self) -> impl Iterator<Item = &Applied> {
        self.instead.iter().filter_map(|members| match members.as_slice() {
            [one] => Some(one),
            _ => None,
        })
    }
}
