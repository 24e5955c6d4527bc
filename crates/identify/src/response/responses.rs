//! Estimated frequency responses.

use super::lines::{Line, Point, Seen};
use crate::error::IdentifyError;
use crate::subspace::recordings::{Named, Recordings};
use deadtime_signal::time::SampleTime;

/// A method that estimates frequency responses; the implementor is its option struct.
pub trait ResponseMethod: Send + Sync {
    /// G and its noise at each line that the inputs excite, above 0 and below the Nyquist frequency.
    ///
    /// # Errors
    /// [`IdentifyError`] for records too short, inputs without excitation or collinear ones, options out of their range.
    fn lines(&self, recordings: &Recordings) -> std::result::Result<Seen, IdentifyError>;
}

/// Frequency responses of m inputs and l outputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Responses {
    /// The method's name.
    pub method: &'static str,
    /// The sample time.
    pub sample_time: SampleTime,
    /// The inputs.
    pub inputs: Vec<Named>,
    /// The outputs.
    pub outputs: Vec<Named>,
    /// The references of a loop; empty: the inputs are assumed independent of the outputs' noise.
    pub references: Vec<Named>,
    /// Samples of all records.
    pub samples: usize,
    /// By increasing frequency; lines without input excitation are absent.
    pub lines: Vec<Line>,
    /// Notes to report, one sentence each.
    pub notes: Vec<String>,
}

impl Responses {
    /// The response from one input to one output.
    #[must_use]
    pub fn pair(&self, output: usize, input: usize) -> Vec<Point> {
        self.lines.iter().filter_map(|line| line.point(output, input)).collect()
    }
}

pub(super) fn of(
    method: &'static str,
    recordings: Recordings,
    seen: Seen,
    references: Vec<Named>,
) -> Responses {
    let samples = recordings.samples();
    let Recordings { sample_time, inputs, outputs, .. } = recordings;
    Responses {
        method,
        sample_time,
        inputs,
        outputs,
        references,
        samples,
        lines: seen.lines,
        notes: seen.notes,
    }
}

/// Why no line has a result: collinear or constant inputs.
pub(super) fn unexcited(recordings: &Recordings) -> IdentifyError {
    let names: Vec<&str> = recordings.inputs.iter().map(|n| n.name.as_str()).collect();
    match names.split_last() {
        Some((last, others)) if !others.is_empty() => {
            IdentifyError::Collinear { channel: (*last).to_owned(), others: others.join(", ") }
        }
        _ => IdentifyError::NotExcited { inputs: names.join(", ") },
    }
}
