//! The truth of a case.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

use super::error::BlindError;
use crate::error::Result;
use deadtime_signal::file::read_bytes;

/// The kinds of cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Group {
    /// One effect of the catalogue.
    Single,
    /// No effect.
    None,
    /// Something outside the catalogue.
    Unknown,
    /// Two effects of the catalogue.
    Pair,
    /// Several effects, with their shares; a cause outside the catalogue may act as well.
    Mixture,
    /// One effect of the catalogue, a delay that moves.
    Moving,
}

impl Group {
    /// All of them, in the order of reports.
    pub const ALL: [Self; 6] =
        [Self::Single, Self::None, Self::Unknown, Self::Pair, Self::Mixture, Self::Moving];

    /// The word that labels use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::None => "none",
            Self::Unknown => "unknown",
            Self::Pair => "pair",
            Self::Mixture => "mixture",
            Self::Moving => "moving",
        }
    }
}

/// A label, `LABELS/ID.json`. Members that are not listed here are passed over.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Label {
    /// The case.
    pub id: String,
    /// The secret that keeps the commitment from being guessed.
    pub salt: String,
    /// The kind of case.
    pub group: Group,
    /// The right verdict.
    #[serde(default, deserialize_with = "or_default")]
    pub verdict: String,
    /// The active effects; empty for `none`, ignored for `unknown`.
    #[serde(default, deserialize_with = "or_default")]
    pub effects: Vec<LabelEffect>,
    /// Which `effect:channel` no data of this case could tell from the truth; of a pair, either one list or one list per effect.
    #[serde(default, deserialize_with = "or_default")]
    pub alias_class: AliasClass,
    /// The outputs in which the effect shows.
    #[serde(default, deserialize_with = "or_default")]
    pub outputs: Vec<String>,
    /// Start of the time in which it shows, s.
    #[serde(default)]
    pub from_s: Option<f64>,
    /// End of it, s.
    #[serde(default)]
    pub to_s: Option<f64>,
    /// Lower edge of the band in which it shows, Hz.
    #[serde(default)]
    pub from_hz: Option<f64>,
    /// Upper edge of it, Hz.
    #[serde(default)]
    pub to_hz: Option<f64>,
    /// The ratio of the effect's trace to the noise, dB.
    #[serde(default)]
    pub strength_db: Option<f64>,
    /// Held-out nrmse of the nominal model.
    #[serde(default)]
    pub before: Option<f64>,
    /// Held-out nrmse once the true structure is fitted.
    #[serde(default)]
    pub oracle_after: Option<f64>,
    /// For a mixture, the share of each effect in the gap's square, in the order of the effects.
    #[serde(default, deserialize_with = "or_default")]
    pub shares: Vec<f64>,
    /// The cause outside every catalogue that acts in addition to a mixture.
    #[serde(default)]
    pub outside: Option<String>,
    /// The plant.
    #[serde(default, deserialize_with = "word")]
    pub plant: Option<String>,
    /// Open, stabilised or closed loop.
    #[serde(default, rename = "loop", deserialize_with = "word")]
    pub loop_kind: Option<String>,
}

/// An effect that acts.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct LabelEffect {
    /// Its name; optional for a cause outside the catalogue.
    #[serde(default, deserialize_with = "or_default")]
    pub effect: String,
    /// Where it acts.
    #[serde(default, deserialize_with = "or_default")]
    pub channel: String,
    /// Its true parameters; null for a limit that does not act. Read from an object, `{"delay": 0.03}`, or from a diagnosis' list of name and value.
    #[serde(default, deserialize_with = "parameters")]
    pub parameters: BTreeMap<String, Option<f64>>,
}

/// One list, or one per effect.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged)]
pub enum AliasClass {
    /// One list of `effect:channel`.
    Flat(Vec<String>),
    /// A list for each effect, in the order of the effects.
    PerEffect(Vec<Vec<String>>),
}

impl Default for AliasClass {
    fn default() -> Self {
        Self::Flat(Vec::new())
    }
}

impl AliasClass {
    /// The aliases of the effect of this number in the data.
    #[must_use]
    pub fn of(&self, effect: usize) -> &[String] {
        match self {
            Self::Flat(list) => list,
            Self::PerEffect(lists) => lists.get(effect).map_or(&[], Vec::as_slice),
        }
    }
}

impl Label {
    /// Reads a label; also gives the file's bytes, for the commitment.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io), [`BlindError::Label`], [`BlindError::LabelId`], [`BlindError::LabelEffects`], [`BlindError::LabelNameless`].
    pub fn read(path: &Path, id: &str) -> Result<(Self, Vec<u8>)> {
        let bytes = read_bytes(path)?;
        let label: Self = serde_json::from_slice(&bytes)
            .map_err(|source| BlindError::Label { file: path.to_owned(), source })?;
        if label.id != id {
            return Err(BlindError::LabelId { file: path.to_owned(), id: label.id }.into());
        }
        let needed = match label.group {
            Group::Single | Group::Moving => 1,
            Group::Pair => 2,
            // A cause outside the catalogue may be described or not.
            Group::Unknown => label.effects.len(),
            Group::None => 0,
            Group::Mixture => label.effects.len().max(1),
        };
        if label.effects.len() != needed {
            return Err(BlindError::LabelEffects {
                id: label.id,
                group: label.group.name(),
                needed,
                got: label.effects.len(),
            }
            .into());
        }
        let nameless = |e: &LabelEffect| e.effect.is_empty() || e.channel.is_empty();
        if label.group != Group::Unknown && label.effects.iter().any(nameless) {
            return Err(BlindError::LabelNameless { id: label.id }.into());
        }
        Ok((label, bytes))
    }
}

/// A member that may be null.
fn or_default<'de, D: Deserializer<'de>, T: Default + Deserialize<'de>>(
    deserializer: D,
) -> Result<T, D::Error> {
    Ok(Option::<T>::deserialize(deserializer)?.unwrap_or_default())
}

/// A word, or a number or truth value as one.
fn word<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    Ok(match Value::deserialize(deserializer)? {
        Value::Null => None,
        Value::String(text) => Some(text),
        other => Some(other.to_string()),
    })
}

/// Parameters as an object, or as a list of names and values. A value that is no number is ignored: it can be no parameter of the catalogue.
fn parameters<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<BTreeMap<String, Option<f64>>, D::Error> {
    let number =
        |value: &Value| value.is_null().then_some(None).or_else(|| value.as_f64().map(Some));
    let listed = |entry: &Value| {
        Some((entry.get("name")?.as_str()?.to_owned(), number(entry.get("value")?)?))
    };
    Ok(match Value::deserialize(deserializer)? {
        Value::Object(object) => {
            object.into_iter().filter_map(|(name, value)| Some((name, number(&value)?))).collect()
        }
        Value::Array(list) => list.iter().filter_map(listed).collect(),
        _ => BTreeMap::new(),
    })
}
