//! Diagnoses of all cases, each stored with its run time and its commitment; finished cases are skipped.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use sha2::{Digest, Sha256};

use super::cases::{COMMITMENT, CaseFiles, find};
use super::error::BlindError;
use super::load;
use super::run_time::RunTime;
use crate::error::{Error, Result};
use deadtime_gap::Diagnosis;
use deadtime_signal::file::{Lock, read_bytes, sweep, write_atomic};
use deadtime_signal::progress::HowFar;
use deadtime_signal::stop::Stop;
use deadtime_signal::threads::at_most;

/// The treatment of cases with an earlier diagnosis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Existing {
    /// They are left as they are.
    #[default]
    Keep,
    /// They are diagnosed again.
    Redo,
}

/// How to run.
#[derive(Debug, Clone, PartialEq)]
pub struct RunOptions {
    /// Cases at a time, at least 1. Default 1: a diagnosis uses all threads itself, and its run time is then its own.
    pub jobs: usize,
    /// The treatment of cases with an earlier diagnosis. Default: kept.
    pub existing: Existing,
    /// Checked between cases; a diagnosis checks its own.
    pub stop: Stop,
    /// The report of the number of finished cases.
    pub far: HowFar,
}

impl Default for RunOptions {
    fn default() -> Self {
        Self { jobs: 1, existing: Existing::Keep, stop: Stop::default(), far: HowFar::default() }
    }
}

/// How one case went.
#[derive(Debug)]
pub enum Outcome {
    /// Diagnosed now.
    Done {
        /// Wall-clock time of the diagnosis, s.
        time_s: f64,
        /// The fault of an earlier verdict that could not be kept.
        damage: Option<&'static str>,
    },
    /// Diagnosed before and kept.
    Kept,
    /// Not diagnosed.
    Failed(Error),
}

/// How all cases went, in order of their names.
#[derive(Debug, Default)]
pub struct Summary {
    /// Every case and its outcome.
    pub cases: Vec<(String, Outcome)>,
}

impl Summary {
    /// The cases that failed, and why.
    pub fn failed(&self) -> impl Iterator<Item = (&str, &Error)> {
        self.cases.iter().filter_map(|(id, outcome)| match outcome {
            Outcome::Failed(e) => Some((id.as_str(), e)),
            Outcome::Done { .. } | Outcome::Kept => None,
        })
    }
}

/// Diagnoses every case of `cases` by `diagnose` and writes `verdicts/ID/{commitment.txt, diagnosis.json, run.json}`.
///
/// A case is complete when its diagnosis can be read, every byte of the verdict is as written, and its commitment is unchanged. The digest is in `run.json`. A
/// case that fails (also by a panic) is an [`Outcome::Failed`] and stops no other; it leaves no earlier diagnosis behind. `progress` is called after every
/// case, from its thread.
///
/// # Errors
/// An error occurs only where no case can begin: [`FileError::Io`](deadtime_signal::file::FileError::Io), [`BlindError::NoCases`], [`BlindError::BadName`].
/// [`FileError::Busy`](deadtime_signal::file::FileError::Busy) where another run writes to `verdicts`. [`Error::Stopped`], with the finished cases written.
pub fn run(
    cases: &Path,
    verdicts: &Path,
    options: &RunOptions,
    diagnose: &(dyn Fn(&CaseFiles) -> Result<Diagnosis> + Sync),
    progress: &(dyn Fn(&str, &Outcome) + Sync),
) -> Result<Summary> {
    let found: Vec<(String, Mutex<Option<Result<CaseFiles>>>)> =
        find(cases)?.into_iter().map(|(id, files)| (id, Mutex::new(Some(files)))).collect();
    let _held = Lock::of(verdicts)?;
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::with_capacity(found.len()));
    let steps = options.far.steps(found.len(), "cases");
    // Separate threads: in a shared pool a waiting case would work on another one, and its run time would include that work.
    std::thread::scope(|scope| {
        for _ in 0..at_most(options.jobs).clamp(1, found.len()) {
            scope.spawn(|| {
                while !options.stop.is_set()
                    && let Some((id, files)) = found.get(next.fetch_add(1, Ordering::Relaxed))
                {
                    let Some(files) = locked(files).take() else { continue };
                    let outcome = run_case(id, files, verdicts, options.existing, diagnose);
                    if matches!(outcome, Outcome::Failed(Error::Stopped(_))) {
                        break;
                    }
                    steps.one_more();
                    progress(id, &outcome);
                    locked(&results).push((id.clone(), outcome));
                }
            });
        }
    });
    options.stop.check()?;
    let mut cases = results.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    cases.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(Summary { cases })
}

