//! Pairs of effects: for each leading single, the second effects with the largest predicted cost reduction, refitted together; then forward and backward.

use super::given_first::GivenFirst;
use super::screen::Screened;
use crate::hypothesis::direction::{NEAR, between, difference, has_limit, with};
use crate::hypothesis::dropouts::decoded;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::penalised_gain::Penalties;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use deadtime_model::effect::{Applied, Lateness, Scales, row};
use deadtime_signal::parallel;

/// The first effects that pairs are built on: the best, and the best of one parameter, each kind of effect once.
fn firsts<'h>(
    singles: &'h [Hypothesis],
    penalties: &Penalties,
    [any, plain]: [usize; 2],
) -> Vec<&'h Hypothesis> {
    let mut order: Vec<&Hypothesis> = singles.iter().filter(|e| e.fitted).collect();
    order.sort_by(|a, b| penalties.gain(b).total_cmp(&penalties.gain(a)));
    let mut chosen: Vec<&Hypothesis> = Vec::new();
    for (count, plain) in [(any, false), (plain, true)] {
        let full = chosen.len() + count;
        for single in &order {
            let known = chosen
                .iter()
                .any(|c| c.effects[0].effect.name() == single.effects[0].effect.name());
            if chosen.len() < full && !known && (!plain || single.free.len() == 1) {
                chosen.push(single);
            }
        }
    }
    chosen
}

/// Pairs: for each leading single, the second effects with the largest predicted cost reduction, refitted together. `remedies`: effects that the checks
/// propose, at the proposed values. Such an effect is a first effect without a separate fit. A gain of −1 fitted alone tends to 0 where a delay is also missing.
pub(crate) fn pairs(
    likelihood: &Likelihood<'_>,
    singles: &[Hypothesis],
    remedies: &[Applied],
    pool: &[Screened],
    scales: &Scales,
    nominal: &Whitened,
) -> Vec<Hypothesis> {
    let penalties = Penalties::of(likelihood);
    let as_first =
        |r: &Applied| Hypothesis { free: vec![(0, 0)], ..Hypothesis::screened(r.clone(), 0.0) };
    let asked_for: Vec<Hypothesis> = remedies.iter().map(as_first).collect();
    let leading = firsts(singles, &penalties, likelihood.budget.firsts).into_iter().cloned();
    let firsts: Vec<Hypothesis> =
        leading.filter(|single| asked_for.iter().all(|r| r.key() != single.key())).collect();
    // A latent sequence absorbs a little of everything: the residual given the sequence carries no evidence for the others.
    let plain = firsts.iter().find(|first| !first.loses_commands());
    let mut asked = firsts.first().filter(|best| best.loses_commands()).into_iter().chain(plain);
    if asked_for.is_empty()
        && !asked.any(|first| has_second_candidate(likelihood, first, pool, scales, nominal))
    {
        return Vec::new();
    }
    let firsts = [asked_for, firsts].concat();
    let mut pairs = with_seconds(likelihood, &firsts, pool, scales, nominal, &[]);
    // Forward and backward: what only a second effect made visible takes the first place.
    let mut kept: Vec<Hypothesis> = Vec::new();
    for (pair, place) in pairs
        .iter()
        .take(likelihood.budget.swapped)
        .flat_map(|pair| (0..pair.effects.len()).map(move |place| (pair, place)))
    {
        let single = pair.only(place);
        if !single.loses_commands() && firsts.iter().chain(&kept).all(|f| f.key() != single.key()) {
            kept.push(single);
        }
    }
    let more = with_seconds(likelihood, &kept, pool, scales, nominal, &pairs);
    pairs.extend(more);
    pairs.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    pairs
}

/// Some candidate has a predicted reduction of the required part of a single effect's residual.
fn has_second_candidate(
    likelihood: &Likelihood<'_>,
    single: &Hypothesis,
    pool: &[Screened],
    scales: &Scales,
    nominal: &Whitened,
) -> bool {
    let Some(given) = GivenFirst::new(likelihood, single, scales) else { return false };
    let is_candidate = |screened: &Screened| {
        // A lattice in raw values need not promise anything.
        let traced = screened.applied.effect.leaves_residual() && !screened.starts.is_empty();
        let own = given.first.effects.iter().any(|e| e.key() == screened.applied.key());
        let starts = likelihood.first_guesses(&screened.applied, scales);
        let every = starts.len().div_ceil(likelihood.budget.glances).max(1);
        let glance = |start: Vec<f64>| {
            // The start itself is known already where anything else is a call.
            let share = if has_limit(&screened.applied) || likelihood.calls(&screened.applied) {
                1.0
            } else {
                0.5
            };
            let there = likelihood
                .whitened(&[with(&screened.applied, &between(&screened.applied, &start, share))]);
            there.is_some_and(|there| {
                given.predicted_reduction(likelihood, &difference(nominal, &there, 1.0))
                    > likelihood
                        .criteria
                        .selection_penalty
                        .max(likelihood.criteria.promising * given.cost)
            })
        };
        !own && (traced || starts.into_iter().step_by(every).any(glance))
    };
    parallel::any(pool, is_candidate)
}

