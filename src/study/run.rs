//! Runs a plan on all cores, block by block; what is done stays done when the program is stopped.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::StudyError;
use super::cell::{Layout, Slot};
use super::estimates::{CsvSink, Field, Row, Sink, key_fields, made, of_record, read_part, value_fields, write_part};
use super::plan::{Delay, Plan};
use super::results::{Cell, FORMAT, Kept, Score, Study};
use super::tally::{Tally, kept};
use crate::file::write_atomic;
use crate::signal::stats;
use crate::stop::Stop;

/// Records of one setting that are made together, and written as one file: seconds of work between two writes at most.
pub(super) const BLOCK: usize = 25;
/// The folder of finished blocks.
const PARTS: &str = "parts";
/// What the blocks belong to.
const STAMP: &str = "plan.sha256";

/// How far a study is.
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
    pub(super) layout: Layout,
    pub(super) blocks: Vec<Block>,
    stamp: String,
}

/// Trials of one setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Block {
    pub(super) setting: usize,
    pub(super) first: usize,
    pub(super) end: usize,
}

impl Runner {
    /// Looks up everything that the plan names, and makes one record of every setting.
    ///
    /// # Errors
    /// [`StudyError::Plan`], [`crate::registry::RegistryError`] for unknown names and options; what keeps a record from being made, as [`StudyError::Record`].
    pub fn new(plan: &Plan) -> crate::Result<Self> {
        let runner = Self::untried(plan)?;
        let tried = runner.layout.settings.par_iter().map(|s| made(plan, s, 0).map(|_| ()));
        tried.collect::<crate::Result<Vec<()>>>()?;
        Ok(runner)
    }

    /// The same without making records: for workers that go on where somebody tried the plan before.
    ///
    /// # Errors
    /// As [`Self::new`], but for records.
    pub fn untried(plan: &Plan) -> crate::Result<Self> {
        let layout = Layout::new(plan)?;
        let blocks = (layout.settings.iter().enumerate())
            .flat_map(|(setting, s)| {
                (0..s.trials).step_by(BLOCK).map(move |first| Block { setting, first, end: (first + BLOCK).min(s.trials) })
            })
            .collect();
        let stamp = stamp(plan, &layout);
        Ok(Self { plan: plan.clone(), layout, blocks, stamp })
    }

    /// The plan.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// A digest of all that the estimates depend on: plan, seed, trials, what its names stand for, and the program's version. Blocks of equal stamps go together.
    #[must_use]
    pub fn stamp(&self) -> &str {
        &self.stamp
    }

    /// Estimates in all.
    #[must_use]
    pub fn estimates(&self) -> usize {
        self.blocks.iter().map(|b| self.size(*b)).sum()
    }

    pub(super) fn size(&self, block: Block) -> usize {
        (block.end - block.first) * self.layout.of(block.setting).len()
    }

    /// Runs what is not done yet and writes `DIR/study.json` and `DIR/estimates.csv` (`.parquet` too with that feature). Finished blocks are kept in `DIR/parts` until then: a run that was stopped goes on
    /// where it was with `resume`. The same to the bit for any number of threads, run times apart. `stop` is looked at between the methods of a record.
    ///
    /// # Errors
    /// [`StudyError::Folder`] where the folder holds another plan's blocks, or some of this one without `resume`; what keeps a record from being made;
    /// [`crate::Error::Io`]; [`crate::Error::Stopped`].
    pub fn run(&self, folder: &Path, resume: bool, stop: &Stop, progress: &(dyn Fn(Progress) + Sync)) -> crate::Result<Study> {
        let parts = self.open(folder, resume)?;
        let pending: Vec<(usize, Block)> = self.blocks.iter().copied().enumerate().filter(|(n, _)| !part(&parts, *n).exists()).collect();
        let all = self.estimates();
        let left: usize = pending.iter().map(|(_, b)| self.size(*b)).sum();
        let count = Mutex::new(Progress { done: all - left, now: 0, all });
        let tell = |more: usize| {
            if let Ok(mut count) = count.lock() {
                count.done += more;
                count.now += more;
                progress(*count);
            }
        };
        tell(0);
        shared_out(&pending, |&(number, block)| {
            write_part(&part(&parts, number), &self.block(block, stop)?)?;
            tell(self.size(block));
            Ok(())
        })?;
        let study = self.gather(folder, &parts, stop)?;
        fs::remove_dir_all(&parts).map_err(|e| crate::Error::io(&parts, e))?;
        Ok(study)
    }

    /// The rows of one block, in the order of trials and cells.
    pub(super) fn block(&self, block: Block, stop: &Stop) -> crate::Result<Vec<Row>> {
        let mut rows = Vec::with_capacity(self.size(block));
        for trial in block.first..block.end {
            rows.extend(of_record(&self.plan, &self.layout, block.setting, trial, stop)?);
        }
        Ok(rows)
    }

