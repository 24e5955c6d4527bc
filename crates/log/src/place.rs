//! The place of a sample, and its neighbours.

/// The place of a sample, for messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The line of a file, as an editor counts it: the header is row 1.
    Row(usize),
    /// The sample of a log that was made in memory, counted from 0.
    Sample(usize),
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Row(row) => write!(f, "row {row}"),
            Self::Sample(sample) => write!(f, "sample {sample}"),
        }
    }
}

impl Place {
    /// The message for a file, or for numbers in memory.
    pub(super) fn either(self, file: &'static str, memory: &'static str) -> &'static str {
        match self {
            Self::Row(_) => file,
            Self::Sample(_) => memory,
        }
    }
}

/// Each value with the one behind it.
pub fn neighbours<T: Copy>(values: &[T]) -> impl Iterator<Item = (T, T)> {
    values.iter().copied().zip(values.iter().copied().skip(1))
}
