//! The classes of causes as an answer reports them.

use super::class_probability::{deviations, probability};
use super::found_effects::found_effects;
use crate::causes::class::EffectClass;
use crate::causes::conclusion::ActiveCauses;
use crate::causes::found::NAMED;
use crate::format::class::{CauseClass, Grounds, Member, RECALIBRATION, in_words, listed};
use crate::format::contributions::{Contribution, Recalibration, Strength};
use crate::judge::intervals::Together;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::Applied;

/// The classes: that of the verdict, then by probability; every contribution gets the probability of its class.
pub(crate) fn classes(
    likelihood: &Likelihood<'_>,
    composed: &ActiveCauses,
    contributions: &mut [Contribution],
    recalibration: &Recalibration,
) -> Vec<CauseClass> {
    let Some(hypothesis) = &composed.hypothesis else { return Vec::new() };
    let found = found_effects(likelihood, hypothesis, composed.estimate.as_ref());
    let place = |key: &str| hypothesis.effects.iter().position(|a| a.key() == key);
    let mut classes = Vec::new();
    for class in &composed.classes {
        let key = class.effect.key();
        let own = contributions.iter_mut().find(|c| format!("{}:{}", c.effect, c.channel) == key);
        let (evidence, at) = (class.evidence, place(&key));
        if let (Some(own), Some(at)) = (own, at) {
            let deviations = deviations(&hypothesis.effects[at], &found[at]);
            let share = own.share.learnt.unwrap_or(0.0);
            let grounds = Grounds { evidence, deviations, share };
            let probability = probability(&grounds);
            own.probability = Some(probability);
            classes.push(CauseClass {
                probability,
                name: in_words(&own.effect, &own.channel),
                members: members(class),
                representative: key,
                share: own.share,
                strength: own.strength,
                grounds,
            });
        } else if at.is_some_and(|at| composed.block().contains(&at)) {
            let deviations = composed
                .estimate
                .as_ref()
                .and_then(|e| e.together.as_ref())
                .map_or(0.0, Together::deviations);
            let share = recalibration.share.learnt.unwrap_or(0.0);
            let grounds = Grounds { evidence, deviations, share };
            classes.extend(recalibrated(composed, class, recalibration, grounds));
        }
    }
    let share = |c: &CauseClass| c.share.learnt.unwrap_or(0.0);
    let leads = |c: &CauseClass| {
        let first = composed.named().and_then(|named| named.effects.first().map(Applied::key));
        first.is_some_and(|first| first == c.representative)
    };
    classes.sort_by(|a, b| {
        (leads(b).cmp(&leads(a)))
            .then(b.probability.total_cmp(&a.probability))
            .then(share(b).total_cmp(&share(a)))
    });
    classes
}

/// The class of the joint recalibration.
fn recalibrated(
    composed: &ActiveCauses,
    class: &EffectClass,
    recalibration: &Recalibration,
    grounds: Grounds,
) -> Option<CauseClass> {
    let hypothesis = composed.hypothesis.as_ref()?;
    recalibration.share.learnt.is_none_or(|share| share >= NAMED).then_some(())?;
    let keys = composed.block().into_iter().map(|at| hypothesis.effects[at].key()).collect();
    let names: Vec<String> =
        recalibration.parameters.iter().map(|p| format!("`{}`", p.name)).collect();
    Some(CauseClass {
        probability: probability(&grounds),
        name: format!("other values of the parameters {}", listed(&names)),
        members: std::iter::once(Member::Several(keys)).chain(instead(class)).collect(),
        representative: RECALIBRATION.to_owned(),
        share: recalibration.share,
        strength: Strength::Clear,
        grounds,
    })
}

fn members(class: &EffectClass) -> Vec<Member> {
    std::iter::once(Member::One(class.effect.key())).chain(instead(class)).collect()
}

fn instead(class: &EffectClass) -> impl Iterator<Item = Member> {
    class.instead.iter().map(|effects| match effects.as_slice() {
        [one] => Member::One(one.key()),
        several => Member::Several(several.iter().map(Applied::key).collect()),
    })
}
