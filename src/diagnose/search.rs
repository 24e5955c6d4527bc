//! The search through the catalogue: candidates screened, the promising ones fitted in full, pairs built on them, all compared under one noise model.

use rayon::prelude::*;

use super::explanation::{Explanation, with};
use super::lost::decoded;
use super::noise::Noise;
use super::pairs::pairs;
use super::problem::{Acting, NOTHING, Problem, Whitened};
use super::progress::Stage;
use super::rank::{SEARCH_WIDE, odds};
use super::screen::{Screened, screen};
use super::shrink::residuals;
use crate::effect::{Applied, Scales, Site};

/// Candidates that are fitted in full after the screen.
const FITTED: usize = 25;
/// Explanations of each size that are fitted again once the noise is known.
const LEADERS: usize = 8;
/// The same where each is calls of a black box.
const CALLED_LEADERS: usize = 4;
/// How often the noise model is renewed from the leading explanation.
const ROUNDS: usize = 2;
/// The same where each is calls of a black box; and what such a one must gain at its start to be worth them.
const CALLED_FITTED: usize = 10;
const CALLED_FROM: f64 = 0.2 * SEARCH_WIDE;
/// Starts of one candidate that are fitted.
const STARTS: usize = 2;
/// Candidates whose fit goes on after the first few steps.
const ON: usize = 10;
/// The part of the best gain from which lost commands are looked for again under another noise.
const AGAIN: f64 = 0.8;
/// Steps of a full fit, and of a fit that starts where another ended.
pub(super) const STEPS: usize = 15;
/// Steps after which all but the best pairs are given up, and how many are left then.
pub(super) const TRIAL: (usize, usize) = (3, 8);

/// What a search found, best first.
pub(super) struct Found {
    /// Single effects: those fitted, then the rest of the catalogue as screened.
    pub(super) singles: Vec<Explanation>,
    pub(super) pairs: Vec<Explanation>,
}

/// Searches the whole catalogue; leaves `problem` with the noise of the largest explanation in play.
pub(super) fn search(
    problem: &mut Problem<'_>,
    catalogue: Vec<Applied>,
    scales: &Scales,
    smallest: &[f64],
    progress: &dyn Fn(Stage),
) -> Option<Found> {
    let nominal = problem.whitened(NOTHING)?;
    progress(Stage::Screening(catalogue.len()));
    let pool = screen(problem, catalogue, scales, &nominal);
    progress(Stage::Fitting);
    let mut found = Found { singles: fit_first(problem, &pool, scales, &nominal), pairs: Vec::new() };
    progress(Stage::Pairing);
    found.pairs = pairs(problem, &found.singles, &pool, scales, &nominal);
    members_alone(problem, &mut found, scales, &nominal);
    for explanations in [&mut found.singles, &mut found.pairs] {
        give_up_what_breaks(problem, explanations, usize::MAX);
    }
    for round in 0..ROUNDS {
        progress(Stage::Refitting(round));
        let weight = problem.weight();
        let leading =
            |all: &[Explanation]| all.iter().filter(|e| e.fitted).max_by(|a, b| odds(a, weight).total_cmp(&odds(b, weight))).cloned();
        let single = leading(&found.singles);
        let pair = leading(&found.pairs).filter(|pair| single.as_ref().is_none_or(|s| odds(pair, weight) > odds(s, weight)));
        let largest = pair.or(single);
        let Some(noise) = noise_of(problem, largest.as_ref().map_or(NOTHING, Acting::from), smallest) else { break };
        problem.set_noise(noise);
        let nominal = problem.whitened(NOTHING)?;
        let cost = problem.inner(&nominal, &nominal);
        for explanations in [&mut found.singles, &mut found.pairs] {
            explanations.par_iter_mut().for_each(|e| e.rescore(problem, cost));
            explanations.sort_by(|a, b| b.gain.total_cmp(&a.gain));
            let steps = if round + 1 < ROUNDS { STEPS } else { STEPS / 2 };
            let best = explanations.first().map_or(0.0, |e| e.gain);
            let leaders = frugal(problem, explanations.iter().take(LEADERS).map(|e| e.effects.as_slice()), CALLED_LEADERS);
            explanations.par_iter_mut().zip(leaders).filter(|(e, leads)| *leads && e.gain.is_finite()).for_each(|(e, _)| {
                // A sequence that explains much less than the best explanation is not worth another search.
                let again = e.lost.is_none() || e.gain > AGAIN * best;
                let sequences = if again { decoded(problem, e.clone(), scales, cost, steps) } else { Some(e.clone()) };
                if let Some(better) = sequences.and_then(|e| Explanation::refit(problem, e, scales, cost, steps)) {
                    *e = better.with_missing_limits(problem, scales, cost, steps);
                    if round == 0 {
                        *e = e.clone().polished(problem, scales, cost, steps);
                    }
                }
            });
            give_up_what_breaks(problem, explanations, LEADERS);
            explanations.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        }
    }
    Some(found)
}

/// Fits see the training spans only: what the rest of a log breaks is no explanation. Of the first so many.
fn give_up_what_breaks(problem: &Problem<'_>, explanations: &mut [Explanation], first: usize) {
    let known = problem.system.is_black_box();
    explanations.par_iter_mut().take(first).filter(|e| e.fitted && !known).for_each(|e| {
        if !problem.holds_throughout(&*e) {
            (e.fitted, e.gain) = (false, f64::NEG_INFINITY);
        }
    });
}

