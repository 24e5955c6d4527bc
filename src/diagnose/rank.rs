//! From fitted candidates to a verdict: probabilities, `none` and `unknown`, classes that the data cannot tell apart.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::data::Record;
use super::diagnosis::{Cause, FoundEffect, Parameter, RankedSingle, RankingRow};
use super::floor::Floor;
use super::problem::{Problem, Whitened};
use super::search::Candidate;
use super::shrink::{Errors, together};
use crate::effect::Site;

/// Twice the log-likelihood by which the best of a whole catalogue must beat no effect: the best of 50 to 100 rivals reaches 10 to 25 on noise alone.
const SEARCH_WIDE: f64 = 30.0;
/// A residual this many times its floor has something left in it that an effect did not explain.
const ABOVE_FLOOR: f64 = 1.5;
/// The same where no effect helps at all: a gap worth the name is three times the noise.
const ABOVE_FLOOR_ALONE: f64 = 2.0;
/// An effect that lowers the rms of no output by this factor is within the noise: the model as it is stands at the floor.
const MATTERS: f64 = 1.3;
/// The share of the explainable that an effect must explain on held-out data: less, and it describes the training logs and no cause.
const GENERALISES: f64 = 0.5;
/// The share of the explainable that one effect must explain.
const EXPLAINS: f64 = 0.93;
/// Rivals that differ by less than this in twice the log-likelihood, and whose trajectories are as close, are one class.
const ALIKE: f64 = 6.0;

/// The verdict and what it rests on.
pub(super) struct Judged<'c> {
    pub(super) found: Vec<&'c Candidate>,
    verdict: Verdict,
    /// Probability of `unknown`.
    unknown: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    None,
    Unknown,
    Effect,
}

/// Twice the log of the posterior odds against no effect (Schwarz 1978, doi:10.1214/aos/1176344136).
fn odds(candidate: &Candidate, weight: f64) -> f64 {
    let parameters = u32::try_from(candidate.free.len().max(1)).unwrap_or(1);
    candidate.gain - f64::from(parameters - 1) * weight.max(2.0).ln() - SEARCH_WIDE
}

/// The best fitted candidate; of equals the first in the table.
pub(super) fn leader(candidates: &[Candidate], weight: f64) -> Option<&Candidate> {
    let best = candidates.iter().filter(|c| c.fitted).map(|c| odds(c, weight)).fold(f64::NEG_INFINITY, f64::max);
    let place = |c: &Candidate| crate::effect::EFFECTS.iter().position(|e| e.name() == c.applied.effect.name());
    candidates.iter().filter(|c| c.fitted && odds(c, weight) > best - 0.5).min_by_key(|c| place(c))
}

