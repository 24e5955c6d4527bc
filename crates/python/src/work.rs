//! Long work next to the interpreter: its lock is released, and Ctrl-C is heard while the work goes on.

use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use super::error::raise;
use deadtime::stop::Stop;
use deadtime::threads::at_most;

/// The period of the checks for signals: an eighth of the 0.2 s in which Ctrl-C acts.
const LOOK: Duration = Duration::from_millis(25);
/// The longest wait for cancelled work, so that it rarely continues after its caller.
const PATIENCE: Duration = Duration::from_millis(100);
/// Stack of the working thread, as a program's first one has it.
const STACK: usize = 8 << 20;

/// Runs `work` in a thread of its own, without the interpreter's lock, on `threads` threads (`None`: all).
///
/// # Errors
/// The result of the work. `KeyboardInterrupt` and every other exception of a signal's handler are raised at once: the work gets a stop request, and ends at
/// its next check.
pub(super) fn long<T: Send + 'static>(
    py: Python<'_>,
    threads: Option<usize>,
    work: impl FnOnce(&Stop) -> deadtime::Result<T> + Send + 'static,
) -> PyResult<T> {
    long_told(py, threads, |_| Ok(()), work)
}

/// The same, with a word from time to time to the thread that waits: an exception that `tell` raises stops the work.
pub(super) fn long_told<T: Send + 'static>(
    py: Python<'_>,
    threads: Option<usize>,
    mut tell: impl FnMut(Python<'_>) -> PyResult<()>,
    work: impl FnOnce(&Stop) -> deadtime::Result<T> + Send + 'static,
) -> PyResult<T> {
    let stop = Stop::default();
    let wish = stop.clone();
    let (answer, answers) = sync_channel(1);
    let body = move || {
        let done = match threads {
            None => Ok(work(&wish)),
            Some(count) => rayon::ThreadPoolBuilder::new()
                .num_threads(at_most(count))
                .build()
                .map(|pool| pool.install(|| work(&wish))),
        };
        // The caller may have gone.
        let _ = answer.send(done);
    };
    thread::Builder::new().name("deadtime".to_owned()).stack_size(STACK).spawn(body)?;
    let answers = std::sync::Mutex::new(answers);
    let wait = |patience: Duration| {
        py.detach(|| {
            answers.lock().map_or(Err(RecvTimeoutError::Disconnected), |answers| {
                answers.recv_timeout(patience)
            })
        })
    };
    loop {
        match wait(LOOK) {
            Ok(Ok(done)) => {
                let done = done.map_err(|e| raise(py, e))?;
                tell(py)?;
                return Ok(done);
            }
            Ok(Err(pool)) => return Err(PyRuntimeError::new_err(pool.to_string())),
            Err(RecvTimeoutError::Timeout) => {
                if let Err(raised) = py.check_signals().and_then(|()| tell(py)) {
                    stop.set();
                    let _ = wait(PATIENCE);
                    return Err(raised);
                }
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err(
                    "the work ended without an answer; this is an error of deadtime",
                ));
            }
        }
    }
}

/// Works for so many seconds, looking for a wish to stop: for tests of interrupts.
#[pyfunction]
pub(super) fn _busy(py: Python<'_>, seconds: f64) -> PyResult<()> {
    long(py, None, move |stop| {
        let from = std::time::Instant::now();
        while from.elapsed().as_secs_f64() < seconds {
            stop.check()?;
            thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    })
}
