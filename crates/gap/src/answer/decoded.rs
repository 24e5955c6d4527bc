//! Lost and late commands of the held-out data, decoded from the held-out outputs, like the initial states.

use super::held_out::HeldOut;
use crate::causes::conclusion::ActiveCauses;
use crate::hypothesis::dropouts::decoded;
use crate::hypothesis::effects::Hypothesis;
use crate::likelihood::active_effects::NO_EFFECT;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::Scales;

/// The causes with the sequences of all logs; those of training logs without a held-out part stay.
pub(super) fn of_all_logs(
    mut causes: ActiveCauses,
    likelihood: &Likelihood<'_>,
    held_out: &HeldOut,
    scales: &Scales,
) -> ActiveCauses {
    let Some(found) = causes.hypothesis.clone().filter(|e| e.lost.is_some()) else { return causes };
    let again = likelihood
        .whitened(NO_EFFECT)
        .map(|w| likelihood.inner(&w, &w))
        .and_then(|cost| decoded(likelihood, found, scales, cost, likelihood.budget.steps));
    let Some(again) = again.and_then(|e| e.lost) else { return causes };
    let known = |hypothesis: &mut Hypothesis| {
        let Some(lost) = &mut hypothesis.lost else { return };
        let own = std::mem::replace(&mut lost.sequences, again.sequences.clone());
        for (at, sequence) in own.into_iter().enumerate() {
            if held_out.span(at).is_none() {
                lost.sequences[at] = sequence;
            }
        }
    };
    causes.hypothesis.iter_mut().for_each(known);
    causes.taken_out.iter_mut().for_each(known);
    causes.without.iter_mut().flatten().for_each(known);
    causes.judged.found.iter_mut().chain(&mut causes.judged.best).for_each(known);
    causes
}