/// Decides between no effect, the leader and something that is in no catalogue.
pub(super) fn judge<'c>(
    problem: &Problem<'_>,
    candidates: &'c [Candidate],
    records: &[Record],
    before: &[DMatrix<f64>],
    after: &[DMatrix<f64>],
    floor: &Floor,
) -> Judged<'c> {
    let weight = problem.weight();
    let leader = leader(candidates, weight);
    let rms = |residuals: &[DMatrix<f64>], held: bool| Errors::of(records, residuals, |r| if held { r.held } else { r.train });
    let (was, is) = (rms(before, false).nrmse(), rms(after, false).nrmse());
    let matters = was.iter().zip(&is).any(|(b, a)| b.zip(*a).is_some_and(|(b, a)| b > MATTERS * a));
    // An effect of chance need not lower the error: its scatter or its lattice speaks for it.
    let chance = leader.is_some_and(|c| c.applied.effect.leaves_residual());
    let beats = (matters || chance) && leader.is_some_and(|c| odds(c, weight) > 0.0);
    let explained = if beats { after } else { before };
    let (all, left) = (Errors::of(records, before, |r| r.train).nrmse(), Errors::of(records, explained, |r| r.train));
    let noise = left.relative(&floor.floor);
    // Judged on the output that gains most; where nothing gains, on the one that is furthest above its floor.
    let gained = |i: usize| Some(all[i]?.powi(2) - left.nrmse()[i]?.powi(2));
    let ratio = |i: usize| Some(left.nrmse()[i]? / noise[i]?.max(1e-9));
    let outputs = 0..all.len();
    let by = |key: &dyn Fn(usize) -> Option<f64>| outputs.clone().max_by(|&a, &b| key(a).unwrap_or(0.0).total_cmp(&key(b).unwrap_or(0.0)));
    let decisive = if beats { by(&gained) } else { by(&ratio) };
    let mut unknown: f64 = 0.0;
    if let Some(i) = decisive
        && let (Some(all), Some(left), Some(noise)) = (all[i], left.nrmse()[i], noise[i])
    {
        let above = left / noise.max(1e-9);
        let share = if all > noise { (all * all - left * left) / (all * all - noise * noise) } else { 1.0 };
        let limit = if beats { ABOVE_FLOOR } else { ABOVE_FLOOR_ALONE };
        if above > limit && share < EXPLAINS && !(beats && chance) {
            unknown = 1.0 - 0.5 * (limit - above).exp();
        }
    }
    // What does not hold on data that it was not fitted to is no explanation.
    let (held_before, held_after) = (rms(before, true), rms(after, true));
    let held = |e: &Errors| together(&e.nrmse()).unwrap_or(0.0);
    let (b, a, f) = (held(&held_before), held(&held_after), together(&held_before.relative(&floor.floor)).unwrap_or(0.0));
    if beats && !chance && b * b - a * a < GENERALISES * (b * b - f * f).max(0.0) {
        unknown = f64::max(unknown, 0.9);
    }
    let verdict = match (unknown > 0.5, beats) {
        (true, _) => Verdict::Unknown,
        (false, true) => Verdict::Effect,
        (false, false) => Verdict::None,
    };
    let found = if verdict == Verdict::Effect { leader.into_iter().collect() } else { Vec::new() };
    Judged { found, verdict, unknown }
}

/// The section `cause`; `after` gives a candidate's training nrmse.
pub(super) fn cause(
    problem: &Problem<'_>,
    judged: &Judged<'_>,
    candidates: &[Candidate],
    after: impl Fn(&Candidate) -> Option<f64> + Sync,
) -> Cause {
    let weight = problem.weight();
    // Probabilities: exp(odds/2), no effect at odds 0, all scaled to leave room for `unknown`.
    let best = candidates.iter().map(|c| odds(c, weight)).fold(0.0, f64::max);
    // Effects within the noise: 9 to 1 for no effect, whatever the likelihood says of something that does not matter.
    let none = if judged.verdict == Verdict::None && best > 0.0 { best + 2.0 * 9.0_f64.ln() } else { 0.0 };
    let best = best.max(none);
    let share = |odds: f64| if odds.is_finite() { (0.5 * (odds - best)).exp() } else { 0.0 };
    let sum: f64 = candidates.iter().map(|c| share(odds(c, weight))).sum::<f64>() + share(none);
    let rest = 1.0 - judged.unknown;
    let row = |effect: &str, channel: Option<String>, probability: f64, after: Option<f64>| RankedSingle {
        effect: effect.to_owned(),
        channel,
        probability,
        after,
    };
    let mut rows: Vec<RankedSingle> = candidates
        .par_iter()
        .map(|c| row(c.applied.effect.name(), Some(c.applied.channel.clone()), rest * share(odds(c, weight)) / sum, after(c)))
        .collect();
    rows.push(row("none", None, rest * share(none) / sum, None));
    rows.push(row("unknown", None, judged.unknown, None));
    // The verdict leads its equals.
    let verdict = match (judged.verdict, judged.found.first()) {
        (Verdict::Effect, Some(found)) => (found.applied.effect.name().to_owned(), Some(found.applied.channel.clone())),
        (Verdict::Unknown, _) => ("unknown".to_owned(), None),
        _ => ("none".to_owned(), None),
    };
    let leads = |r: &RankedSingle| (&r.effect, &r.channel) == (&verdict.0, &verdict.1);
    rows.sort_by(|a, b| leads(b).cmp(&leads(a)).then(b.probability.total_cmp(&a.probability)));
    let class = judged.found.first().map(|found| alike(problem, found, candidates)).unwrap_or_default();
    let next_experiment = (class.len() > 1).then(|| experiment(&class));
    Cause {
        verdict: verdict.0,
        channel: verdict.1,
        effects: judged.found.iter().map(|c| found_effect(c)).collect(),
        ranking: rows.into_iter().map(RankingRow::Single).collect(),
        indistinguishable: if class.len() > 1 { vec![class.iter().map(|c| c.applied.key()).collect()] } else { Vec::new() },
        not_tried: Vec::new(),
        next_experiment,
    }
}

