//! What a diagnosis can be made of, but a reader has to know.

use nalgebra::DMatrix;

use super::GapError;
use super::data::{Record, Span};
use crate::simulate::System;

/// A free run this many times further off than the output ever moves is no simulation of it. Units that differ by a million are still compared.
const EXPLODES: f64 = 1e9;

/// Something that weakens a diagnosis, as a sentence.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Caveat {
    /// A held-out log with the samples of a training log.
    #[error(
        "{held} holds the same samples as {learnt}, which was learnt from: the shrink is not measured on unseen data; hold out another log"
    )]
    HeldOutIsTraining {
        /// The held-out log.
        held: String,
        /// The training log.
        learnt: String,
    },
    /// Two training logs with the same samples.
    #[error("{second} holds the same samples as {first}: they count twice, and the intervals are too narrow; leave one out")]
    Twice {
        /// The first of them.
        first: String,
        /// The other.
        second: String,
    },
    /// A command that never changes in what is learnt from.
    #[error("`{input}` never changes in what is learnt from: nothing that acts on it can be seen; record a log in which it moves")]
    ConstantInput {
        /// The input.
        input: String,
    },
    /// An output without a sample in what is learnt from.
    #[error("`{output}` has no sample in what is learnt from: nothing is said of it")]
    NothingToLearn {
        /// The output.
        output: String,
    },
    /// Calls of a simulator failed; the rivals that made them are out of the race.
    #[error("the simulator failed in {failed} of {calls} calls, and what asked for them was given up; the last time: {why}")]
    SimulatorFailed {
        /// Calls that failed.
        failed: usize,
        /// All calls.
        calls: usize,
        /// The last failure.
        why: String,
    },
    /// No output of a simulator depends on an input.
    #[error("no output of the simulator depends on `{input}`: effects on it were not tried")]
    InputMovesNothing {
        /// The input.
        input: String,
    },
    /// No output of a simulator depends on a parameter.
    #[error(
        "a tenth more or less of the parameter `{parameter}` moves no output: the simulator does not apply it, or these logs do not show it"
    )]
    ParameterMovesNothing {
        /// The parameter.
        parameter: String,
    },
    /// No output of a simulator depends on a start.
    #[error("no output of the simulator depends on the start of `{state}`: it counts as exactly known")]
    StartMovesNothing {
        /// The state.
        state: String,
    },
    /// A simulator whose start nobody named.
    #[error(
        "no state of the simulator is named: every log is taken to start exactly as the simulator does; a start that is off passes for an effect"
    )]
    NoStart,
    /// A simulator that remembers its start to the end of a log.
    #[error(
        "of a push at the start {left} is left at the end of the log: the simulator integrates, and what is a little off at first stays so{}",
        if *started { "" } else { "; name its states with their uncertainty" }
    )]
    NeverForgets {
        /// What is left.
        left: String,
        /// Starts are named.
        started: bool,
    },
    /// An unstable simulator.
    #[error(
        "what a push at the start does grows {factor}-fold over the log: the simulator is unstable there, and small causes pass for large ones; close the loop inside it, or cut the logs into shorter ones"
    )]
    Grows {
        /// By how much.
        factor: String,
    },
    /// A simulator that answers next to nothing with something.
    #[error(
        "a change of the inputs by 1e-10 moves `{output}` by {percent} % of its motion: the simulator is rough or chaotic, and no effect smaller than that can be told"
    )]
    Rough {
        /// The output.
        output: String,
        /// By how much.
        percent: String,
    },
    /// Something is left that effects on equations might explain, which a black box does not let anyone try.
    #[error(
        "what was found leaves {times} times the noise, and effects on equations (friction, drag and the like) could not be tried: one of them may be the cause instead; name them as parameters of the simulator, or diagnose a model in equations"
    )]
    Incomplete {
        /// The residual over the floor.
        times: String,
    },
    /// Something is left beside what was found.
    #[error("beside what was found {times} times the noise floor is left of `{output}`: the simulator differs in something else, too")]
    Rest {
        /// The residual over the floor.
        times: String,
        /// The output on which the verdict was decided.
        output: String,
    },
    /// An output without a sample in what is held out.
    #[error("`{output}` has no sample in what is held out: how far its gap shrinks is not known")]
    NothingHeldOut {
        /// The output.
        output: String,
    },
}

/// All caveats of these logs.
pub(super) fn caveats(system: &System, records: &[Record]) -> Vec<Caveat> {
    let mut found = Vec::new();
    let same = |a: &Record, b: &Record| a.time_s == b.time_s && a.inputs == b.inputs && a.measured == b.measured;
    for (at, record) in records.iter().enumerate() {
        let Some(twin) = records[..at].iter().find(|r| same(r, record)) else { continue };
        let (first, second) = (twin.name.clone(), record.name.clone());
        found.push(match (twin.train, record.train) {
            (Some(_), None) => Caveat::HeldOutIsTraining { held: second, learnt: first },
            _ => Caveat::Twice { first, second },
        });
    }
    let inside =
        |span: Option<Span>, r: &Record| (0..r.time_s.len()).filter(|&k| span.is_some_and(|s| s.holds(r.time_s[k]))).collect::<Vec<_>>();
    for (j, input) in system.inputs.iter().enumerate() {
        // A level of its own in each log is no movement either: nothing happens after the start.
        #[allow(clippy::float_cmp)]
        let still = |r: &Record| {
            let values: Vec<f64> = inside(r.train, r).into_iter().map(|k| r.inputs[j][k]).collect();
            values.windows(2).all(|w| w[0] == w[1])
        };
        if records.iter().all(still) {
            found.push(Caveat::ConstantInput { input: input.name.clone() });
        }
    }
    for (i, output) in system.outputs.iter().enumerate() {
        let none = |span: &dyn Fn(&Record) -> Option<Span>| {
            records.iter().all(|r| inside(span(r), r).into_iter().all(|k| r.measured[i].get(k).is_none()))
        };
        if none(&|r| r.train) {
            found.push(Caveat::NothingToLearn { output: output.name.clone() });
        }
        if none(&|r| r.held) {
            found.push(Caveat::NothingHeldOut { output: output.name.clone() });
        }
    }
    found
}

/// Refuses a model whose predictions leave all bounds, from its residuals on the logs (samples × outputs, one matrix per log).
///
/// # Errors
/// [`GapError::Nominal`] with the output and the factor.
pub(super) fn must_not_explode(system: &System, records: &[Record], residuals: &[DMatrix<f64>]) -> Result<(), GapError> {
    for (i, output) in system.outputs.iter().enumerate() {
        let measured = |r: &Record| (0..r.time_s.len()).filter_map(|k| r.measured[i].get(k)).collect::<Vec<f64>>();
        let size = records.iter().flat_map(measured).map(f64::abs).fold(0.0, f64::max);
        for (record, residual) in records.iter().zip(residuals) {
            let off = residual.column(i).iter().map(|e| e.abs()).fold(0.0, f64::max);
            if size > 0.0 && off > EXPLODES * size {
                let why = format!(
                    "its `{}` runs away, to {:.0e} times what was measured; check parameters and start, or leave the prediction mode to the program",
                    output.name,
                    off / size
                );
                return Err(GapError::Nominal { log: record.name.clone(), why });
            }
        }
    }
    Ok(())
}
