//! The place of a gap in the form of a diagnosis.

use serde::{Deserialize, Serialize};

/// Where the gap is: outputs, times, bands, regimes, each with the largest share first.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Where {
    /// Outputs.
    pub outputs: Vec<WhereOutput>,
    /// Spans of time.
    pub times: Vec<TimeSpan>,
    /// Frequency bands.
    pub bands: Vec<Band>,
    /// Ranges of another variable.
    pub regimes: Vec<Regime>,
}

/// An output's share of the gap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WhereOutput {
    /// The output.
    pub name: String,
    /// Its share of the whole gap.
    pub share: f64,
}

/// A span of time in which an output's gap lies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeSpan {
    /// The log.
    pub log: String,
    /// The output.
    pub output: String,
    /// Start, s from the log's first sample.
    pub from_s: f64,
    /// End, s from the log's first sample.
    pub to_s: f64,
    /// Its share of that output's gap.
    pub share: f64,
}

/// A frequency band in which an output's gap lies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Band {
    /// The output.
    pub output: String,
    /// Lower edge, Hz.
    pub from_hz: f64,
    /// Upper edge, Hz.
    pub to_hz: f64,
    /// Its share of that output's gap.
    pub share: f64,
}

/// A range of another variable in which an output's gap lies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Regime {
    /// The output.
    pub output: String,
    /// The variable: a channel of the log.
    pub variable: String,
    /// Lower edge, in its unit.
    pub from: f64,
    /// Upper edge, in its unit.
    pub to: f64,
    /// Its share of that output's gap.
    pub share: f64,
}
