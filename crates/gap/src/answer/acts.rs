//! The probability that a contribution, or what could stand in its place, acts on the machine.
//!
//! A likelihood is of no use here: in a composition every effect is certain beyond all bounds, and what is wrong is the catalogue, not the fit. What is in no
//! catalogue is taken by a neighbour. But what is not of the machine's shape hardly settles its own numbers beside the others: of all traces that an answer bears
//! (share, held-out share, what stays, the number of effects, of parameters, of stand-ins) only how well its numbers are known told true effects from others
//! on machines left out. So it is counted how often effects whose numbers are known that well are true, and a logistic law goes through these counts.
//!
//! How it can be wrong: a machine unlike the drawn ones. So the law has two numbers, the table of another draw stands beside it (docs/results/mixtures.md), and
//! no verdict depends on it. How well numbers are known counts from 0, for gains too.
//!
//! Source: Platt (1999), "Probabilistic outputs for support vector machines and comparisons to regularized likelihood methods".

use crate::format::found::{FoundEffect, FoundParameter};

/// The law's constant, and its number by the logarithm to base 10 of how many standard deviations a parameter is from 0; `scripts/contribution_study` fitted them
/// to 44 machines of seed 20261210.
const LAW: [f64; 2] = [-0.509, 1.575];

/// The part of such lists that lack no effect and hold no stand-in for one, where all that they hold act; `scripts/contribution_study` counted it on the same machines.
const COMPLETE: f64 = 0.408;

/// Below and beyond so many standard deviations no more is told.
const KNOWN: [f64; 2] = [1.0, 1000.0];

/// By the parameter that is known worst; one without an interval, at a bound, is not known.
pub(super) fn probability(parameters: &[FoundParameter]) -> f64 {
    let known = |p: &FoundParameter| p.value.map(|value| p.std.filter(|std| *std > 0.0).map_or(0.0, |std| value.abs() / std));
    let worst = parameters.iter().filter_map(known).fold(f64::INFINITY, f64::min);
    let sum = LAW[0] + LAW[1] * worst.clamp(KNOWN[0], KNOWN[1]).log10();
    1.0 / (1.0 + (-sum).exp())
}

/// How often a list of several effects that explains all is exactly the machine's: each of them acts, and none is missing. 1 for a single effect, which was
/// compared with every other.
pub(super) fn list(effects: &[FoundEffect]) -> f64 {
    if effects.len() < 2 { 1.0 } else { COMPLETE * effects.iter().map(|e| probability(&e.parameters)).product::<f64>() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameter(value: Option<f64>, std: Option<f64>) -> FoundParameter {
        FoundParameter { name: "p".into(), unit: "1".into(), value, std, ci95: None }
    }

    #[test]
    fn what_is_known_worst_decides_and_a_limit_that_is_none_does_not() {
        let of = probability;
        let one = std::slice::from_ref::<FoundParameter>;
        let (well, badly) = (parameter(Some(-2.0), Some(0.002)), parameter(Some(0.3), Some(0.1)));
        assert!(of(one(&well)) > of(one(&badly)));
        assert_eq!(of(&[well.clone(), badly.clone()]), of(&[badly]));
        assert_eq!(of(&[well.clone(), parameter(None, None)]), of(one(&well)));
        // At a bound, no better than nothing known; a value of 0 likewise.
        let none = of(&[parameter(Some(1.0), Some(1.0))]);
        for unknown in [parameter(Some(2.0), None), parameter(Some(0.0), Some(0.0)), parameter(Some(0.0), Some(1.0))] {
            assert_eq!(of(&[well.clone(), unknown]), none);
        }
        // 1/(1 + exp(0.509 − 1.575·2)), by hand.
        assert!((of(&[parameter(Some(10.0), Some(0.1))]) - 0.933454).abs() < 1e-5);
    }

    #[test]
    fn a_list_is_less_likely_than_each_of_its_effects_and_a_single_effect_is_no_list() {
        let effect =
            |value: f64| FoundEffect { effect: "e".into(), channel: "c".into(), parameters: vec![parameter(Some(value), Some(0.1))] };
        let (sure, doubtful) = (effect(10.0), effect(0.3));
        assert_eq!(list(std::slice::from_ref(&doubtful)), 1.0);
        let two = list(&[sure.clone(), doubtful.clone()]);
        assert!((two - COMPLETE * probability(&sure.parameters) * probability(&doubtful.parameters)).abs() < 1e-12);
        assert!(list(&[sure.clone(), sure.clone()]) > two && two > list(&[sure, doubtful.clone(), doubtful]));
    }
}
