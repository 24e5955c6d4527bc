//! Predictions over the windows of a log, for a comparison with the measured outputs.

use super::problem::StructuredProblem;
use super::record::LogRecord;
use super::window::{Buffers, WindowPoint};

/// Records with stored predictions: enough to look at, whatever the number of logs.
pub(super) const RECORDS: usize = 10;

/// One output of one record, measured and predicted. Every window starts at the log's own row; windows do not overlap.
#[derive(Debug, Clone, PartialEq)]
pub struct WindowRun {
    /// The record's file.
    pub source: String,
    /// The output.
    pub output: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Times of the rows, s.
    pub time_s: Vec<f64>,
    /// Measured values, one a row; NaN where missing.
    pub measured: Vec<f64>,
    /// Predictions of the file's model and of the fitted one; NaN outside the windows and at their starts.
    pub predicted: [Vec<f64>; 2],
}

/// Predicted outputs with the file's own values, per record rows × outputs; NaN where no window predicts.
pub(super) fn predictions(problem: &StructuredProblem<'_>) -> Vec<Vec<f64>> {
    let outputs = problem.simulator.equations.output_variables().len();
    let of_record = |record: usize| {
        let measured = &problem.records[record];
        let mut y = vec![f64::NAN; measured.y.len()];
        let p = problem.parameters(record, &vec![0.0; problem.unknowns()]);
        let weights = problem.plain_weights(record);
        let mut buffers = Buffers::default();
        let mut free_from = 0;
        for &start in measured.windows.iter().filter(|start| **start >= problem.reach) {
            if start < free_from {
                continue;
            }
            free_from = start + problem.simulator.horizon;
            let Some(shift) = problem.start_of(record, start, &p, &weights, &mut buffers) else {
                continue;
            };
            let at =
                WindowPoint { p: &p, columns: &[], starts: &problem.starts.states, shift: &shift };
            problem.simulator.walk(measured, start, at, &mut buffers, |seen| {
                let row = (start + seen.horizon) * outputs;
                y[row..row + outputs].copy_from_slice(seen.outputs);
            });
        }
        y
    };
    (0..problem.records.len().min(RECORDS)).map(of_record).collect()
}

/// The predictions of both models with the measured values, output by output.
pub(super) fn paired(
    records: &[LogRecord],
    units: &[(String, Option<String>)],
    step_s: f64,
    [file, fitted]: [&[Vec<f64>]; 2],
) -> Vec<WindowRun> {
    let outputs = units.len();
    let column = |of: &[f64], i: usize| of.iter().skip(i).step_by(outputs).copied().collect();
    let records = records.iter().zip(file.iter().zip(fitted));
    records
        .flat_map(|(record, (before, after))| {
            units.iter().enumerate().map(move |(i, (output, unit))| WindowRun {
                source: record.source.clone(),
                output: output.clone(),
                unit: unit.clone(),
                time_s: (0..record.y.len() / outputs)
                    .map(|k| record.start_s + k as f64 * step_s)
                    .collect(),
                measured: column(&record.y, i),
                predicted: [column(before, i), column(after, i)],
            })
        })
        .collect()
}