    /// The folder of blocks, new or of this very plan.
    fn open(&self, folder: &Path, resume: bool) -> crate::Result<PathBuf> {
        let parts = folder.join(PARTS);
        let stamp = parts.join(STAMP);
        let mine = self.stamp.as_str();
        if parts.exists() {
            let theirs = fs::read_to_string(&stamp).unwrap_or_default();
            let detail = if theirs.trim() != mine {
                "holds the unfinished study of another plan (other trials, seed or program version included); give another folder, or remove its folder `parts`"
            } else if !resume {
                "holds this study unfinished; `resume` goes on where it was, removing its folder `parts` starts anew"
            } else {
                return Ok(parts);
            };
            return Err(StudyError::Folder { folder: folder.to_owned(), detail: detail.to_owned() }.into());
        }
        write_atomic(&stamp, |out| writeln!(out, "{mine}"))?;
        Ok(parts)
    }

    /// Reads all blocks in order, one row at a time, and writes what came of them.
    fn gather(&self, folder: &Path, parts: &Path, stop: &Stop) -> crate::Result<Study> {
        let keys: Vec<_> = (0..self.layout.slots.len()).map(|number| self.key(number)).collect();
        let mut tallies = vec![Tally::default(); keys.len()];
        let mut sinks = sinks(folder)?;
        for number in 0..self.blocks.len() {
            stop.check()?;
            for row in read_part(&part(parts, number))? {
                let row = row?;
                let Some((tally, key)) = tallies.get_mut(row.cell).zip(keys.get(row.cell)) else { continue };
                self.count(tally, &row);
                let values = value_fields(&row);
                sinks.iter_mut().try_for_each(|s| s.write(key, &values))?;
            }
        }
        sinks.into_iter().try_for_each(Sink::finish)?;
        let study = self.study(&tallies);
        study.write(&folder.join("study.json"))?;
        Ok(study)
    }

    /// The columns of a cell's estimates that are the same in all of them.
    pub(super) fn key(&self, number: usize) -> Vec<(&'static str, Field)> {
        self.layout.slots.get(number).map(|slot| key_fields(number, &self.cell(*slot))).unwrap_or_default()
    }

    /// Adds an estimate to the sums of its cell.
    pub(super) fn count(&self, tally: &mut Tally, row: &Row) {
        let setting = &self.layout.settings[self.layout.slots[row.cell].setting];
        tally.add(row, &self.plan.grids[setting.grid].scoring, setting.sample_time);
    }

    /// What the sums of all cells say.
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
                let variance: Option<f64> = of.iter().map(|t| t.rms_std().map(|[_, s]| s * s)).sum();
                let half = variance.map(|v| stats::NORMAL_95 * v.sqrt() / count);
                scores.push(Score {
                    grid: cells[first].grid.clone(),
                    place: cells[first].place,
                    method: cells[first].method.clone(),
                    options: cells[first].options.clone(),
                    kept_percent: percent,
                    mean_rms_samples: mean,
                    ci95_samples: mean.zip(half).filter(|_| percent >= 100.0).map(|(m, h)| [(m - h).max(0.0), m + h]),
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
                Delay::PerInput(all) => all.get(slot.input).map_or_else(|| key.delay.clone(), |s| Delay::Same(*s)),
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

/// What two runs must share for their blocks to go together; what published numbers and aims say is no part of it.
fn stamp(plan: &Plan, layout: &Layout) -> String {
    let plan = serde_json::to_string(&Plan { published: Vec::new(), aims: Vec::new(), ..plan.clone() }).unwrap_or_default();
    let definitions: Vec<&str> = layout.settings.iter().map(|s| s.definition.as_str()).collect();
    let text = format!("{}|{BLOCK}|{plan}|{}", env!("CARGO_PKG_VERSION"), definitions.join(" "));
    Sha256::digest(text.as_bytes()).iter().map(|b| format!("{b:02x}")).collect()
}

/// Hands the items out to as many workers as there are threads, in order, until one fails.
///
/// Each worker is a pool of one thread: what a method would do in parallel it does there one after the other, so that its run time is its own, and no other estimate's.
fn shared_out<T: Sync>(items: &[T], work: impl Fn(&T) -> crate::Result<()> + Sync) -> crate::Result<()> {
    let next = AtomicUsize::new(0);
    let failed = AtomicBool::new(false);
    let worker = || -> crate::Result<()> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| StudyError::Threads { detail: e.to_string() })?;
        while !failed.load(Ordering::Relaxed)
            && let Some(item) = items.get(next.fetch_add(1, Ordering::Relaxed))
        {
            pool.install(|| work(item)).inspect_err(|_| failed.store(true, Ordering::Relaxed))?;
        }
        Ok(())
    };
    let workers = rayon::current_num_threads().min(items.len());
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(worker)).collect();
        let ended = |w: std::thread::ScopedJoinHandle<'_, crate::Result<()>>| {
            w.join().unwrap_or_else(|_| Err(StudyError::Threads { detail: "a worker stopped".to_owned() }.into()))
        };
        // All are waited for; the first error is told.
        workers.into_iter().map(ended).collect::<Vec<_>>().into_iter().collect()
    })
}

/// The files that every estimate goes to.
fn sinks(folder: &Path) -> crate::Result<Vec<Box<dyn Sink>>> {
    Ok(vec![
        Box::new(CsvSink::new(folder.join("estimates.csv"))?),
        #[cfg(feature = "parquet")]
        Box::new(super::parquet::ParquetSink::new(folder.join("estimates.parquet"))),
    ])
}

fn part(parts: &Path, number: usize) -> PathBuf {
    parts.join(format!("{number:08}.csv"))
}
