//! The search over all effects on all channels: screened by signature, fitted in full, compared under one noise model.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::noise::Noise;
use super::problem::{Problem, Whitened};
use crate::effect::{Applied, EFFECTS, Scales, Site};
use crate::fit::{LevenbergMarquardt, Normal};
use crate::simulate::System;

/// Candidates that are fitted in full after the screen.
const FITTED: usize = 25;
/// Candidates that are fitted again once the noise is known.
const LEADERS: usize = 12;
/// Where a signature is taken, as a share of the way from nominal to a start.
const NEAR: f64 = 0.02;
/// How often the way along a signature is halved before it is given up.
const HALVINGS: i32 = 5;
/// Starts of one candidate that are fitted.
const STARTS: usize = 2;

/// An effect on a channel with its best parameters so far.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub(super) applied: Applied,
    /// Other starts, best first.
    starts: Vec<Vec<f64>>,
    /// Parameters that were fitted; limits that do not act are not among them.
    pub(super) free: Vec<usize>,
    /// How far the whitened cost falls against no effect.
    pub(super) gain: f64,
    /// Standard deviations of the parameters, in whitened units; `None` at a bound or where not fitted.
    pub(super) std: Vec<Option<f64>>,
    pub(super) fitted: bool,
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

fn with(applied: &Applied, values: &[f64]) -> Applied {
    Applied { values: values.to_vec(), ..applied.clone() }
}

/// Values moved a share of the way from nominal to a start; infinite limits stay.
fn between(applied: &Applied, start: &[f64], share: f64) -> Vec<f64> {
    let move_one = |(value, p): (&f64, &crate::effect::Parameter)| {
        let moved = p.nominal + share * (value - p.nominal);
        if p.nominal.is_infinite() || !moved.is_finite() { *value } else { moved.clamp(p.lower, p.upper) }
    };
    start.iter().zip(&applied.parameters).map(move_one).collect()
}

