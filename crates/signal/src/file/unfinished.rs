//! The files that this process has begun and not yet named, for whoever ends it: a signal runs no destructors.
//!
//! The one list that is not handed from caller to caller: whoever ends a process knows nothing of what its threads write.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

static BEGUN: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// From so many on those that are gone are forgotten.
const MANY: usize = 256;

/// Takes note of a temporary file, or of a folder that goes if it is empty.
pub(super) fn begun(path: &Path) {
    let mut begun = BEGUN.lock().unwrap_or_else(PoisonError::into_inner);
    if begun.len() >= MANY {
        begun.retain(|path| path.exists());
    }
    begun.push(path.to_owned());
}

/// Removes a file from the list, before its deletion.
pub(super) fn ended(path: &Path) {
    BEGUN.lock().unwrap_or_else(PoisonError::into_inner).retain(|begun| begun != path);
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
