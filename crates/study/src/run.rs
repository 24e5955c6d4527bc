//! Runs a plan on all cores, block by block; finished blocks stay when the program is stopped.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::block_file::{BlockFile, Damaged};
use super::blocks::{BLOCK, Block, Blocks};
use super::budget::Budget;
use super::cell::{Resolved, Slot};
use super::error::{Error, Result, StudyError};
use super::estimates::{CsvSink, Field, Row, Sink, key_fields, made, of_record, value_fields};
use super::keys::Delay;
#[cfg(feature = "tables")]
use super::parquet::ParquetSink;
use super::plan::{PLAIN, Plan};
use super::results::{Cell, FORMAT, Kept, Score, Study};
use super::tally::{Tally, kept};
use deadtime_signal::file::{Lock, sweep, write_atomic};
use deadtime_signal::parallel;
use deadtime_signal::remedy::{Message, Remedy};
use deadtime_signal::stats;
use deadtime_signal::stop::Stop;

/// The folder of finished blocks.
const PARTS: &str = "parts";
/// The file with the digest of the study of the blocks.
const STAMP: &str = "plan.sha256";
/// The folder of blocks that are no longer needed, on its way out.
const SPENT: &str = ".deadtime-parts.tmp";

/// The progress of a study.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Estimates made, those of earlier runs included.
    pub done: usize,
    /// Estimates made by this run.
    pub now: usize,
    /// Estimates in all.
    pub all: usize,
}

/// A plan made ready to run.
pub struct Runner {
    pub(super) plan: Plan,
    pub(super) layout: Resolved,
    pub(super) blocks: Blocks,
    stamp: String,
}

/// A study in a folder without another writer.
pub struct Begun<'a> {
    runner: &'a Runner,
    folder: PathBuf,
    parts: PathBuf,
    /// Blocks that need not be made.
    done: BTreeSet<usize>,
    damaged: Vec<Damaged>,
    _lock: Lock,
}

impl Runner {
    /// Looks up everything that the plan names, and makes one record of every setting; no larger than a [`Budget`] allows by default.
    ///
    /// # Errors
    /// [`StudyError::Plan`], [`deadtime_signal::registry::RegistryError`] for unknown names and options; what keeps a record from being made, as [`StudyError::Record`];
    /// [`StudyError::Budget`].
    pub fn new(plan: &Plan) -> Result<Self> {
        Self::within(plan, &Budget::default())
    }

