//! Outcomes of a command that have an exit code of their own.

/// A gate or a requested limit that was not met: exit code 1.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct LimitNotMet(pub(super) String);

/// No trusted answer where one was required: exit code 3.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct NothingTrusted(pub(super) String);
