//! The common part of excitations, conversions and estimators: a name, a summary, and options by name.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::text::{did_you_mean, shown};

/// One line of a registry: a named implementor of `T`, built from its options.
pub struct Entry<T: ?Sized + 'static> {
    /// The name that the command line uses.
    pub name: &'static str,
    /// Its purpose, in one line.
    pub summary: &'static str,
    /// All options with their default values, as a JSON object.
    pub defaults: fn() -> Value,
    /// Builds the implementor from a JSON object; options left out take their defaults.
    pub build: fn(Value) -> Result<Box<T>, serde_json::Error>,
}

/// A name or option outside a registry.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RegistryError {
    /// No entry has this name.
    #[error("there is no {kind} `{name}`{}; there are: {known}", did_you_mean(name, known.iter().copied()), name = shown(name), known = known.join(", "))]
    Unknown {
        /// The kind of the name: method, excitation, conversion.
        kind: &'static str,
        /// The name given.
        name: String,
        /// The names there are.
        known: Vec<&'static str>,
    },
    /// The entry does not take these options.
    #[error("{name}: {source}; its options and defaults are {defaults}")]
    Options {
        /// The entry's name.
        name: &'static str,
        /// All its options.
        defaults: Value,
        /// The error of serde.
        source: serde_json::Error,
    },
    /// The same with the place of a file that names it.
    #[error("{place}: {source}")]
    At {
        /// The file and its line.
        place: String,
        /// The fault there.
        source: Box<RegistryError>,
    },
    /// An option is written `key=value`.
    #[error("option `{text}`: write it as KEY=VALUE", text = shown(text))]
    Syntax {
        /// The text given.
        text: String,
    },
}

/// The entry called `name`.
///
/// # Errors
/// [`RegistryError::Unknown`], with the names there are.
pub fn find<'a, T: ?Sized>(
    entries: &'a [Entry<T>],
    kind: &'static str,
    name: &str,
) -> Result<&'a Entry<T>, RegistryError> {
    entries.iter().find(|e| e.name == name).ok_or_else(|| RegistryError::Unknown {
        kind,
        name: name.to_owned(),
        known: entries.iter().map(|e| e.name).collect(),
    })
}

impl<T: ?Sized> Entry<T> {
    /// Name, summary, and options with their defaults.
    #[must_use]
    pub fn data(&self) -> Value {
        serde_json::json!({ "name": self.name, "summary": self.summary, "options": (self.defaults)() })
    }

    /// Builds the entry with the given options over its defaults.
    ///
    /// # Errors
    /// [`RegistryError::Options`] for an unknown option or a value of the wrong kind.
    pub fn with(&self, options: Value) -> Result<Box<T>, RegistryError> {
        (self.build)(options).map_err(|source| RegistryError::Options {
            name: self.name,
            defaults: (self.defaults)(),
            source,
        })
    }
}

/// `KEY=VALUE` texts as one JSON object; a value that is not JSON is a string.
///
/// # Errors
/// [`RegistryError::Syntax`] for a text without `=`.
pub fn options<'a>(texts: impl IntoIterator<Item = &'a str>) -> Result<Value, RegistryError> {
    let mut object = serde_json::Map::new();
    for text in texts {
        let (key, value) =
            text.split_once('=').ok_or_else(|| RegistryError::Syntax { text: text.to_owned() })?;
        let value = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()));
        object.insert(key.trim().to_owned(), value);
    }
    Ok(Value::Object(object))
}

/// The default options of an implementor, for [`Entry::defaults`].
#[must_use]
pub fn defaults<S: Default + Serialize>() -> Value {
    serde_json::to_value(S::default()).unwrap_or(Value::Null)
}

/// The implementor with the given options, for [`Entry::build`].
///
/// # Errors
/// The error of serde.
pub fn parse<S: DeserializeOwned>(options: Value) -> Result<S, serde_json::Error> {
    serde_json::from_value(options)
}

/// One registry line: `entry!("name", "summary", OptionStruct)`; the list determines its type, or a fourth argument: `dyn Trait`.
#[macro_export]
macro_rules! entry {
    ($name:literal, $summary:literal, $options:ty $(, $object:ty)? $(,)?) => {
        $crate::registry::Entry$(::<$object>)? {
            name: $name,
            summary: $summary,
            defaults: $crate::registry::defaults::<$options>,
            build: |options| Ok(Box::new($crate::registry::parse::<$options>(options)?)),
        }
    };
}
#[doc(inline)]
pub use entry;
