//! Ranges for any trainer, `deadtime/ranges@1`.

use serde::{Deserialize, Serialize};

use super::node::Node;
use super::ranges::{Range, Ranges};
use super::source::Source;
use super::target::Target;
use crate::error::Result;

/// Ranges for any trainer.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DomainRandomisation {}

impl Target for DomainRandomisation {
    fn export(&self, ranges: &Ranges, source: &Source<'_>) -> Result<Node> {
        let cause = &source.diagnosis.cause;
        Ok(Node::map([
            ("format", "deadtime/ranges@1".into()),
            ("model", source.diagnosis.model.as_str().into()),
            ("verdict", cause.verdict.as_str().into()),
            ("widen", source.widen.into()),
            ("ranges", Node::List(ranges.ranges.iter().map(Range::node).collect())),
            ("noise", Node::List(ranges.noise.iter().map(super::ranges::Noise::node).collect())),
        ]))
    }
}
