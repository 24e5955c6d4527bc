//! The search through the catalogue: candidates screened by their signatures, the promising ones fitted in full, pairs built on them, all compared under
//! one noise model.

use rayon::prelude::*;

use super::explanation::{Explanation, difference, with};
use super::lost::decoded;
use super::noise::Noise;
use super::problem::{Acting, NOTHING, Problem, Whitened};
use super::progress::Stage;
use super::rank::{SEARCH_WIDE, odds};
use crate::effect::{Applied, EFFECTS, Scales, Site};
use crate::simulate::System;

/// Candidates that are fitted in full after the screen.
const FITTED: usize = 25;
/// Explanations of each size that are fitted again once the noise is known.
const LEADERS: usize = 8;
/// How often the noise model is renewed from the leading explanation.
const ROUNDS: usize = 2;
/// Where a signature is taken, as a share of the way from nominal to a start.
const NEAR: f64 = 0.02;
/// How often the way along a signature is halved before it is given up.
const HALVINGS: i32 = 5;
/// Starts of one candidate that are fitted.
const STARTS: usize = 2;
/// Candidates whose fit goes on after the first few steps.
const ON: usize = 10;
/// Steps of a full fit, and of a fit that starts where another ended.
const STEPS: usize = 15;
/// First effects of pairs: so many of the best, and so many more that have one parameter; leading singles are often flexible impostors.
const FIRSTS: (usize, usize) = (2, 4);
/// Starts of a candidate that are looked at before any pair is fitted.
const GLANCES: usize = 3;
/// Second effects that are fitted with each first one.
const SECONDS: usize = 6;
/// Pairs whose members are tried as first effects in their turn.
const SWAPPED: usize = 3;
/// First effects beside which lost commands are looked for.
const LOSING: usize = 3;
/// The part of a first effect's cost that a second one must promise to take away: less is a model that is a little off.
const PROMISING: f64 = 0.05;
/// Steps after which all but the best pairs are given up, and how many are left then.
const TRIAL: (usize, usize) = (3, 8);

/// A candidate with its starts, best first.
pub(super) struct Screened {
    applied: Applied,
    starts: Vec<Vec<f64>>,
    gain: f64,
}

/// What a search found, best first.
pub(super) struct Found {
    /// Single effects: those fitted, then the rest of the catalogue as screened.
    pub(super) singles: Vec<Explanation>,
    pub(super) pairs: Vec<Explanation>,
}

/// All candidates of a system, in the order of the effects' table, with the reasons for those that cannot act.
pub(super) fn catalogue(system: &System) -> (Vec<Applied>, Vec<(&'static str, String)>) {
    let (mut all, mut left_out) = (Vec::new(), Vec::new());
    for effect in EFFECTS {
        if effect.site() == Site::Dynamics && system.is_sampled() {
            left_out.push((effect.name(), "the model is sampled".to_owned()));
            continue;
        }
        let channels = effect.channels(system);
        if channels.is_empty() {
            left_out.push((effect.name(), "the model has no channel for it".to_owned()));
        }
        all.extend(channels.iter().filter_map(|channel| Applied::nominal(system, effect, channel).ok()));
    }
    (all, left_out)
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
    eprintln!("STAGE screen"); // DBG
    let pool = screen(problem, catalogue, scales, &nominal);
    eprintln!("STAGE first"); // DBG
    progress(Stage::Fitting);
    let mut found = Found { singles: fit_first(problem, &pool, scales, &nominal), pairs: Vec::new() };
    progress(Stage::Pairing);
    eprintln!("STAGE pairs {}", found.singles.len()); // DBG
    found.pairs = pairs(problem, &found.singles, &pool, scales, &nominal);
    dbg_list("white", &found, problem.weight()); // DBG
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
            explanations.par_iter_mut().take(LEADERS).for_each(|e| {
                if let Some(better) =
                    decoded(problem, e.clone(), scales, cost, steps).and_then(|e| Explanation::refit(problem, e, scales, cost, steps))
                {
                    *e = better.with_missing_limits(problem, scales, cost, steps);
                    if round == 0 {
                        *e = e.clone().polished(problem, scales, cost, steps);
                    }
                }
            });
            explanations.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        }
        dbg_list("round", &found, problem.weight()); // DBG
    }
    Some(found)
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

/// Values moved a share of the way from nominal to a start; infinite limits stay.
fn between(applied: &Applied, start: &[f64], share: f64) -> Vec<f64> {
    let move_one = |(value, p): (&f64, &crate::effect::Parameter)| {
        let moved = p.nominal + share * (value - p.nominal);
        if p.nominal.is_infinite() || !moved.is_finite() { *value } else { moved.clamp(p.lower, p.upper) }
    };
    keep_shape(applied, start, start.iter().zip(&applied.parameters).map(move_one).collect())
}

