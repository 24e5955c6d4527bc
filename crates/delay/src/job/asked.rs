//! The configuration of an estimation on logs.

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

/// Known feedback in the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Feedback {
    /// Unknown: the program tests for it.
    #[default]
    Auto,
    /// The input does not depend on the output.
    Open,
    /// The input depends on the output.
    Closed,
}

impl Feedback {
    /// The user's statement on the log, as a finding.
    pub(super) fn said(self) -> Option<Finding> {
        let evidence = Message::from(Remedy::ClosedLoop);
        (self == Self::Closed).then_some(Finding { condition: Condition::Feedback, evidence })
    }
}

/// The configuration of an estimation; [`Job::new`] has every method and the defaults.
pub struct Job {
    /// The name of the log.
    pub name: String,
    /// Its records, all on one even grid.
    pub logs: Vec<Log>,
    /// Input channels.
    pub inputs: Vec<String>,
    /// Output channels; every pair with an input is estimated.
    pub outputs: Vec<String>,
    /// The methods, as [`Ready::all`] or `chosen` makes them; state methods need a model.
    pub methods: Vec<Ready>,
    /// The plant model: its relative degrees, and A and B for state methods.
    pub model: Option<ModelFile>,
    /// Longest delay to search, s. `None`: that of `Search`; for records shorter than four times that, 25 % of the longest record. The window doubles while the
    /// response begins later, up to a third of the longest record.
    pub max_delay_s: Option<f64>,
    /// Samples after which the plant responds without any dead time; `None`: the model's, or 1.
    pub degree_bias: Option<usize>,
    /// The trend subtracted from each channel.
    pub detrend: Detrend,
    /// Known feedback.
    pub feedback: Feedback,
    /// Requests the delay against time, also where one delay describes the records.
    pub track: bool,
    /// Cancellation, checked between methods, pairs, and the delays of long scans.
    pub stop: Stop,
    /// Progress: the share of methods that have finished.
    pub far: HowFar,
}

impl Job {
    /// Every method on every pair of these inputs and outputs of one or several records. The defaults: those of `Search`, means subtracted, feedback tested.
    /// The job has its first record's name.
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

    /// The largest apparent lead of a response, s, caused by resampling the logs onto another grid.
    pub(super) fn early_s(&self) -> f64 {
        self.logs.iter().map(Log::early_s).fold(0.0, f64::max)
    }
}

/// The number of samples in `seconds`.
pub(super) fn whole(step: SampleTime, seconds: f64) -> Result<usize> {
    let samples = step.samples(seconds)?;
    Ok(samples.whole + usize::from(samples.fraction > 0.0))
}
