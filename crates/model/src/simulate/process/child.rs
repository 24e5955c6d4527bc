//! A child process in a group of its own, its pipes read by threads, and the list of those that run.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// What is kept of the words on standard error.
const KEPT: usize = 2000;
/// How often it is looked whether a process has ended.
const LOOK: Duration = Duration::from_millis(2);

/// The variable of the environment by which whatever a simulator starts is known as its own, in whatever session.
const MARK: &str = "DEADTIME_SIMULATOR";
/// Looks for processes with a mark: one that is being started while it is looked escapes the first.
#[cfg(target_os = "linux")]
const LOOKS: usize = 5;

/// The processes that run just now; copies share one list.
#[derive(Debug, Clone, Default)]
pub struct Children(Arc<Mutex<Begun>>);

/// The processes with their marks, and how many there were.
#[derive(Debug, Default)]
struct Begun {
    running: BTreeMap<u32, String>,
    count: u64,
}

impl Children {
    fn lock(&self) -> MutexGuard<'_, Begun> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends all that run, with their own children.
    pub fn end_all(&self) {
        let running = std::mem::take(&mut self.lock().running);
        for (process, mark) in running {
            end_group(process);
            end_marked(&mark);
        }
    }

    /// How many run.
    #[must_use]
    pub fn running(&self) -> usize {
        self.lock().running.len()
    }
}

/// Kills processes, a group by its number below 0.
#[cfg(unix)]
fn kill(numbers: &[String]) {
    // There is no way to signal without unsafe code; every Unix has the program.
    let kill = Command::new("kill")
        .args(["-KILL", "--"])
        .args(numbers)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    drop(kill);
}

/// Ends a process and what it started in its group.
#[cfg(unix)]
fn end_group(process: u32) {
    kill(&[format!("-{process}")]);
}

/// Ends whatever has a mark in its environment, also in sessions of its own.
#[cfg(target_os = "linux")]
fn end_marked(mark: &str) {
    let variable = format!("{MARK}={mark}").into_bytes();
    for _ in 0..LOOKS {
        let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
        let numbers = processes.filter_map(|p| p.file_name().into_string().ok());
        let marked: Vec<String> = numbers
            .filter(|number| number.bytes().all(|b| b.is_ascii_digit()))
            .filter(|number| {
                std::fs::read(format!("/proc/{number}/environ"))
                    .is_ok_and(|all| all.split(|b| *b == 0).any(|one| one == variable))
            })
            .collect();
        if marked.is_empty() {
            return;
        }
        kill(&marked);
    }
}

/// Elsewhere a process that begins a session of its own is not found.
#[cfg(not(target_os = "linux"))]
fn end_marked(_: &str) {}

#[cfg(not(unix))]
fn end_group(process: u32) {
    let kill = Command::new("taskkill")
        .args(["/F", "/T", "/PID", &process.to_string()])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    drop(kill);
}

/// A process that is ended when nobody holds it any more.
#[derive(Debug)]
pub(super) struct Running {
    pub(super) child: Child,
    ended: Option<ExitStatus>,
    children: Children,
    mark: String,
    words: Words,
}

/// The end of what a process said on standard error, and the thread that listens.
#[derive(Debug)]
struct Words {
    said: Arc<Mutex<Vec<u8>>>,
    listener: Option<thread::JoinHandle<()>>,
}

impl Words {
    fn of(child: &mut Child) -> Self {
        let said = Arc::new(Mutex::new(Vec::new()));
        let listener = child.stderr.take().and_then(|mut pipe| {
            let said = said.clone();
            let listen = move || {
                let mut bytes = [0; 1024];
                while let Ok(count @ 1..) = pipe.read(&mut bytes) {
                    let mut said = said.lock().unwrap_or_else(PoisonError::into_inner);
                    said.extend_from_slice(&bytes[..count]);
                    let over = said.len().saturating_sub(KEPT);
                    said.drain(..over);
                }
            };
            thread::Builder::new().name("deadtime stderr".to_owned()).spawn(listen).ok()
        });
        Self { said, listener }
    }
}

impl Running {
    /// Starts a command of the shell.
    ///
    /// # Errors
    /// As a phrase: what the operating system said.
    pub(super) fn start(
        command: &str,
        folder: Option<&Path>,
        children: &Children,
    ) -> Result<Self, String> {
        let mut shell = shell(command);
        if let Some(folder) = folder {
            shell.current_dir(folder);
        }
        shell.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut list = children.lock();
        list.count += 1;
        let mark = format!("{}-{:p}-{}", std::process::id(), Arc::as_ptr(&children.0), list.count);
        shell.env(MARK, &mark);
        let mut child =
            shell.spawn().map_err(|e| format!("`{command}` could not be started: {e}"))?;
        list.running.insert(child.id(), mark.clone());
        drop(list);
        let words = Words::of(&mut child);
        Ok(Self { child, ended: None, children: children.clone(), mark, words })
    }

    /// Waits for its end; `None` where it does not come in time.
    pub(super) fn wait(&mut self, until: Instant) -> Option<ExitStatus> {
        loop {
            if let Ok(Some(status)) = self.child.try_wait() {
                self.ended = Some(status);
                return Some(status);
            }
            if Instant::now() >= until {
                return None;
            }
            thread::sleep(LOOK);
        }
    }

    /// Ends it, and what it started. Once it has ended its number may be another's.
    pub(super) fn end(&mut self) {
        if self.ended.is_none() {
            end_group(self.child.id());
            end_marked(&self.mark);
            let _ = self.child.kill();
            self.ended = self.child.wait().ok();
        }
    }

    /// Ends what it left behind when it ended.
    pub(super) fn end_left(&self) {
        end_marked(&self.mark);
    }

    /// Whether it has ended.
    pub(super) fn has_ended(&mut self) -> bool {
        self.ended.is_some() || self.wait(Instant::now()).is_some()
    }

    /// What it last said on standard error, as the end of a sentence; to be asked when it has ended.
    pub(super) fn last_words(&mut self) -> String {
        if let Some(listener) = self.words.listener.take() {
            // Whoever else holds the pipe may keep it open.
            let until = Instant::now() + Duration::from_millis(200);
            while !listener.is_finished() && Instant::now() < until {
                thread::sleep(LOOK);
            }
        }
        let said = self.words.said.lock().unwrap_or_else(PoisonError::into_inner);
        let text = String::from_utf8_lossy(&said);
        let lines: Vec<&str> = text.lines().map(str::trim_end).filter(|l| !l.is_empty()).collect();
        let last = lines[lines.len().saturating_sub(3)..].join(" | ");
        if last.is_empty() {
            "; it said nothing on standard error".to_owned()
        } else {
            format!("; it said: {}", deadtime_signal::text::message(&last))
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.end();
        self.children.lock().running.remove(&self.child.id());
    }
}

#[cfg(unix)]
fn shell(command: &str) -> Command {
    use std::os::unix::process::CommandExt;
    let mut shell = Command::new("sh");
    shell.args(["-c", command]).process_group(0);
    shell
}

#[cfg(not(unix))]
fn shell(command: &str) -> Command {
    let mut shell = Command::new("cmd");
    shell.args(["/C", command]);
    shell
}

/// How a process ended, in words.
pub(super) fn ended(status: ExitStatus) -> String {
    match status.code() {
        Some(code) => format!("it ended with exit code {code}"),
        None => format!("it was ended ({status})"),
    }
}
