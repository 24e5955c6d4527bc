//! The rule of the verdict: from the errors before and after the best hypothesis to an effect, none, or a cause outside the catalogue.

use crate::input::criteria::Criteria;

/// The kind of the verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum GapVerdict {
    None,
    Unknown,
    Effects,
}

/// Errors of all outputs as nrmse; `None` for a constant output.
#[derive(Debug, Clone, Default)]
pub(super) struct Sizes {
    /// The errors of the nominal model.
    pub(super) before: Vec<Option<f64>>,
    /// With what explains best.
    pub(super) after: Vec<Option<f64>>,
    pub(super) floor: Vec<Option<f64>>,
}

impl Sizes {
    /// Before, after and floor of all outputs together, where all three are known.
    fn of_all(&self) -> [f64; 3] {
        let each = self.before.iter().zip(&self.after).zip(&self.floor);
        let mut sums = [0.0; 3];
        for ((before, after), floor) in each {
            if let (Some(before), Some(after), Some(floor)) = (before, after, floor) {
                for (sum, one) in sums.iter_mut().zip([before, after, floor]) {
                    *sum += one * one;
                }
            }
        }
        sums.map(f64::sqrt)
    }
}

/// The inputs of the verdict.
#[derive(Debug, Clone, Default)]
pub(super) struct Levels {
    /// On the training logs.
    pub(super) train: Sizes,
    /// The number of effects of the best hypothesis; 0: the nominal model.
    pub(super) effects: usize,
    /// Noise decides what one of them does to single samples.
    pub(super) chance: bool,
    /// Some hypothesis beats no effect, whether it matters or not.
    pub(super) beaten: bool,
}

/// The verdict, and how far it is from another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ruling {
    pub(crate) verdict: GapVerdict,
    /// Probability of `unknown`.
    pub(crate) unknown: f64,
    /// The output on which the verdict was decided, and how many times the noise floor is left of it, where that is more than noise.
    pub(crate) left_over: Option<(usize, f64)>,
    /// The residual is noise, or within the inexactness of every simulator.
    pub(crate) complete: bool,
}

/// Decides.
pub(super) fn rule(levels: &Levels, criteria: &Criteria) -> Ruling {
    let Levels { train, effects, chance, beaten, .. } = levels;
    let decisive = decisive(train, *effects);
    let mut unknown: f64 = 0.0;
    let (mut left_over, mut complete) = (None, true);
    if let Some(i) = decisive
        && let (Some(before), Some(after), Some(floor)) =
            (train.before[i], train.after[i], train.floor[i])
    {
        let above = after / floor.max(1e-9);
        // Noise, and what every simulator is inexact by, add up as independent errors.
        let limit_of = |least: f64, before: f64, floor: f64| {
            least.hypot(criteria.inexact_gap * before / floor.max(1e-9))
        };
        let limit = match (*effects, *beaten) {
            (0, false) => criteria.above_floor_alone,
            _ => criteria.above_floor,
        };
        // Without an effect the whole output, in whose spread errors are measured, is the model's.
        let limit =
            if *effects == 0 { limit.min(limit_of(criteria.complete, 1.0, floor)) } else { limit };
        let further = limit_of(criteria.further, before, floor);
        let [before_all, after_all, floor_all] = train.of_all();
        complete = *chance
            || after_all / floor_all.max(1e-9)
                <= limit_of(criteria.complete, before_all, floor_all);
        left_over = Some((i, above)).filter(|_| above > limit && !chance);
        let share = if before > floor {
            (before * before - after * after) / (before * before - floor * floor)
        } else {
            1.0
        };
        let explains =
            share >= [criteria.one_explains, criteria.two_explain][(*effects).clamp(1, 2) - 1];
        if above > limit && (!explains || above > further) && !chance {
            unknown = 1.0 - 0.5 * (limit - above).exp();
        }
    }
    let verdict = match (unknown > criteria.unknown_from, effects) {
        (true, _) => GapVerdict::Unknown,
        (false, 0) => GapVerdict::None,
        (false, _) => GapVerdict::Effects,
    };
    Ruling { verdict, unknown, left_over, complete }
}

