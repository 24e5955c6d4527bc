//! What a record shows that not every method withstands.

use super::method::Condition;
use deadtime_signal::remedy::Message;

/// A complication that a record shows, and what shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The complication.
    pub condition: Condition,
    /// The evidence, in words that follow the condition's own.
    pub evidence: Message,
}
