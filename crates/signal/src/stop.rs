//! A stop request, which long work checks from time to time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Nobody waits for the answer any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped before it was done")]
pub struct Stopped;

/// Set by a caller who no longer waits for the answer; copies share one request. A fresh one never stops anything.
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
    /// [`Stopped`].
    pub fn check(&self) -> Result<(), Stopped> {
        if self.is_set() { Err(Stopped) } else { Ok(()) }
    }
}

/// Options are equal with any request.
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
        assert!(matches!(copy.check(), Err(Stopped)));
        assert!(!Stop::default().is_set());
    }
}