/// The second effects with the largest predicted cost reduction given each first, fitted jointly with it; known pairs are left out.
fn with_seconds(
    likelihood: &Likelihood<'_>,
    firsts: &[Hypothesis],
    pool: &[Screened],
    scales: &Scales,
    nominal: &Whitened,
    known: &[Hypothesis],
) -> Vec<Hypothesis> {
    let given: Vec<GivenFirst> =
        parallel::filter_map(firsts.iter(), |first| GivenFirst::new(likelihood, first, scales));
    if given.is_empty() {
        return Vec::new();
    }
    let reductions = reductions(likelihood, &given, pool, scales, nominal);
    let wanted = wanted(likelihood, &given, &reductions, pool, known);
    fitted(likelihood, wanted, scales, likelihood.inner(nominal, nominal))
}

/// The predicted cost reduction of a second effect given a first, and the start that gave it.
type Reduction = (f64, Applied);

/// The predicted cost reductions of every candidate of the pool given every first.
fn reductions(
    likelihood: &Likelihood<'_>,
    given: &[GivenFirst],
    pool: &[Screened],
    scales: &Scales,
    nominal: &Whitened,
) -> Vec<Vec<Reduction>> {
    let of = |screened: &Screened| {
        let applied = &screened.applied;
        let starts = likelihood.first_guesses(applied, scales);
        let first = starts.first().map_or_else(|| applied.clone(), |start| with(applied, start));
        let mut best: Vec<Reduction> = given.iter().map(|_| (0.0, first.clone())).collect();
        let whole = has_limit(applied) || likelihood.calls(applied) || screened.proportional;
        for start in starts {
            for share in if whole { &[1.0][..] } else { &[NEAR, 1.0] } {
                let moved = with(applied, &between(applied, &start, *share));
                let Some(there) = likelihood.whitened(std::slice::from_ref(&moved)) else {
                    continue;
                };
                let signature = difference(nominal, &there, 1.0);
                for (best, given) in best.iter_mut().zip(given) {
                    // A remedy of a wrong sign reverses the others' signatures, too.
                    let together = || {
                        let effects: Vec<Applied> =
                            given.first.effects.iter().cloned().chain([moved.clone()]).collect();
                        likelihood
                            .whitened(&effects)
                            .map(|there| difference(&given.residual, &there, 1.0))
                    };
                    let joint = if given.first.fitted { None } else { together() };
                    let reduction =
                        given.predicted_reduction(likelihood, joint.as_ref().unwrap_or(&signature));
                    if reduction > best.0 {
                        *best = (reduction, with(applied, &start));
                    }
                }
            }
        }
        best
    };
    parallel::map(pool.iter(), of)
}

/// The pairs that are worth a fit, each once: of every first the seconds that promise most.
fn wanted(
    likelihood: &Likelihood<'_>,
    given: &[GivenFirst],
    reductions: &[Vec<Reduction>],
    pool: &[Screened],
    known: &[Hypothesis],
) -> Vec<Vec<Applied>> {
    let traces: Vec<String> = (pool.iter())
        .filter(|s| s.applied.effect.leaves_residual() && !s.starts.is_empty())
        .map(|s| s.applied.key())
        .collect();
    let keys = |effects: &[Applied]| effects.iter().map(Applied::key).collect::<Vec<_>>();
    let mut wanted: Vec<Vec<Applied>> = Vec::new();
    for (at, given) in given.iter().enumerate() {
        let least =
            likelihood.criteria.selection_penalty.max(likelihood.criteria.promising * given.cost);
        let mut seconds: Vec<&Reduction> =
            reductions.iter().map(|p| &p[at]).filter(|(gain, _)| *gain > least).collect();
        seconds.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (losing, seconds): (Vec<_>, Vec<_>) = seconds
            .into_iter()
            .filter(|(_, s)| given.first.effects.iter().all(|f| f.key() != s.key()))
            .partition(|(_, s)| s.effect.loses_commands());
        // A lattice in the raw values is a fact without a predicted reduction.
        let traced = reductions
            .iter()
            .map(|p| &p[at])
            .filter(|(_, s)| s.effect.leaves_residual() && traces.contains(&s.key()));
        let special = losing.into_iter().chain(traced).take(if at < likelihood.budget.losing {
            likelihood.budget.plain.seconds
        } else {
            0
        });
        // Each kind has a quota: candidates that cost calls start from coarser guesses, and their predicted reductions are too small.
        let (mut called, mut others) = (0, 0);
        let seconds = seconds.into_iter().filter(|(_, second)| {
            let count = if likelihood.calls(second) { &mut called } else { &mut others };
            *count += 1;
            *count <= likelihood.allowance(second).seconds
        });
        for (_, second) in seconds.chain(special) {
            let mut pair: Vec<Applied> =
                given.first.effects.iter().chain([second]).cloned().collect();
            if pair.iter().filter(|a| a.effect.loses_commands()).count() > 1
                || pair[0].key() == pair[1].key()
            {
                continue;
            }
            // Delays of single commands take a little of all that a second effect could explain.
            if pair.iter().any(|a| a.effect.lateness() == Some(Lateness::Random)) {
                continue;
            }
            pair.sort_by_key(|a| row(a.effect));
            if wanted
                .iter()
                .chain(known.iter().map(|k| &k.effects))
                .all(|known| keys(known) != keys(&pair))
            {
                wanted.push(pair);
            }
        }
    }
    wanted
}

