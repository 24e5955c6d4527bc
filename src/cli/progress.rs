//! What is being done and how far it is, on standard error; nothing where that is no terminal.

use std::fmt::Display;
use std::io::{IsTerminal, Write, stderr};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::Out;
use crate::text::shown;

/// Cells of the bar.
const CELLS: f64 = 24.0;

/// A person waits this long without asking.
const PATIENCE: Duration = Duration::from_secs(2);
/// How often a line is drawn anew.
const EVERY: Duration = Duration::from_secs(1);

/// A line on the terminal that a thread draws anew each second; taken away when it is dropped.
#[derive(Debug)]
struct Line(Option<(Sender<()>, JoinHandle<()>)>);

impl Line {
    /// The text after so many seconds, from `first` on.
    fn new(to: &Out<'_>, first: Duration, text: impl Fn(u64) -> Option<String> + Send + 'static) -> Self {
        if !(to.tells_progress() && stderr().is_terminal()) {
            return Self(None);
        }
        let (end, ended) = channel();
        let began = Instant::now();
        let tell = move || {
            let (mut wait, mut drawn) = (first, false);
            while ended.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
                if let Some(text) = text(began.elapsed().as_secs()) {
                    let _ = write!(stderr().lock(), "\r\x1b[K{text}");
                    drawn = true;
                }
                wait = EVERY;
            }
            if drawn {
                let _ = write!(stderr().lock(), "\r\x1b[K");
            }
        };
        Self(std::thread::Builder::new().spawn(tell).ok().map(|thread| (end, thread)))
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        if let Some((end, thread)) = self.0.take() {
            drop(end);
            let _ = thread.join();
        }
    }
}

/// The part that is done, 0 to 1, and what is being done now.
type Far = Arc<Mutex<Option<(f64, String)>>>;

/// A bar: how far a command is, what it does, and for how long it has worked.
#[derive(Debug)]
pub(super) struct Bar {
    far: Far,
    line: Line,
}

impl Bar {
    pub(super) fn new(to: &Out<'_>) -> Self {
        let far = Far::default();
        let shared = Arc::clone(&far);
        let text = move |seconds: u64| {
            let far = shared.lock().unwrap_or_else(PoisonError::into_inner);
            far.as_ref().map(|(share, what)| drawn(*share, what, seconds))
        };
        Self { far, line: Line::new(to, EVERY / 5, text) }
    }

    /// The part that is done, 0 to 1, and what is being done now. A terminal that cannot be written to stops nothing.
    pub(super) fn show(&self, share: f64, what: &dyn Display) {
        *self.far.lock().unwrap_or_else(PoisonError::into_inner) = Some((share, shown(&what.to_string())));
    }

    /// Takes the bar away.
    pub(super) fn end(self) {
        drop(self.line);
    }
}

fn drawn(share: f64, what: &str, seconds: u64) -> String {
    let (done, cells) = ((share.clamp(0.0, 1.0) * CELLS).round() as usize, CELLS as usize);
    format!("[{}{}] {:3.0} % {what}, {seconds} s", "#".repeat(done), "-".repeat(cells - done), 100.0 * share)
}

/// Work without a bar: from the second second on, what is being done and for how long; taken away when it is dropped.
#[derive(Debug)]
pub(super) struct Waiting {
    _line: Line,
}

impl Waiting {
    pub(super) fn new(to: &Out<'_>, what: &str) -> Self {
        Self::counting(to, what, String::new)
    }

    /// A file is being read.
    pub(super) fn reading(to: &Out<'_>, path: &std::path::Path) -> Self {
        Self::new(to, &format!("reading {}", path.display()))
    }

    /// With what is done by now.
    pub(super) fn counting(to: &Out<'_>, what: &str, done: impl Fn() -> String + Send + 'static) -> Self {
        let what = shown(what);
        Self { _line: Line::new(to, PATIENCE, move |seconds| Some(format!("{what}{}: {seconds} s", done()))) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_is_as_full_as_the_work_is_done() {
        assert_eq!(drawn(0.5, "fitting", 3), "[############------------]  50 % fitting, 3 s");
        assert_eq!(drawn(2.0, "x", 0), format!("[{}] 200 % x, 0 s", "#".repeat(24)));
    }
}
