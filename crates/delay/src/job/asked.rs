//! What is asked of an estimation on logs.

use super::chosen::Ready;
use crate::error::Result;
use crate::experiment::Detrend;
use crate::finding::Finding;
use crate::method::Condition;
use deadtime_log::Log;
use deadtime_model::ModelFile;
use deadtime_signal::progress::HowFar;
use deadtime_signal::remedy::{Message, Remedy};
use deadtime_signal::stop::Stop;
use deadtime_signal::time::SampleTime;

/// What is known of feedback in the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Feedback {
    /// Nothing: it is looked for.
    #[default]
    Auto,
    /// The input does not depend on the output.
    Open,
    /// It does.
    Closed,
}

impl Feedback {
    /// What the user says of the log, as a finding.
    pub(super) fn said(self) -> Option<Finding> {
        let evidence = Message::from(Remedy::ClosedLoop);
        (self == Self::Closed).then_some(Finding { condition: Condition::Feedback, evidence })
    }
}

/// Everything that an estimation needs; [`Job::new`] has every method and the defaults.
pub struct Job {
    /// What the log is called.
    pub name: String,
    /// Its records, all on one even grid.
    pub logs: Vec<Log>,
    /// Input channels.
    pub inputs: Vec<String>,
    /// Output channels; every pair with an input is estimated.
    pub outputs: Vec<String>,
    /// The methods, as [`Ready::all`] or `chosen` makes them; those that look at states wait for a model.
    pub methods: Vec<Ready>,
    /// The plant: its relative degrees, and A and B for the methods that look at states.
    pub model: Option<ModelFile>,
    /// Longest delay to search, s. `None`: that of `Search`; of records shorter than four times that, 25 % of the longest record. It is doubled while the response begins
    /// later, up to a third of the longest record.
    pub max_delay_s: Option<f64>,
    /// Samples that the plant needs to respond without any dead time; `None`: the model's, or 1.
    pub degree_bias: Option<usize>,
    /// What to take off each channel first.
    pub detrend: Detrend,
    /// What is known of feedback.
    pub feedback: Feedback,
    /// The delay against time is wanted, also where one delay describes the records.
    pub track: bool,
    /// Looked at between methods, pairs, and the delays of long scans.
    pub stop: Stop,
    /// Where it is said how many methods have answered.
    pub far: HowFar,
}

impl Job {
    /// Every method on every pair of these inputs and outputs of one or several records, with the defaults of `Search`, means taken off, and feedback looked for;
    /// called as its first record is.
    pub fn new<I: Into<String>, O: Into<String>>(
        logs: Vec<Log>,
        inputs: impl IntoIterator<Item = I>,
        outputs: impl IntoIterator<Item = O>,
    ) -> Self {
        Self {
            name: logs.first().map_or_else(String::new, |log| log.source().to_owned()),
            logs,
            inputs: inputs.into_iter().map(Into::into).collect(),
            outputs: outputs.into_iter().map(Into::into).collect(),
            methods: Ready::all(),
            model: None,
            max_delay_s: None,
            degree_bias: None,
            detrend: Detrend::default(),
            feedback: Feedback::default(),
            track: false,
            stop: Stop::default(),
            far: HowFar::default(),
        }
    }

    /// By how much a response may look too early because the logs were put onto another grid than their own, s.
    pub(super) fn early_s(&self) -> f64 {
        self.logs.iter().map(Log::early_s).fold(0.0, f64::max)
    }
}

/// Samples that hold so many seconds.
pub(super) fn whole(step: SampleTime, seconds: f64) -> Result<usize> {
    let samples = step.samples(seconds)?;
    Ok(samples.whole + usize::from(samples.fraction > 0.0))
}
