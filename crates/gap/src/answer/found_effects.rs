//! Effects with their parameters and intervals in the form of a diagnosis.

use crate::format::found::{FoundEffect, FoundParameter};
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::shared_time::is_same;
use crate::judge::intervals::Estimate;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::Role;
use deadtime_signal::stats::interval95;

/// Relative standard deviation of a lattice's step: the rounding of numbers in a log.
const LATTICE: f64 = 1e-6;

/// The effects of a hypothesis; `estimate` belongs to it.
pub(crate) fn found_effects(
    likelihood: &Likelihood<'_>,
    hypothesis: &Hypothesis,
    estimate: Option<&Estimate>,
) -> Vec<FoundEffect> {
    let longest_s =
        likelihood.records.iter().filter_map(|r| r.time_s.last()).fold(0.0, |a: f64, b| a.max(*b));
    let parameter = |e: usize, i: usize| {
        let applied = &hypothesis.effects[e];
        let fitted = |at: &(usize, usize)| is_same(&hypothesis.effects, *at, (e, i));
        let place = hypothesis.free.iter().position(fitted);
        let std = match (&hypothesis.lost, place) {
            (Some(lost), None) if applied.effect.loses_commands() => {
                let input = likelihood.system.inputs.iter().position(|p| p.name == applied.channel);
                input.and_then(|input| lost.std[input].get(i).copied())
            }
            (_, None) if applied.effect.leaves_residual() => Some(LATTICE * applied.values[i]),
            _ => estimate
                .zip(place)
                .and_then(|(estimate, at)| estimate.std[at])
                .filter(|std| std.is_finite()),
        };
        let (value, own) = (applied.values[i], &applied.parameters[i]);
        // No interval reaches beyond what physics allows, or a time beyond the logs.
        let upper = if own.role == Role::Instant { longest_s.min(own.upper) } else { own.upper };
        let [least, most] = [own.lower.min(value), upper.max(value)];
        FoundParameter {
            name: own.name.to_string(),
            unit: own.unit.clone(),
            value: value.is_finite().then_some(value),
            std,
            ci95: std.map(|s| interval95(value, s).map(|end| end.clamp(least, most))),
        }
    };
    (hypothesis.effects.iter().enumerate())
        .map(|(e, applied)| FoundEffect {
            effect: applied.effect.name().to_owned(),
            channel: applied.channel.clone(),
            parameters: (0..applied.values.len()).map(|i| parameter(e, i)).collect(),
        })
        .collect()
}
