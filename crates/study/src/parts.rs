//! A study that many machines make: tasks of several blocks, each of which becomes a part `DIR/estimates/part-00000017.parquet`.
//!
//! The assignment of blocks to tasks is written once, to `DIR/tasks.json`, and is kept when the study continues later. Every worker therefore makes the same
//! part under the same name, any number of times. A part is written under a temporary name and renamed; its footer names its study and task.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::block_file::Damaged;
use super::blocks::BLOCK;
use super::error::{Error, Result, StudyError};
use super::estimates::{Row, of_record, value_fields};
use super::parquet::{EstimateReader, EstimateTable, unread, unwritten};
use super::results::Study;
use super::run::Runner;
use super::seal;
use super::setting::Setting;
use super::tally::Tally;
use deadtime_signal::file::{read_text, sweep, write_atomic};
use deadtime_signal::parallel;
use deadtime_signal::remedy::{Message, Remedy};
use deadtime_signal::stop::Stop;

/// The format of `tasks.json`.
const FORMAT: &str = "deadtime/tasks@1";
const TASKS: &str = "tasks.json";
const ESTIMATES: &str = "estimates";
/// Names in a part's footer.
const STAMP: &str = "deadtime.stamp";
const BLOCKS: &str = "deadtime.blocks";
/// Estimates of a task at most: some 60 MB while it runs.
const LARGEST: usize = 400_000;
/// Records of a setting that are timed, the fastest of which counts: the first one of a process warms it up.
const TIMED: usize = 3;

/// Which blocks every task holds, and where their estimates are kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tasks {
    folder: PathBuf,
    stamp: String,
    /// One past the last block of every task.
    ends: Vec<usize>,
}

/// `tasks.json`.
#[derive(Serialize, Deserialize)]
struct Saved {
    format: String,
    plan: String,
    stamp: String,
    records_per_block: usize,
    ends: Vec<usize>,
}

impl Runner {
    /// Blocks in all: trials of one setting, 25 at most.
    #[must_use]
    pub fn blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Estimates of these blocks.
    #[must_use]
    pub fn estimates_of(&self, blocks: Range<usize>) -> usize {
        self.blocks.iter(blocks).map(|b| self.size(b)).sum()
    }

    /// A setting of every kind, and the records of that kind. Records of a kind have the same methods, number of samples and search range, and so about equal
    /// cost.
    #[must_use]
    pub fn kinds(&self) -> Vec<(usize, usize)> {
        let mut kinds: Vec<(usize, usize)> = Vec::new();
        for (number, (setting, kind)) in self.layout.settings.iter().zip(self.kind_of()).enumerate()
        {
            match kinds.get_mut(kind) {
                Some((_, records)) => *records += setting.trials,
                None => kinds.push((number, setting.trials)),
            }
        }
        kinds
    }

    /// The kind of every setting, in the order in which kinds are first met.
    fn kind_of(&self) -> Vec<usize> {
        let mut known = BTreeMap::new();
        let settings = self.layout.settings.iter();
        let key =
            |s: &Setting| (s.grid, s.key.samples, s.max_delay, s.inputs.len(), s.outputs.len());
        settings
            .map(|s| {
                let next = known.len();
                *known.entry(key(s)).or_insert(next)
            })
            .collect()
    }

    /// The cost of a record of this setting with all its estimates, s of wall-clock time on this thread.
    ///
    /// # Errors
    /// [`StudyError::Record`]; [`Error::Stopped`].
    pub fn cost(&self, setting: usize, stop: &Stop) -> Result<f64> {
        let Some(trials) = self.layout.settings.get(setting).map(|s| s.trials) else {
            return Ok(0.0);
        };
        let mut least = f64::INFINITY;
        for trial in 0..TIMED.min(trials) {
            let clock = Instant::now();
            of_record(&self.plan, &self.layout, setting, trial, stop)?;
            least = least.min(clock.elapsed().as_secs_f64());
        }
        Ok(least)
    }

