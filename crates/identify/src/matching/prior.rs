//! A weak prior at the file's values, for parameters that the responses do not determine.

/// A posterior spread above this share of the prior's is attributed to the prior.
pub(super) const HELD: f64 = 0.7;

/// The prior at the file's values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Prior {
    /// One standard deviation, in sizes.
    pub(super) spread: f64,
    /// The penalty of z², in the norm's squares.
    pub(super) weight: f64,
}
