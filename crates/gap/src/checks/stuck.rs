//! A channel that repeats its value although everything else moves.

use super::evidence::{ALL, Evidence, result, short};
use super::moments::deviation;
use super::runs::{Stretch, Trace};
use crate::format::diagnosis::{Check, CheckKind};
use deadtime_signal::remedy::{Message, Remedy};

/// Shorter stretches are not tested, samples.
const SHORTEST: usize = 10;
/// Chance of a false alarm in one channel, were repetitions independent.
const CHANCE: f64 = 1e-6;
/// The required motion of the other signals during the stretch, as a part of their whole motion.
const MOVES: f64 = 0.3;
/// A channel that repeats more often than this elsewhere may be constant for a reason: coarse steps, friction, a command of steps.
const RARELY: f64 = 0.3;
/// A stretch at the start is a machine at rest unless it covers this part of the log.
const MOST: f64 = 0.5;

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let mut found = Vec::new();
    for i in 0..e.view.outputs() {
        for (at, record) in e.view.records.iter().enumerate() {
            let trace = Trace::output(record, i);
            let others = |span: std::ops::Range<usize>| e.moves(at, span, Some(i));
            if let Some(check) = judge(&trace, e.output(i), others, false) {
                found.push(check);
                break;
            }
        }
    }
    for (j, port) in e.view.system.inputs.iter().enumerate() {
        for (at, record) in e.view.records.iter().enumerate() {
            let trace = Trace::input(record, j);
            let others = |span: std::ops::Range<usize>| e.outputs_move(at, span);
            if let Some(check) = judge(&trace, &port.name, others, true) {
                found.push(check);
                break;
            }
        }
    }
    if found.is_empty() {
        found.push(result(
            CheckKind::Stuck,
            ALL,
            Some(true),
            "no channel stops while the rest moves".to_owned(),
        ));
    }
    found
}

fn judge(
    trace: &Trace<'_>,
    name: &str,
    others_move: impl Fn(std::ops::Range<usize>) -> bool,
    command: bool,
) -> Option<Check> {
    let run = trace.longest().filter(|r| r.len() >= SHORTEST)?;
    let count = trace.values.len();
    let value = *trace.values.get(run.from)?;
    let whole = run.len() == count;
    let most = run.len() as f64 >= MOST * count as f64;
    // A limit is clipping, not sticking; a command may rest at 0 and where it began; a machine may rest at the start.
    let limit = !whole && (value == trace.smallest() || value == trace.largest());
    let rest = command && (value == 0.0 || Some(&value) == trace.values.first());
    if limit || rest || (run.from == 0 && !most) || (command && whole) {
        return None;
    }
    let repeats = trace.repeats(|k| k < run.from || k >= run.to);
    let needed =
        (CHANCE.ln() - (count as f64).ln()) / repeats.max(1.0 / count as f64).min(1.0 - 1e-9).ln();
    if (run.len() as f64) < needed && !whole || !others_move(trace.span(run)) {
        return None;
    }
    if command && repeats > RARELY {
        return None;
    }
    Some(finding(trace, run, name, value, repeats, command))
}

fn finding(
    trace: &Trace<'_>,
    run: Stretch,
    name: &str,
    value: f64,
    repeats: f64,
    command: bool,
) -> Check {
    let (from_s, to_s) = (trace.time_s(run.from), trace.time_s(run.to - 1));
    let place = format!("from {from_s:.2} s to {to_s:.2} s of {}", trace.record.name);
    if run.len() == trace.values.len() {
        let finding = format!(
            "`{name}` is {} throughout {} while the rest moves: a dead sensor or the wrong column",
            short(value),
            trace.record.name
        );
        return result(CheckKind::Stuck, name, Some(false), finding);
    }
    if command {
        let finding = format!(
            "`{name}` holds {} {place}, elsewhere it changes with nearly every sample: so commanded, or a logger that stopped",
            short(value)
        );
        return result(CheckKind::Stuck, name, None, finding);
    }
    if repeats > RARELY {
        let finding = format!(
            "`{name}` stays at {} {place} while the rest moves; it often repeats, so it may be stuck or be held by friction",
            short(value)
        );
        return result(CheckKind::Stuck, name, None, finding);
    }
    let finding = format!(
        "`{name}` repeats {} exactly {} times, {place}, while the rest moves: a sensor or a logger that stopped; cut it out (",
        short(value),
        run.len()
    );
    let finding = Message::from(finding).and(Remedy::Window).and(") or leave these cells empty");
    result(CheckKind::Stuck, name, Some(false), finding)
}

impl Evidence<'_> {
    /// The cause of an output's motion moves in a stretch of a log: its model, or without one a command or another output.
    fn moves(&self, at: usize, span: std::ops::Range<usize>, output: Option<usize>) -> bool {
        let record = self.view.records[at];
        let enough = |values: &[f64]| {
            values.get(span.clone()).is_some_and(|part| {
                deviation(part) > MOVES * deviation(values) && deviation(part) > 0.0
            })
        };
        let model = self.search.as_ref().filter(|_| !self.view.predicts()).zip(output);
        match model {
            Some((search, i)) => enough(&search.modelled[at][i]),
            None => record.inputs.iter().any(|u| enough(u)),
        }
    }

    fn outputs_move(&self, at: usize, span: std::ops::Range<usize>) -> bool {
        let record = self.view.records[at];
        record.measured.iter().any(|m| {
            m.present.is_none()
                && m.values.get(span.clone()).is_some_and(|part| {
                    deviation(part) > MOVES * deviation(&m.values) && deviation(part) > 0.0
                })
        })
    }
}
