//! Normalised errors of outputs.

use nalgebra::DMatrix;

use crate::input::record::{LogRecord, Span};
use deadtime_signal::stats;

/// Sums of squared errors and of squared deviations of the measurement, per output.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Errors {
    squares: Vec<f64>,
    /// Σ (y − mean)².
    pub(crate) deviations: Vec<f64>,
    count: Vec<f64>,
}

impl Errors {
    /// Of residuals on the training spans.
    pub(crate) fn trained(records: &[LogRecord], residuals: &[DMatrix<f64>]) -> Self {
        let spans: Vec<Option<Span>> = records.iter().map(|r| r.train).collect();
        Self::inside(records, residuals, &spans)
    }

    /// Of residuals inside the spans, one per record.
    pub(crate) fn inside(
        records: &[LogRecord],
        residuals: &[DMatrix<f64>],
        spans: &[Option<Span>],
    ) -> Self {
        let outputs = records.first().map_or(0, |r| r.measured.len());
        let mut errors = Self {
            squares: vec![0.0; outputs],
            deviations: vec![0.0; outputs],
            count: vec![0.0; outputs],
        };
        for i in 0..outputs {
            for ((record, residual), span) in records.iter().zip(residuals).zip(spans) {
                let inside: Vec<(f64, f64)> = (0..record.time_s.len())
                    .filter_map(|k| Some((record.measured_in(*span, i, k)?, residual[(k, i)])))
                    .collect();
                let count = inside.len() as f64;
                let mean = stats::mean(inside.iter().map(|v| v.0)).unwrap_or(0.0);
                errors.squares[i] += inside.iter().map(|v| v.1 * v.1).sum::<f64>();
                errors.deviations[i] += inside.iter().map(|v| (v.0 - mean).powi(2)).sum::<f64>();
                errors.count[i] += count;
            }
        }
        errors
    }

    /// Of residuals so many times as large.
    pub(crate) fn times(mut self, factor: f64) -> Self {
        self.squares.iter_mut().for_each(|s| *s *= factor * factor);
        self
    }

    /// Root of the mean squared error, per output.
    pub(crate) fn rms(&self) -> Vec<f64> {
        self.squares.iter().zip(&self.count).map(|(e, n)| (e / n.max(1.0)).sqrt()).collect()
    }

    /// Mean squared error over that of others, every output counting alike.
    pub(crate) fn over(&self, others: &Self) -> f64 {
        let parts: Vec<f64> = self
            .rms()
            .iter()
            .zip(others.rms())
            .filter(|(_, o)| *o > 0.0)
            .map(|(e, o)| (e / o).powi(2))
            .collect();
        parts.iter().sum::<f64>() / parts.len().max(1) as f64
    }

    /// The largest factor by which the rms of an output falls from these to others.
    pub(crate) fn largest_fall(&self, after: &Self) -> f64 {
        let each = self.nrmse().into_iter().zip(after.nrmse());
        each.filter_map(|(before, after)| Some(before? / after?)).fold(0.0, f64::max)
    }

    /// Per output; `None` where it is constant.
    pub(crate) fn nrmse(&self) -> Vec<Option<f64>> {
        self.squares
            .iter()
            .zip(&self.deviations)
            .map(|(e, d)| (*d > 0.0).then(|| (e / d).sqrt()))
            .collect()
    }

    /// A standard deviation of each output's error as nrmse.
    pub(crate) fn relative(&self, std: &[f64]) -> Vec<Option<f64>> {
        let parts = std.iter().zip(&self.deviations).zip(&self.count);
        parts.map(|((s, d), n)| (*d > 0.0).then(|| s * (n / d).sqrt())).collect()
    }
}

/// The rms of the outputs' numbers; `None` where there is none.
pub(crate) fn overall(outputs: &[Option<f64>]) -> Option<f64> {
    let known: Vec<f64> = outputs.iter().flatten().copied().collect();
    let count = known.len() as f64;
    (count > 0.0).then(|| (known.iter().map(|v| v * v).sum::<f64>() / count).sqrt())
}

/// The explained share of the explainable part, from errors before and after a hypothesis; `None` where nothing is explainable.
pub(crate) fn explained(before: f64, after: f64, floor: f64) -> Option<f64> {
    (before > floor).then(|| (before * before - after * after) / (before * before - floor * floor))
}