/// Screens all candidates: the fall of the cost along each start's signature, or at the start itself where that is more.
pub(super) fn screen(problem: &Problem<'_>, catalogue: Vec<Applied>, scales: &Scales, nominal: &Whitened) -> Vec<Candidate> {
    let cost = problem.inner(nominal, nominal);
    let mut candidates: Vec<Candidate> = catalogue
        .into_par_iter()
        .map(|applied| {
            let mut tried: Vec<(f64, Vec<f64>)> = Vec::new();
            let starts = applied.effect.starts(problem.system, &applied.channel, scales);
            let evaluate = |values: &[f64]| problem.whitened(&[with(&applied, values)]);
            for (at, start) in starts.iter().enumerate() {
                if let Some(there) = evaluate(start) {
                    tried.push((cost - problem.inner(&there, &there), start.clone()));
                }
                // All starts of one parameter have the same signature; a limit has none.
                if applied.parameters.iter().any(|p| p.nominal.is_infinite()) || (at > 0 && applied.parameters.len() == 1) {
                    continue;
                }
                // The signature close to nominal, scaled as it fits best.
                let Some(near) = evaluate(&keep_shape(&applied, start, between(&applied, start, NEAR))) else { continue };
                let signature: Whitened = nominal.iter().zip(&near).map(|(n, t)| n - t).collect();
                let share = NEAR * problem.inner(&signature, nominal) / problem.inner(&signature, &signature);
                if !share.is_finite() {
                    continue;
                }
                // Shorter where the whole way makes things worse or cannot be simulated.
                for halved in 0..HALVINGS {
                    let share = share.clamp(-20.0, 20.0) * 0.5_f64.powi(halved);
                    let values = keep_shape(&applied, start, between(&applied, start, share));
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
            let starts: Vec<Vec<f64>> = tried.into_iter().map(|t| t.1).collect();
            let values = starts.first().cloned().unwrap_or_else(|| applied.values.clone());
            let std = vec![None; values.len()];
            Candidate { applied: with(&applied, &values), starts, free: Vec::new(), gain, std, fitted: false }
        })
        .collect();
    // Stable: of equals the first of the table leads.
    candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    candidates
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

/// Fits the most promising candidates in full.
pub(super) fn fit_all(problem: &Problem<'_>, candidates: &mut [Candidate], scales: &Scales, nominal: &Whitened, again: bool) {
    let count = if again { LEADERS } else { FITTED };
    candidates.par_iter_mut().take(count).for_each(|candidate| {
        let starts: Vec<Vec<f64>> =
            if again { vec![candidate.applied.values.clone()] } else { candidate.starts.iter().take(STARTS).cloned().collect() };
        for start in starts {
            let fitted = fit(problem, &candidate.applied, &start, scales, nominal);
            if let Some(better) = fitted.map(|c| if again { with_scatter(problem, c, nominal) } else { c })
                && (better.gain > candidate.gain || !candidate.fitted || again)
            {
                let starts = std::mem::take(&mut candidate.starts);
                *candidate = Candidate { starts, ..better };
            }
        }
    });
    candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
}

/// The gain of every candidate under the problem's present noise, parameters as they are.
pub(super) fn rescore(problem: &Problem<'_>, candidates: &mut [Candidate], nominal: &Whitened) {
    let cost = problem.inner(nominal, nominal);
    candidates.par_iter_mut().for_each(|candidate| {
        let there = problem.whitened(std::slice::from_ref(&candidate.applied));
        let effects = std::slice::from_ref(&candidate.applied);
        candidate.gain = there.map_or(f64::NEG_INFINITY, |e| cost - problem.inner(&e, &e) + problem.scatter(effects, &e));
    });
    candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
}

/// The step for a numerical derivative.
fn step(applied: &Applied, at: usize, value: f64, scales: &Scales) -> f64 {
    let p = &applied.parameters[at];
    let size = if p.nominal.is_finite() { (value - p.nominal).abs() } else { value.abs() };
    let least = match p.unit.as_str() {
        "s" => 0.01 * scales.sample_time_s,
        _ => 1e-6 * value.abs(),
    };
    let step = (1e-4 * size).max(1e-4 * least).max(1e-12);
    if value + step > p.upper { -step } else { step }
}

/// The parameter of an effect of chance, fitted to mean and scatter together: the best of a grid, refined by the parabola through its neighbours, whose
/// curvature gives the standard deviation. Other effects stay as they are.
fn with_scatter(problem: &Problem<'_>, candidate: Candidate, nominal: &Whitened) -> Candidate {
    const GRID: [f64; 9] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];
    let cost = problem.inner(nominal, nominal);
    let gain = |p: f64| {
        let effects = [with(&candidate.applied, &[p])];
        let e = problem.whitened(&effects)?;
        Some((cost - problem.inner(&e, &e), problem.scatter(&effects, &e)))
    };
    let acts = candidate.applied.values.len() == 1 && candidate.applied.values.iter().all(|&p| gain(p).is_some_and(|(_, s)| s != 0.0));
    if !acts {
        return candidate;
    }
    let total: Vec<f64> = GRID.iter().map(|&p| gain(p).map_or(f64::NEG_INFINITY, |(mean, scatter)| mean + scatter)).collect();
    let Some(at) = (1..GRID.len() - 1).max_by(|&a, &b| total[a].total_cmp(&total[b])) else { return candidate };
    let (left, middle, right) = (total[at - 1], total[at], total[at + 1]);
    let bend = left - 2.0 * middle + right;
    if bend >= 0.0 || !bend.is_finite() {
        return candidate;
    }
    let step = GRID[1] - GRID[0];
    let p = GRID[at] + (0.5 * step * (left - right) / bend).clamp(-step, step);
    let Some((mean, scatter)) = gain(p) else { return candidate };
    // Twice the log-likelihood bends by −2/σ².
    let std = vec![Some((-2.0 * step * step / bend).sqrt())];
    Candidate { applied: with(&candidate.applied, &[p]), gain: mean + scatter, std, ..candidate }
}

/// The bounds of a parameter in a search: its own, and what these logs can show at all.
fn range(applied: &Applied, at: usize, scales: &Scales) -> (f64, f64) {
    let p = &applied.parameters[at];
    let (lower, upper) = match (p.name, p.unit.as_str()) {
        // From a fifth of a period in the whole log to near the Nyquist frequency.
        ("frequency", _) => (0.2 / scales.duration_s, 0.45 / scales.sample_time_s),
        ("damping", _) => (1e-3, 2.0),
        ("delay", _) => (0.0, scales.longest_delay_s),
        ("time_constant", _) => (0.0, 0.25 * scales.duration_s),
        ("offset", "s") if applied.effect.site() == Site::Clock => (-scales.longest_delay_s, scales.longest_delay_s),
        _ => (p.lower, p.upper),
    };
    (lower.max(p.lower), upper.min(p.upper))
}

/// Gauss-Newton with bounds from one start.
fn fit(problem: &Problem<'_>, applied: &Applied, start: &[f64], scales: &Scales, nominal: &Whitened) -> Option<Candidate> {
    let free: Vec<usize> = (0..start.len()).filter(|&i| start[i].is_finite()).collect();
    let full = |values: &[f64]| {
        let mut all = start.to_vec();
        for (&i, v) in free.iter().zip(values) {
            all[i] = *v;
        }
        all
    };
    let evaluate = |values: &[f64]| -> Option<Normal> {
        let here = full(values);
        let e = problem.whitened(&[with(applied, &here)])?;
        let mut columns: Vec<Whitened> = Vec::with_capacity(free.len());
        for &i in &free {
            let h = step(applied, i, here[i], scales);
            let mut moved = here.clone();
            moved[i] += h;
            let there = problem.whitened(&[with(applied, &moved)])?;
            columns.push(there.iter().zip(&e).map(|(t, e)| (t - e) / h).collect());
        }
        let k = free.len();
        Some(Normal {
            cost: problem.inner(&e, &e),
            gradient: DVector::from_fn(k, |i, _| problem.inner(&columns[i], &e)),
            information: DMatrix::from_fn(k, k, |i, j| problem.inner(&columns[i], &columns[j])),
        })
    };
    let (lower, upper) = free.iter().map(|&i| range(applied, i, scales)).unzip();
    let search = LevenbergMarquardt { max_iterations: 15, gradient_tolerance: 1e-4, step_tolerance: 1e-4, cost_floor: 0.0, lower, upper };
    let from: Vec<f64> = free.iter().map(|&i| start[i]).collect();
    let found = search.minimise(&from, evaluate);
    if found.normal.information.is_empty() {
        return None;
    }
    let (mut values, mut kept) = (full(&found.parameters), free.clone());
    let cost = found.normal.cost;
    // A limit that the training data never reach is infinite.
    for &i in &free {
        if applied.parameters[i].nominal.is_infinite() {
            let mut without = values.clone();
            without[i] = applied.parameters[i].nominal;
            let idle = problem.whitened(&[with(applied, &without)]).is_some_and(|e| (problem.inner(&e, &e) - cost).abs() <= 1e-9 * cost);
            if idle {
                values = without;
                kept.retain(|&j| j != i);
            }
        }
    }
    let inverse = found.normal.information.clone().try_inverse();
    let mut std = vec![None; values.len()];
    for (at, &i) in free.iter().enumerate().filter(|(_, i)| kept.contains(i)) {
        let (lower, upper) = range(applied, i, scales);
        let inside = values[i] > lower && values[i] < upper;
        let variance = inverse.as_ref().map(|m| m[(at, at)]).filter(|v| v.is_finite() && *v > 0.0);
        std[i] = variance.filter(|_| inside).map(f64::sqrt);
    }
    let best = with(applied, &values);
    let scatter = problem.whitened(std::slice::from_ref(&best)).map_or(0.0, |e| problem.scatter(std::slice::from_ref(&best), &e));
    let gain = problem.inner(nominal, nominal) - cost + scatter;
    Some(Candidate { applied: best, starts: Vec::new(), free: kept, gain, std, fitted: true })
}

/// The noise of the residuals that one explanation leaves, per record; records of one sample time share it.
pub(super) fn noise_of(problem: &Problem<'_>, effects: &[Applied], smallest: &[f64]) -> Option<Vec<Noise>> {
    let residuals = (0..problem.records.len())
        .map(|at| {
            let record = &problem.records[at];
            let span = record.train.or(record.held)?;
            Some(problem.residual(at, &problem.predict_from_posterior(at, effects, span)?))
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
