//! The diagnosis file, `deadtime/diagnosis@3`, as plain data; files of `@1` and `@2` are read too.
//!
//! A number that may be missing is an `Option` and `null` in the file. NaN and infinities are written as `null` too. A diagnosis without a compulsory number is
//! refused when it is written, so that every written file can be read.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::class::CauseClass;
use super::contributions::{Contribution, Explained, Recalibration, Remainder};
use super::errors_by_mode::ErrorsByMode;
use super::found::FoundEffect;
use super::nuisance::NuisanceEstimate;
use super::place::Where;
use crate::error::Result;
use deadtime_signal::file::{read_text, write_atomic};
use deadtime_signal::remedy::Message;

/// A diagnosis file that cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DiagnosisError {
    /// Not a diagnosis of this format.
    #[error("{file}: not a deadtime/diagnosis@1, @2 or @3: {source}")]
    Unreadable {
        /// The file.
        file: String,
        /// The error of serde, with line and column.
        source: serde_json::Error,
    },
    /// A number that must be given is NaN or infinite.
    #[error(
        "{file}: the diagnosis was not written, it could not be read again (a number that must be given is NaN or infinite): {source}"
    )]
    Unwritable {
        /// The file.
        file: String,
        /// The error of serde, with line and column of the unwritten text.
        source: serde_json::Error,
    },
}

/// The format line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum DiagnosisFormat {
    /// The verdict alone, without what contributes.
    #[serde(rename = "deadtime/diagnosis@1")]
    V1,
    /// With all contributions, and the remainder.
    #[serde(rename = "deadtime/diagnosis@2")]
    V2,
    /// With classes and their probabilities.
    #[default]
    #[serde(rename = "deadtime/diagnosis@3")]
    V3,
}

/// The diagnosis of the gap between one model and its logs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Diagnosis {
    /// The format line.
    pub format: DiagnosisFormat,
    /// The model's name.
    pub model: String,
    /// The training logs.
    pub logs: Vec<String>,
    /// The held-out parts.
    pub holdout: Vec<Holdout>,
    /// The meaning of "predicted" in this diagnosis.
    pub prediction: Prediction,
    /// The gap on the training logs.
    pub gap: Gap,
    /// Where the gap is.
    #[serde(rename = "where")]
    pub place: Where,
    /// Checks that need no dynamics.
    pub checks: Vec<Check>,
    /// The cause of the gap.
    pub cause: Cause,
    /// The reduction of the gap on the held-out data.
    pub shrink: Shrink,
    /// The held-out error by how far ahead it is predicted; missing in `@1` and `@2`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub errors: Option<ErrorsByMode>,
    /// The nuisances of the model file in every log; empty where it has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub nuisances: Vec<NuisanceEstimate>,
}

/// A held-out part of a log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Holdout {
    /// The log.
    pub log: String,
    /// Start, s from the log's first sample.
    pub from_s: f64,
    /// End, s from the log's first sample.
    pub to_s: f64,
}

/// How outputs were predicted, and why so.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prediction {
    /// Free run, one-step predictions or predictions over a horizon.
    pub mode: Mode,
    /// The reason, as a phrase.
    pub why: String,
    /// Samples that are predicted from one state; missing where the mode has no horizon.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub horizon: Option<usize>,
}

/// How the reason begins where a simulator is started again on the way.
pub(crate) const STARTED_AGAIN: &str = "started again";

impl Prediction {
    /// The model's kind of prediction, in a sentence.
    #[must_use]
    pub fn words(&self) -> &'static str {
        match self.mode {
            Mode::Simulation if self.why.starts_with(STARTED_AGAIN) => {
                "simulated from window to window"
            }
            Mode::Simulation => "simulated freely",
            Mode::Predictor => "predicted one step ahead",
            Mode::Horizon => "predicted over a horizon",
        }
    }
}

/// The prediction mode; values of different modes are not comparable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// A free run of the model.
    Simulation,
    /// One-step predictions of a fixed-gain observer.
    Predictor,
    /// Free runs over a horizon of samples, each from the state that a fixed-gain observer has estimated there.
    Horizon,
}

/// How a gap is measured.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Metric {
    /// rms(measured − predicted)/std(measured); of several outputs the rms of theirs.
    #[default]
    Nrmse,
}

/// The gap on the training logs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gap {
    /// The metric of the errors.
    pub metric: Metric,
    /// Over all outputs; missing when every output is constant.
    pub before: Option<f64>,
    /// The part of it that no deterministic model can explain.
    pub floor: Option<f64>,
    /// All outputs of the model, in its order.
    pub outputs: Vec<GapOutput>,
}

/// The gap of one output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GapOutput {
    /// The output.
    pub name: String,
    /// Its gap; missing when it is constant.
    pub before: Option<f64>,
    /// Its floor.
    pub floor: Option<f64>,
    /// Its share of the sum of before² − floor² over the outputs.
    pub share: Option<f64>,
}

/// A check that needs no dynamics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Check {
    /// The kind of the check.
    pub check: CheckKind,
    /// The channel; `*` for all.
    pub channel: String,
    /// Whether it passed; missing where it cannot be tested.
    pub ok: Option<bool>,
    /// The finding, as a sentence.
    pub finding: Message,
}

/// The checks there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CheckKind {
    /// A channel of the wrong sign.
    Sign,
    /// Channels that changed places.
    Axes,
    /// A channel in another unit.
    Unit,
    /// A channel one sample late or early.
    OneSampleShift,
    /// Sensors' clock off by a constant.
    ClockOffset,
    /// Sensors' clock at another rate.
    ClockSkew,
    /// A channel that repeats its value.
    Stuck,
    /// A channel at its limit.
    Clipped,
    /// A command with too little excitation.
    Excitation,
    /// Mean values of model and log with a large distance; of `deadtime check` alone.
    OperatingPoint,
}

