//! A simulator that a diagnosis is exported to.

use super::node::Node;
use super::ranges::Ranges;
use super::source::Source;
use crate::error::Result;
use serde::{Deserialize, Serialize};

/// Something that a diagnosis is handed over to.
pub trait Target: std::fmt::Debug {
    /// The exported parts.
    ///
    /// # Errors
    /// [`ExportError`](super::source::ExportError): the target needs something that is not there.
    fn export(&self, ranges: &Ranges, source: &Source<'_>) -> Result<Node>;
}

/// How a text is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Syntax {
    /// JSON.
    #[default]
    Json,
    /// YAML 1.1 and 1.2 alike.
    Yaml,
}
