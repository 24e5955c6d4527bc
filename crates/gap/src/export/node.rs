//! Data in the order in which a person reads it: as JSON, as YAML.

use serde_saphyr::{FlowSeq, SerializerOptions};

use serde::ser::{Serialize, SerializeMap, SerializeSeq, Serializer};

/// A tree of data whose maps keep their order.
#[derive(Debug, Clone, PartialEq)]
pub enum Node {
    /// Nothing.
    Null,
    /// True or false.
    Truth(bool),
    /// A whole number.
    Whole(i64),
    /// A number; null where it is not finite.
    Number(f64),
    /// A text.
    Text(String),
    /// A list.
    List(Vec<Node>),
    /// Keys and values.
    Map(Vec<(String, Node)>),
}

impl Node {
    /// A map of keys and values.
    pub(super) fn map<const N: usize>(entries: [(&str, Node); N]) -> Self {
        Self::Map(entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
    }

    /// The value of a key of a map.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&Self> {
        let Self::Map(entries) = self else { return None };
        entries.iter().find(|(k, _)| k == key).map(|(_, value)| value)
    }

    /// The text as JSON, with a newline at its end.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// The text as YAML that readers of YAML 1.1, as PyYAML is, and of 1.2 read alike; JSON, which is YAML too, where it cannot be written.
    #[must_use]
    pub fn to_yaml(&self) -> String {
        let mut options = SerializerOptions::default();
        options.prefer_block_scalars = false;
        serde_saphyr::to_string_with_options(self, options).unwrap_or_else(|_| self.to_json())
    }

    /// A number, or the place of one that is undefined.
    fn is_number(&self) -> bool {
        matches!(self, Self::Number(_) | Self::Whole(_) | Self::Null)
    }
}

impl From<f64> for Node {
    fn from(value: f64) -> Self {
        Self::Number(value)
    }
}

impl From<&str> for Node {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Node {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<bool> for Node {
    fn from(truth: bool) -> Self {
        Self::Truth(truth)
    }
}

impl<T: Into<Node>> From<Option<T>> for Node {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Null, Into::into)
    }
}

impl<T: Into<Node>> From<Vec<T>> for Node {
    fn from(list: Vec<T>) -> Self {
        Self::List(list.into_iter().map(Into::into).collect())
    }
}

impl Serialize for Node {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Null => serializer.serialize_unit(),
            Self::Truth(truth) => serializer.serialize_bool(*truth),
            Self::Whole(number) => serializer.serialize_i64(*number),
            Self::Number(number) if number.is_finite() => serializer.serialize_f64(*number),
            Self::Number(_) => serializer.serialize_unit(),
            Self::Text(text) => serializer.serialize_str(text),
            // In YAML, rows of numbers stand on one line, as people write them.
            Self::List(list) if !list.is_empty() && list.iter().all(Self::is_number) => {
                FlowSeq(list.iter().collect::<Vec<&Self>>()).serialize(serializer)
            }
            Self::List(list) => {
                let mut seq = serializer.serialize_seq(Some(list.len()))?;
                list.iter().try_for_each(|one| seq.serialize_element(one))?;
                seq.end()
            }
            Self::Map(entries) => {
                let mut map = serializer.serialize_map(Some(entries.len()))?;
                entries.iter().try_for_each(|(key, value)| map.serialize_entry(key, value))?;
                map.end()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn yaml_reads_alike_in_either_version() {
        let node = Node::map([
            ("small", Node::Number(1e-9)),
            ("large", Node::Number(-3e20)),
            ("whole", Node::Number(5.0)),
            ("undefined", Node::Number(f64::NAN)),
            ("steps", Node::Whole(5)),
            ("no", Node::from("no: \"quoted\"\n")),
            ("texts", Node::from(vec!["off", "1e5", "1_000", "12:30:45", "2020-01-01", "x"])),
            ("pair", Node::from(vec![0.5, 1e-5])),
            ("deep", Node::List(vec![Node::map([("a", Node::Null)]), Node::from("x")])),
        ]);
        let expected = "small: 1.0e-9\nlarge: -3.0e+20\nwhole: 5.0\nundefined: null\nsteps: 5\n\
                        \"no\": \"no: \\\"quoted\\\"\\n\"\ntexts:\n- \"off\"\n- \"1e5\"\n- \"1_000\"\n- \"12:30:45\"\n- \"2020-01-01\"\n- x\n\
                        pair: [0.5, 0.00001]\ndeep:\n- a: null\n- x\n";
        assert_eq!(node.to_yaml(), expected);
    }
}
