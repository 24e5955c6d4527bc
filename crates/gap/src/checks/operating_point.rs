//! The operating point: outputs of logs and of the model with a large distance of their mean values.
//!
//! A linear model holds about the point at which it was linearised. A file without that point takes zero for it, and every level of the machine becomes an error.
//!
//! How it can be wrong: an output that moves little about a missed offset has the same signature where the offset alone is wrong. The finding reports both
//! levels, which are true. A predictor follows every level, and a declared nuisance takes a constant up: there the check is undecided.

use nalgebra::DMatrix;

use super::evidence::{ALL, result, short};
use super::moments::{deviation, mean};
use crate::format::diagnosis::{Check, CheckKind};
use crate::input::record::LogRecord;
use deadtime_model::simulate::System;

/// The mean values differ by this many times the common motion of output and model. A constant offset of a sensor or of an input is rarely as large as the
/// measured motion.
const APART: f64 = 3.0;

/// The levels of an output.
pub(crate) struct Levels {
    pub(crate) output: usize,
    /// Means of the samples that are trained on, measured and modelled, in the output's unit.
    pub(crate) measured: f64,
    pub(crate) modelled: f64,
    /// Standard deviation of both about their means, summed.
    pub(crate) moves: f64,
}

impl Levels {
    /// Both levels in words.
    pub(crate) fn words(&self, system: &System) -> String {
        let name = system.outputs.get(self.output).map_or("", |port| port.name.as_str());
        format!(
            "`{name}` is {} on average where the model gives {}, and both move by {} about that",
            short(self.measured),
            short(self.modelled),
            short(self.moves)
        )
    }
}

/// The outputs with different mean values; `predicted`: samples × outputs of each record, by the nominal model in free run.
pub(crate) fn apart(
    system: &System,
    records: &[LogRecord],
    predicted: &[DMatrix<f64>],
) -> Vec<Levels> {
    let levels = |output: usize| {
        let pairs = records.iter().zip(predicted).flat_map(|(r, model)| {
            (0..model.nrows()).filter_map(move |k| {
                r.measured_in(r.train, output, k).map(|y| (y, model[(k, output)]))
            })
        });
        let (y, m): (Vec<f64>, Vec<f64>) = pairs.unzip();
        let (measured, modelled) = (mean(y.iter().copied()), mean(m.iter().copied()));
        Levels { output, measured, modelled, moves: deviation(&y) + deviation(&m) }
    };
    let far = |l: &Levels| l.moves > 0.0 && (l.measured - l.modelled).abs() > APART * l.moves;
    (0..system.outputs.len()).map(levels).filter(far).collect()
}

/// The check. `predicted`: as for [`apart`]; `None` where the model is not simulated freely or declares nuisances.
pub(super) fn check(
    system: &System,
    records: &[LogRecord],
    predicted: Option<&[DMatrix<f64>]>,
) -> Vec<Check> {
    let kind = CheckKind::OperatingPoint;
    let Some(predicted) = predicted else {
        let why = "undecided: the model is not simulated freely, or takes a constant up itself";
        return vec![result(kind, ALL, None, why)];
    };
    let found = apart(system, records, predicted);
    if found.is_empty() {
        let good = "the level of every output is within what it moves of the model's";
        return vec![result(kind, ALL, Some(true), good)];
    }
    let named = |levels: &Levels| {
        let text = format!(
            "{}: a linear model may hold about another operating point (`operating` of its channels, commands too), or start elsewhere",
            levels.words(system)
        );
        result(kind, &system.outputs[levels.output].name, Some(false), text)
    };
    found.iter().map(named).collect()
}