    /// The same within other limits.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn within(plan: &Plan, budget: &Budget) -> Result<Self> {
        let runner = Self::untried(plan, budget)?;
        parallel::try_map(&runner.layout.settings, |s| made(plan, s, 0).map(|_| ()))?;
        Ok(runner)
    }

    /// The same without making records: for workers that go on where somebody tried the plan before.
    ///
    /// # Errors
    /// As [`Self::new`], but for records.
    pub fn untried(plan: &Plan, budget: &Budget) -> Result<Self> {
        budget.check(plan)?;
        let layout = Resolved::new(plan).map_err(|e| plan.origin.place(e))?;
        let uncounted = || StudyError::Plan {
            plan: plan.name.clone(),
            detail: "`trials`: more records than can be counted".to_owned(),
        };
        let blocks = Blocks::new(layout.settings.iter().map(|s| s.trials)).ok_or_else(uncounted)?;
        let stamp = stamp(plan, &layout);
        Ok(Self { plan: plan.clone(), layout, blocks, stamp })
    }

    /// The plan.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// A digest of all inputs of the estimates: plan, seed, trials, the definitions of its names, and the program's version. Blocks of equal stamps may be
    /// combined.
    #[must_use]
    pub fn stamp(&self) -> &str {
        &self.stamp
    }

    /// Estimates in all.
    #[must_use]
    pub fn estimates(&self) -> usize {
        self.layout
            .settings
            .iter()
            .enumerate()
            .map(|(number, s)| s.trials.saturating_mul(self.layout.of(number).len()))
            .sum()
    }

    pub(super) fn size(&self, block: Block) -> usize {
        (block.end - block.first) * self.layout.of(block.setting).len()
    }

    /// Runs the unfinished part and writes `DIR/study.json` and `DIR/estimates.csv` (`.parquet` too with that feature). Finished blocks are kept in `DIR/parts`
    /// until then: a stopped run continues there with `resume`. The same to the bit for any number of threads, run times apart. `stop` is checked between the
    /// methods of a record.
    ///
    /// # Errors
    /// As [`Self::begin`] and [`Begun::run`].
    pub fn run(
        &self,
        folder: &Path,
        resume: bool,
        stop: &Stop,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Study> {
        self.begin(folder, resume, stop)?.run(stop, progress)
    }

    /// Locks the folder, removes what killed runs left half-written, and checks every block that is there, byte by byte.
    ///
    /// # Errors
    /// [`FileError::Busy`](deadtime_signal::file::FileError::Busy) where another run writes to the folder; [`StudyError::Folder`] where it holds another plan's blocks, or some of this one without
    /// `resume`; [`FileError::Io`](deadtime_signal::file::FileError::Io); [`Error::Stopped`].
    pub fn begin(&self, folder: &Path, resume: bool, stop: &Stop) -> Result<Begun<'_>> {
        let lock = Lock::of(folder)?;
        let spent = folder.join(SPENT);
        if spent.exists() {
            fs::remove_dir_all(&spent).map_err(|e| Error::io(&spent, e))?;
        }
        sweep(folder)?;
        let parts = self.open(folder, resume)?;
        sweep(&parts)?;
        let there: Vec<(usize, PathBuf)> = blocks_in(&parts)?
            .into_iter()
            .filter(|(number, _)| *number < self.blocks.len())
            .collect();
        let whole = |(number, path): &(usize, PathBuf)| -> Result<Option<Damaged>> {
            stop.check()?;
            let damaged = |why| Damaged { file: path.clone(), why };
            Ok(self.block_file(*number).body(path)?.err().map(damaged))
        };
        let checked = parallel::try_map(&there, whole)?;
        let done = there
            .iter()
            .zip(&checked)
            .filter(|(_, damage)| damage.is_none())
            .map(|((number, _), _)| *number)
            .collect();
        let damaged = checked.into_iter().flatten().collect();
        Ok(Begun { runner: self, folder: folder.to_owned(), parts, done, damaged, _lock: lock })
    }

    fn block_file(&self, number: usize) -> BlockFile<'_> {
        BlockFile {
            stamp: &self.stamp,
            number,
            rows: self.blocks.get(number).map_or(0, |b| self.size(b)),
        }
    }

    /// The rows of one block, in the order of trials and cells.
    pub(super) fn block(&self, block: Block, stop: &Stop) -> Result<Vec<Row>> {
        let mut rows = Vec::with_capacity(self.size(block));
        for trial in block.first..block.end {
            rows.extend(of_record(&self.plan, &self.layout, block.setting, trial, stop)?);
        }
        Ok(rows)
    }

    /// The folder of blocks, new or of this very plan.
    fn open(&self, folder: &Path, resume: bool) -> Result<PathBuf> {
        let parts = folder.join(PARTS);
        let stamp = parts.join(STAMP);
        let mine = self.stamp.as_str();
        if parts.exists() {
            if !stamp.exists() && blocks_in(&parts)?.is_empty() {
                // A run was killed before it wrote its stamp.
                write_atomic(&stamp, |out| writeln!(out, "{mine}"))?;
                return Ok(parts);
            }
            let theirs = fs::read_to_string(&stamp).unwrap_or_default();
            let detail = if theirs.trim() != mine {
                "holds the unfinished study of another plan (other trials, seed or program version included); give another folder, or remove its folder `parts`".into()
            } else if !resume {
                Message::from("holds this study unfinished; ")
                    .and(Remedy::Resume)
                    .and(" goes on where it was, removing its folder `parts` starts anew")
            } else {
                return Ok(parts);
            };
            return Err(StudyError::Folder { folder: folder.to_owned(), detail }.into());
        }
        write_atomic(&stamp, |out| writeln!(out, "{mine}"))?;
        Ok(parts)
    }

    /// The columns of a cell's estimates that are the same in all of them.
    pub(super) fn key(&self, number: usize) -> Vec<(&'static str, Field)> {
        self.layout
            .slots
            .get(number)
            .map(|slot| key_fields(number, &self.cell(*slot)))
            .unwrap_or_default()
    }

    /// Adds an estimate to the sums of its cell.
    pub(super) fn count(&self, tally: &mut Tally, row: &Row) {
        let setting = &self.layout.settings[self.layout.slots[row.cell].setting];
        tally.add(row, &self.plan.grids[setting.grid].scoring, setting.sample_time);
    }

    /// The study from the sums of all cells.
    pub(super) fn study(&self, tallies: &[Tally]) -> Study {
        let mut cells: Vec<Cell> = self.layout.slots.iter().map(|s| self.cell(*s)).collect();
        for (cell, tally) in cells.iter_mut().zip(tallies) {
            cell.trials = tally.trials;
            cell.scored = tally.scored;
            cell.rms_samples = tally.rms();
            cell.rms_ci95_samples = tally.rms_ci95();
            cell.bias_samples = tally.bias();
            cell.mean_raw_s = tally.mean_raw_s();
            cell.std_raw_s = tally.std_raw_s();
            cell.flagged = tally.flagged;
            cell.unflagged_wrong = tally.wrong;
            cell.intervals = tally.intervals;
            cell.coverage95 = tally.coverage95();
            cell.bound_rms_samples = tally.bound_rms();
            cell.predicted_rms_samples = tally.predicted_rms();
            cell.time_per_estimate_s = tally.time_s();
        }
        let scores = self.scores(&mut cells, tallies);
        Study {
            format: FORMAT.to_owned(),
            plan: self.plan.name.clone(),
            about: self.plan.about.clone(),
            seed: self.plan.seed,
            program: format!("deadtime {}", env!("CARGO_PKG_VERSION")),
            cells,
            scores,
        }
    }

    /// Every method of every grid and place, at every share that is kept.
    fn scores(&self, cells: &mut [Cell], tallies: &[Tally]) -> Vec<Score> {
        let mut groups: BTreeMap<(usize, u8, usize), Vec<usize>> = BTreeMap::new();
        for (number, slot) in self.layout.slots.iter().enumerate() {
            let grid = self.layout.settings[slot.setting].grid;
            groups.entry((grid, slot.place as u8, slot.method)).or_default().push(number);
        }
        let mut scores = Vec::new();
        for ((grid, ..), members) in &groups {
            let of: Vec<&Tally> = members.iter().map(|&m| &tallies[m]).collect();
            for &percent in &self.plan.grids[*grid].scoring.kept_percent {
                let rms = kept(&of, percent);
                for (&member, rms) in members.iter().zip(&rms) {
                    cells[member].kept.push(Kept { percent, rms_samples: *rms });
                }
                let Some(&first) = members.first() else { continue };
                let some: Vec<f64> = rms.iter().flatten().copied().collect();
                let count = some.len() as f64;
                let mean = stats::mean(some.iter().copied());
                // Cells are independent of each other.
                let variance: Option<f64> =
                    of.iter().map(|t| t.rms_std().map(|[_, s]| s * s)).sum();
                let half = variance.map(|v| stats::NORMAL_95 * v.sqrt() / count);
                scores.push(Score {
                    grid: cells[first].grid.clone(),
                    place: cells[first].place,
                    method: cells[first].method.clone(),
                    options: cells[first].options.clone(),
                    kept_percent: percent,
                    mean_rms_samples: mean,
                    ci95_samples: mean
                        .zip(half)
                        .filter(|_| percent >= 100.0)
                        .map(|(m, h)| [(m - h).max(0.0), m + h]),
                });
            }
        }
        scores
    }

    /// The key of a cell, without results.
    fn cell(&self, slot: Slot) -> Cell {
        let setting = &self.layout.settings[slot.setting];
        let grid = &self.plan.grids[setting.grid];
        let chosen = self.layout.chosen(slot);
        let key = &setting.key;
        Cell {
            grid: grid.name.clone(),
            plant: key.plant.clone(),
            input: setting.inputs[slot.input].clone(),
            output: slot.output.map_or_else(|| "*".to_owned(), |o| setting.outputs[o].clone()),
            c2d: key.c2d.clone(),
            excitation: key.excitation.clone(),
            snr: key.snr.is_finite().then_some(key.snr),
            noise: key.noise.clone(),
            loops: key.loops,
            controller: key.controller.clone(),
            place: slot.place,
            delay_s: match &key.delay {
                Delay::PerInput(all) => {
                    all.get(slot.input).map_or_else(|| key.delay.clone(), |s| Delay::Same(*s))
                }
                other => other.clone(),
            },
            samples: key.samples,
            sample_time_s: key.sample_time_s,
            max_delay: setting.max_delay,
            truth: grid.truth,
            method: chosen.method.entry.name.to_owned(),
            options: match &chosen.options {
                Value::Object(options) => options.clone(),
                _ => Map::new(),
            },
            logging: (key.logging != PLAIN).then(|| key.logging.clone()),
            definition: setting.definition.clone(),
            repeatable: setting.repeatable,
            trials: 0,
            scored: 0,
            rms_samples: None,
            rms_ci95_samples: None,
            bias_samples: None,
            mean_raw_s: None,
            std_raw_s: None,
            flagged: 0,
            unflagged_wrong: 0,
            intervals: 0,
            coverage95: None,
            bound_rms_samples: None,
            predicted_rms_samples: None,
            time_per_estimate_s: None,
            kept: Vec::new(),
        }
    }
}