    /// Blocks combined to tasks of about `task_s`, if a record of kind k costs `cost_s[k]`: one block at least, 400 000 estimates at most. A task holds whole
    /// settings, or a share of one. The result is one past the last block of every task.
    #[must_use]
    pub fn tasks(&self, cost_s: &[f64], task_s: f64) -> Vec<usize> {
        let kind = self.kind_of();
        // The share of a task that a block is.
        let share = |setting: usize, block: usize| {
            let records = self.blocks.get(block).map_or(0, |b| b.end - b.first) as f64;
            let cost = kind.get(setting).and_then(|k| cost_s.get(*k)).copied().unwrap_or(0.0);
            (records * cost / task_s)
                .max(self.estimates_of(block..block + 1) as f64 / LARGEST as f64)
        };
        let (mut ends, mut held) = (Vec::new(), 0.0);
        let mut first = 0;
        while let Some(setting) = self.blocks.get(first).map(|b| b.setting) {
            let end = self.blocks.of(setting).end;
            let whole: f64 = (first..end).map(|b| share(setting, b)).sum();
            if held + whole > 1.0 && held > 0.0 {
                ends.push(first);
                held = 0.0;
            }
            if whole > 1.0 {
                let pieces = (whole.ceil() as usize).min(end - first);
                ends.extend((1..=pieces).map(|piece| first + (end - first) * piece / pieces));
            } else {
                held += whole;
            }
            first = end;
        }
        if held > 0.0 || ends.last().is_none_or(|e| *e < self.blocks.len()) {
            ends.push(self.blocks.len());
        }
        ends
    }

    /// The same with so many blocks in a task.
    #[must_use]
    pub fn tasks_of(&self, blocks: usize) -> Vec<usize> {
        let kinds = self.kinds();
        let task_s = (blocks.max(1) * BLOCK) as f64;
        self.tasks(&vec![1.0; kinds.len()], task_s)
    }

    /// Makes the estimates of these blocks, on this thread, as the bytes of a part.
    ///
    /// # Errors
    /// [`StudyError::Record`], naming setting, trial and seed; [`Error::Stopped`].
    pub fn part(&self, blocks: Range<usize>, stop: &Stop) -> Result<Vec<u8>> {
        let told = [(STAMP, self.stamp().to_owned()), (BLOCKS, text(&blocks)), seal::open()];
        let wrong = |e| unwritten(Path::new("part"), &e);
        let mut keys = BTreeMap::new();
        let mut table: Option<EstimateTable<Vec<u8>>> = None;
        for block in self.blocks.iter(blocks) {
            for row in self.block(block, stop)? {
                let key = keys.entry(row.cell).or_insert_with(|| self.key(row.cell));
                let values = value_fields(&row);
                let fields = key.iter().chain(&values);
                let table = match &mut table {
                    Some(table) => table,
                    none => none.insert(
                        EstimateTable::new(Vec::new(), fields.clone(), &told).map_err(wrong)?,
                    ),
                };
                table.write(fields).map_err(wrong)?;
            }
        }
        table.map_or_else(|| Ok(Vec::new()), |t| t.finish().map(seal::close).map_err(wrong))
    }
}

/// Blocks as a part's footer has them.
fn text(blocks: &Range<usize>) -> String {
    format!("{}..{}", blocks.start, blocks.end)
}

