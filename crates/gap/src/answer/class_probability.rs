//! The probability that a member of a class acts on the machine, calibrated on drawn machines.
//!
//! A posterior over sets alone is no such probability. Given hundreds of samples, every member of the best set has a posterior near 1; the incomplete catalogue is the source of error.
//! A logistic law (Platt 1999) therefore maps the evidence on a class to the frequency with which such classes act on drawn machines.
//! Its inputs are the evidence for the class, the distance of its parameters from nominal in standard deviations, and its share of the gap.
//! The residual above the noise adds no information on the drawn machines.
//!
//! How it can be wrong: a machine unlike the drawn ones.

use crate::format::class::Grounds;
use crate::format::found::{FoundEffect, FoundParameter};
use deadtime_model::effect::{Applied, Parameter, Role};

/// The constant, and the weights of the logarithms to base 10 of evidence, deviations and share; `scripts/bank law` fits them to the
/// development bank.
const LAW: [f64; 4] = [-0.473, 0.396, 1.554, 0.486];
/// Beyond these the logarithms stay.
const EVIDENCE: [f64; 2] = [1.0, 1e4];
const DEVIATIONS: [f64; 2] = [1.0, 1e3];
const SHARE: [f64; 2] = [1e-3, 1.0];

/// The calibrated probability of a class.
pub(super) fn probability(grounds: &Grounds) -> f64 {
    let Grounds { evidence, deviations, share } = *grounds;
    let shown = [(evidence, EVIDENCE), (deviations, DEVIATIONS), (share, SHARE)];
    let of = |(value, [least, most]): (f64, [f64; 2])| value.clamp(least, most).log10();
    let weighted = LAW[1..].iter().zip(shown).map(|(weight, one)| weight * of(one));
    let sum = LAW[0] + weighted.sum::<f64>();
    1.0 / (1.0 + (-sum).exp())
}

/// The distance of the worst known parameter from its nominal value, in standard deviations. A parameter without an interval, at a bound, is not known. Some
/// effects have several parameters that are not 0 when nominal (a gain before and after a jump). The one farthest from nominal is used: the identity needs all
/// of them. Instants and phases have an arbitrary origin, and no distance from it. `effect` and `found` are the same effect.
pub(super) fn deviations(effect: &Applied, found: &FoundEffect) -> f64 {
    let known = |(p, found): (&Parameter, &FoundParameter)| {
        if matches!(p.role, Role::Instant | Role::Phase) {
            return None;
        }
        let away = |value: f64| {
            found.std.filter(|std| *std > 0.0).map_or(0.0, |std| p.departure(value) / std)
        };
        found.value.map(|value| {
            (!p.role.is_shape() && p.nominal.is_finite() && p.nominal != 0.0, away(value))
        })
    };
    let all: Vec<(bool, f64)> =
        effect.parameters.iter().zip(&found.parameters).filter_map(known).collect();
    let of = |ratio: bool| all.iter().filter(move |k| k.0 == ratio).map(|k| k.1);
    of(true).reduce(f64::max).into_iter().chain(of(false)).fold(DEVIATIONS[1], f64::min)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use deadtime_model::effect::find;

    /// A parameter: its role, its nominal value, and its value with its standard deviation.
    type Known = (Role, f64, Option<f64>, Option<f64>);

    fn of(parameters: &[Known]) -> f64 {
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
        let parameters = parameters.iter().map(free).collect();
        deviations(&Applied { effect, channel, parameters, values }, &found)
    }

    fn size(value: f64, std: f64) -> Known {
        (Role::Size, 0.0, Some(value), Some(std))
    }

    #[test]
    fn the_worst_known_parameter_decides_and_an_absent_limit_does_not() {
        let (well, badly) = (size(-2.0, 0.002), size(0.3, 0.1));
        assert!((of(&[well]) - 1000.0).abs() < 1e-9);
        assert_eq!(of(&[well, badly]), of(&[badly]));
        assert_eq!(of(&[well, (Role::Limit, f64::INFINITY, None, None)]), of(&[well]));
        assert_eq!(of(&[well, (Role::Size, 0.0, Some(2.0), None)]), 0.0);
        // The time of a jump that may lie anywhere between two commands is no doubt about the jump.
        assert_eq!(of(&[well, (Role::Instant, 0.0, Some(5.2), Some(6e4))]), of(&[well]));
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
            prop_assert!((of(&[ratio(off)]) - of(&[size(apart, std)])).abs() < 1e-9);
            // A jump from nominal is as certain as its other value, in either order.
            prop_assert_eq!(of(&[ratio(0.0), ratio(off)]), of(&[ratio(off)]));
        }

        #[test]
        fn more_evidence_and_a_better_known_parameter_are_never_less_probable(
            evidence in 0.0..1e5,
            deviations in 0.0..1e5,
            share in 0.0..1.0,
            more in 1.0..100.0,
        ) {
            let grounds = Grounds { evidence, deviations, share };
            let p = probability(&grounds);
            let of = |grounds: Grounds| probability(&grounds);
            let [evident, known, large] = [
                of(Grounds { evidence: evidence * more, ..grounds }),
                of(Grounds { deviations: deviations * more, ..grounds }),
                of(Grounds { share: share * more, ..grounds }),
            ];
            prop_assert!(evident >= p && known >= p && large >= p);
        }
    }
}
