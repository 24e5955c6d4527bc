//! General forms of an effect and their special cases. Examples: jumping and fixed delays, frictions that fall with speed and constant frictions, nonlinear
//! sensors and sensors with another gain.
//!
//! Failure without a separate rule: an inexact simulator leaves a structured residual, and the general form with its additional parameters absorbs a part of
//! it. The likelihood gain then outweighs every penalty on parameters. The general form must therefore meet the rule of any further cause. It must explain a
//! part of the gap that matters, or lower the error beyond the simulator's own error. Otherwise its gain is set to that of the special case, and both are
//! reported as indistinguishable.
//!
//! The cost of this rule: a real general form is missed if it explains less than that part and lowers the error by less. The special case is then
//! named.

use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::level::Level;
use crate::hypothesis::penalised_gain::Penalties;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::Applied;

/// Limits the gain of every general form to that of its special case unless the difference matters. The rule is for a simulator that can only be called, where
/// no sets are searched.
///
/// The gain of a pair of the special case and another effect is limited as well, where the general form alone explains as much.
pub(super) fn held_back(
    likelihood: &Likelihood<'_>,
    singles: &mut [Hypothesis],
    pairs: &mut [Hypothesis],
) {
    let Some(original) = Level::of(likelihood, None) else { return };
    let penalties = Penalties::of(likelihood);
    let fitted: Vec<Hypothesis> =
        singles.iter().chain(pairs.iter()).filter(|e| e.fitted).cloned().collect();
    // The gains of the limited general forms, and their special cases.
    let mut held: Vec<(f64, &Hypothesis)> = Vec::new();
    for hypothesis in singles.iter_mut().chain(pairs.iter_mut()).filter(|e| e.fitted) {
        let plainer = plainer_keys(hypothesis);
        let best = fitted
            .iter()
            .filter(|e| plainer.contains(&e.key()))
            .max_by(|a, b| a.gain.total_cmp(&b.gain));
        let Some(plain) = best.filter(|plain| hypothesis.gain > plain.gain) else { continue };
        let levels =
            Level::of(likelihood, Some(plain)).zip(Level::of(likelihood, Some(hypothesis)));
        if levels.is_some_and(|(before, after)| !is_more(likelihood, &original, &before, &after)) {
            held.push((penalties.gain(hypothesis), plain));
            hypothesis.gain = plain.gain;
        }
    }
    for pair in pairs.iter_mut().filter(|e| e.fitted) {
        let has = |plain: &Hypothesis| {
            plain.effects.len() < pair.effects.len()
                && plain.effects.iter().all(|p| pair.effects.iter().any(|a| a.key() == p.key()))
        };
        if let Some((_, plain)) =
            held.iter().find(|(gained, plain)| has(plain) && penalties.gain(pair) <= *gained)
        {
            pair.gain = plain.gain.min(pair.gain);
        }
    }
    for hypotheses in [singles, pairs] {
        hypotheses.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    }
}

/// Keys of the hypotheses with the special case in place of a general form; where the special case is present already, without the general form.
fn plainer_keys(hypothesis: &Hypothesis) -> Vec<String> {
    let keys: Vec<String> = hypothesis.effects.iter().map(Applied::key).collect();
    let instead = |(at, plain): (usize, String)| {
        let mut others: Vec<String> =
            keys.iter().enumerate().filter(|(i, _)| *i != at).map(|(_, k)| k.clone()).collect();
        if !others.contains(&plain) {
            others.push(plain);
        }
        others.sort();
        others.join(" + ")
    };
    let elaborate = hypothesis.effects.iter().enumerate();
    // The special case may also act on all outputs, as it does where the model has one output.
    let forms = |(at, a): (usize, &Applied)| {
        a.effect.elaborates().map(|plain| [&a.channel, "*"].map(|c| (at, format!("{plain}:{c}"))))
    };
    elaborate.filter_map(forms).flatten().map(instead).collect()
}

/// The rule of a further cause: explain a part of the gap that matters, or lower the error of an output by the factor `clear`.
fn is_more(likelihood: &Likelihood<'_>, original: &Level, before: &Level, after: &Level) -> bool {
    let criteria = &likelihood.criteria;
    let taken = before.train.over(&original.train) - after.train.over(&original.train);
    taken >= criteria.added_matters || before.train.largest_fall(&after.train) > criteria.clear
}
