//! Weaknesses of the logs themselves: repeated samples, constant commands, missing outputs.

use super::record::{LogRecord, Span};
use super::subject::Subject;
use crate::format::caveat::Caveat;
use deadtime_log::Log;
use deadtime_model::simulate::{Port, System};
use deadtime_model::whole_turn;

/// Angles that jump by whole turns: declared angles have no turns left.
pub(crate) fn whole_turns(subject: Subject<'_>, logs: &[Log]) -> Vec<Caveat> {
    let times = |port: Port| {
        let turn = whole_turn(port.unit.as_deref())?;
        let times = logs.iter().map(|log| log.whole_turns(&port.name, turn)).sum();
        (times > 0).then_some(Caveat::WholeTurns { channel: port.name, times })
    };
    subject.inputs().into_iter().chain(subject.outputs()).filter_map(times).collect()
}

/// All caveats of these logs.
pub(crate) fn log_caveats(
    system: &System,
    records: &[LogRecord],
    held: &[Option<Span>],
) -> Vec<Caveat> {
    let mut found = Vec::new();
    let same = |a: &LogRecord, b: &LogRecord| {
        a.time_s == b.time_s && a.inputs == b.inputs && a.measured == b.measured
    };
    for (at, record) in records.iter().enumerate() {
        let Some(twin) = records[..at].iter().find(|r| same(r, record)) else { continue };
        let (first, second) = (twin.name.clone(), record.name.clone());
        found.push(match (twin.train, record.train) {
            (Some(_), None) => Caveat::HeldOutIsTraining { held: second, learnt: first },
            _ => Caveat::Twice { first, second },
        });
    }
    let inside = |span: Option<Span>, r: &LogRecord| {
        (0..r.time_s.len())
            .filter(|&k| span.is_some_and(|s| s.holds(r.time_s[k])))
            .collect::<Vec<_>>()
    };
    for (j, input) in system.inputs.iter().enumerate() {
        // A separate constant in each log is no motion either: nothing happens after the start.
        #[allow(clippy::float_cmp)]
        let still = |r: &LogRecord| {
            let values: Vec<f64> = inside(r.train, r).into_iter().map(|k| r.inputs[j][k]).collect();
            values.windows(2).all(|w| w[0] == w[1])
        };
        if records.iter().all(still) {
            found.push(Caveat::ConstantInput { input: input.name.clone() });
        }
    }
    for (i, output) in system.outputs.iter().enumerate() {
        let nothing = |(r, span): (&LogRecord, Option<Span>)| {
            inside(span, r).into_iter().all(|k| r.measured[i].get(k).is_none())
        };
        if records.iter().map(|r| (r, r.train)).all(nothing) {
            found.push(Caveat::NothingToLearn { output: output.name.clone() });
        }
        if records.iter().zip(held.iter().copied()).all(nothing) {
            found.push(Caveat::NothingHeldOut { output: output.name.clone() });
        }
    }
    found
}
