//! The alias classes of individually fitted effects, where no sets are searched: for a simulator that can only be called, and for a lattice.

use super::class::EffectClass;
use crate::hypothesis::direction::difference;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::penalised_gain::Penalties;
use crate::likelihood::gaussian::Likelihood;
use crate::search::catalogue_search::SearchResult;
use deadtime_model::effect::Applied;

/// For every effect of the leader: all candidates that could replace it with an equal likelihood and equal trajectories. `inexact` is the simulator's own error
/// given the leader; smaller differences are no evidence.
pub(super) fn classes(
    likelihood: &Likelihood<'_>,
    leader: &Hypothesis,
    found: &SearchResult,
    inexact: f64,
) -> Vec<EffectClass> {
    let penalties = Penalties::of(likelihood);
    let begin = |a: &Applied| EffectClass { effect: a.clone(), instead: Vec::new(), evidence: 0.0 };
    let mut classes: Vec<EffectClass> = leader.effects.iter().map(begin).collect();
    let Some(own) = likelihood.whitened(leader) else { return classes };
    let same_size = if leader.effects.len() == 1 { &found.singles } else { &found.pairs };
    let slack = penalties.slack(leader.gain).max(inexact);
    for rival in same_size.iter().filter(|r| r.fitted && (r.gain - leader.gain).abs() < slack) {
        let missing = |of: &Hypothesis, from: &Hypothesis| {
            let keys: Vec<String> = from.effects.iter().map(Applied::key).collect();
            (0..of.effects.len())
                .filter(|&i| !keys.contains(&of.effects[i].key()))
                .collect::<Vec<_>>()
        };
        let (&[place], &[other]) =
            (missing(leader, rival).as_slice(), missing(rival, leader).as_slice())
        else {
            continue;
        };
        let Some(theirs) = likelihood.whitened(rival) else { continue };
        let apart = difference(&own, &theirs, 1.0);
        if likelihood.inner(&apart, &apart) < 2.0 * slack {
            classes[place].instead.push(vec![rival.effects[other].clone()]);
        }
    }
    for class in &mut classes {
        let members: Vec<String> =
            class.aliases().chain([&class.effect]).map(Applied::key).collect();
        let lacks = |e: &&Hypothesis| e.effects.iter().all(|a| !members.contains(&a.key()));
        let all = found.singles.iter().chain(&found.pairs).filter(|e| e.fitted);
        let next = all.filter(lacks).map(|e| penalties.gain(e)).fold(0.0, f64::max);
        class.evidence = (penalties.gain(leader) - next).max(0.0);
    }
    classes
}
