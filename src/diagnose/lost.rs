//! Which commands were lost: the hidden sequence, estimated from the outputs.
//!
//! A lost command leaves the last one that arrived in force. To first order every such difference δ adds δ·g to the residual, g being the response to one
//! held sample. A search through the sequences keeps the most probable ones (the M-algorithm; Anderson and Mohan 1984, doi:10.1109/TCOM.1984.1096023);
//! the best is then simulated exactly and its likelihood charged with the probability of its decisions.
//!
//! How it can be wrong: a command that changes by less than the noise shows decides nothing, so the probability is taken from the others; a nonlinear plant's
//! response varies, so the exact simulation has the last word; a misfit of another kind is followed by lost commands in part only, and stays above the floor.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::data::Record;
use super::explanation::Explanation;
use super::problem::{Acting, Problem};
use crate::effect::{Applied, Chance, Scales};
use crate::simulate::plan::InputPath;
use crate::simulate::{Commands, Piecewise};

/// Which commands of each input are lost; `None` where none are.
pub(super) type Sequences = Vec<Option<Vec<bool>>>;

/// Lost commands of all records.
#[derive(Debug, Clone)]
pub(super) struct Lost {
    /// One per record.
    pub(super) sequences: Vec<Sequences>,
    /// Twice the negative log-probability of the decisions on the training logs.
    pub(super) price: f64,
    /// Standard deviation of each input's probability, where one could be estimated.
    pub(super) std: Vec<Option<f64>>,
}

/// Sequences that are kept.
const KEPT: usize = 32;
/// Samples after which the response to one command counts as over, at most.
const LONGEST: usize = 400;
/// A decision counts for the probability where the two possible pasts differ by this many noise standard deviations.
const DECIDED: f64 = 4.0;
/// The probability with which a search begins.
const FIRST: f64 = 0.3;
/// Searches, each with the last one's probability and parameters.
const PASSES: usize = 2;

/// The explanation with the sequence of its lost commands estimated and its other parameters refitted; unchanged where it has none, `None` where nothing
/// can be decided.
pub(super) fn decoded(
    problem: &Problem<'_>,
    mut explanation: Explanation,
    scales: &Scales,
    nominal_cost: f64,
    steps: usize,
) -> Option<Explanation> {
    let losing: Vec<usize> = (0..explanation.effects.len()).filter(|&e| explanation.effects[e].effect.loses_commands()).collect();
    if losing.is_empty() {
        return Some(explanation);
    }
    for _ in 0..PASSES {
        let mut lost = Lost {
            sequences: vec![vec![None; problem.system.inputs.len()]; problem.records.len()],
            price: 0.0,
            std: vec![None; problem.system.inputs.len()],
        };
        for &e in &losing {
            let channel = explanation.effects[e].channel.clone();
            let input = problem.system.inputs.iter().position(|p| p.name == channel)?;
            let others: Vec<Applied> = explanation.effects.iter().filter(|a| !a.effect.loses_commands()).cloned().collect();
            let before = explanation.effects[e].values[0];
            let given = if explanation.lost.is_some() { before.clamp(0.01, 0.9) } else { FIRST };
            let probability = decode_input(problem, &others, &mut lost, input, given)?;
            explanation.effects[e].values[0] = probability;
        }
        explanation.lost = Some(lost);
        explanation = Explanation::refit(problem, explanation, scales, nominal_cost, steps)?;
    }
    Some(explanation)
}

/// Estimates one input's sequences over all records; the probability of a loss.
fn decode_input(problem: &Problem<'_>, others: &[Applied], lost: &mut Lost, input: usize, probability: f64) -> Option<f64> {
    let (mut decided, mut held) = (0.0_f64, 0.0_f64);
    let decode = |(at, record): (usize, &Record)| {
        let span = record.train.or(record.held)?;
        let acting = Acting { effects: others, lost: Some(lost) };
        let residual = problem.residual(at, &problem.predict_from_posterior(at, acting, span)?);
        let plan = problem.plan(others, Chance::Mean)?;
        let through = |v: f64| static_value(&plan.inputs[input], v);
        let response = response(problem, at, others, input)?;
        let (e, g) = (problem.whiten_whole(at, &residual), problem.filter(at, &response));
        Some((search(&record.inputs[input], &through, &e, &g, probability), g.norm_squared()))
    };
    let paths: Vec<(Path, f64)> = problem.records.par_iter().enumerate().map(decode).collect::<Option<_>>()?;
    for (at, (path, energy)) in paths.into_iter().enumerate() {
        let counts = if problem.records[at].train.is_some() { path.decisions.as_slice() } else { &[] };
        for decision in counts {
            lost.price -= 2.0 * if decision.lost { probability.ln() } else { (1.0 - probability).ln() };
            if decision.difference.powi(2) * energy > DECIDED * DECIDED {
                decided += 1.0;
                held += if decision.lost { 1.0 } else { 0.0 };
            }
        }
        lost.sequences[at][input] = Some(path.lost);
    }
    if decided < 5.0 {
        return None;
    }
    // Laplace's rule keeps the probability off its edges.
    let p = (held + 0.5) / (decided + 1.0);
    lost.std[input] = Some((p * (1.0 - p) / decided).sqrt());
    Some(p)
}