impl Found {
    /// A delay that explains a good part of the gap stands at the longest that was looked for.
    pub(super) fn wants_longer_delays(&self, scales: &Scales) -> bool {
        let best = self.singles.iter().filter(|e| e.fitted).map(|e| e.gain).fold(0.0, f64::max);
        let at_edge = |e: &Explanation| {
            e.free.iter().any(|&(at, i)| {
                let p = &e.effects[at].parameters[i];
                p.unit == "s" && matches!(p.name, "delay" | "offset") && e.effects[at].values[i] > p.nominal && e.at_bound((at, i), scales)
            })
        };
        self.singles.iter().any(|e| e.fitted && e.gain > SEARCH_WIDE.max(0.25 * best) && at_edge(e))
    }
}

/// Which of a list of explanations are worth their price: all that cost no call of a black box, and so many of the others.
fn frugal<'e>(problem: &Problem<'_>, all: impl Iterator<Item = &'e [Applied]>, most: usize) -> Vec<bool> {
    let mut called = 0;
    all.map(|effects| {
        let calls = effects.iter().any(|a| problem.calls(a));
        called += usize::from(calls);
        !calls || called <= most
    })
    .collect()
}

/// Which of the pool are fitted. Of a black box so many on its inputs and so many parameters beside what costs no call: commands can mimic much, and a far
/// wrong parameter promises less than it keeps.
fn worth_a_fit(problem: &Problem<'_>, pool: &[Screened]) -> Vec<bool> {
    let (mut free, mut inputs, mut parameters) = (0, 0, 0);
    let worth = |screened: &Screened| {
        let (count, most) = match (problem.calls(&screened.applied), screened.applied.effect.site()) {
            (false, _) => (&mut free, FITTED),
            (true, Site::Dynamics) => (&mut parameters, CALLED_FITTED),
            (true, _) => (&mut inputs, CALLED_FITTED),
        };
        *count += 1;
        *count <= most && (!problem.calls(&screened.applied) || screened.gain > CALLED_FROM)
    };
    pool.iter().map(worth).collect()
}

/// Members of the best pair of a black box as explanations of their own, from where they stand in it: one that few calls were spent on may lead alone.
fn members_alone(problem: &Problem<'_>, found: &mut Found, scales: &Scales, nominal: &Whitened) {
    let cost = problem.inner(nominal, nominal);
    let Some(pair) = found.pairs.first().filter(|_| problem.system.is_black_box()) else { return };
    let members: Vec<Explanation> = (0..pair.effects.len()).map(|place| pair.only(place)).filter(|e| !e.loses_commands()).collect();
    let better: Vec<Explanation> = members.into_par_iter().filter_map(|e| Explanation::refit(problem, e, scales, cost, STEPS)).collect();
    for alone in better {
        if let Some(single) = found.singles.iter_mut().find(|s| s.key() == alone.key()).filter(|s| !s.fitted || s.gain < alone.gain) {
            *single = alone;
        }
    }
    found.singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
}

/// Fits the most promising of the pool, each from its best starts, the best of them to the end; the others stay as screened.
fn fit_first(problem: &Problem<'_>, pool: &[Screened], scales: &Scales, nominal: &Whitened) -> Vec<Explanation> {
    let cost = problem.inner(nominal, nominal);
    let fitted = worth_a_fit(problem, pool);
    let mut singles: Vec<Explanation> = pool
        .par_iter()
        .enumerate()
        .map(|(at, screened)| {
            let values = screened.starts.first().map_or(screened.applied.values.as_slice(), Vec::as_slice);
            let as_screened = Explanation::screened(with(&screened.applied, values), screened.gain);
            let starts = screened.starts.iter().take(if fitted[at] { STARTS } else { 0 });
            let fits = starts.filter_map(|start| Explanation::fit(problem, &[with(&screened.applied, start)], scales, cost, TRIAL.0));
            fits.max_by(|a, b| a.gain.total_cmp(&b.gain)).unwrap_or(as_screened)
        })
        .collect();
    singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let on = frugal(problem, singles.iter().take(ON).map(|e| e.effects.as_slice()), CALLED_LEADERS);
    singles.par_iter_mut().zip(on).filter(|(_, on)| *on).for_each(|(single, _)| {
        let better = if single.loses_commands() && single.gain > SEARCH_WIDE {
            decoded(problem, single.clone(), scales, cost, STEPS)
        } else {
            Explanation::refit(problem, single.clone(), scales, cost, STEPS)
        };
        if let Some(better) = better {
            *single = better;
        }
    });
    singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    singles
}

/// The noise of the residuals that one explanation leaves, per record; records of one sample time share it.
fn noise_of(problem: &Problem<'_>, acting: Acting<'_>, smallest: &[f64]) -> Option<Vec<Noise>> {
    let residuals = residuals(problem, acting)?;
    let same = |a: f64, b: f64| (a - b).abs() <= 0.02 * b;
    let noise = |ts: f64| {
        let members: Vec<usize> =
            (0..residuals.len()).filter(|&i| problem.records[i].train.is_some() && same(problem.records[i].sample_time_s, ts)).collect();
        // A held-out record of another sample time: all training records, as a stand-in.
        let members =
            if members.is_empty() { (0..residuals.len()).filter(|&i| problem.records[i].train.is_some()).collect() } else { members };
        let records: Vec<_> = members.iter().map(|&i| &problem.records[i]).collect();
        let residuals: Vec<_> = members.iter().map(|&i| &residuals[i]).collect();
        Noise::fit(&records, &residuals, smallest)
    };
    Some(problem.records.iter().map(|r| noise(r.sample_time_s)).collect())
}
