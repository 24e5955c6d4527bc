//! A diagnosis that cannot be begun.

use crate::input::record::LogRecord;
use deadtime_signal::remedy::{Message, Remedied, Remedy};

/// Why a gap cannot be diagnosed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GapError {
    /// A sampled model and a log of another sample time.
    #[error(
        "{log}: its sample time is {log_s} s, the sampled model's is {model_s} s; resample the log or convert the model"
    )]
    SampleTime {
        /// The log.
        log: String,
        /// Sample time of the model, seconds.
        model_s: f64,
        /// Sample time of the log, seconds.
        log_s: f64,
    },
    /// A channel of the model that a log does not have.
    #[error("{}", self.remedied().unwrap_or_default())]
    Channel {
        /// The fault of the log.
        found: Box<deadtime_log::LogError>,
        /// The model's name for it.
        channel: String,
    },
    /// Too few samples.
    #[error("{log}: {got} samples are too few for a diagnosis; at least {needed} are needed")]
    Short {
        /// The log.
        log: String,
        /// Samples needed.
        needed: usize,
        /// Samples there are.
        got: usize,
    },
    /// A longest delay that is none, or that leaves nothing of a log to learn from.
    #[error(
        "the longest delay is {given_s} s; give 0 s or more and less than half the shortest log, {limit_s} s"
    )]
    LongestDelay {
        /// The given value, seconds.
        given_s: f64,
        /// Half the shortest log, seconds.
        limit_s: f64,
    },
    /// No log to learn from.
    #[error("a diagnosis needs at least one log")]
    NoLogs,
    /// A horizon that is none, or that leaves nothing to begin from; or one where the mode needs none, or none where it needs one.
    #[error(
        "a horizon of {given} samples: predictions over a horizon take 1 to {most} samples, 25 % of the shortest log, and go with no other prediction mode"
    )]
    Horizon {
        /// The given value, samples.
        given: usize,
        /// The most, samples.
        most: usize,
    },
    /// A predictor for a simulator without accessible states.
    #[error(
        "a simulator that is only called can only be simulated freely: a predictor corrects a state, and none is at hand; leave the prediction mode to the program"
    )]
    NoPredictor,
    /// A simulator with more than one answer.
    #[error(
        "{log}: two equal calls of the simulator differ, `{output}` at sample {sample} is {first} and then {second}; \
         begin afresh at every call, and fix the seed of whatever is random in it"
    )]
    NotRepeatable {
        /// The log.
        log: String,
        /// The output.
        output: String,
        /// Sample, counted from 0.
        sample: usize,
        /// The first answer.
        first: f64,
        /// The second.
        second: f64,
    },
    /// A simulator whose free run carries no information.
    #[error("{}", self.remedied().unwrap_or_default())]
    Unstable {
        /// The log.
        log: String,
        /// The growth factor.
        factor: f64,
    },
    /// A state without a sample in the log.
    #[error("{}", self.remedied().unwrap_or_default())]
    NoState {
        /// The log.
        log: String,
        /// The channel.
        channel: String,
    },
    /// Starts that follow each other too fast.
    #[error("{}", self.remedied().unwrap_or_default())]
    RestartsTooOften {
        /// The log.
        log: String,
        /// The given value, seconds.
        given_s: f64,
        /// Samples between two starts.
        got: usize,
        /// The shortest time, seconds.
        least_s: f64,
    },
    /// More starts than can be fitted.
    #[error("{}", self.remedied().unwrap_or_default())]
    TooManyStarts {
        /// The log.
        log: String,
        /// Seconds between two starts.
        every_s: f64,
        /// Starts, of all states together.
        got: usize,
        /// The most.
        most: usize,
    },
    /// A nuisance that is none.
    #[error("model {model}, the nuisance `{nuisance}`: {why}")]
    Nuisance {
        /// The model.
        model: String,
        /// The entry, as `effect:channel`.
        nuisance: String,
        /// The fault, and the remedy.
        why: String,
    },
    /// A diagnosis that would take longer than it may.
    #[error("{}", self.remedied().unwrap_or_default())]
    TooWide {
        /// The model.
        model: String,
        /// Its states.
        states: usize,
        /// Its inputs.
        inputs: usize,
        /// Candidates of the catalogue.
        candidates: usize,
        /// Rows of all training logs.
        rows: usize,
        /// The estimated time, minutes.
        minutes: f64,
        /// The longest time, minutes.
        most: f64,
    },
    /// The nominal model cannot follow the log.
    #[error("{log}: the model cannot be simulated on it: {why}")]
    Nominal {
        /// The log.
        log: String,
        /// The cause of the stop.
        why: String,
    },
}

/// The nominal model has no finite predictions of these logs.
pub(crate) fn not_finite(records: &[LogRecord]) -> crate::error::Error {
    let log = records.first().map(|r| r.name.clone()).unwrap_or_default();
    GapError::Nominal { log, why: "its predictions are not finite".to_owned() }.into()
}

impl Remedied for GapError {
    fn remedied(&self) -> Option<Message> {
        let said = |text: String| Message::from(text);
        Some(match self {
            Self::Channel { found, channel } => {
                found.message().and("; say which column it is with ").and(Remedy::ColumnOf { channel: channel.clone() })
            }
            Self::Unstable { log, factor } => said(format!(
                "{log}: a small perturbation of the simulator grows {factor:.0e}-fold over the log, so that a free run carries no information; \
                 name the log's channels of its states, from which it is then started again and again ("
            ))
            .and(Remedy::States)
            .and("), or close the loop inside the simulator"),
            Self::NoState { log, channel } => said(format!(
                "{log}: `{channel}`, from which the simulator is to be started again, has no sample; name another channel of that state ("
            ))
            .and(Remedy::States)
            .and(")"),
            Self::RestartsTooOften { log, given_s, got, least_s } => {
                said(format!("{log}: a start every {given_s} s leaves {got} samples between two; give {least_s:.3} s or more ("))
                    .and(Remedy::RestartEvery)
                    .and(")")
            }
            Self::TooManyStarts { log, every_s, got, most } => said(format!(
                "{log}: started again every {every_s:.3} s, the simulator has {got} starts to fit, more than {most}; look at fewer rows ("
            ))
            .and(Remedy::LookAt)
            .and("), or give a longer time between starts (")
            .and(Remedy::RestartEvery)
            .and(")"),
            Self::TooWide { model, states, inputs, candidates, rows, minutes, most } => said(format!(
                "{model}: {candidates} candidate effects on {states} states and {inputs} inputs over {rows} rows take about {minutes:.0} minutes on one core, more than {most:.0}; name the effects to try or allow more time ("
            ))
            .and(Remedy::Effects)
            .and("), or use fewer rows (")
            .and(Remedy::LookAt)
            .and(")"),
            _ => return None,
        })
    }
}
