//! The last samples of a channel.

/// The last samples, the newest first.
#[derive(Debug, Clone)]
pub(super) struct Past<T> {
    ring: Vec<T>,
    newest: usize,
    seen: usize,
}

impl<T: Copy> Past<T> {
    /// A buffer of this length, filled with `of`.
    pub(super) fn new(length: usize, of: T) -> Self {
        Self { ring: vec![of; length.max(1)], newest: 0, seen: 0 }
    }

    /// Adds a sample and drops the oldest.
    pub(super) fn push(&mut self, value: T) {
        self.newest = (self.newest + self.ring.len() - 1) % self.ring.len();
        self.ring[self.newest] = value;
        self.seen = (self.seen + 1).min(self.ring.len());
    }

    /// The sample `back` steps ago.
    pub(super) fn at(&self, back: usize) -> T {
        self.ring[(self.newest + back) % self.ring.len()]
    }

    /// The buffer has received its full number of samples.
    pub(super) fn is_full(&self) -> bool {
        self.seen == self.ring.len()
    }

    /// Samples that it holds.
    pub(super) fn length(&self) -> usize {
        self.ring.len()
    }
}
