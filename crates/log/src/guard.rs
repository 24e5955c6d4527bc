//! The guard around other crates that decode files. Some of them stop the program where parts of a damaged file do not fit together.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

use super::error::{Error, LogError};

thread_local! {
    /// Whether this thread reads a file behind the guard.
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

static SILENCE: Once = Once::new();

/// Reads behind the guard: a panic is the reader's error, and nothing of it is printed. Data that `read` changes are not used after a panic.
///
/// # Errors
/// The reader's result; [`LogError::Format`] where it panicked.
pub(super) fn guarded<T>(
    source: &str,
    format: &'static str,
    read: impl FnOnce() -> Result<T, Error>,
) -> Result<T, Error> {
    attempted(read).unwrap_or_else(|| {
        let what = "damaged: its parts do not fit together; write it again";
        Err(LogError::format(source, format, what).into())
    })
}

/// The same of a part of a file; `None` after a panic.
pub(super) fn attempted<T>(read: impl FnOnce() -> T) -> Option<T> {
    SILENCE.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |panic| {
            // At the end of a thread its local values may not exist.
            if !GUARDED.try_with(Cell::get).unwrap_or(false) {
                before(panic);
            }
        }));
    });
    let outer = GUARDED.replace(true);
    let read = catch_unwind(AssertUnwindSafe(read));
    GUARDED.set(outer);
    read.ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_and_the_next_file_is_read() {
        let read = |panics: bool| {
            guarded("a.x", "X", || if panics { panic!("out of bounds") } else { Ok(7) })
        };
        let said = read(true).unwrap_err().to_string();
        assert!(said.contains("a.x: X: damaged"), "{said}");
        assert_eq!(read(false).unwrap(), 7);
        assert!(!GUARDED.get());
        // Guards within guards stay quiet until the outermost ends.
        let nested = attempted(|| {
            let inner: Option<()> = attempted(|| panic!("inner"));
            (inner, GUARDED.get())
        });
        assert_eq!(nested, Some((None, true)));
    }
}
