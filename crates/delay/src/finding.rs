//! Conditions of a record that some methods do not withstand.

use super::method::Condition;
use deadtime_signal::remedy::Message;

/// A condition of a record, with its evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The condition.
    pub condition: Condition,
    /// The evidence, in words that follow the condition's own.
    pub evidence: Message,
}
