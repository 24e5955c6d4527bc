//! The guesses and omissions of a reader, a sentence each.

use std::ops::{Deref, DerefMut};

use deadtime_signal::remedy::{Message, Words};
use serde::Serialize;

/// Sentences about how a file was read, in order.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Notes(Vec<Message>);

impl Notes {
    /// Adds a sentence.
    pub fn push(&mut self, note: impl Into<Message>) {
        self.0.push(note.into());
    }

    /// The sentences in the words of a face.
    #[must_use]
    pub fn worded(&self, words: Words) -> Self {
        Self(self.0.iter().map(|note| note.worded(words).into()).collect())
    }

    /// Adds a sentence that is not among them yet.
    pub fn push_once(&mut self, note: impl Into<Message>) {
        let note = note.into();
        if !self.0.contains(&note) {
            self.0.push(note);
        }
    }
}

impl Deref for Notes {
    type Target = [Message];

    fn deref(&self) -> &[Message] {
        &self.0
    }
}

impl DerefMut for Notes {
    fn deref_mut(&mut self) -> &mut [Message] {
        &mut self.0
    }
}

impl<M: Into<Message>> Extend<M> for Notes {
    fn extend<I: IntoIterator<Item = M>>(&mut self, notes: I) {
        self.0.extend(notes.into_iter().map(Into::into));
    }
}

impl IntoIterator for Notes {
    type Item = Message;
    type IntoIter = std::vec::IntoIter<Message>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}
