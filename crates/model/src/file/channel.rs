//! Channels and effects of a model file.

use serde::{Deserialize, Serialize, Serializer};
use std::collections::BTreeMap;

/// The point of the model's linearisation: the matrices act on u − operating and give y − operating.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Operating {
    /// A value in the channel's unit.
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

/// Implements serde's traits by the derived ones of the type itself (`remote = "Self"`), and accepts a text as the name alone.
macro_rules! named {
    ($type:ty, $one:literal, $of_name:expr) => {
        impl serde::Serialize for $type {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                Self::serialize(self, serializer)
            }
        }
        impl<'de> serde::Deserialize<'de> for $type {
            fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                struct NameOrTable;
                impl<'de> serde::de::Visitor<'de> for NameOrTable {
                    type Value = $type;
                    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                        f.write_str(concat!($one, ": its name or a table { name = …, unit = … }"))
                    }
                    fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<$type, E> {
                        Ok($of_name(name))
                    }
                    fn visit_map<A: serde::de::MapAccess<'de>>(
                        self,
                        map: A,
                    ) -> Result<$type, A::Error> {
                        <$type>::deserialize(serde::de::value::MapAccessDeserializer::new(map))
                    }
                }
                from.deserialize_any(NameOrTable)
            }
        }
    };
}
pub(super) use named;

named!(Channel, "an input or output", |name| Channel::plain(name, None));

/// An input or output; in a file alternatively its name alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self")]
pub struct Channel {
    /// The name of the log's column.
    pub name: String,
    /// Its unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The operating point.
    #[serde(default)]
    pub operating: Operating,
    /// The input whose slope this input is; a log without the channel derives it from that input's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub derivative_of: Option<String>,
    /// The kind of its values, other than plain numbers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<ChannelKind>,
}

/// The kind of a channel's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelKind {
    /// An angle that may be logged within one turn, in rad or degrees, without its whole turns.
    Angle,
}

impl Channel {
    /// A channel of plain numbers about 0.
    #[must_use]
    pub fn plain(name: &str, unit: Option<&str>) -> Self {
        Self {
            name: name.to_owned(),
            unit: unit.map(str::to_owned),
            operating: Operating::default(),
            derivative_of: None,
            kind: None,
        }
    }

    /// A whole turn of an angle, in its unit; `None` for other channels.
    #[must_use]
    pub fn turn(&self) -> Option<f64> {
        self.kind.and_then(|ChannelKind::Angle| whole_turn(self.unit.as_deref()))
    }
}

/// A whole turn in this unit; `None` for a unit of another kind.
#[must_use]
pub fn whole_turn(unit: Option<&str>) -> Option<f64> {
    match unit {
        Some("rad") => Some(std::f64::consts::TAU),
        Some("deg" | "°" | "degree" | "degrees") => Some(360.0),
        _ => None,
    }
}

/// An effect that is already part of the simulator, as in the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectEntry {
    /// The effect's name.
    pub effect: String,
    /// Its channel.
    pub channel: String,
    /// Its parameters. An inactive limit is infinite; files omit it, because JSON has no infinity.
    #[serde(default, serialize_with = "acting")]
    pub parameters: BTreeMap<String, f64>,
}

/// The parameters that are finite.
pub(super) fn acting<S: Serializer>(
    parameters: &BTreeMap<String, f64>,
    serializer: S,
) -> std::result::Result<S::Ok, S::Error> {
    serializer.collect_map(parameters.iter().filter(|(_, value)| value.is_finite()))
}