/// Frequency, damping and phase keep the start's value when a signature is scaled.
fn keep_shape(applied: &Applied, start: &[f64], mut values: Vec<f64>) -> Vec<f64> {
    for ((value, start), p) in values.iter_mut().zip(start).zip(&applied.parameters) {
        if matches!(p.name, "frequency" | "damping" | "phase") {
            *value = *start;
        }
    }
    values
}

/// Some parameter is a limit, infinite when nominal.
fn has_limit(applied: &Applied) -> bool {
    applied.parameters.iter().any(|p| p.nominal.is_infinite())
}

/// Screens all candidates: the fall of the cost along each start's signature, or at the start itself where that is more.
fn screen(problem: &Problem<'_>, catalogue: Vec<Applied>, scales: &Scales, nominal: &Whitened) -> Vec<Screened> {
    let cost = problem.inner(nominal, nominal);
    let mut candidates: Vec<Screened> = catalogue
        .into_par_iter()
        .map(|applied| {
            let mut tried: Vec<(f64, Vec<f64>)> = Vec::new();
            let starts = applied.starts(problem.system, scales);
            let evaluate = |values: &[f64]| problem.whitened(&[with(&applied, values)]);
            for (at, start) in starts.iter().enumerate() {
                if let Some(there) = evaluate(start) {
                    tried.push((cost - problem.inner(&there, &there), start.clone()));
                }
                // All starts of one parameter have the same signature; a limit has none.
                if has_limit(&applied) || (at > 0 && applied.parameters.len() == 1) {
                    continue;
                }
                // The signature close to nominal, scaled as it fits best.
                let Some(near) = evaluate(&between(&applied, start, NEAR)) else { continue };
                let signature = difference(nominal, &near, 1.0);
                let share = NEAR * problem.inner(&signature, nominal) / problem.inner(&signature, &signature);
                if !share.is_finite() {
                    continue;
                }
                // Shorter where the whole way makes things worse or cannot be simulated.
                for halved in 0..HALVINGS {
                    let share = share.clamp(-20.0, 20.0) * 0.5_f64.powi(halved);
                    let values = between(&applied, start, share);
                    let gain = evaluate(&values).map(|there| cost - problem.inner(&there, &there));
                    tried.extend(gain.map(|gain| (gain, values)));
                    if gain.is_some_and(|g| g > 0.0) {
                        break;
                    }
                }
            }
            tried.retain(|(gain, _)| gain.is_finite());
            tried.sort_by(|a, b| b.0.total_cmp(&a.0));
            let gain = tried.first().map_or(f64::NEG_INFINITY, |t| t.0);
            Screened { applied, starts: tried.into_iter().map(|t| t.1).collect(), gain }
        })
        .collect();
    // Stable: of equals the first of the table leads.
    candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    candidates
}

