//! A bar on standard error that says how far a command is; nothing where that is no terminal.

use std::fmt::Display;
use std::io::{IsTerminal, Write, stderr};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

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

/// Work that cannot tell how far it is: from the second second on, what is being done and for how long; taken away when it is dropped.
#[derive(Debug)]
pub(super) struct Waiting {
    running: Option<(Sender<()>, JoinHandle<()>)>,
}

/// A person waits this long without asking.
const PATIENCE: Duration = Duration::from_secs(2);

impl Waiting {
    pub(super) fn new(to: &Out<'_>, what: &str) -> Self {
        if !(to.tells_progress() && stderr().is_terminal()) {
            return Self { running: None };
        }
        let (end, ended) = channel();
        let (what, began) = (shown(what), Instant::now());
        let tell = move || {
            let mut wait = PATIENCE;
            while ended.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
                let _ = write!(stderr().lock(), "\r\x1b[K{what}: {} s", began.elapsed().as_secs());
                wait = Duration::from_secs(1);
            }
            if wait < PATIENCE {
                let _ = write!(stderr().lock(), "\r\x1b[K");
            }
        };
        Self { running: std::thread::Builder::new().spawn(tell).ok().map(|thread| (end, thread)) }
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        if let Some((end, thread)) = self.running.take() {
            drop(end);
            let _ = thread.join();
        }
    }
}