impl CheckKind {
    /// Its name, as in a file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sign => "sign",
            Self::Axes => "axes",
            Self::Unit => "unit",
            Self::OneSampleShift => "one_sample_shift",
            Self::ClockOffset => "clock_offset",
            Self::ClockSkew => "clock_skew",
            Self::Stuck => "stuck",
            Self::Clipped => "clipped",
            Self::Excitation => "excitation",
            Self::OperatingPoint => "operating_point",
        }
    }
}

/// The cause of the gap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cause {
    /// The leading effect, `none` or `unknown`.
    pub verdict: String,
    /// Its channel; missing for `none` and `unknown`.
    pub channel: Option<String>,
    /// All effects of the verdict, in order of their contributions.
    pub effects: Vec<FoundEffect>,
    /// Classes of indistinguishable effects with the probability that a member acts, the most probable first; empty in `@1` and `@2`.
    #[serde(default)]
    pub classes: Vec<CauseClass>,
    /// In which order the effects of the written model act, as `effect:channel`; empty in `@1` and `@2`.
    #[serde(default)]
    pub order: Vec<String>,
    /// Every candidate, and one row each for `none` and `unknown`; probabilities add up to 1.
    pub ranking: Vec<RankingRow>,
    /// Classes of indistinguishable `effect:channel`.
    pub indistinguishable: Vec<Vec<String>>,
    /// Candidates that were left out.
    pub not_tried: Vec<NotTried>,
    /// The excitation that would separate what this data cannot; missing where nothing is to be separated.
    pub next_experiment: Option<String>,
    /// Whether the found effects explain the gap; missing in `@1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub explained: Option<Explained>,
    /// All active effects, in order of their shares, for any verdict.
    #[serde(default)]
    pub contributions: Vec<Contribution>,
    /// The part that small errors of all the model's own parameters explain; missing in `@1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recalibration: Option<Recalibration>,
    /// The remainder of the gap; missing in `@1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remainder: Option<Remainder>,
}

/// A row of the ranking: one effect (or `none`, `unknown`), or several together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum RankingRow {
    /// One effect, `none` or `unknown`.
    Single(RankedSingle),
    /// Several effects together.
    Pair(RankedPair),
}

/// One candidate of the ranking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RankedSingle {
    /// The effect, `none` or `unknown`.
    pub effect: String,
    /// Where it acts; missing for `none` and `unknown`.
    pub channel: Option<String>,
    /// Its probability.
    pub probability: f64,
    /// The training nrmse with this candidate alone.
    pub after: Option<f64>,
}

/// Several effects together as one candidate of the ranking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RankedPair {
    /// Effect and channel of each.
    pub effects: Vec<[String; 2]>,
    /// Its probability.
    pub probability: f64,
    /// The training nrmse with these effects.
    pub after: Option<f64>,
}

/// A candidate that was left out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NotTried {
    /// The effect.
    pub effect: String,
    /// The reason, as a phrase.
    pub why: String,
}

/// The reduction of the gap on the held-out data once the effects are added.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shrink {
    /// Held-out nrmse of the nominal model.
    pub before: Option<f64>,
    /// Held-out nrmse of the written model, with the found effects: nothing is decoded from the held-out outputs.
    pub after: Option<f64>,
    /// The same once a hidden sequence (which commands were lost) is known; missing where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decoded: Option<f64>,
    /// The held-out floor.
    pub floor: Option<f64>,
    /// 1 − after/before.
    pub fraction: Option<f64>,
    /// (before² − after²)/(before² − floor²); missing where before ≤ floor.
    pub of_explainable: Option<f64>,
    /// The 95 % interval of `fraction`.
    pub ci95: Option<[f64; 2]>,
    /// All outputs of the model, in its order.
    pub outputs: Vec<ShrinkOutput>,
    /// The error by the steps since a prediction began; empty where the mode has no horizon.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub horizons: Vec<HorizonError>,
}

/// The held-out error so many steps after a prediction began.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HorizonError {
    /// Steps, samples of the log.
    pub samples: usize,
    /// nrmse of the nominal model; missing without measurements there.
    pub before: Option<f64>,
    /// nrmse of the written model.
    pub after: Option<f64>,
}

/// The reduction of the gap of one output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShrinkOutput {
    /// The output.
    pub name: String,
    /// Before; missing when it is constant.
    pub before: Option<f64>,
    /// After.
    pub after: Option<f64>,
    /// Its floor.
    pub floor: Option<f64>,
}

impl Diagnosis {
    /// Reads a diagnosis file.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io), or [`DiagnosisError::Unreadable`] with line and column.
    pub fn read(path: &Path) -> Result<Self> {
        let text = read_text(path)?;
        Ok(serde_json::from_str(&text).map_err(|source| DiagnosisError::Unreadable {
            file: path.display().to_string(),
            source,
        })?)
    }

    /// Writes a diagnosis file as a whole.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io), or [`DiagnosisError::Unwritable`] where a number that must be given is NaN or infinite.
    pub fn write(&self, path: &Path) -> Result<()> {
        let refused =
            |source| DiagnosisError::Unwritable { file: path.display().to_string(), source };
        let text = serde_json::to_string_pretty(self).map_err(refused)?;
        serde_json::from_str::<Self>(&text).map_err(refused)?;
        Ok(write_atomic(path, |out| writeln!(out, "{text}"))?)
    }
}
