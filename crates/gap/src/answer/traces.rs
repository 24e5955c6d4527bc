//! The measured outputs, and the model's outputs with and without the reported effects: the curves of a diagnosis.

use nalgebra::DMatrix;

use super::held_out::HeldOut;
use crate::input::record::{LogRecord, Span};
use crate::likelihood::active_effects::{ActiveEffects, NO_EFFECT};
use crate::likelihood::gaussian::Likelihood;

/// One output of one log.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// The log.
    pub log: String,
    /// The output.
    pub output: String,
    /// Its unit, where the model gives one.
    pub unit: Option<String>,
    /// Time from the log's first sample, s.
    pub time_s: Vec<f64>,
    /// The measurement; missing samples are `None`. In the output's unit, as are all below.
    pub measured: Vec<Option<f64>>,
    /// The model's prediction.
    pub before: Vec<f64>,
    /// The prediction with the effects that were found; `None` where none was.
    pub after: Option<Vec<f64>>,
    /// The training span, s.
    pub train: Option<[f64; 2]>,
    /// The held-out span, s.
    pub held: Option<[f64; 2]>,
    /// Standard deviation of the part that no deterministic model can explain.
    pub floor: f64,
}

/// One command of one log, at the times of the log's [`Trace`]s.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandTrace {
    /// The log.
    pub log: String,
    /// The input.
    pub input: String,
    /// Its unit, where the model gives one.
    pub unit: Option<String>,
    /// As logged, in the input's unit.
    pub values: Vec<f64>,
}

/// All inputs of all logs, by log and then by input.
pub(crate) fn command_traces(likelihood: &Likelihood<'_>) -> Vec<CommandTrace> {
    let of = |record: &LogRecord| {
        let inputs = likelihood.system.inputs.iter().zip(&record.inputs);
        inputs
            .map(|(input, values)| CommandTrace {
                log: record.name.clone(),
                input: input.name.clone(),
                unit: input.unit.clone(),
                values: values.clone(),
            })
            .collect::<Vec<_>>()
    };
    likelihood.records.iter().flat_map(of).collect()
}

/// All outputs of all logs, by output and then by log; `floor` holds one standard deviation per output. Empty where a simulation fails.
pub(crate) fn traces(
    likelihood: &Likelihood<'_>,
    held_out: &HeldOut,
    found: Option<ActiveEffects<'_>>,
    floor: &[f64],
) -> Vec<Trace> {
    let predictions = |active: ActiveEffects<'_>| -> Option<Vec<DMatrix<f64>>> {
        let records = likelihood.records.iter().enumerate();
        records
            .map(|(at, record)| {
                likelihood.predict_from_posterior(at, active, record.estimated_from()?)
            })
            .collect()
    };
    let Some(before) = predictions(NO_EFFECT) else { return Vec::new() };
    let after = found.and_then(predictions);
    let column = |y: &DMatrix<f64>, i: usize| y.column(i).iter().copied().collect::<Vec<f64>>();
    let span = |s: Option<Span>| s.map(|s| [s.from_s, s.to_s]);
    let trace = |i: usize, at: usize| {
        let (record, output) = (&likelihood.records[at], &likelihood.system.outputs[i]);
        Trace {
            log: record.name.clone(),
            output: output.name.clone(),
            unit: output.unit.clone(),
            time_s: record.time_s.clone(),
            measured: (0..record.time_s.len()).map(|k| record.measured[i].get(k)).collect(),
            before: column(&before[at], i),
            after: after.as_ref().map(|y| column(&y[at], i)),
            train: span(record.train),
            held: span(held_out.span(at)),
            floor: floor.get(i).copied().unwrap_or(0.0),
        }
    };
    (0..likelihood.system.outputs.len())
        .flat_map(|i| (0..likelihood.records.len()).map(move |at| (i, at)))
        .map(|(i, at)| trace(i, at))
        .collect()
}
