//! What an addition to a composition must do to be accepted.

use super::standing::{Standing, t_of};
use crate::diagnose::input::criteria::Criteria;
use crate::diagnose::likelihood::errors::{Errors, overall};

/// The gate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gate {
    pub(super) criteria: Criteria,
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
        let limits = &self.criteria;
        let fall = Self::fall(before, after);
        let logarithms: Vec<f64> = before.blocks.iter().zip(&after.blocks).map(|(b, a)| (b / a).ln()).collect();
        let better = logarithms.iter().filter(|l| **l > 0.0).count() as f64;
        let mostly = better >= limits.added_blocks * logarithms.len() as f64 && t_of(&logarithms) >= limits.added_t;
        let held = 1.0 - after.held.over(&before.held);
        let taken = [(&before.train, &after.train, &original.train), (&before.held, &after.held, &original.held)];
        fall >= limits.added_falls
            && (mostly || self.better(before, after))
            && before.train.log_ratio(&after.train) >= limits.added_gains
            && held >= limits.added_held_out.max(limits.added_generalises * fall)
            && (taken.iter().all(|(before, after, original)| before.over(original) - after.over(original) >= limits.added_matters)
                || (fall.min(held) >= limits.added_of_rest && taken.iter().all(|(before, after, _)| self.shows(before, after))))
    }

    /// Better in most blocks, or plainly better over all of them and on held-out data: a limit acts in few blocks, and the start of a log is in one.
    pub(super) fn better(&self, before: &Standing, after: &Standing) -> bool {
        after.better_by_t(before) >= self.criteria.added_t || self.plainly(before, after)
    }

    /// Plainly better over all blocks and held-out data together (the geometric mean of their errors), and better on each.
    fn plainly(&self, before: &Standing, after: &Standing) -> bool {
        let ratios = [after.error() / before.error(), after.held.over(&before.held)];
        let each = ratios.iter().all(|ratio| 1.0 - ratio >= self.criteria.added_falls);
        each && (ratios[0] * ratios[1]).sqrt() <= 1.0 - self.criteria.added_plainly
    }

    /// What is taken is seen in the outputs, however large the gap is of which it is a part.
    fn shows(&self, before: &Errors, after: &Errors) -> bool {
        let square = |errors: &Errors| overall(&errors.nrmse()).map_or(0.0, |e| e * e);
        square(before) - square(after) >= self.criteria.added_shows.powi(2)
    }

    /// Another takes nearly as much as the best and does not differ from it over the blocks.
    pub(super) fn stands_in(&self, before: &Standing, best: &Standing, other: &Standing) -> bool {
        let enough = Self::fall(before, other) >= self.criteria.stands_in * Self::fall(before, best);
        let alike = other.error() <= (1.0 + self.criteria.added_equals) * best.error();
        enough && (alike || best.better_by_t(other).abs() < self.criteria.added_t)
    }

    /// What takes another's place is hardly worse on held-out data.
    pub(super) fn holds_out(&self, before: &Standing, after: &Standing) -> bool {
        after.held.over(&before.held) <= 1.0 / (1.0 - self.criteria.added_falls)
    }

    /// An earlier effect is needless where the blocks are hardly worse without it, unless all of them together are worse and held-out data plainly so.
    pub(super) fn needless(&self, without: &Standing, with: &Standing) -> bool {
        let asked_for = Self::fall(without, with) > 0.0 && 1.0 - with.held.over(&without.held) >= self.criteria.added_plainly;
        with.better_by_t(without) < self.criteria.dropped_t && !asked_for
    }
}
