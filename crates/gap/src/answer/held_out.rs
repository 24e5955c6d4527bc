//! The held-out part of the logs. Its samples are visible in the parent module alone, which writes the report; the compiler denies them to every selection step.

use nalgebra::DMatrix;

use crate::format::diagnosis::Holdout;
use crate::input::record::{LogRecord, Span};
use crate::likelihood::errors::Errors;

/// All logs, training logs first, with the held-out span of each.
#[derive(Debug, Clone)]
pub(crate) struct HeldOut {
    records: Vec<LogRecord>,
    spans: Vec<Option<Span>>,
}

impl HeldOut {
    /// Of records, in their order.
    pub(crate) fn new(records: Vec<LogRecord>, spans: Vec<Option<Span>>) -> Self {
        Self { records, spans }
    }

    /// All logs with all of their samples.
    pub(in crate::answer) fn records(&self) -> &[LogRecord] {
        &self.records
    }

    /// Per record, its held-out span.
    pub(in crate::answer) fn spans(&self) -> &[Option<Span>] {
        &self.spans
    }

    /// The held-out span of a record.
    pub(crate) fn span(&self, record: usize) -> Option<Span> {
        self.spans.get(record).copied().flatten()
    }

    /// Of residuals, one matrix per record (samples × outputs).
    pub(crate) fn errors(&self, records: &[LogRecord], residuals: &[DMatrix<f64>]) -> Errors {
        Errors::inside(records, residuals, &self.spans)
    }

    /// The spans by name.
    pub(crate) fn listed(&self) -> Vec<Holdout> {
        let one = |(record, span): (&LogRecord, &Option<Span>)| {
            let span = (*span)?;
            Some(Holdout { log: record.name.clone(), from_s: span.from_s, to_s: span.to_s })
        };
        self.records.iter().zip(&self.spans).filter_map(one).collect()
    }
}
