//! The result of an estimation in the file format `deadtime/estimate@1`, and further fields for display.

use deadtime_signal::remedy::{Message, Words};
use serde::Serialize;

use super::estimate::{DelayEstimate, Outcome};
use super::finding::Finding;
use super::method::{Class, Condition, Method};
use super::verdict::answer::distrust;
use super::verdict::conclusion::Verdict;
use crate::events::jitter::Jitter;
use crate::response::estimator::ResponseMethod;
use crate::track::answer::{Moving, Tracked};

/// One method's estimate in the file format.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// The method.
    pub method: String,
    /// The outcome.
    pub outcome: Outcome,
    /// The dead time, s.
    pub delay_s: Option<f64>,
    /// Its standard deviation, s.
    pub std_s: Option<f64>,
    /// Its 95 % interval, s.
    pub ci95_s: Option<[f64; 2]>,
    /// The estimate of the method's original definition, s.
    pub raw_delay_s: Option<f64>,
    /// Samples subtracted from the raw value.
    #[serde(serialize_with = "whole_if_it_is")]
    pub degree_bias_samples: f64,
    /// A note for the reader.
    pub note: Option<Message>,
    /// The standard deviation predicted before the method ran, s ([`super::richness::richness`]).
    pub predicted_std_s: Option<f64>,
    /// Run time, s.
    pub time_s: f64,
    /// The heading of its class.
    #[serde(skip)]
    pub class: Class,
    /// Conditions of the record that the method does not withstand.
    #[serde(skip)]
    pub distrust: Vec<Condition>,
    /// The method's residual contradicts its own model.
    #[serde(skip)]
    pub contradicted: bool,
}

impl Estimate {
    /// An estimate with its method, its predicted accuracy, its run time, and the conditions of the record.
    #[must_use]
    pub fn new(
        method: &Method,
        estimate: &DelayEstimate,
        predicted_std_s: Option<f64>,
        time_s: f64,
        findings: &[Finding],
    ) -> Self {
        let distrust = distrust(method, estimate, findings);
        let answer = Self::of((method.entry.name, method.class), estimate, time_s);
        Self { predicted_std_s, distrust, ..answer }
    }

    /// The estimate of a method for frequency responses, and its run time.
    #[must_use]
    pub fn of_response(method: &ResponseMethod, estimate: &DelayEstimate, time_s: f64) -> Self {
        Self::of((method.entry.name, method.class), estimate, time_s)
    }

    fn of((method, class): (&str, Class), estimate: &DelayEstimate, time_s: f64) -> Self {
        Self {
            method: method.to_owned(),
            outcome: estimate.outcome,
            delay_s: estimate.delay_s,
            std_s: estimate.std_s,
            ci95_s: estimate.ci95_s,
            raw_delay_s: estimate.raw_delay_s,
            degree_bias_samples: estimate.degree_bias_samples,
            note: estimate.note.clone(),
            predicted_std_s: None,
            time_s,
            class,
            distrust: Vec::new(),
            contradicted: estimate.contradicted,
        }
    }
}

/// All estimates for one pair.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pair {
    /// The input.
    pub input: String,
    /// The output; `*` for an estimate that holds for any output.
    pub output: String,
    /// The conditions of the record.
    #[serde(skip)]
    pub findings: Vec<Finding>,
    /// One estimate per method, class by class.
    pub estimates: Vec<Estimate>,
    /// The standard deviation predicted before any method ran, s, where neighbouring delays are nearly indistinguishable.
    #[serde(skip)]
    pub poor_std_s: Option<f64>,
    /// Isolated output samples, far from their neighbours.
    #[serde(skip)]
    pub standing_off: usize,
    /// The channels are taken for two sensors of one signal: delays are those of relative degree 0.
    #[serde(skip)]
    pub two_sensors: bool,
    /// The dead time and its reasons.
    pub verdict: Verdict,
    /// A time-varying delay; absent where one delay describes the records.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moving: Option<Moving>,
    /// The delay against time, where it was requested and the records allow it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub track: Option<Tracked>,
    /// Delays of single events; absent where no events can be paired.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jitter: Option<Jitter>,
}

impl Pair {
    /// The estimates of methods for an input and an output, and the verdict on them.
    pub(super) fn new(names: [&str; 2], estimates: Vec<Estimate>, verdict: Verdict) -> Self {
        let [input, output] = names.map(str::to_owned);
        Self {
            input,
            output,
            findings: Vec::new(),
            estimates,
            poor_std_s: None,
            standing_off: 0,
            two_sensors: false,
            verdict,
            moving: None,
            track: None,
            jitter: None,
        }
    }
}

/// The file `deadtime/estimate@1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// `deadtime/estimate@1`.
    pub format: &'static str,
    /// The log.
    pub log: String,
    /// The sample time, s. For a frequency response: half the period of the highest frequency, or half the width of the verdict's interval if smaller.
    pub sample_time_s: f64,
    /// The longest delay searched, s.
    pub max_delay_s: f64,
    /// One entry per input and output.
    pub pairs: Vec<Pair>,
    /// The kind of data that was searched.
    #[serde(skip)]
    pub searched: Searched,
}

impl Report {
    /// The report with its notes and findings in the words of a user interface.
    #[must_use]
    pub fn worded(mut self, words: Words) -> Self {
        for pair in &mut self.pairs {
            pair.findings.iter_mut().for_each(|f| f.evidence = f.evidence.worded(words).into());
            pair.estimates
                .iter_mut()
                .for_each(|e| e.note = e.note.as_ref().map(|note| note.worded(words).into()));
        }
        self
    }
}

/// The data searched for a dead time, and the assumptions.
#[derive(Debug, Clone, PartialEq)]
pub enum Searched {
    /// Samples of a log.
    Samples {
        /// Samples of all records.
        samples: usize,
        /// Records.
        records: usize,
        /// The source of the degree bias.
        bias: Bias,
        /// The largest apparent lead of a response, s, caused by resampling the log onto an even grid.
        early_s: f64,
    },
    /// Two sequences of event times.
    Events {
        /// Events of each.
        counts: [usize; 2],
        /// The typical interval between events of the first, s.
        interval_s: f64,
    },
    /// A frequency response.
    Frequencies {
        /// How many.
        count: usize,
        /// The first and the last, Hz.
        band_hz: [f64; 2],
        /// Delays at this distance are aliases, s.
        unambiguous_s: f64,
        /// Notes on the interpretation of the file.
        notes: Vec<String>,
    },
}

/// The source of the samples that are subtracted from raw values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Bias {
    /// A strictly proper plant behind a zero-order hold.
    Assumed,
    /// The relative degrees of the model of this name.
    Model(String),
    /// As given.
    Given(usize),
}

/// An estimated impulse response, one value per sample, the first at lag 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// The coefficients.
    pub values: Vec<f64>,
    /// Their standard deviations.
    pub std: Vec<f64>,
}

/// The value of [`Report::format`].
pub const FORMAT: &str = "deadtime/estimate@1";

impl Estimate {
    /// The estimate has a delay, and the record has no condition that the method does not withstand.
    #[must_use]
    pub fn counts(&self) -> bool {
        self.outcome == Outcome::Found && self.distrust.is_empty() && !self.contradicted
    }
}

/// A whole number without a point, as the format has it.
fn whole_if_it_is<S: serde::Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    if value.fract() == 0.0 && value.abs() < 1e15 {
        serializer.serialize_i64(*value as i64)
    } else {
        serializer.serialize_f64(*value)
    }
}
