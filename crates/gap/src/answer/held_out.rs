//! The held-out part of the logs: what the report measures, and nothing that selects has at hand.

use nalgebra::DMatrix;

use crate::format::diagnosis::Holdout;
use crate::input::record::{LogRecord, Span};
use crate::likelihood::errors::Errors;

/// Per record, the held-out span.
#[derive(Debug, Clone)]
pub(crate) struct HeldOut {
    spans: Vec<Option<Span>>,
}

impl HeldOut {
    /// Of records, in their order.
    pub(crate) fn new(spans: Vec<Option<Span>>) -> Self {
        Self { spans }
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
    pub(crate) fn listed(&self, records: &[LogRecord]) -> Vec<Holdout> {
        let one = |(record, span): (&LogRecord, &Option<Span>)| {
            let span = (*span)?;
            Some(Holdout { log: record.name.clone(), from_s: span.from_s, to_s: span.to_s })
        };
        records.iter().zip(&self.spans).filter_map(one).collect()
    }
}
