//! A child process in its own process group, with threads that read its pipes, and the list of running processes.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Length of the stored standard error.
const KEPT: usize = 2000;
/// Interval of the checks whether a process has ended.
const LOOK: Duration = Duration::from_millis(2);

/// The environment variable that marks all processes started by a simulator, in any session.
const MARK: &str = "DEADTIME_SIMULATOR";
/// Number of searches for marked processes: a process being started may escape the first.
#[cfg(target_os = "linux")]
const LOOKS: usize = 20;

/// The running processes; copies share one list.
#[derive(Debug, Clone, Default)]
pub struct Children(Arc<Mutex<Begun>>);

/// The processes with their marks, and their total number.
#[derive(Debug, Default)]
struct Begun {
    running: BTreeMap<u32, String>,
    count: u64,
}

impl Children {
    fn lock(&self) -> MutexGuard<'_, Begun> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends all running processes, with their own children.
    pub fn end_all(&self) {
        let running = std::mem::take(&mut self.lock().running);
        for (process, mark) in running {
            end_group(process);
            end_marked(&mark);
        }
    }

    /// Number of running processes.
    #[must_use]
    pub fn running(&self) -> usize {
        self.lock().running.len()
    }
}

/// Kills processes; a negative number denotes a group.
#[cfg(unix)]
fn kill(numbers: &[String]) {
    // Signalling without unsafe code is impossible in the standard library; every Unix has the program.
    let kill = Command::new("kill")
        .args(["-KILL", "--"])
        .args(numbers)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    drop(kill);
}

/// Ends a process and its group.
#[cfg(unix)]
fn end_group(process: u32) {
    kill(&[format!("-{process}")]);
}

/// Ends all processes with a mark in their environment, also in other sessions. A process shows no environment while it begins its program: then the search is
/// repeated.
#[cfg(target_os = "linux")]
fn end_marked(mark: &str) {
    let variable = format!("{MARK}={mark}").into_bytes();
    for _ in 0..LOOKS {
        let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
        let numbers = processes
            .filter_map(|p| p.file_name().into_string().ok())
            .filter(|number| number.bytes().all(|b| b.is_ascii_digit()));
        let (mut marked, mut begins) = (Vec::new(), false);
        for number in numbers {
            match std::fs::read(format!("/proc/{number}/environ")) {
                Ok(all) if all.split(|b| *b == 0).any(|one| one == variable) => marked.push(number),
                Ok(all) if all.is_empty() => begins |= is_new(&number),
                _ => {}
            }
        }
        if !marked.is_empty() {
            kill(&marked);
        } else if begins {
            thread::sleep(LOOK);
        } else {
            return;
        }
    }
}

/// Whether a process began less than a second ago and has not ended. Times are hundredths of a second since the machine started (proc(5)).
#[cfg(target_os = "linux")]
fn is_new(number: &str) -> bool {
    let read = |name: &str| std::fs::read_to_string(format!("/proc/{name}")).ok();
    let seconds = || read("uptime")?.split_whitespace().next()?.parse::<f64>().ok();
    // The name in parentheses may hold spaces; state and beginning are the first and the twentieth word after it.
    let stat = read(&format!("{number}/stat"));
    let mut words =
        stat.iter().filter_map(|s| s.rsplit_once(')')).flat_map(|s| s.1.split_whitespace());
    let ended = words.next().is_none_or(|state| ["Z", "X"].contains(&state));
    let began = words.nth(18).and_then(|ticks| ticks.parse::<f64>().ok());
    !ended && began.zip(seconds()).is_some_and(|(began, now)| now - began / 100.0 < 1.0)
}

/// On other systems a process in its own session is not found.
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

/// A process that is ended when it is dropped.
#[derive(Debug)]
pub(super) struct Running {
    pub(super) child: Child,
    ended: Option<ExitStatus>,
    children: Children,
    mark: String,
    words: Words,
}

/// The end of the standard error of a process, and the thread that reads it.
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
    /// Starts a shell command.
    ///
    /// # Errors
    /// The message of the operating system, as a phrase.
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

    /// Waits for its end; `None` after the deadline.
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

    /// Ends it, and its children. After its end its number may belong to another process.
    pub(super) fn end(&mut self) {
        if self.ended.is_none() {
            end_group(self.child.id());
            end_marked(&self.mark);
            let _ = self.child.kill();
            self.ended = self.child.wait().ok();
        }
    }

    /// Ends the processes that it left behind.
    pub(super) fn end_left(&self) {
        end_marked(&self.mark);
    }

    /// Whether it has ended.
    pub(super) fn has_ended(&mut self) -> bool {
        self.ended.is_some() || self.wait(Instant::now()).is_some()
    }

    /// The end of its standard error, as the end of a sentence; valid after the end of the process.
    pub(super) fn last_words(&mut self) -> String {
        if let Some(listener) = self.words.listener.take() {
            // Other holders of the pipe may keep it open.
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

/// The exit of a process, in words.
pub(super) fn ended(status: ExitStatus) -> String {
    match status.code() {
        Some(code) => format!("it ended with exit code {code}"),
        None => format!("it was ended ({status})"),
    }
}
