//! The begun and not yet named files of this process, for the code that ends it: a signal runs no destructors.
//!
//! The only global list: the code that ends a process does not know the files of its threads.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

static BEGUN: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// From this number on, removed files are dropped from the list.
const MANY: usize = 256;

/// The list, while a file is made or removed: the code that ends the process waits until list and disk agree.
pub(super) struct Undisturbed(MutexGuard<'static, Vec<PathBuf>>);

/// To be held from before a file is made until it is noted, and while one goes.
pub(super) fn undisturbed() -> Undisturbed {
    Undisturbed(BEGUN.lock().unwrap_or_else(PoisonError::into_inner))
}

impl Undisturbed {
    /// Takes note of a temporary file, or of a folder that goes if it is empty.
    pub(super) fn begun(&mut self, path: &Path) {
        if self.0.len() >= MANY {
            self.0.retain(|path| path.exists());
        }
        self.0.push(path.to_owned());
    }

    /// Takes a file off the list.
    pub(super) fn ended(&mut self, path: &Path) {
        self.0.retain(|begun| begun != path);
    }
}

/// Removes every file that this process has begun and not yet named; to be called when it ends at once. Nothing else can be written from then on.
pub fn abandon() {
    let mut begun = BEGUN.lock().unwrap_or_else(PoisonError::into_inner);
    for path in begun.drain(..) {
        // One that has its name is no longer under this one.
        let _ = std::fs::remove_file(&path).or_else(|_| std::fs::remove_dir(path));
    }
    // Held until the process ends: no thread begins another file.
    std::mem::forget(begun);
}
