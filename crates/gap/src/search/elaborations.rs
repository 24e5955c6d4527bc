//! More elaborate forms of a plain effect: a delay that jumps beside one that stands still, a friction that falls with speed beside one that does not, a sensor
//! that is bent beside one of another gain.
//!
//! How it goes wrong without a rule of its own: a simulator that is a little off leaves a residual of its own shape, and the form with more numbers takes some
//! of it with a likelihood that no penalty on numbers outweighs. So the elaborate form must do what any further cause must: take a part of the gap that
//! matters, or lower the error so far that no simulator's own error explains it. Else it gains what the plain form does, and is told as hardly told apart from it.
//!
//! What this gives away: an elaboration that is real, takes less than that part of the gap, and lowers the error by less. The plain form is named then.

use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::level::Level;
use crate::hypothesis::penalised_gain::Penalties;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::Applied;

/// Lets no elaborate form gain more than its plain one unless that matters: of a simulator that can only be called, where no sets are searched.
///
/// Nor does the plain form beside something else gain more, where the elaborate form alone explains as well: what did not matter as one effect is no second one.
pub(super) fn held_back(
    likelihood: &Likelihood<'_>,
    singles: &mut [Hypothesis],
    pairs: &mut [Hypothesis],
) {
    let Some(original) = Level::of(likelihood, None) else { return };
    let penalties = Penalties::of(likelihood);
    let fitted: Vec<Hypothesis> =
        singles.iter().chain(pairs.iter()).filter(|e| e.fitted).cloned().collect();
    // What those held back gained, and their plain forms.
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

/// Keys of the hypotheses that have the plain form in the place of an elaborate one; where the plain form stands beside it already, without the elaborate one.
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
    // The plain form may also act on all outputs; it does where there is but one.
    let forms = |(at, a): (usize, &Applied)| {
        a.effect.elaborates().map(|plain| [&a.channel, "*"].map(|c| (at, format!("{plain}:{c}"))))
    };
    elaborate.filter_map(forms).flatten().map(instead).collect()
}

/// What a further cause must do: take a part of the gap that matters, or lower the error of an output by the factor `clear`.
fn is_more(likelihood: &Likelihood<'_>, original: &Level, before: &Level, after: &Level) -> bool {
    let criteria = &likelihood.criteria;
    let taken = before.train.over(&original.train) - after.train.over(&original.train);
    taken >= criteria.added_matters || before.train.largest_fall(&after.train) > criteria.clear
}
