//! The probability that a contribution, or what could stand in its place, acts on the machine.
//!
//! A likelihood is of no use here: in a composition every effect is certain beyond all bounds, and what is wrong is the catalogue, not the fit. What is in no
//! catalogue is taken by a neighbour. But what is not of the machine's shape hardly settles its own numbers beside the others: of all traces that an answer bears
//! (share, held-out share, what stays, the number of effects, of parameters, of stand-ins) only how well its numbers are known told true effects from others
//! on machines left out. So it is counted how often effects whose numbers are known that well are true, and a logistic law goes through these counts.
//!
//! How it can be wrong: a machine unlike the drawn ones. So the law has two numbers, the table of another draw stands beside it (docs/results/mixtures.md), and
//! no verdict depends on it. The fit of the law counted gains from 0, where a probability counts them from their nominal value.
//!
//! Source: Platt (1999), "Probabilistic outputs for support vector machines and comparisons to regularized likelihood methods".

use crate::format::found::{FoundEffect, FoundParameter};
use deadtime_model::effect::{Applied, Parameter};

/// The law's constant, and its number by the logarithm to base 10 of how many standard deviations a parameter is from nominal; `lab/contribution_study` fitted them
/// to 44 machines of seed 20261210.
const LAW: [f64; 2] = [-0.509, 1.575];

/// The part of such lists that lack no effect and hold no stand-in for one, where all that they hold act; `lab/contribution_study` counted it on the same machines.
const COMPLETE: f64 = 0.408;

/// Below and beyond so many standard deviations no more is told.
const KNOWN: [f64; 2] = [1.0, 1000.0];

/// By the parameter that is known worst; one without an interval, at a bound, is not known. Of several that are not 0 when nominal (a gain before and after a
/// jump) the one farthest from nominal counts: the identity needs all of them. `effect` and `found` are the same effect.
pub(super) fn probability(effect: &Applied, found: &FoundEffect) -> f64 {
    let known = |(p, found): (&Parameter, &FoundParameter)| {
        let deviations = |value: f64| {
            found.std.filter(|std| *std > 0.0).map_or(0.0, |std| p.departure(value) / std)
        };
        found.value.map(|value| {
            (!p.role.is_shape() && p.nominal.is_finite() && p.nominal != 0.0, deviations(value))
        })
    };
    let all: Vec<(bool, f64)> =
        effect.parameters.iter().zip(&found.parameters).filter_map(known).collect();
    let of = |ratio: bool| all.iter().filter(move |k| k.0 == ratio).map(|k| k.1);
    let worst =
        of(true).reduce(f64::max).into_iter().chain(of(false)).fold(f64::INFINITY, f64::min);
    let sum = LAW[0] + LAW[1] * worst.clamp(KNOWN[0], KNOWN[1]).log10();
    1.0 / (1.0 + (-sum).exp())
}