/// The output that gains most; where nothing gains, the one that is furthest above its floor.
fn decisive(train: &Sizes, effects: usize) -> Option<usize> {
    let gained = |i: usize| Some(train.before[i]?.powi(2) - train.after[i]?.powi(2));
    let ratio = |i: usize| Some(train.after[i]? / train.floor[i]?.max(1e-9));
    let key = |i: usize| if effects > 0 { gained(i) } else { ratio(i) }.unwrap_or(0.0);
    (0..train.before.len()).max_by(|&a, &b| key(a).total_cmp(&key(b)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sizes(before: f64, after: f64, floor: f64) -> Sizes {
        Sizes { before: vec![Some(before)], after: vec![Some(after)], floor: vec![Some(floor)] }
    }

    fn one_effect(train: Sizes) -> Levels {
        Levels { train, effects: 1, beaten: true, ..Levels::default() }
    }

    fn verdict(levels: &Levels) -> GapVerdict {
        rule(levels, &Criteria::default()).verdict
    }

    #[test]
    fn an_effect_that_reaches_the_floor_is_the_verdict() {
        let ruling = rule(&one_effect(sizes(0.5, 0.1, 0.1)), &Criteria::default());
        assert_eq!(
            ruling,
            Ruling { verdict: GapVerdict::Effects, unknown: 0.0, left_over: None, complete: true }
        );
    }

    /// 0.2 is twice the floor; of 0.25 − 0.01 it leaves 0.03, which is 87.5 % explained: less than 93 %.
    #[test]
    fn an_effect_that_leaves_twice_the_floor_and_explains_too_little_is_unknown() {
        let ruling = rule(&one_effect(sizes(0.5, 0.2, 0.1)), &Criteria::default());
        assert_eq!((ruling.verdict, ruling.left_over), (GapVerdict::Unknown, Some((0, 2.0))));
        assert!((ruling.unknown - (1.0 - 0.5 * (-0.5_f64).exp())).abs() < 1e-12);
    }

    /// The same twice the floor of a ten times larger gap: 99.9 % explained. The effect is named, and the remainder is reported.
    #[test]
    fn an_effect_that_explains_nearly_all_of_a_large_gap_is_named_beside_a_little_more_than_noise()
    {
        let ruling = rule(&one_effect(sizes(5.0, 0.2, 0.1)), &Criteria::default());
        assert_eq!((ruling.verdict, ruling.left_over), (GapVerdict::Effects, Some((0, 2.0))));
    }

    /// 1.4 times the floor of a gap of five floors: the limit is √(1.25² + 0.25²) = 1.27 times. Of 30 floors it is 1.95 times.
    #[test]
    fn what_stays_above_noise_and_inexactness_makes_an_answer_incomplete() {
        let ruling = |before| rule(&one_effect(sizes(before, 0.14, 0.1)), &Criteria::default());
        let (small, large) = (ruling(0.5), ruling(3.0));
        assert_eq!((small.verdict, small.complete), (GapVerdict::Effects, false));
        assert!(large.complete);
    }

    /// 0.6 is six times the floor, 98.6 % explained: the limit is √(5² + (0.05 · 5/0.1)²) = 5.59 times. With a gap of 10 the limit is 7.07 times.
    #[test]
    fn what_is_far_above_noise_and_inexactness_has_a_further_cause() {
        assert_eq!(verdict(&one_effect(sizes(5.0, 0.6, 0.1))), GapVerdict::Unknown);
        assert_eq!(verdict(&one_effect(sizes(10.0, 0.6, 0.1))), GapVerdict::Effects);
    }

    /// 1.6 times the floor: between the limits for a gap that nothing beats and for one that something beats.
    #[test]
    fn without_an_effect_the_limit_depends_on_whether_anything_beats_the_search() {
        let levels =
            |beaten| Levels { train: sizes(0.016, 0.016, 0.01), beaten, ..Levels::default() };
        assert_eq!(verdict(&levels(false)), GapVerdict::None);
        assert_eq!(verdict(&levels(true)), GapVerdict::Unknown);
    }

    /// 1.3 times the floor: of an error of 1.3 % of the spread within the inexactness of every simulator, of one of 40 % not.
    #[test]
    fn without_an_effect_a_large_error_is_compared_with_noise_alone() {
        let nothing = |floor: f64| Levels {
            train: sizes(1.3 * floor, 1.3 * floor, floor),
            ..Levels::default()
        };
        assert_eq!(verdict(&nothing(0.01)), GapVerdict::None);
        assert_eq!(verdict(&nothing(0.3)), GapVerdict::Unknown);
    }

    #[test]
    fn what_noise_decides_sample_by_sample_is_excused() {
        let lattice = Levels { chance: true, ..one_effect(sizes(0.5, 0.4, 0.1)) };
        assert_eq!(
            rule(&lattice, &Criteria::default()),
            Ruling { verdict: GapVerdict::Effects, unknown: 0.0, left_over: None, complete: true }
        );
    }

    #[test]
    fn an_output_that_stands_still_decides_nothing() {
        let levels = Levels {
            train: Sizes { before: vec![None], after: vec![None], floor: vec![None] },
            ..Levels::default()
        };
        assert_eq!(verdict(&levels), GapVerdict::None);
    }
}
