//! The memory that reading one file may take.

use deadtime_signal::remedy::{Message, Remedy};
use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::error::LogError;
use super::options::ReadOptions;

/// The least budget of any file, bytes.
const LEAST: u64 = 64 << 20;
/// As many times the size of its file a log may take: numbers of one byte become numbers of eight.
const TIMES: u64 = 4;

/// A limit of memory, checked before memory is taken; copies share it. It stays exceeded once it is.
#[derive(Debug, Clone)]
pub(super) struct Budget(Arc<Account>);

#[derive(Debug)]
struct Account {
    limit: u64,
    left: AtomicU64,
}

/// The remainder of a budget that is exceeded.
const EXCEEDED: u64 = u64::MAX;

impl Default for Budget {
    fn default() -> Self {
        Self::new(u64::MAX - 1)
    }
}

impl Budget {
    pub(super) fn new(limit: u64) -> Self {
        let limit = limit.min(EXCEEDED - 1);
        Self(Arc::new(Account { limit, left: AtomicU64::new(limit) }))
    }

    /// The budget of a file with this number of bytes, unless the caller gives another limit.
    pub(super) fn of(length: u64, options: &ReadOptions) -> Self {
        Self::new(
            options.memory.unwrap_or_else(|| length.saturating_mul(TIMES).saturating_add(LEAST)),
        )
    }

    /// Takes memory; false where there is not as much, and from then on.
    pub(super) fn take(&self, bytes: u64) -> bool {
        let taken = self.0.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| {
            (left != EXCEEDED).then(|| left.checked_sub(bytes).unwrap_or(EXCEEDED))
        });
        taken.is_ok_and(|before| before >= bytes)
    }

    /// The same, where the caller can do without: the budget is not exceeded then.
    pub(super) fn spare(&self, bytes: u64) -> bool {
        bytes <= self.room() && self.take(bytes)
    }

    /// Gives memory back that was taken.
    pub(super) fn give(&self, bytes: u64) {
        let add =
            |left: u64| (left != EXCEEDED).then(|| left.saturating_add(bytes).min(self.0.limit));
        let _ = self.0.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, add);
    }

    /// The remainder, bytes.
    pub(super) fn room(&self) -> u64 {
        match self.0.left.load(Ordering::Relaxed) {
            EXCEEDED => 0,
            left => left,
        }
    }

    /// The whole, bytes.
    pub(super) fn limit(&self) -> u64 {
        self.0.limit
    }

    /// From now on nothing is to be had.
    pub(super) fn exceed(&self) {
        self.0.left.store(EXCEEDED, Ordering::Relaxed);
    }

    /// The message on a part that needs more than the remainder.
    pub(super) fn left_out(&self, what: &str) -> Message {
        let limit = self.0.limit.div_ceil(1 << 20);
        Message::from(format!("{what} takes more memory than is left of {limit} MiB, the limit for a file of its size; left out: "))
            .and(Remedy::MaxMemory)
            .and(" lifts the limit")
    }

    pub(super) fn exceeded(&self) -> bool {
        self.0.left.load(Ordering::Relaxed) == EXCEEDED
    }

    /// # Errors
    /// [`LogError::Memory`] where more was wanted than there is.
    pub(super) fn check(&self, source: &str) -> Result<(), LogError> {
        if self.exceeded() {
            return Err(LogError::Memory {
                file: source.to_owned(),
                limit_mb: self.0.limit.div_ceil(1 << 20),
            });
        }
        Ok(())
    }

    /// Reads a source of bytes to its end, at most `most`; every read is taken from the budget.
    ///
    /// # Errors
    /// The error of the source; out of memory where it has more than the remainder.
    pub(super) fn read(
        &self,
        source: impl Read,
        most: u64,
        into: &mut Vec<u8>,
    ) -> std::io::Result<()> {
        let mut source = source.take(most);
        let mut part = [0; 1 << 14];
        loop {
            let read = match source.read(&mut part) {
                Ok(0) => return Ok(()),
                Ok(read) => read,
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
                Err(e) => return Err(e),
            };
            // A buffer that grows is held twice for a moment.
            if !self.spare(read as u64) {
                return Err(std::io::ErrorKind::OutOfMemory.into());
            }
            into.extend_from_slice(part.get(..read).unwrap_or_default());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_more_is_taken_than_there_is(
            limit in 0_u64..100_000,
            asked in prop::collection::vec((0_u64..40_000, any::<bool>()), 1..20),
        ) {
            let budget = Budget::new(limit);
            let mut held = 0;
            for (bytes, back) in asked {
                let fits = held + bytes <= limit;
                prop_assert_eq!(budget.take(bytes), fits);
                if !fits {
                    prop_assert!(budget.exceeded() && budget.room() == 0 && !budget.take(0));
                    budget.give(limit);
                    prop_assert!(budget.exceeded());
                    break;
                }
                held += bytes;
                if back {
                    budget.give(bytes);
                    held -= bytes;
                }
                prop_assert_eq!(budget.room(), limit - held);
            }
        }

        #[test]
        fn a_source_is_read_up_to_the_limit(limit in 0_usize..60_000, length in 0_usize..60_000) {
            let budget = Budget::new(limit as u64);
            let mut into = Vec::new();
            let read = budget.read(vec![1; length].as_slice(), u64::MAX, &mut into);
            prop_assert_eq!(read.is_ok(), length <= limit);
            prop_assert!(into.len() <= limit.min(length));
        }
    }
}