/// How often a list of several effects that explains all is exactly the machine's: each of them acts, and none is missing. 1 for a single effect, which was
/// compared with every other.
pub(super) fn list(effects: &[Applied], found: &[FoundEffect]) -> f64 {
    if found.len() < 2 {
        1.0
    } else {
        COMPLETE * effects.iter().zip(found).map(|(e, f)| probability(e, f)).product::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use deadtime_model::effect::{Role, find};

    /// A parameter: its role, its nominal value, and its value with its standard deviation.
    type Known = (Role, f64, Option<f64>, Option<f64>);

    /// An effect with such parameters; which one it is called is of no matter here.
    fn effect(parameters: &[Known]) -> (Applied, FoundEffect) {
        let free = |&(role, nominal, ..): &Known| Parameter {
            name: "p".into(),
            unit: "1".into(),
            role,
            nominal,
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
        };
        let found = |&(_, _, value, std): &Known| FoundParameter {
            name: "p".into(),
            unit: "1".into(),
            value,
            std,
            ci95: None,
        };
        let (effect, channel) = (find("input_gain").unwrap(), "u".to_owned());
        let found = FoundEffect {
            effect: "input_gain".into(),
            channel: "u".into(),
            parameters: parameters.iter().map(found).collect(),
        };
        let values = parameters.iter().map(|p| p.2.unwrap_or(p.1)).collect();
        (
            Applied { effect, channel, parameters: parameters.iter().map(free).collect(), values },
            found,
        )
    }

    fn of(parameters: &[Known]) -> f64 {
        let (effect, found) = effect(parameters);
        probability(&effect, &found)
    }

    fn size(value: f64, std: f64) -> Known {
        (Role::Size, 0.0, Some(value), Some(std))
    }

    const LIMIT: Known = (Role::Limit, f64::INFINITY, None, None);

    #[test]
    fn what_is_known_worst_decides_and_a_limit_that_is_none_does_not() {
        let (well, badly) = (size(-2.0, 0.002), size(0.3, 0.1));
        assert!(of(&[well]) > of(&[badly]));
        assert_eq!(of(&[well, badly]), of(&[badly]));
        assert_eq!(of(&[well, LIMIT]), of(&[well]));
        // At a bound, no better than nothing known; a value of 0 likewise.
        let none = of(&[size(1.0, 1.0)]);
        for unknown in [(Role::Size, 0.0, Some(2.0), None), size(0.0, 0.0), size(0.0, 1.0)] {
            assert_eq!(of(&[well, unknown]), none);
        }
        // 1/(1 + exp(0.509 − 1.575·2)), by hand.
        assert!((of(&[size(10.0, 0.1)]) - 0.933454).abs() < 1e-5);
    }

    #[test]
    fn a_clock_ratio_within_its_deviation_of_one_is_as_good_as_unknown() {
        // 1/(1 + exp(0.509)), by hand.
        assert!((of(&[(Role::Size, 1.0, Some(1.0004), Some(0.0005))]) - 0.375427).abs() < 1e-5);
    }

    proptest! {
        #[test]
        fn a_ratio_counts_from_its_nominal_value_as_a_size_from_zero(
            nominal in prop_oneof![Just(1.0), 0.01..50.0, -50.0..-0.01],
            off in -20.0..20.0,
            std in 1e-3..1.0,
        ) {
            let ratio = |off: f64| (Role::Size, nominal, Some(nominal + off), Some(std));
            let apart = nominal + off - nominal;
            prop_assert!((of(&[ratio(off)]) - of(&[size(apart, std)])).abs() < 1e-12);
            // A jump from nominal is as certain as what it jumps to, in either order.
            prop_assert_eq!(of(&[ratio(0.0), ratio(off)]), of(&[ratio(off)]));
            prop_assert_eq!(of(&[ratio(off), ratio(0.0)]), of(&[ratio(off)]));
        }

        #[test]
        fn a_shape_and_a_limit_count_by_their_size(value in 0.1..20.0, std in 1e-3..1.0, nominal in 0.1..20.0) {
            for (role, nominal) in [(Role::Frequency, nominal), (Role::Shape, nominal), (Role::Damping, value), (Role::Limit, f64::INFINITY)] {
                prop_assert_eq!(of(&[(role, nominal, Some(value), Some(std))]), of(&[size(value, std)]));
            }
        }
    }

    #[test]
    fn a_list_is_less_likely_than_each_of_its_effects_and_a_single_effect_is_no_list() {
        let of = |sizes: &[f64]| {
            let (effects, found): (Vec<_>, Vec<_>) =
                sizes.iter().map(|value| effect(&[size(*value, 0.1)])).unzip();
            list(&effects, &found)
        };
        let alone = |value: f64| super::tests::of(&[size(value, 0.1)]);
        assert_eq!(of(&[0.3]), 1.0);
        let two = of(&[10.0, 0.3]);
        assert!((two - COMPLETE * alone(10.0) * alone(0.3)).abs() < 1e-12);
        assert!(of(&[10.0, 10.0]) > two && two > of(&[10.0, 0.3, 0.3]));
    }
}