impl Begun<'_> {
    /// Blocks that were there and cannot be used: they are made again.
    #[must_use]
    pub fn damaged(&self) -> &[Damaged] {
        &self.damaged
    }

    /// Runs the unfinished part, and writes the results of the whole.
    ///
    /// # Errors
    /// The error of a record; [`FileError::Io`](deadtime_signal::file::FileError::Io); [`Error::Stopped`].
    pub fn run(self, stop: &Stop, progress: &(dyn Fn(Progress) + Sync)) -> Result<Study> {
        let runner = self.runner;
        let done = self
            .done
            .iter()
            .filter_map(|number| runner.blocks.get(*number))
            .map(|b| runner.size(b))
            .sum();
        let count = Mutex::new(Progress { done, now: 0, all: runner.estimates() });
        let tell = |more: usize| {
            if let Ok(mut count) = count.lock() {
                count.done += more;
                count.now += more;
                progress(*count);
            }
        };
        tell(0);
        shared_out(runner.blocks.len(), |number| {
            let Some(block) = runner.blocks.get(number).filter(|_| !self.done.contains(&number))
            else {
                return Ok(());
            };
            runner
                .block_file(number)
                .write(&part(&self.parts, number), &runner.block(block, stop)?)?;
            tell(runner.size(block));
            Ok(())
        })?;
        let study = self.gather(stop)?;
        // At once, so that a kill on the way leaves no half of them.
        let spent = self.folder.join(SPENT);
        fs::rename(&self.parts, &spent)
            .and_then(|()| fs::remove_dir_all(&spent))
            .map_err(|e| Error::io(&self.parts, e))?;
        Ok(study)
    }

    /// Reads all blocks in order, one at a time, and writes what came of them.
    fn gather(&self, stop: &Stop) -> Result<Study> {
        let Self { runner, folder, parts, .. } = self;
        let keys: Vec<_> =
            (0..runner.layout.slots.len()).map(|number| runner.key(number)).collect();
        let mut tallies = vec![Tally::default(); keys.len()];
        let mut sinks = sinks(folder)?;
        for number in 0..runner.blocks.len() {
            stop.check()?;
            let path = part(parts, number);
            for row in runner.block_file(number).read(&path)? {
                let Some((tally, key)) = tallies.get_mut(row.cell).zip(keys.get(row.cell)) else {
                    return Err(StudyError::Results {
                        path,
                        detail: format!("cell {} is none of this study", row.cell).into(),
                    }
                    .into());
                };
                runner.count(tally, &row);
                let values = value_fields(&row);
                sinks.iter_mut().try_for_each(|s| s.write(key, &values))?;
            }
        }
        sinks.into_iter().try_for_each(Sink::finish)?;
        let study = runner.study(&tallies);
        study.write(&folder.join("study.json"))?;
        Ok(study)
    }
}

