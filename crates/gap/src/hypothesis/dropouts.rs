//! The lost commands: their latent sequence, estimated from the outputs.
//!
//! A lost command leaves the last one that arrived in force. To first order every such difference δ adds δ·g to the residual, g being the response to one held
//! sample. A search through the sequences keeps the most probable ones (the M-algorithm; Anderson and Mohan 1984, doi:10.1109/TCOM.1984.1096023). The best is
//! then simulated exactly, and its likelihood is charged with the probability of its decisions.
//!
//! How it can be wrong: a change of a command below the noise gives no decision, so the loss probability is estimated from the others. A nonlinear plant's
//! response varies, so the exact simulation decides. Lost commands fit a misfit of another kind in part only, and the misfit stays above the floor.

use super::arrivals;
use super::direction::with;
use super::effects::{Dropouts, Hypothesis};
use super::response::{response, static_value};
use super::sequence::{Decision, Path, search};
use super::waits::{Bursts, Wait};
use crate::input::record::LogRecord;
use crate::likelihood::active_effects::ActiveEffects;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Applied, Chance, Fates, Lateness, Scales};
use deadtime_signal::parallel;

/// The probability with which a search begins.
const FIRST: f64 = 0.3;

/// The hypothesis with the sequence of its lost commands estimated and its other parameters refitted. Unchanged where it has no sequence, `None` where no
/// decision is possible.
pub(crate) fn decoded(
    likelihood: &Likelihood<'_>,
    mut hypothesis: Hypothesis,
    scales: &Scales,
    nominal_cost: f64,
    steps: usize,
) -> Option<Hypothesis> {
    let losing: Vec<usize> = (0..hypothesis.effects.len())
        .filter(|&e| hypothesis.effects[e].effect.loses_commands())
        .collect();
    if losing.is_empty() {
        return Some(hypothesis);
    }
    for _ in 0..likelihood.budget.passes {
        let mut lost = Dropouts::none(likelihood);
        for &e in &losing {
            let channel = hypothesis.effects[e].channel.clone();
            let input = likelihood.system.inputs.iter().position(|p| p.name == channel)?;
            let others: Vec<Applied> =
                hypothesis.effects.iter().filter(|a| !a.effect.loses_commands()).cloned().collect();
            if hypothesis.effects[e].effect.lateness() == Some(Lateness::Random) {
                if let Some(known) = &hypothesis.lost {
                    known
                        .sequences
                        .iter()
                        .zip(&mut lost.sequences)
                        .for_each(|(from, to)| to[input].clone_from(&from[input]));
                }
                hypothesis.effects[e] = arrivals::decode(
                    likelihood,
                    &others,
                    &hypothesis.effects[e],
                    input,
                    &mut lost,
                )?;
                continue;
            }
            let before = hypothesis.effects[e].values[0];
            let given = if hypothesis.lost.is_some() { before.clamp(0.01, 0.9) } else { FIRST };
            let found = decode_input(likelihood, &others, &mut lost, input, given)?;
            hypothesis.effects[e] = with(&hypothesis.effects[e], &found);
        }
        hypothesis.lost = Some(lost);
        hypothesis = Hypothesis::refit(likelihood, hypothesis, scales, nominal_cost, steps)?;
    }
    Some(hypothesis)
}

/// Estimates one input's sequences over all records; the probability of a loss, and its mean length, infinite where chance alone makes it.
fn decode_input(
    likelihood: &Likelihood<'_>,
    others: &[Applied],
    lost: &mut Dropouts,
    input: usize,
    probability: f64,
) -> Option<[f64; 2]> {
    let decode = |at| sequence(likelihood, others, lost, (at, input), probability);
    let paths: Vec<(Path, f64)> = parallel::try_map(0..likelihood.records.len(), decode)?;
    let mut evidence = Evidence::default();
    for (at, (path, energy)) in paths.into_iter().enumerate() {
        let record = &likelihood.records[at];
        if record.train.is_some() {
            for decision in &path.decisions {
                lost.price -=
                    2.0 * if decision.lost { probability.ln() } else { (1.0 - probability).ln() };
            }
            let shows = |decision: &Decision| {
                decision.difference.powi(2) * energy > likelihood.criteria.decided.powi(2)
            };
            evidence.add(record, &path.decisions, shows, &mut lost.waits[input]);
        }
        lost.sequences[at][input] = Some(Fates::Missing(path.lost));
    }
    let Evidence { decided, held, cut } = evidence;
    if decided < likelihood.criteria.decisions {
        return None;
    }
    // Laplace's rule keeps the probability off its edges.
    let p = (held + 0.5) / (decided + 1.0);
    let Some(Bursts { losses, std }) = Bursts::of(&lost.waits[input], &cut) else {
        lost.std[input] = vec![(p * (1.0 - p) / decided).sqrt()];
        return Some([p, f64::INFINITY]);
    };
    lost.std[input] = std.to_vec();
    Some([losses.probability, losses.burst.unwrap_or(f64::INFINITY)])
}

/// The most probable sequence of one input over one record, and the energy of the response to one held sample.
fn sequence(
    likelihood: &Likelihood<'_>,
    others: &[Applied],
    lost: &Dropouts,
    (at, input): (usize, usize),
    probability: f64,
) -> Option<(Path, f64)> {
    let record = &likelihood.records[at];
    let span = record.estimated_from()?;
    let active = ActiveEffects { effects: others, lost: Some(&lost.sequences) };
    let residual = likelihood.residual(at, &likelihood.predict_from_posterior(at, active, span)?);
    let plan = likelihood.plan(others, Chance::Mean)?;
    let through = |v: f64| static_value(&plan.inputs[input], v);
    let response = response(likelihood, at, others, input)?;
    let (e, g) = (likelihood.whiten_whole(at, &residual), likelihood.filter(at, &response));
    let kept = likelihood.budget.sequences;
    let path = search(&record.inputs[input], &through, &e, &g, probability, kept);
    Some((path, g.norm_squared()))
}

/// The evidence of decisions on losses.
#[derive(Default)]
struct Evidence {
    /// The number of decisions that show, and of the losses among them.
    decided: f64,
    held: f64,
    /// Losses whose end does not show.
    cut: Vec<Wait>,
}

impl Evidence {
    /// Adds the decisions on one record, in the order of time; `waits`: those of commands that show.
    fn add(
        &mut self,
        record: &LogRecord,
        decisions: &[Decision],
        shows: impl Fn(&Decision) -> bool,
        waits: &mut Vec<Wait>,
    ) {
        let (mut wait, mut sent): (usize, Option<usize>) = (0, None);
        // Samples since a command was seen to arrive.
        let mut rested: Option<usize> = None;
        for decision in decisions {
            let shows = shows(decision);
            if shows {
                self.decided += 1.0;
                self.held += if decision.lost { 1.0 } else { 0.0 };
            }
            if shows && decision.lost {
                sent = sent.or(Some(decision.sample));
                wait += 1;
                continue;
            }
            let sent_s = record.time_s[sent.unwrap_or(decision.sample)];
            let this = Wait { sent_s, samples: wait, rested, sample_time_s: record.sample_time_s };
            match (shows, wait) {
                (true, _) => waits.push(this),
                (false, 0) => {}
                (false, _) => self.cut.push(this),
            }
            rested = if shows { Some(0) } else { rested.map(|samples| samples + 1) };
            (wait, sent) = (0, None);
        }
        if let Some(sent_s) = sent.map(|at| record.time_s[at]) {
            let sample_time_s = record.sample_time_s;
            self.cut.push(Wait { sent_s, samples: wait, rested, sample_time_s });
        }
    }
}
