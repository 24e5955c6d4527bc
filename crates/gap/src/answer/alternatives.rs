//! What the data cannot tell from what was found.

use crate::hypothesis::direction::difference;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::penalised_gain::Penalties;
use crate::likelihood::gaussian::Likelihood;
use crate::search::catalogue_search::SearchResult;
use deadtime_model::effect::Applied;

/// For every effect of the leader: itself and all that could stand in its place with a likelihood and trajectories as good; classes of one are left out.
/// `inexact` is what the simulator is seen to be off by beside the leader: smaller differences say nothing.
pub(crate) fn classes(
    likelihood: &Likelihood<'_>,
    leader: &Hypothesis,
    found: &SearchResult,
    inexact: f64,
) -> Vec<Vec<Applied>> {
    let Some(own) = likelihood.whitened(leader) else { return Vec::new() };
    let mut classes: Vec<Vec<Applied>> = leader.effects.iter().map(|a| vec![a.clone()]).collect();
    let same_size = if leader.effects.len() == 1 { &found.singles } else { &found.pairs };
    let slack = Penalties::of(likelihood).slack(leader.gain).max(inexact);
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
            classes[place].push(rival.effects[other].clone());
        }
    }
    classes.retain(|class| class.len() > 1);
    classes
}