/// The common part of two runs whose blocks may be combined; published numbers and aims are no part of it.
fn stamp(plan: &Plan, layout: &Resolved) -> String {
    let plan =
        serde_json::to_string(&Plan { published: Vec::new(), aims: Vec::new(), ..plan.clone() })
            .unwrap_or_default();
    let definitions: Vec<&str> = layout.settings.iter().map(|s| s.definition.as_str()).collect();
    let text = format!("{}|{BLOCK}|{plan}|{}", env!("CARGO_PKG_VERSION"), definitions.join(" "));
    Sha256::digest(text.as_bytes()).iter().map(|b| format!("{b:02x}")).collect()
}

/// Hands the numbers below `count` out to as many workers as there are threads, in order, until one fails.
///
/// Each worker is a pool of one thread. The parallel parts of a method run there one after the other, so that its run time is its own, and no other estimate's.
fn shared_out(count: usize, work: impl Fn(usize) -> Result<()> + Sync) -> Result<()> {
    let next = AtomicUsize::new(0);
    let failed = AtomicBool::new(false);
    let worker = || -> Result<()> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .map_err(|e| StudyError::Threads { detail: e.to_string() })?;
        while !failed.load(Ordering::Relaxed) {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= count {
                break;
            }
            pool.install(|| work(number)).inspect_err(|_| failed.store(true, Ordering::Relaxed))?;
        }
        Ok(())
    };
    let workers = parallel::threads().min(count);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(worker)).collect();
        let ended = |w: std::thread::ScopedJoinHandle<'_, Result<()>>| {
            w.join().unwrap_or_else(|_| {
                Err(StudyError::Threads { detail: "a worker stopped".to_owned() }.into())
            })
        };
        // All workers are joined; the first error is returned.
        workers.into_iter().map(ended).collect::<Vec<_>>().into_iter().collect()
    })
}

/// The blocks in a folder of parts, by their names; what else lies there is none.
fn blocks_in(parts: &Path) -> Result<Vec<(usize, PathBuf)>> {
    let wrong = |e| Error::io(parts, e);
    let mut found = Vec::new();
    for entry in fs::read_dir(parts).map_err(wrong)? {
        let name = entry.map_err(wrong)?.file_name();
        let number =
            name.to_str().and_then(|n| n.strip_suffix(".csv")).and_then(|n| n.parse().ok());
        if let Some(number) = number
            && part(parts, number).file_name() == Some(&name)
        {
            found.push((number, part(parts, number)));
        }
    }
    found.sort_unstable();
    Ok(found)
}

/// The files that every estimate goes to.
fn sinks(folder: &Path) -> Result<Vec<Box<dyn Sink>>> {
    Ok(vec![
        Box::new(CsvSink::new(folder.join("estimates.csv"))?),
        #[cfg(feature = "tables")]
        Box::new(ParquetSink::new(folder.join("estimates.parquet"))),
    ])
}

fn part(parts: &Path, number: usize) -> PathBuf {
    parts.join(format!("{number:08}.csv"))
}
