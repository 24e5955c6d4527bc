//! The model file, `deadtime/model@1`: TOML or JSON, as the extension says; linear, as equations or as transfer functions, as its `kind` says.

#![deny(clippy::indexing_slicing)]

mod candidate;
mod document;
mod equations;
mod lti;
mod nuisance;
mod table;
mod transfer;

use std::collections::BTreeMap;
use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize, Serializer};

use super::ModelError;
use crate::error::Result;

pub use candidate::{Candidate, CandidateEntry, CandidateParameter, Candidates};
pub use document::ModelDocument;
pub use equations::{EquationsFile, GroupEntry, GroupKind, ParameterEntry, StateEntry};
pub use lti::{ModelFile, State};
pub use nuisance::NuisanceEntry;

const FORMAT: &str = "deadtime/model@1";
/// What `kind` may say.
const KINDS: &str = "lti, equations, tf and zpk";

/// The point at which a model was linearised: the matrices act on u − operating and give y − operating.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Operating {
    /// A number in the channel's unit.
    Value(f64),
    /// The channel's mean over the training logs, written `"mean"`.
    Mean(Mean),
}

/// The word `mean`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mean {
    /// The channel's mean.
    Mean,
}

impl Default for Operating {
    fn default() -> Self {
        Self::Value(0.0)
    }
}

/// An input or output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// The name that a log's column carries.
    pub name: String,
    /// Its unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The operating point.
    #[serde(default)]
    pub operating: Operating,
    /// The input whose slope this input is: a log that lacks the channel gets it from that input's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub derivative_of: Option<String>,
    /// What its numbers are, where they are no plain ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<ChannelKind>,
}

/// What a channel's numbers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelKind {
    /// An angle that may be logged within one turn, in rad or degrees: its whole turns are taken out of logs.
    Angle,
}

impl Channel {
    /// A plain channel about 0.
    #[must_use]
    pub fn plain(name: &str, unit: Option<&str>) -> Self {
        Self { name: name.to_owned(), unit: unit.map(str::to_owned), operating: Operating::default(), derivative_of: None, kind: None }
    }

    /// A whole turn of an angle, in its unit; `None` for all else.
    #[must_use]
    pub fn turn(&self) -> Option<f64> {
        self.kind.and_then(|ChannelKind::Angle| whole_turn(self.unit.as_deref()))
    }
}

/// A whole turn in this unit, where it is one of angles.
#[must_use]
pub fn whole_turn(unit: Option<&str>) -> Option<f64> {
    match unit {
        Some("rad") => Some(std::f64::consts::TAU),
        Some("deg" | "°" | "degree" | "degrees") => Some(360.0),
        _ => None,
    }
}

/// An effect that already belongs to the simulator, kept as it stands in the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectEntry {
    /// The effect's name.
    pub effect: String,
    /// Where it acts.
    pub channel: String,
    /// Its parameters. A limit that does not act is infinite; files leave it out, for JSON has no infinity.
    #[serde(default, serialize_with = "acting")]
    pub parameters: BTreeMap<String, f64>,
}

/// The parameters that are finite.
fn acting<S: Serializer>(parameters: &BTreeMap<String, f64>, serializer: S) -> std::result::Result<S::Ok, S::Error> {
    serializer.collect_map(parameters.iter().filter(|(_, value)| value.is_finite()))
}

#[derive(Clone, Copy)]
enum Syntax {
    Toml,
    Json,
}

fn syntax(path: &Path) -> std::result::Result<Syntax, ModelError> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("toml") => Ok(Syntax::Toml),
        Some("json") => Ok(Syntax::Json),
        _ => Err(ModelError::Extension { path: path.to_owned() }),
    }
}

fn read_text(path: &Path) -> Result<(String, Syntax)> {
    let syntax = syntax(path)?;
    let text = deadtime_signal::file::read_text(path)?;
    Ok((text, syntax))
}

fn parse_text<T: DeserializeOwned>(text: &str, syntax: Syntax, path: &Path) -> std::result::Result<T, ModelError> {
    let wrong = |detail: String| ModelError::File { path: path.to_owned(), detail };
    match syntax {
        Syntax::Toml => toml::from_str(text).map_err(|e| wrong(e.to_string())),
        Syntax::Json => serde_json::from_str(text).map_err(|e| wrong(e.to_string())),
    }
}