/// Diagnoses one case, as [`run`] does each.
#[must_use]
pub fn run_case(
    id: &str,
    files: Result<CaseFiles>,
    verdicts: &Path,
    existing: Existing,
    diagnose: &(dyn Fn(&CaseFiles) -> Result<Diagnosis> + Sync),
) -> Outcome {
    let place = Place::new(verdicts.join(id));
    files
        .and_then(|files| place.diagnose(&files, existing, diagnose))
        .unwrap_or_else(|e| place.clear().map_or_else(Outcome::Failed, |()| Outcome::Failed(e)))
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// The folder of one verdict.
struct Place {
    commitment: PathBuf,
    diagnosis: PathBuf,
    time: PathBuf,
}

impl Place {
    fn new(folder: PathBuf) -> Self {
        Self {
            commitment: folder.join(COMMITMENT),
            diagnosis: folder.join(load::DIAGNOSIS),
            time: folder.join(load::RUN_TIME),
        }
    }

    fn diagnose(
        &self,
        case: &CaseFiles,
        existing: Existing,
        diagnose: &(dyn Fn(&CaseFiles) -> Result<Diagnosis> + Sync),
    ) -> Result<Outcome> {
        let commitment = read_bytes(&case.commitment)?;
        let mut damage = None;
        if existing == Existing::Keep {
            match self.state(&commitment) {
                State::Done => return Ok(Outcome::Kept),
                State::Damaged(why) => damage = Some(why),
                State::Missing => {}
            }
        }
        self.clear()?;
        if let Some(folder) = self.time.parent() {
            sweep(folder)?;
        }
        let clock = Instant::now();
        let diagnosis = catch_unwind(AssertUnwindSafe(|| diagnose(case))).map_err(|panic| {
            let message = panic
                .downcast_ref::<&str>()
                .map(|t| (*t).to_owned())
                .or_else(|| panic.downcast_ref::<String>().cloned());
            BlindError::Panicked { id: case.id.clone(), message: message.unwrap_or_default() }
        })??;
        let time_s = clock.elapsed().as_secs_f64();
        write_atomic(&self.commitment, |out| out.write_all(&commitment))?;
        diagnosis.write(&self.diagnosis)?;
        let sealed = sealed(time_s, &read_bytes(&self.diagnosis)?, &commitment);
        write_atomic(&self.time, |out| out.write_all(sealed.as_bytes()))?;
        Ok(Outcome::Done { time_s, damage })
    }

    /// The state that an earlier run left.
    fn state(&self, commitment: &[u8]) -> State {
        let Ok(run) = std::fs::read(&self.time) else { return State::Missing };
        let Ok(RunTime { time_s, .. }) = load::run_time(&self.time) else {
            return State::Damaged("run.json cannot be read");
        };
        if std::fs::read(&self.commitment).ok().as_deref() != Some(commitment) {
            return State::Damaged("its commitment is not the case's");
        }
        let Ok(diagnosis) = std::fs::read(&self.diagnosis) else {
            return State::Damaged("diagnosis.json is missing");
        };
        if sealed(time_s, &diagnosis, commitment).as_bytes() != run {
            return State::Damaged("the digest in run.json is not that of the verdict");
        }
        if Diagnosis::read(&self.diagnosis).is_err() {
            State::Damaged("diagnosis.json cannot be read")
        } else {
            State::Done
        }
    }

    /// Removes the files of an earlier run, the mark of completion first.
    fn clear(&self) -> Result<()> {
        for file in [&self.time, &self.diagnosis, &self.commitment] {
            match std::fs::remove_file(file) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                    return Err(Error::io(file, e));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// The content of a verdict's folder.
enum State {
    Missing,
    Done,
    Damaged(&'static str),
}

/// The text of `run.json`: the run time, and a digest of it and of all else that the verdict consists of.
fn sealed(time_s: f64, diagnosis: &[u8], commitment: &[u8]) -> String {
    let time = serde_json::json!(time_s).to_string();
    let lengths = format!("{time} {} {}\n", diagnosis.len(), commitment.len());
    let digest = Sha256::new()
        .chain_update(lengths)
        .chain_update(diagnosis)
        .chain_update(commitment)
        .finalize();
    let hex: String = digest.iter().map(|b| format!("{b:02x}")).collect();
    format!(
        "{{\n  \"format\": \"deadtime/blind-run@1\",\n  \"time_s\": {time},\n  \"sha256\": \"{hex}\"\n}}\n"
    )
}
