//! What an addition to a composition must do to be accepted.

use super::standing::{Standing, t_of};
use crate::input::criteria::Criteria;
use crate::likelihood::errors::{Errors, overall};

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
        let logarithms: Vec<f64> =
            before.blocks.iter().zip(&after.blocks).map(|(b, a)| (b / a).ln()).collect();
        let better = logarithms.iter().filter(|l| **l > 0.0).count() as f64;
        let mostly = better >= limits.added_blocks * logarithms.len() as f64
            && t_of(&logarithms) >= limits.added_t;
        let held = 1.0 - after.held.over(&before.held);
        let taken = [
            (&before.train, &after.train, &original.train),
            (&before.held, &after.held, &original.held),
        ];
        (fall >= limits.added_falls && (mostly || self.better(before, after))
            || self.foretells(before, after))
            && before.train.log_ratio(&after.train) >= limits.added_gains
            && held >= limits.added_held_out.max(limits.added_generalises * fall)
            && (taken.iter().all(|(before, after, original)| {
                before.over(original) - after.over(original) >= limits.added_matters
            }) || (fall.min(held) >= limits.added_of_rest
                && taken.iter().all(|(before, after, _)| self.shows(before, after))))
    }

    /// What takes another's place explains more, and more for every further number.
    pub(super) fn pays(&self, before: &Standing, after: &Standing) -> bool {
        let more = after.hypothesis.free.len().saturating_sub(before.hypothesis.free.len());
        Self::fall(before, after) > self.criteria.added_falls * (1 + more) as f64
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

    /// Plainly better on what was learnt from and on held-out data alike, and no worse over the blocks: where other causes are not found yet, their misfit decides what
    /// a block tells of a number, and no block foretells the others; held-out data were never fitted.
    fn foretells(&self, before: &Standing, after: &Standing) -> bool {
        let falls = [after.train.over(&before.train), after.held.over(&before.held)];
        falls.iter().all(|left| 1.0 - left >= self.criteria.added_plainly)
            && before.better_by_t(after) < self.criteria.dropped_t
    }

    /// What is taken is seen in the outputs, however large the gap is of which it is a part.
    fn shows(&self, before: &Errors, after: &Errors) -> bool {
        let square = |errors: &Errors| overall(&errors.nrmse()).map_or(0.0, |e| e * e);
        square(before) - square(after) >= self.criteria.added_shows.powi(2)
    }

    /// Another takes nearly as much as the best and does not differ from it over the blocks.
    pub(super) fn stands_in(&self, before: &Standing, best: &Standing, other: &Standing) -> bool {
        // What foretells may not lower the blocks' error at all.
        let fall = Self::fall(before, best);
        let enough =
            Self::fall(before, other) >= fall - (1.0 - self.criteria.stands_in) * fall.abs();
        let alike = other.error() <= (1.0 + self.criteria.added_equals) * best.error();
        enough && (alike || best.better_by_t(other).abs() < self.criteria.added_t)
    }

    /// What takes another's place is hardly worse on held-out data.
    pub(super) fn holds_out(&self, before: &Standing, after: &Standing) -> bool {
        after.held.over(&before.held) <= 1.0 / (1.0 - self.criteria.added_falls)
    }

    /// An earlier effect is needless where the blocks are hardly worse without it, unless all of them together are worse and held-out data plainly so.
    pub(super) fn needless(&self, without: &Standing, with: &Standing) -> bool {
        let asked_for = Self::fall(without, with) > 0.0
            && 1.0 - with.held.over(&without.held) >= self.criteria.added_plainly;
        with.better_by_t(without) < self.criteria.dropped_t
            && !asked_for
            && !self.foretells(without, with)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::options::GapOptions;

    /// Ten blocks of squared error 1, of which the first is as said; a held-out error; and so many free numbers.
    fn standing(first: f64, held: f64, numbers: usize) -> Standing {
        let mut blocks = vec![1.0; 10];
        blocks[0] = first;
        Standing::judged(
            blocks,
            Errors::of_one(1.0, 100.0),
            Errors::of_one(held.sqrt(), 100.0),
            numbers,
        )
    }

    fn gate() -> Gate {
        Gate { criteria: GapOptions::default().criteria }
    }

    /// All of the fall is in one block, so no t says anything: 40 % of the blocks' error and 10 % of the held-out one are a quarter in the mean, 40 and 5 are not.
    #[test]
    fn plainly_better_is_a_quarter_in_the_mean_of_learnt_and_held_out() {
        let before = standing(11.0, 1.0, 1);
        let after = |held: f64| standing(3.0, held, 1);
        assert!(after(0.9).better_by_t(&before) < gate().criteria.added_t);
        assert!(gate().better(&before, &after(0.9)));
        assert!(!gate().better(&before, &after(0.95)));
        // Much better on what was learnt, and worse held out.
        assert!(!gate().better(&before, &standing(0.0, 1.01, 1)));
    }

    /// Hardly better over the blocks: held-out data that are a quarter worse without it keep an effect, unless the blocks are better without it.
    #[test]
    fn held_out_data_keep_an_effect() {
        let with = standing(1.0, 0.7, 2);
        let without = |first: f64, held: f64| {
            let mut without = standing(first, held, 1);
            without.blocks[1] = 0.7;
            without
        };
        assert!(with.better_by_t(&without(1.5, 0.9)) < gate().criteria.dropped_t);
        assert!(gate().needless(&without(1.5, 0.9), &with));
        assert!(!gate().needless(&without(1.5, 1.0), &with));
        assert!(gate().needless(&without(0.5, 1.0), &with));
    }

    /// A quarter less learnt and held out, while the blocks are a little worse: it passes, and is not taken out again. Not where the blocks are worse for certain, nor where
    /// either falls by less.
    #[test]
    fn what_foretells_held_out_data_passes_where_blocks_say_nothing() {
        let with = |blocks: [f64; 2], train: f64, held: f64| {
            let [first, second] = blocks;
            let mut with = standing(first, held, 2);
            with.blocks[1] = second;
            with.train = Errors::of_one(train.sqrt(), 100.0);
            with
        };
        let (before, original) = (
            standing(1.0, 1.0, 1),
            Original { train: Errors::of_one(1.0, 100.0), held: Errors::of_one(1.0, 100.0) },
        );
        let after = with([2.0, 0.5], 0.7, 0.7);
        assert!(Gate::fall(&before, &after) < 0.0);
        assert!(gate().accepts(&before, &after, &original) && !gate().needless(&before, &after));
        assert!(gate().stands_in(&before, &after, &after));
        let mut worse = with([2.0, 2.0], 0.7, 0.7);
        worse.blocks[2..].fill(1.1);
        for other in [worse, with([2.0, 0.5], 0.8, 0.7), with([2.0, 0.5], 0.7, 0.8)] {
            assert!(!gate().accepts(&before, &other, &original));
        }
    }

    /// Of an error of 20 each further number has to take 0.4 more.
    #[test]
    fn every_further_number_is_paid_for() {
        let before = standing(11.0, 1.0, 2);
        let after = |fall: f64, numbers: usize| standing(11.0 - 20.0 * fall, 1.0, numbers);
        assert!(gate().pays(&before, &after(0.03, 2)) && gate().pays(&before, &after(0.03, 1)));
        assert!(!gate().pays(&before, &after(0.03, 3)) && gate().pays(&before, &after(0.05, 3)));
        assert!(!gate().pays(&before, &after(0.09, 6)) && gate().pays(&before, &after(0.11, 6)));
    }
}