/// What a command becomes at rest on its way: the curve and the maps of the path.
fn static_value(path: &InputPath, value: f64) -> f64 {
    let mut signal = Piecewise::held(&[0.0], [value]);
    if let Some(curve) = path.curve {
        signal = signal.map(|p| (curve.gain * p.value + curve.quadratic * p.value * p.value.abs(), 0.0));
    }
    path.maps.iter().fold(signal, |signal, map| map(signal)).first()
}

/// The outputs' response to one held sample of one unit behind the maps of the path, samples × outputs.
fn response(problem: &Problem<'_>, at: usize, others: &[Applied], input: usize) -> Option<DMatrix<f64>> {
    let record = &problem.records[at];
    let mut plan = problem.plan(others, Chance::Mean)?;
    (plan.inputs[input].curve, plan.inputs[input].maps) = (None, Vec::new());
    let samples = record.time_s.len();
    let place = samples / 4;
    let size = 1e-2 * record.inputs[input].iter().map(|u| u.abs()).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let simulate = |by: f64| {
        let mut inputs = record.inputs.clone();
        inputs[input][place] += by;
        let commands = Commands { time_s: &record.time_s, inputs: &inputs };
        problem.system.simulate(&plan, commands, &problem.system.initial, problem.correction(at)).ok()
    };
    let (up, down) = (simulate(0.5 * size)?.y, simulate(-0.5 * size)?.y);
    let length = LONGEST.min(samples - place);
    let g = (up.rows(place, length) - down.rows(place, length)) / size;
    g.iter().all(|v| v.is_finite()).then_some(g)
}

/// One command that differs from the one in force.
#[derive(Debug, Clone, Copy)]
struct Decision {
    lost: bool,
    /// Between the command and the one in force, behind the maps.
    difference: f64,
}

struct Path {
    lost: Vec<bool>,
    decisions: Vec<Decision>,
}

/// A sequence up to now.
#[derive(Clone)]
struct Hypothesis {
    cost: f64,
    /// The command in force.
    held: f64,
    /// Deviations of the whitened residual that are still to come, a ring of samples × outputs.
    ahead: Vec<f64>,
    /// The last decision, in the list of all.
    last: Option<usize>,
}

/// The most probable sequence: `e` whitened residuals without losses, `g` the whitened response to one held sample (both samples × outputs).
fn search(u: &[f64], through: &dyn Fn(f64) -> f64, e: &DMatrix<f64>, g: &DMatrix<f64>, probability: f64) -> Path {
    let (length, outputs) = g.shape();
    let mut all: Vec<(Option<usize>, usize, Decision)> = Vec::new();
    let mut beam = vec![Hypothesis { cost: 0.0, held: u.first().copied().unwrap_or(0.0), ahead: vec![0.0; length * outputs], last: None }];
    let (pass, lose) = (-2.0 * (1.0 - probability).ln(), -2.0 * probability.ln());
    for (k, &command) in u.iter().enumerate() {
        let slot = k % length;
        let arrived = through(command);
        let mut next: Vec<Hypothesis> = Vec::with_capacity(2 * beam.len());
        for mut h in beam {
            if h.held == command {
                next.push(h);
                continue;
            }
            let difference = through(h.held) - arrived;
            let mut decide = |lost: bool| {
                all.push((h.last, k, Decision { lost, difference }));
                Some(all.len() - 1)
            };
            let (passed, missed) = (decide(false), decide(true));
            let mut other = h.clone();
            (other.cost, other.last) = (h.cost + lose, missed);
            for n in 0..length {
                for i in 0..outputs {
                    other.ahead[((slot + n) % length) * outputs + i] += difference * g[(n, i)];
                }
            }
            next.push(other);
            (h.cost, h.last, h.held) = (h.cost + pass, passed, command);
            next.push(h);
        }
        for h in &mut next {
            for i in 0..outputs {
                let deviation = std::mem::take(&mut h.ahead[slot * outputs + i]);
                // Samples that are missing or outside the span are exactly 0.
                if e[(k, i)] != 0.0 {
                    h.cost += (e[(k, i)] - deviation).powi(2);
                }
            }
        }
        next.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        next.truncate(KEPT);
        beam = next;
    }
    let mut path = Path { lost: vec![false; u.len()], decisions: Vec::new() };
    let mut at = beam.first().and_then(|h| h.last);
    while let Some((before, k, decision)) = at.and_then(|at| all.get(at)) {
        path.lost[*k] = decision.lost;
        path.decisions.push(*decision);
        at = *before;
    }
    path
}