impl Tasks {
    /// The tasks of a folder in which this study was begun; `None` where it was not.
    ///
    /// # Errors
    /// [`StudyError::Folder`] where the folder holds another study, or this one without `resume`; [`FileError::Io`](deadtime_signal::file::FileError::Io).
    pub fn open(runner: &Runner, folder: &Path, resume: bool) -> Result<Option<Self>> {
        let path = folder.join(TASKS);
        let refused =
            |detail: Message| Err(StudyError::Folder { folder: folder.to_owned(), detail }.into());
        if !path.exists() {
            let full = std::fs::read_dir(folder.join(ESTIMATES))
                .is_ok_and(|mut entries| entries.next().is_some());
            return if full {
                refused(
                    "has a folder `estimates` that is no part of this study; give another folder"
                        .into(),
                )
            } else {
                Ok(None)
            };
        }
        let text = read_text(&path)?;
        let saved: Saved =
            serde_json::from_str(&text).map_err(|e| unread(&path, &format!("no {FORMAT}: {e}")))?;
        if saved.stamp != runner.stamp()
            || saved.format != FORMAT
            || !tile(&saved.ends, runner.blocks())
        {
            return refused(
                "holds the parts of another study (other trials, seed or program version included); give another folder, or remove its tasks.json and estimates".into(),
            );
        }
        if !resume {
            return refused(
                Message::from("holds parts of this study; ").and(Remedy::Resume).and(
                    " goes on where it was, removing its tasks.json and estimates starts anew",
                ),
            );
        }
        Ok(Some(Self { folder: folder.to_owned(), stamp: saved.stamp, ends: saved.ends }))
    }

    /// Begins a study in a folder: `ends` is one past the last block of every task.
    ///
    /// # Errors
    /// [`StudyError::Folder`] where these tasks do not hold every block once; [`FileError::Io`](deadtime_signal::file::FileError::Io).
    pub fn new(runner: &Runner, folder: &Path, ends: Vec<usize>) -> Result<Self> {
        if !tile(&ends, runner.blocks()) {
            return Err(StudyError::Folder {
                folder: folder.to_owned(),
                detail: "the tasks do not hold every block once".into(),
            }
            .into());
        }
        let (path, parts) = (folder.join(TASKS), folder.join(ESTIMATES));
        std::fs::create_dir_all(&parts).map_err(|e| Error::io(&parts, e))?;
        let (plan, stamp) = (runner.plan.name.clone(), runner.stamp().to_owned());
        let saved =
            Saved { format: FORMAT.to_owned(), plan, stamp, records_per_block: BLOCK, ends };
        let text = serde_json::to_string(&saved).map_err(|e| unread(&path, &e.to_string()))?;
        write_atomic(&path, |out| writeln!(out, "{text}"))?;
        Ok(Self { folder: folder.to_owned(), stamp: saved.stamp, ends: saved.ends })
    }

    /// The folder of the study.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The number of tasks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// There is nothing to do.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// The blocks of a task.
    #[must_use]
    pub fn blocks(&self, task: usize) -> Range<usize> {
        let first =
            task.checked_sub(1).and_then(|before| self.ends.get(before)).copied().unwrap_or(0);
        first..self.ends.get(task).copied().unwrap_or(first)
    }

    /// Where a task's estimates are kept.
    #[must_use]
    pub fn path(&self, task: usize) -> PathBuf {
        self.folder.join(ESTIMATES).join(format!("part-{task:08}.parquet"))
    }

    /// Where all of them are kept, in order.
    #[must_use]
    pub fn paths(&self) -> Vec<PathBuf> {
        (0..self.len()).map(|task| self.path(task)).collect()
    }

