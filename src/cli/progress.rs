//! A bar on standard error that says how far a command is; nothing where that is no terminal.

use std::fmt::Display;
use std::io::{IsTerminal, Write, stderr};

use super::Out;
use crate::text::shown;

/// Cells of the bar.
const CELLS: f64 = 24.0;

/// The bar.
#[derive(Debug)]
pub(super) struct Bar {
    seen: bool,
}

impl Bar {
    pub(super) fn new(to: &Out<'_>) -> Self {
        Self { seen: to.tells_progress() && stderr().is_terminal() }
    }

    /// The part that is done, 0 to 1, and what is being done now. A terminal that cannot be written to stops nothing.
    pub(super) fn show(&self, share: f64, what: &dyn Display) {
        if self.seen {
            let (done, cells) = ((share.clamp(0.0, 1.0) * CELLS).round() as usize, CELLS as usize);
            let mut out = stderr().lock();
            let what = shown(&what.to_string());
            let _ = write!(out, "\r\x1b[K[{}{}] {:3.0} % {what}", "#".repeat(done), "-".repeat(cells - done), 100.0 * share);
            let _ = out.flush();
        }
    }

    /// Takes the bar away.
    pub(super) fn end(&self) {
        if self.seen {
            let _ = write!(stderr().lock(), "\r\x1b[K");
        }
    }
}
