//! A wish to stop, that long work looks at from time to time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Set by whoever waits for an answer and no longer wants it; copies share one wish. A fresh one never stops anything.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Wishes that the work stops.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// The work is no longer wanted.
    #[must_use]
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Goes on, unless the work is no longer wanted.
    ///
    /// # Errors
    /// [`crate::Error::Stopped`].
    pub fn check(&self) -> crate::Result<()> {
        if self.is_set() { Err(crate::Error::Stopped) } else { Ok(()) }
    }
}

/// Options are equal whatever is wished for besides.
impl PartialEq for Stop {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_reaches_every_copy() {
        let stop = Stop::default();
        let copy = stop.clone();
        assert!(copy.check().is_ok());
        stop.set();
        assert!(matches!(copy.check(), Err(crate::Error::Stopped)));
        assert!(!Stop::default().is_set());
    }
}