fn text<T: Serialize>(file: &T, syntax: Syntax) -> std::result::Result<String, String> {
    match syntax {
        Syntax::Toml => toml::to_string(file).map_err(|e| e.to_string()),
        Syntax::Json => serde_json::to_string_pretty(file).map_err(|e| e.to_string()).map(|t| t + "\n"),
    }
}

fn write_text<T: Serialize>(path: &Path, file: &T, syntax: Syntax) -> Result<()> {
    let text = text(file, syntax).map_err(|detail| ModelError::File { path: path.to_owned(), detail })?;
    Ok(deadtime_signal::file::write_atomic(path, |out| out.write_all(text.as_bytes()))?)
}

/// The keys that say what the rest means.
#[derive(Deserialize)]
struct Header {
    format: Option<String>,
    kind: Option<String>,
}

/// The file's kind, `lti`, `equations`, `tf` or `zpk`; its format is that of this version.
fn kind(text: &str, syntax: Syntax, path: &Path) -> std::result::Result<String, ModelError> {
    let Header { format, kind } = parse_text(text, syntax, path)?;
    let wrong = |key, found: Option<String>, known| {
        let found = found.unwrap_or_else(|| "missing".to_owned());
        ModelError::Kind { path: path.to_owned(), key, found, known }
    };
    if format.as_deref() != Some(FORMAT) {
        return Err(wrong("format", format, FORMAT));
    }
    match kind {
        Some(kind) if ["lti", "equations", "tf", "zpk"].contains(&kind.as_str()) => Ok(kind),
        kind => Err(wrong("kind", kind, KINDS)),
    }
}

/// No more states, inputs, outputs and parameters than a model may have: before anything is compared with anything.
fn check_sizes(path: &Path, [inputs, states, parameters, outputs]: [usize; 4]) -> std::result::Result<(), ModelError> {
    let wrong = |source| ModelError::Equations { path: path.to_owned(), source: Box::new(source) };
    super::equations::check_sizes(inputs, states, parameters, outputs).map_err(wrong)
}

/// No name twice.
fn check_names(path: &Path, what: &'static str, names: &[&str]) -> std::result::Result<(), ModelError> {
    match names.iter().enumerate().find(|(i, n)| names.iter().take(*i).any(|before| before == *n)) {
        Some((_, name)) => Err(ModelError::Duplicate { path: path.to_owned(), what, name: (*name).to_owned() }),
        None => Ok(()),
    }
}

/// Inputs and outputs: no name twice, finite operating points.
fn check_channels(path: &Path, inputs: &[Channel], outputs: &[Channel]) -> std::result::Result<(), ModelError> {
    for (what, channels) in [("input", inputs), ("output", outputs)] {
        check_names(path, what, &channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>())?;
    }
    let operating = inputs.iter().chain(outputs).find_map(|c| match c.operating {
        Operating::Value(v) if !v.is_finite() => Some(v),
        _ => None,
    });
    if let Some(value) = operating {
        return Err(ModelError::Number { path: path.to_owned(), key: "operating", value, rule: "it must be finite" });
    }
    match inputs.iter().chain(outputs).find(|c| c.kind == Some(ChannelKind::Angle) && c.turn().is_none()) {
        Some(channel) => Err(ModelError::Unmatched {
            path: path.to_owned(),
            what: "the angle",
            name: channel.name.clone(),
            lacks: "needs its unit, `rad` or `deg`, to know what a whole turn is",
        }),
        None => Ok(()),
    }
}

/// Which numbers a list may hold.
#[derive(Clone, Copy, PartialEq)]
enum Sign {
    Any,
    NotNegative,
}

/// A list that may be absent, else has its length and finite numbers.
fn check_list(path: &Path, key: &'static str, list: &[f64], needed: usize, sign: Sign) -> std::result::Result<(), ModelError> {
    if !list.is_empty() && list.len() != needed {
        let detail = ModelError::Count { what: key, needed, got: list.len() }.to_string();
        return Err(ModelError::File { path: path.to_owned(), detail });
    }
    let positive = sign == Sign::NotNegative;
    match list.iter().find(|v| !v.is_finite() || (positive && **v < 0.0)) {
        Some(&value) => {
            let rule = if positive { "it must be finite and not negative" } else { "it must be finite" };
            Err(ModelError::Number { path: path.to_owned(), key, value, rule })
        }
        None => Ok(()),
    }
}