/// Fits the most promising of the pool, each from its best starts, the best of them to the end; the others stay as screened.
fn fit_first(problem: &Problem<'_>, pool: &[Screened], scales: &Scales, nominal: &Whitened) -> Vec<Explanation> {
    let cost = problem.inner(nominal, nominal);
    let mut singles: Vec<Explanation> = pool
        .par_iter()
        .enumerate()
        .map(|(at, screened)| {
            let values = screened.starts.first().map_or(screened.applied.values.as_slice(), Vec::as_slice);
            let as_screened = Explanation::screened(with(&screened.applied, values), screened.gain);
            let starts = screened.starts.iter().take(if at < FITTED { STARTS } else { 0 });
            let fits = starts.filter_map(|start| Explanation::fit(problem, &[with(&screened.applied, start)], scales, cost, TRIAL.0));
            fits.max_by(|a, b| a.gain.total_cmp(&b.gain)).unwrap_or(as_screened)
        })
        .collect();
    singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    singles.par_iter_mut().take(ON).for_each(|single| {
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

/// The first effects that pairs are built on: the best, and the best of one parameter, each kind of effect once.
fn firsts(singles: &[Explanation], weight: f64) -> Vec<&Explanation> {
    let mut order: Vec<&Explanation> = singles.iter().filter(|e| e.fitted).collect();
    order.sort_by(|a, b| odds(b, weight).total_cmp(&odds(a, weight)));
    let mut chosen: Vec<&Explanation> = Vec::new();
    for (count, plain) in [(FIRSTS.0, false), (FIRSTS.1, true)] {
        let full = chosen.len() + count;
        for single in &order {
            let known = chosen.iter().any(|c| c.effects[0].effect.name() == single.effects[0].effect.name());
            if chosen.len() < full && !known && (!plain || single.free.len() == 1) {
                chosen.push(single);
            }
        }
    }
    chosen
}

/// What a second effect promises beside each first: the fall of the cost along its signature, the first's own directions taken out.
struct Beside {
    first: Explanation,
    residual: Whitened,
    cost: f64,
    /// Directions in which the first can still move, orthonormal.
    own: Vec<Whitened>,
}

impl Beside {
    fn new(problem: &Problem<'_>, first: &Explanation, scales: &Scales) -> Option<Self> {
        let slopes = first.slopes(problem, scales)?;
        let mut own: Vec<Whitened> = Vec::new();
        for mut column in slopes.columns {
            let whole = problem.inner(&column, &column);
            for q in &own {
                let along = problem.inner(q, &column);
                column = column.iter().zip(q).map(|(c, q)| c - q * along).collect();
            }
            let left = problem.inner(&column, &column);
            if left > 1e-10 * whole {
                own.push(column.iter().map(|c| c / left.sqrt()).collect());
            }
        }
        let cost = problem.inner(&slopes.residual, &slopes.residual);
        Some(Self { first: first.clone(), residual: slopes.residual, cost, own })
    }

    /// How far the cost would fall along a signature, at any size.
    fn promise(&self, problem: &Problem<'_>, signature: &Whitened) -> f64 {
        let mut along = problem.inner(signature, &self.residual);
        let mut length = problem.inner(signature, signature);
        for q in &self.own {
            let part = problem.inner(q, signature);
            along -= part * problem.inner(q, &self.residual);
            length -= part * part;
        }
        if length > 0.0 && along.is_finite() { along * along / length } else { 0.0 }
    }
}

/// Pairs: for each of the leading singles the seconds that promise most beside it, refitted together.
fn pairs(problem: &Problem<'_>, singles: &[Explanation], pool: &[Screened], scales: &Scales, nominal: &Whitened) -> Vec<Explanation> {
    let weight = problem.weight();
    let firsts: Vec<Explanation> = firsts(singles, weight).into_iter().cloned().collect();
    if !something_beside(problem, firsts.first(), pool, scales, nominal) {
        return Vec::new();
    }
    let mut pairs = with_seconds(problem, &firsts, pool, scales, nominal, &[]);
    // Forward and backward: what only a second effect made visible takes the first place.
    let mut kept: Vec<Explanation> = Vec::new();
    for (pair, place) in pairs.iter().take(SWAPPED).flat_map(|pair| (0..pair.effects.len()).map(move |place| (pair, place))) {
        let single = pair.only(place);
        if !single.loses_commands() && firsts.iter().chain(&kept).all(|f| f.key() != single.key()) {
            kept.push(single);
        }
    }
    let more = with_seconds(problem, &kept, pool, scales, nominal, &pairs);
    pairs.extend(more);
    pairs.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    pairs
}

/// Something of the catalogue promises to take a part of what the best single leaves.
fn something_beside(problem: &Problem<'_>, best: Option<&Explanation>, pool: &[Screened], scales: &Scales, nominal: &Whitened) -> bool {
    let Some(beside) = best.and_then(|best| Beside::new(problem, best, scales)) else { return false };
    let promises = |screened: &Screened| {
        // A lattice in raw values need not promise anything.
        let traced = screened.applied.effect.leaves_residual() && !screened.starts.is_empty();
        let own = beside.first.effects.iter().any(|e| e.key() == screened.applied.key());
        let starts = screened.applied.starts(problem.system, scales);
        let every = starts.len().div_ceil(GLANCES).max(1);
        let glance = |start: Vec<f64>| {
            let share = if has_limit(&screened.applied) { 1.0 } else { 0.5 };
            let there = problem.whitened(&[with(&screened.applied, &between(&screened.applied, &start, share))]);
            there.is_some_and(|there| beside.promise(problem, &difference(nominal, &there, 1.0)) > SEARCH_WIDE.max(PROMISING * beside.cost))
        };
        !own && (traced || starts.into_iter().step_by(every).any(glance))
    };
    pool.par_iter().any(promises)
}

/// The seconds that promise most beside each first, fitted with it; but those known already.
fn with_seconds(
    problem: &Problem<'_>,
    firsts: &[Explanation],
    pool: &[Screened],
    scales: &Scales,
    nominal: &Whitened,
    known: &[Explanation],
) -> Vec<Explanation> {
    let beside: Vec<Beside> = firsts.par_iter().filter_map(|first| Beside::new(problem, first, scales)).collect();
    if beside.is_empty() {
        return Vec::new();
    }
    // Per candidate and first: the promise, and the start that gave it.
    let promises: Vec<Vec<(f64, Applied)>> = pool
        .par_iter()
        .map(|screened| {
            let applied = &screened.applied;
            let starts = applied.starts(problem.system, scales);
            let first = starts.first().map_or_else(|| applied.clone(), |start| with(applied, start));
            let mut best: Vec<(f64, Applied)> = beside.iter().map(|_| (0.0, first.clone())).collect();
            for start in starts {
                for share in if has_limit(applied) { &[1.0][..] } else { &[NEAR, 1.0] } {
                    let Some(there) = problem.whitened(&[with(applied, &between(applied, &start, *share))]) else { continue };
                    let signature = difference(nominal, &there, 1.0);
                    for (best, beside) in best.iter_mut().zip(&beside) {
                        let promise = beside.promise(problem, &signature);
                        if promise > best.0 {
                            *best = (promise, with(applied, &start));
                        }
                    }
                }
            }
            best
        })
        .collect();
    let traces: Vec<String> =
        (pool.iter()).filter(|s| s.applied.effect.leaves_residual() && !s.starts.is_empty()).map(|s| s.applied.key()).collect();
    let mut wanted: Vec<Vec<Applied>> = Vec::new();
    for (at, beside) in beside.iter().enumerate() {
        let mut seconds: Vec<&(f64, Applied)> =
            promises.iter().map(|p| &p[at]).filter(|(gain, _)| *gain > SEARCH_WIDE.max(PROMISING * beside.cost)).collect();
        seconds.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (losing, seconds): (Vec<_>, Vec<_>) = seconds
            .into_iter()
            .filter(|(_, s)| beside.first.effects.iter().all(|f| f.key() != s.key()))
            .partition(|(_, s)| s.effect.loses_commands());
        // A lattice in the raw values is there whatever it promises.
        let traced = promises.iter().map(|p| &p[at]).filter(|(_, s)| s.effect.leaves_residual() && traces.contains(&s.key()));
        let special = losing.into_iter().chain(traced).take(if at < LOSING { SECONDS } else { 0 });
        for (_, second) in seconds.into_iter().take(SECONDS).chain(special) {
            let mut pair: Vec<Applied> = beside.first.effects.iter().chain([second]).cloned().collect();
            if pair.iter().filter(|a| a.effect.loses_commands()).count() > 1 || pair[0].key() == pair[1].key() {
                continue;
            }
            pair.sort_by_key(|a| EFFECTS.iter().position(|e| e.name() == a.effect.name()));
            let keys = |effects: &[Applied]| effects.iter().map(Applied::key).collect::<Vec<_>>();
            if wanted.iter().chain(known.iter().map(|k| &k.effects)).all(|known| keys(known) != keys(&pair)) {
                wanted.push(pair);
            }
        }
    }
    let ((trial, left), cost) = (TRIAL, problem.inner(nominal, nominal));
    // Lost commands are told from a lag by their sequence only.
    let losing: Vec<Vec<Applied>> = wanted.iter().filter(|pair| pair.iter().any(|a| a.effect.loses_commands())).cloned().collect();
    wanted.retain(|pair| pair.iter().all(|a| !a.effect.loses_commands()));
    let mut pairs: Vec<Explanation> = wanted.par_iter().filter_map(|pair| Explanation::fit(problem, pair, scales, cost, trial)).collect();
    pairs.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    pairs.truncate(left);
    pairs.extend(
        losing
            .par_iter()
            .filter_map(|pair| {
                let begin = Explanation { effects: pair.clone(), free: Vec::new(), gain: 0.0, fitted: false, lost: None };
                decoded(problem, begin, scales, cost, STEPS)
            })
            .collect::<Vec<_>>(),
    );
    pairs.par_iter_mut().for_each(|pair| {
        if let Some(better) = Explanation::fit(problem, &pair.effects, scales, cost, STEPS) {
            *pair = better;
        }
    });
    pairs.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    pairs
}

/// The noise of the residuals that one explanation leaves, per record; records of one sample time share it.
fn noise_of(problem: &Problem<'_>, acting: Acting<'_>, smallest: &[f64]) -> Option<Vec<Noise>> {
    let residuals = (0..problem.records.len())
        .map(|at| {
            let record = &problem.records[at];
            let span = record.train.or(record.held)?;
            Some(problem.residual(at, &problem.predict_from_posterior(at, acting, span)?))
        })
        .collect::<Option<Vec<_>>>()?;
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

// DBG
fn dbg_list(what: &str, found: &Found, weight: f64) {
    // DBG
    if std::env::var("DT_DEBUG").is_ok() {
        // DBG
        for (n, e) in found.singles.iter().take(8).chain(found.pairs.iter().take(12)).enumerate() {
            // DBG
            eprintln!("{what} {n} odds {:.1} gain {:.1} fitted {} {:?}", odds(e, weight), e.gain, e.fitted, e.effects); // DBG
        } // DBG
    } // DBG
} // DBG
