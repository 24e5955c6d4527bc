//! A gate or a limit as the outcome of a command.

/// A gate or a requested limit that was not met: exit code 1.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct LimitNotMet(pub(super) String);