/// Pairs after a few steps each, the best of them to the end; those that lose commands with their sequences.
fn fitted(
    likelihood: &Likelihood<'_>,
    wanted: Vec<Vec<Applied>>,
    scales: &Scales,
    cost: f64,
) -> Vec<Hypothesis> {
    let budget = likelihood.budget;
    // Lost commands are distinguishable from a lag by their sequence only.
    let (losing, plain): (Vec<_>, Vec<_>) =
        wanted.into_iter().partition(|pair| pair.iter().any(|a| a.effect.loses_commands()));
    let mut pairs: Vec<Hypothesis> = parallel::filter_map(plain.iter(), |pair| {
        Hypothesis::fit(likelihood, pair, scales, cost, budget.trial_steps)
    });
    pairs.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let (mut called, mut others) = (0, 0);
    pairs.retain(|pair| {
        let calls = pair.effects.iter().any(|a| likelihood.calls(a));
        let (count, most) = if calls {
            (&mut called, budget.called.pairs)
        } else {
            (&mut others, budget.plain.pairs)
        };
        *count += 1;
        *count <= most
    });
    parallel::for_each(&mut pairs, |pair| {
        if let Some(better) = Hypothesis::fit(likelihood, &pair.effects, scales, cost, budget.steps)
        {
            *pair = better;
        }
    });
    // These come fitted to the end, each with its sequence.
    let decode = |pair: &Vec<Applied>| {
        let begin = Hypothesis {
            effects: pair.clone(),
            free: Vec::new(),
            gain: 0.0,
            fitted: false,
            lost: None,
        };
        decoded(likelihood, begin, scales, cost, budget.steps)
    };
    pairs.extend(parallel::filter_map(losing.iter(), decode));
    pairs.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::likelihood::active_effects::NO_EFFECT;
    use crate::likelihood::servo::{nominal, with_servo};
    use crate::search::screen::screen;
    use crate::search::singles::fit_first;

    /// The sequence of losses must survive the last fit of a pair. The mean of all sequences explains far less than the pair does.
    #[test]
    fn a_pair_keeps_the_lost_commands_that_were_found_for_it() {
        with_servo(
            &[("dropped_commands", "u", &[0.3, f64::INFINITY]), ("sensor_bias", "angle", &[0.3])],
            |likelihood, scales| {
                let candidates =
                    [("dropped_commands", "u"), ("sensor_bias", "angle"), ("input_delay", "u")];
                let candidates = candidates
                    .map(|(effect, channel)| nominal(likelihood.system, effect, channel))
                    .to_vec();
                let whitened = likelihood.whitened(NO_EFFECT).unwrap();
                let pool = screen(likelihood, candidates, scales, &whitened);
                let singles = fit_first(likelihood, &pool, scales, &whitened);
                let pairs = pairs(likelihood, &singles, &[], &pool, scales, &whitened);

                let pair = pairs
                    .iter()
                    .find(|p| p.key() == "dropped_commands:u + sensor_bias:angle")
                    .unwrap();
                let cost = likelihood.inner(&whitened, &whitened);
                let by_mean = Hypothesis::fit(
                    likelihood,
                    &pair.effects,
                    scales,
                    cost,
                    likelihood.budget.steps,
                )
                .unwrap();
                assert!(pair.lost.is_some());
                assert!(
                    pair.gain > by_mean.gain + 1000.0,
                    "{} with its sequence, {} without",
                    pair.gain,
                    by_mean.gain
                );
                assert_eq!(pairs[0].key(), pair.key());
            },
        );
    }
}