    /// The tasks without a part of this study, in order, and those with an unusable part. Parts are read whole, byte by byte. Half-written files of a dead
    /// client's workers are removed: the caller holds the folder's [`deadtime_signal::file::Lock`].
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io); [`Error::Stopped`].
    pub fn missing(&self, stop: &Stop) -> Result<(Vec<usize>, Vec<Damaged>)> {
        self.tidy()?;
        let state = |task: usize| -> Result<Option<(usize, Option<Damaged>)>> {
            stop.check()?;
            let path = self.path(task);
            if !path.exists() {
                return Ok(Some((task, None)));
            }
            Ok(self.sound(task)?.err().map(|why| (task, Some(Damaged { file: path, why }))))
        };
        let missing = parallel::try_map(0..self.len(), state)?;
        let (tasks, damaged): (Vec<usize>, Vec<Option<Damaged>>) =
            missing.into_iter().flatten().unzip();
        Ok((tasks, damaged.into_iter().flatten().collect()))
    }

    /// A task's part, after a check that every byte is as written and that it is this task's of this study. Otherwise the reason.
    fn sound(&self, task: usize) -> Result<Result<EstimateReader, String>> {
        let path = self.path(task);
        let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, e))?;
        if !seal::is_whole(&bytes) {
            return Ok(Err(if bytes.is_empty() {
                "it is empty"
            } else {
                "its digest is not that of its bytes"
            }
            .to_owned()));
        }
        Ok(match EstimateReader::of(&path, bytes) {
            Err(e) => Err(e.to_string()),
            Ok(part) if !self.owns(task, &part) => {
                Err("it is no part of this study, or another task's".to_owned())
            }
            Ok(part) => Ok(part),
        })
    }

    fn owns(&self, task: usize, part: &EstimateReader) -> bool {
        part.about(STAMP) == Some(self.stamp.as_str())
            && part.about(BLOCKS) == Some(text(&self.blocks(task)).as_str())
    }

    /// Writes a task's part, all of it or none.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io).
    pub fn keep(&self, task: usize, part: &[u8]) -> Result<()> {
        Ok(write_atomic(&self.path(task), |out| out.write_all(part))?)
    }

    /// Reads all parts and writes `DIR/study.json`. Every cell's sums over its estimates are in the order of the blocks, as on one machine. The sums are then
    /// the same to the bit. Memory holds one part for every thread.
    ///
    /// # Errors
    /// [`StudyError::Results`] for a part that is missing, damaged or another study's;
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io); [`Error::Stopped`].
    pub fn gather(&self, runner: &Runner, stop: &Stop) -> Result<Study> {
        let cells = runner.layout.slots.len();
        // Tasks that share a setting are added up one after the other.
        let starts = |task: &usize| {
            let first = self.blocks(*task).start;
            first == 0
                || runner.blocks.get(first).map(|b| b.setting)
                    != runner.blocks.get(first - 1).map(|b| b.setting)
        };
        let mut runs: Vec<Range<usize>> = Vec::new();
        for task in 0..self.len() {
            match runs.last_mut() {
                Some(run) if !starts(&task) => run.end = task + 1,
                _ => runs.push(task..task + 1),
            }
        }
        let of_run = |run: &Range<usize>| -> Result<BTreeMap<usize, Tally>> {
            let mut tallies: BTreeMap<usize, Tally> = BTreeMap::new();
            for task in run.clone() {
                stop.check()?;
                for row in self.rows(runner, task)? {
                    if row.cell >= cells {
                        return Err(unread(
                            &self.path(task),
                            &format!("cell {} is none of this study", row.cell),
                        ));
                    }
                    runner.count(tallies.entry(row.cell).or_default(), &row);
                }
            }
            Ok(tallies)
        };
        let added = parallel::try_map(&runs, of_run)?;
        let mut tallies = vec![Tally::default(); cells];
        for (cell, tally) in added.into_iter().flatten() {
            if let Some(place) = tallies.get_mut(cell) {
                *place = tally;
            }
        }
        self.tidy()?;
        let study = runner.study(&tallies);
        study.write(&self.folder.join("study.json"))?;
        Ok(study)
    }

    /// Removes what workers that were killed while they wrote left behind.
    fn tidy(&self) -> Result<()> {
        sweep(&self.folder)?;
        Ok(sweep(&self.folder.join(ESTIMATES))?)
    }

    /// The estimates of one task.
    fn rows(&self, runner: &Runner, task: usize) -> Result<Vec<Row>> {
        let path = self.path(task);
        let rows = self.sound(task)?.map_err(|why| unread(&path, &why))?.rows()?;
        let expected = runner.estimates_of(self.blocks(task));
        if rows.len() == expected {
            Ok(rows)
        } else {
            Err(unread(&path, &format!("{} estimates where there are {expected}", rows.len())))
        }
    }
}

/// The ends go up to the last block, none of them twice.
fn tile(ends: &[usize], blocks: usize) -> bool {
    ends.first().is_some_and(|e| *e > 0)
        && ends.windows(2).all(|w| w[0] < w[1])
        && ends.last() == Some(&blocks)
}
