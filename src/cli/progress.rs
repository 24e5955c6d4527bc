//! What is being done and how far it is, on standard error; nothing where that is no terminal.

use std::io::{IsTerminal, Write, stderr};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::show::Out;
use deadtime_signal::progress::HowFar;
use deadtime_signal::text::shown;

/// Cells of the bar.
const CELLS: f64 = 24.0;

/// How often a line is drawn anew; work that is done sooner draws none.
const EVERY: Duration = Duration::from_secs(1);

/// A bar: how far a command is, what it does, and for how long it has worked. A thread draws it anew each second; it goes when it is dropped.
#[derive(Debug)]
pub(super) struct Bar {
    far: HowFar,
    quiet: bool,
    drawing: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Bar {
    pub(super) fn new(to: &Out<'_>) -> Self {
        let (far, quiet) = (HowFar::watched(), !to.tells_progress());
        if quiet || !stderr().is_terminal() {
            return Self { far, quiet, drawing: None };
        }
        let (end, ended) = channel();
        let (began, shared) = (Instant::now(), far.clone());
        let draw = move || {
            let mut drawn = false;
            while ended.recv_timeout(EVERY) == Err(RecvTimeoutError::Timeout) {
                if let Some((share, what)) = shared.told() {
                    let _ = write!(
                        stderr().lock(),
                        "\r\x1b[K{}",
                        bar(share, &shown(&what), began.elapsed().as_secs())
                    );
                    drawn = true;
                }
            }
            if drawn {
                let _ = write!(stderr().lock(), "\r\x1b[K");
            }
        };
        Self {
            far,
            quiet,
            drawing: std::thread::Builder::new().spawn(draw).ok().map(|thread| (end, thread)),
        }
    }

    /// A line that stays, in the place of the bar until it is drawn anew; nothing where nothing is to be said.
    pub(super) fn say(&self, line: &str) {
        if self.quiet {
            return;
        }
        let clear = if self.drawing.is_some() { "\r\x1b[K" } else { "" };
        eprintln!("{clear}{line}");
    }

    /// Where the work says how far it is. A terminal that cannot be written to stops nothing.
    pub(super) fn far(&self) -> &HowFar {
        &self.far
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        if let Some((end, thread)) = self.drawing.take() {
            drop(end);
            let _ = thread.join();
        }
    }
}

fn bar(share: f64, what: &str, seconds: u64) -> String {
    let (done, cells) = ((share.clamp(0.0, 1.0) * CELLS).round() as usize, CELLS as usize);
    format!(
        "[{}{}] {:3.0} % {what}, {seconds} s",
        "#".repeat(done),
        "-".repeat(cells - done),
        100.0 * share
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_is_as_full_as_the_work_is_done() {
        assert_eq!(bar(0.5, "fitting", 3), "[############------------]  50 % fitting, 3 s");
        assert_eq!(bar(2.0, "x", 0), format!("[{}] 200 % x, 0 s", "#".repeat(24)));
    }
}
