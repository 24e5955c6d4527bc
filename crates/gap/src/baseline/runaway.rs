//! A nominal model whose predictions leave all bounds is no model of the log.

use nalgebra::DMatrix;

use crate::format::error::GapError;
use crate::input::record::LogRecord;
use deadtime_model::simulate::System;

/// A free run this many times further off than the output ever moves is no simulation of it. Units that differ by a million are still compared.
const EXPLODES: f64 = 1e9;

/// Refuses a model whose predictions leave all bounds, from its residuals on the logs (samples × outputs, one matrix per log).
///
/// # Errors
/// [`GapError::Nominal`] with the output and the factor.
pub(crate) fn must_not_explode(
    system: &System,
    records: &[LogRecord],
    residuals: &[DMatrix<f64>],
) -> Result<(), GapError> {
    for (i, output) in system.outputs.iter().enumerate() {
        let measured = |r: &LogRecord| {
            (0..r.time_s.len()).filter_map(|k| r.measured[i].get(k)).collect::<Vec<f64>>()
        };
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
