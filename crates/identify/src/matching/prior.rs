//! A weak prior at the file's values: what the responses do not fix stays there.

/// A posterior spread above this share of the prior's is the prior's own.
pub(super) const HELD: f64 = 0.7;

/// What holds parameters to the file's values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Prior {
    /// One standard deviation, in sizes.
    pub(super) spread: f64,
    /// What z² costs, in the norm's squares.
    pub(super) weight: f64,
}
