//! Frequency responses from records without a model: one file a method, one line each in [`RESPONSES`].
//!
//! Both methods say at each line ω: y = G·u + v, with G (l × m), the covariance of the noise v (l × l) and how well the inputs are told apart (m × m).
//! From these follow standard deviations, 95 % intervals and coherence alike (`lines`); with a reference, those of a loop (`reference`).

mod lines;
mod lpm;
mod reference;
mod welch;

use serde_json::Value;

pub use lines::{Line, Point, Seen};
pub use lpm::LocalPolynomial;
pub use welch::Welch;

use super::IdentifyError;
use super::subspace::{Named, Recordings};
use crate::error::Result;
use deadtime_log::Log;
use deadtime_signal::registry::{Entry, entry, find};
use deadtime_signal::time::SampleTime;

/// A method that estimates frequency responses; the implementor is its option struct.
pub trait ResponseMethod: Send + Sync {
    /// G and its noise at each line that the inputs excite, above 0 and below the Nyquist frequency.
    ///
    /// # Errors
    /// [`IdentifyError`]: records that are too short, inputs that excite nothing or are combinations of each other, options beyond their range.
    fn lines(&self, recordings: &Recordings) -> std::result::Result<Seen, IdentifyError>;
}

/// Every method.
pub const RESPONSES: &[Entry<dyn ResponseMethod>] = &[
    entry!(
        "lpm",
        "local polynomials of response and transient, with the noise beside them: leakage goes",
        LocalPolynomial,
        dyn ResponseMethod
    ),
    entry!("welch", "averaged spectra of windowed segments, with coherence", Welch, dyn ResponseMethod),
];

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
    /// The references of a loop; none: the inputs are taken for independent of the outputs' noise.
    pub references: Vec<Named>,
    /// Samples of all records.
    pub samples: usize,
    /// By frequency, increasing; what the inputs do not excite is absent.
    pub lines: Vec<Line>,
    /// What a reader must know, a sentence each.
    pub notes: Vec<String>,
}

impl Responses {
    /// The response from one input to one output.
    #[must_use]
    pub fn pair(&self, output: usize, input: usize) -> Vec<Point> {
        self.lines.iter().filter_map(|line| line.point(output, input)).collect()
    }
}

/// Frequency responses from the named inputs to the named outputs by the method of this name.
///
/// Inputs: logs on one even grid, any number of records. `references`: of a closed loop what is fed in from outside, as many as inputs; then
/// G = G_yr·G_ur⁻¹, which feedback of noise does not bias. Source: Pintelon and Schoukens (2012), "System Identification: A Frequency Domain Approach",
/// 2nd ed., section 2.6 and chapter 7, doi:10.1002/9781118287422.
///
/// # Errors
/// [`deadtime_log::LogError`] for channels and time stamps, [`deadtime_signal::registry::RegistryError`] for method and options, [`IdentifyError`] for the data.
pub fn frequency_responses(
    logs: &[Log],
    (inputs, outputs, references): (&[String], &[String], &[String]),
    method: &str,
    options: Value,
) -> Result<Responses> {
    let line = find(RESPONSES, "frequency response method", method)?;
    let method = line.with(options)?;
    if references.is_empty() {
        let recordings = Recordings::from_logs(logs, inputs, outputs)?;
        recordings.scales()?;
        let seen = method.lines(&recordings)?;
        return Ok(of(line.name, recordings, seen, Vec::new()));
    }
    if references.len() != inputs.len() {
        return Err(IdentifyError::References { references: references.len(), inputs: inputs.len() }.into());
    }
    let both: Vec<String> = outputs.iter().chain(inputs).cloned().collect();
    let recordings = Recordings::from_logs(logs, references, &both)?;
    recordings.scales()?;
    let seen = reference::divided(method.lines(&recordings)?, outputs.len())?;
    let Recordings { sample_time, inputs: references, outputs: mut all, stretches } = recordings;
    let inputs = all.split_off(outputs.len());
    Ok(of(line.name, Recordings { sample_time, inputs, outputs: all, stretches }, seen, references))
}

fn of(method: &'static str, recordings: Recordings, seen: Seen, references: Vec<Named>) -> Responses {
    let samples = recordings.samples();
    let Recordings { sample_time, inputs, outputs, .. } = recordings;
    Responses { method, sample_time, inputs, outputs, references, samples, lines: seen.lines, notes: seen.notes }
}

/// Why no line has an answer: inputs that repeat each other, or that do not move.
fn unexcited(recordings: &Recordings) -> IdentifyError {
    let names: Vec<&str> = recordings.inputs.iter().map(|n| n.name.as_str()).collect();
    match names.split_last() {
        Some((last, others)) if !others.is_empty() => IdentifyError::Collinear { channel: (*last).to_owned(), others: others.join(", ") },
        _ => IdentifyError::NotExcited { inputs: names.join(", ") },
    }
}
