//! The current step and its progress, on standard error: a bar on a terminal, a line a minute elsewhere.

use std::io::{IsTerminal, Write, stderr};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::show::Out;
use deadtime_signal::progress::HowFar;
use deadtime_signal::text::shown;

/// Cells of the bar.
const CELLS: f64 = 24.0;

/// The period of the bar; shorter work draws none.
const EVERY: Duration = Duration::from_secs(1);
/// The period of a line where standard error is no terminal.
const LINE: Duration = Duration::from_secs(60);

/// A bar: the progress of a command, its current step, and the elapsed time. A thread draws it anew each second, and it is removed when it is dropped. Where
/// standard error is no terminal, the thread prints a line a minute with the remaining time.
#[derive(Debug)]
pub(super) struct Bar {
    far: HowFar,
    quiet: bool,
    drawing: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Bar {
    pub(super) fn new(to: &Out<'_>) -> Self {
        let (far, quiet) = (HowFar::watched(), !to.tells_progress());
        if quiet {
            return Self { far, quiet, drawing: None };
        }
        let (end, ended) = channel();
        let (began, shared) = (Instant::now(), far.clone());
        let terminal = stderr().is_terminal();
        let every = if terminal { EVERY } else { LINE };
        let draw = move || {
            let mut drawn = false;
            while ended.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
                let (share, what) = shared.told().unwrap_or_else(|| (0.0, "begins".to_owned()));
                let (what, seconds) = (shown(&what), began.elapsed().as_secs());
                let mut out = stderr().lock();
                let _ = match terminal {
                    true => write!(out, "\r\x1b[K{}", bar(share, &what, seconds)),
                    false => writeln!(out, "deadtime: {}", line(share, &what, seconds)),
                };
                drawn = terminal;
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

    /// A line that stays, in the place of the bar until it is drawn anew; none for an empty message.
    pub(super) fn say(&self, line: &str) {
        if self.quiet {
            return;
        }
        let clear = if stderr().is_terminal() { "\r\x1b[K" } else { "" };
        eprintln!("{clear}{line}");
    }

    /// The progress report of the work. A terminal without write access stops no work.
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

/// The same as a line, with the time that is left where enough is done to extrapolate.
fn line(share: f64, what: &str, seconds: u64) -> String {
    /// The share from which the time is extrapolated.
    const LEAST: f64 = 0.02;
    let spent = seconds as f64;
    let left = (share > LEAST).then(|| spent * (1.0 - share).max(0.0) / share);
    let left = left.map_or_else(String::new, |left| match left {
        left if left < 90.0 => format!(", about {left:.0} s left"),
        left => format!(", about {:.0} min left", left / 60.0),
    });
    format!("{:.0} % {what}, {seconds} s{left}", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_extrapolates_the_time_that_is_left() {
        assert_eq!(line(0.5, "fitting", 60), "50 % fitting, 60 s, about 60 s left");
        assert_eq!(line(0.1, "fitting", 60), "10 % fitting, 60 s, about 9 min left");
        assert_eq!(line(0.01, "fitting", 60), "1 % fitting, 60 s");
        assert_eq!(line(1.0, "fitting", 60), "100 % fitting, 60 s, about 0 s left");
    }

    #[test]
    fn a_bar_is_as_full_as_the_work_is_done() {
        assert_eq!(bar(0.5, "fitting", 3), "[############------------]  50 % fitting, 3 s");
        assert_eq!(bar(2.0, "x", 0), format!("[{}] 200 % x, 0 s", "#".repeat(24)));
    }
}
