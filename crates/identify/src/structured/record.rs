//! Logs as rows of inputs, outputs and initial states, and the windows in them.

use super::error::StructuredError;
use super::group::Group;
use crate::error::Result;
use deadtime_log::Log;
use deadtime_model::{EquationsFile, GroupKind};

/// A log in the model's order.
#[derive(Debug, Clone)]
pub(super) struct LogRecord {
    pub(super) source: String,
    pub(super) start_s: f64,
    /// Rows × inputs, as logged.
    pub(super) u: Vec<f64>,
    /// Rows × outputs; NaN where missing.
    pub(super) y: Vec<f64>,
    /// Rows × states; NaN where missing or not logged.
    pub(super) x: Vec<f64>,
    /// First rows of the windows.
    pub(super) windows: Vec<usize>,
}

/// The arrangement of windows in a record.
#[derive(Debug, Clone, Copy)]
pub(super) struct WindowLayout {
    pub(super) horizon: usize,
    pub(super) stride: usize,
}

/// A log's columns in the model's order, and the names of the states that it contains.
pub(super) fn record(
    file: &EquationsFile,
    groups: &[Group],
    logged: &[bool],
    log: &Log,
    layout: WindowLayout,
) -> Result<LogRecord> {
    let (rows, names) = (log.len(), |i: usize| file.inputs[i].name.as_str());
    let (m, outputs, n) = (file.inputs.len(), file.outputs.len(), file.states.len());
    let mut u = vec![0.0; rows * m];
    for i in 0..m {
        let values = log.input(names(i))?;
        for (k, value) in values.iter().enumerate().take(rows) {
            u[k * m + i] = *value;
        }
    }
    let fill = |to: &mut Vec<f64>, width: usize, i: usize, name: &str| -> Result<()> {
        let channel = log.output(name)?;
        for k in 0..rows {
            to[k * width + i] = channel.get(k).unwrap_or(f64::NAN);
        }
        Ok(())
    };
    let mut y = vec![f64::NAN; rows * outputs];
    for (i, output) in file.outputs.iter().enumerate() {
        fill(&mut y, outputs, i, &output.name)?;
    }
    let mut x = vec![f64::NAN; rows * n];
    for (i, (name, _)) in file.states.iter().enumerate() {
        if logged[i] {
            fill(&mut x, n, i, name)?;
        }
    }
    for group in groups.iter().filter(|g| g.kind == GroupKind::Attitude) {
        normalise(file, group, logged, &mut x);
    }
    let complete = |k: &usize| (0..n).all(|i| !logged[i] || x[k * n + i].is_finite());
    let windows: Vec<usize> =
        (0..rows.saturating_sub(layout.horizon)).step_by(layout.stride).filter(complete).collect();
    if windows.is_empty() {
        return Err(StructuredError::NoWindow {
            file: log.source().to_owned(),
            horizon: layout.horizon,
            rows,
        }
        .into());
    }
    Ok(LogRecord { source: log.source().to_owned(), start_s: log.time_s()[0], u, y, x, windows })
}

/// Normalises a logged quaternion: its deviation from length 1 is rounding.
fn normalise(file: &EquationsFile, group: &Group, logged: &[bool], x: &mut [f64]) {
    let same = |&i: &usize| file.states.iter().position(|(name, _)| *name == file.outputs[i].name);
    let states: Vec<usize> = group.outputs.iter().filter_map(same).filter(|&i| logged[i]).collect();
    if states.len() != 4 {
        return;
    }
    for row in x.chunks_exact_mut(file.states.len()) {
        let length = states.iter().map(|&i| row[i] * row[i]).sum::<f64>().sqrt();
        states.iter().for_each(|&i| row[i] /= length);
    }
}
