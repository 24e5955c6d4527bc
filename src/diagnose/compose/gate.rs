//! What an addition to a composition must do to be accepted.

use super::standing::{Standing, t_of};
use crate::diagnose::likelihood::errors::Errors;

/// The limits of the gate. Where they come from: a throw-away study on 14 machines and 31 controls without a cause set them; scripts/criteria varies each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::diagnose) struct Gate {
    /// The part of the squared error over blocks left out in turn by which it must fall.
    pub(in crate::diagnose) fall: f64,
    /// Student's t of the paired differences over the blocks.
    pub(in crate::diagnose) paired_t: f64,
    /// The part of the blocks that must improve where the logarithms of their errors are compared instead: friction acts at times only.
    pub(in crate::diagnose) most_blocks: f64,
    /// Twice the log-likelihood that must be gained: the best of a whole catalogue reaches 10 to 25 on noise alone.
    pub(in crate::diagnose) likelihood: f64,
    /// The part of the held-out squared error by which it must fall; and the same as a part of the fall over the blocks.
    pub(in crate::diagnose) held_out: [f64; 2],
    /// The part of the original squared error that must be taken, on what was learnt from and on held-out data: on a precise machine a simulator's own
    /// inexactness is certain, too.
    pub(in crate::diagnose) of_original: f64,
    /// Accepted additions whose errors over the blocks differ by less than this part are equals.
    pub(in crate::diagnose) equals: f64,
    /// What takes this part of the winner's fall and does not differ from it over the blocks could stand in its place.
    pub(in crate::diagnose) stands_in: f64,
    /// An effect without which the blocks are not worse by this t is dropped.
    pub(in crate::diagnose) dropped_t: f64,
    /// So many effects at most.
    pub(in crate::diagnose) most: usize,
}

impl Default for Gate {
    fn default() -> Self {
        Self {
            fall: 0.02,
            paired_t: 1.8,
            most_blocks: 0.7,
            likelihood: 30.0,
            held_out: [0.01, 0.2],
            of_original: 0.01,
            equals: 0.01,
            stands_in: 0.7,
            dropped_t: 1.0,
            most: 5,
        }
    }
}

/// The errors of the model as it came, on what was learnt from and on held-out data.
pub(super) struct Original {
    pub(super) train: Errors,
    pub(super) held: Errors,
}

impl Gate {
    /// The part of the squared error over the blocks by which an addition lowers it.
    pub(super) fn fall(before: &Standing, after: &Standing) -> f64 {
        1.0 - after.error() / before.error()
    }

    /// Whether an addition is accepted.
    pub(super) fn accepts(&self, before: &Standing, after: &Standing, original: &Original) -> bool {
        let fall = Self::fall(before, after);
        let logarithms: Vec<f64> = before.blocks.iter().zip(&after.blocks).map(|(b, a)| (b / a).ln()).collect();
        let better = logarithms.iter().filter(|l| **l > 0.0).count() as f64;
        let mostly = better >= self.most_blocks * logarithms.len() as f64 && t_of(&logarithms) >= self.paired_t;
        let held = 1.0 - after.held.over(&before.held);
        let taken = [(&before.train, &after.train, &original.train), (&before.held, &after.held, &original.held)];
        fall >= self.fall
            && (mostly || after.better_by_t(before) >= self.paired_t)
            && before.train.log_ratio(&after.train) >= self.likelihood
            && held >= self.held_out[0].max(self.held_out[1] * fall)
            && taken.iter().all(|(before, after, original)| before.over(original) - after.over(original) >= self.of_original)
    }

    /// An earlier effect is needless where the blocks are hardly worse without it.
    pub(super) fn needless(&self, without: &Standing, with: &Standing) -> bool {
        with.better_by_t(without) < self.dropped_t
    }
}