fn found_effect(candidate: &Candidate) -> FoundEffect {
    let applied = &candidate.applied;
    let parameter = |i: usize| {
        let (value, std) = (applied.values[i], candidate.std[i]);
        Parameter {
            name: applied.parameters[i].name.to_owned(),
            unit: applied.parameters[i].unit.clone(),
            value: value.is_finite().then_some(value),
            std,
            ci95: std.map(|s| [value - 1.96 * s, value + 1.96 * s]),
        }
    };
    FoundEffect {
        effect: applied.effect.name().to_owned(),
        channel: applied.channel.clone(),
        parameters: (0..applied.values.len()).map(parameter).collect(),
    }
}

/// The leader and all whose likelihood and fitted trajectories are as good as its own.
fn alike<'c>(problem: &Problem<'_>, leader: &'c Candidate, candidates: &'c [Candidate]) -> Vec<&'c Candidate> {
    let Some(own) = problem.whitened(std::slice::from_ref(&leader.applied)) else { return vec![leader] };
    let mut class = vec![leader];
    for rival in candidates.iter().filter(|c| c.fitted && (c.gain - leader.gain).abs() < ALIKE && c.applied.key() != leader.applied.key()) {
        let Some(other) = problem.whitened(std::slice::from_ref(&rival.applied)) else { continue };
        let apart: Whitened = own.iter().zip(&other).map(|(a, b)| a - b).collect();
        if problem.inner(&apart, &apart) < 2.0 * ALIKE {
            class.push(rival);
        }
    }
    class
}

/// The excitation that would separate a class, by the sites and kinds of its members.
fn experiment(class: &[&Candidate]) -> String {
    let sites = |site: Site| class.iter().any(|c| c.applied.effect.site() == site);
    let names = class.iter().map(|c| c.applied.key()).collect::<Vec<_>>().join(", ");
    let is = |list: &[&str]| class.iter().filter(|c| list.contains(&c.applied.effect.name())).count() > 1;
    let advice =
        if is(&["deadband", "saturation", "input_gain", "input_curve", "backlash", "quadratic_drag", "coulomb_friction", "sensor_gain"]) {
            "repeat the experiment at two or more amplitudes, with slow reversals through zero"
        } else if is(&["input_offset", "sensor_bias", "constant_disturbance", "sensor_drift", "gain_fade"]) {
            "step the operating point, and start from a known state"
        } else if is(&["input_delay", "actuator_lag", "rate_limit", "dropped_commands", "unmodelled_mode", "output_delay", "sensor_lag"])
            && !sites(Site::Output)
        {
            "excite with a broadband signal that reaches well above one over the lag, at two amplitudes"
        } else if sites(Site::Output) || sites(Site::Clock) {
            "record motion that is not caused by the commands (a release from a displaced start, a push by hand), beside the same commands"
        } else {
            "excite with a multisine over the whole bandwidth, at two amplitudes and two operating points"
        };
    format!("To separate {names}: {advice}.")
}
