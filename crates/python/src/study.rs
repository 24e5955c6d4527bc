//! Accuracy studies: [`deadtime::study`].

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use numpy::IntoPyArray;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use super::convert::{json, text};
use super::error::OrRaise;
use super::work::{long, long_told};
use deadtime::file::write_atomic;
use deadtime::report::{gate, junit, study as report};
use deadtime::study::{self, Cell, PLANS, PLANTS, Progress, StudyError, Values};
use deadtime::text::message;

/// For counting alone.
const UNLIMITED_DISK: study::Budget = study::Budget { memory_gb: 4.0, disk_gb: f64::INFINITY };

/// What a study runs: one or several products of lists, plants × conversions × excitations × noise × loops × delays × methods × trials.
///
/// Parameters
/// ----------
/// source : str, path, dict or Plan
///     The name of a shipped plan (`deadtime.plans()`), the path of a plan file, the text of one (several lines), or its keys as a dict.
/// folder : path, optional
///     The folder that file names in a text or dict count from; default: the working directory. Names in a file count from its own folder.
///
/// Raises
/// ------
/// StudyError
///     No such plan, or what is wrong with it, naming the key.
#[pyclass(frozen, module = "deadtime", name = "Plan")]
#[derive(Clone)]
pub(super) struct Plan(pub(super) study::Plan);

#[pymethods]
impl Plan {
    #[new]
    #[pyo3(signature = (source, folder = None))]
    fn new(py: Python<'_>, source: &Bound<'_, PyAny>, folder: Option<PathBuf>) -> PyResult<Self> {
        let folder = std::path::absolute(folder.unwrap_or_else(|| PathBuf::from(".")))?;
        if let Ok(plan) = source.cast::<Self>() {
            return Ok(plan.get().clone());
        }
        if source.is_instance_of::<PyDict>() {
            let keys = toml::Table::try_from(json(source)?)
                .map_err(|e| StudyError::Plan { plan: "dict".to_owned(), detail: e.to_string() })
                .or_raise(py)?;
            return study::Plan::of("dict", keys, &folder).map(Self).or_raise(py);
        }
        let name: Option<String> = source.extract().ok();
        let plan = match name {
            Some(text) if text.contains('\n') => {
                study::Plan::parse("text", &text, &folder).or_raise(py)?
            }
            Some(name) => py.detach(|| study::Plan::open(&name)).or_raise(py)?,
            None => {
                let path: PathBuf = source.extract().map_err(|_| {
                    PyTypeError::new_err("a plan is a name, a path, a text, a dict or a Plan")
                })?;
                // A path is a file even where a shipped plan is called so.
                let path = std::path::absolute(path)?;
                py.detach(|| study::Plan::open(&path.display().to_string())).or_raise(py)?
            }
        };
        let folder = std::path::absolute(&plan.folder).unwrap_or(folder);
        Ok(Self(study::Plan { folder, ..plan }))
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// What it is for, in a sentence.
    #[getter]
    fn about(&self) -> &str {
        &self.0.about
    }

    /// Seed of every record, together with what the record is of.
    #[getter]
    fn seed(&self) -> u64 {
        self.0.seed
    }

    /// The folder that its file names count from.
    #[getter]
    fn folder(&self) -> PathBuf {
        self.0.folder.clone()
    }

    /// Names of its grids.
    #[getter]
    fn grids(&self) -> Vec<String> {
        self.0.grids.iter().map(|g| g.name.clone()).collect()
    }

    /// Its methods with their options, as the plan writes them, each once.
    #[getter]
    fn methods(&self) -> Vec<String> {
        let mut all: Vec<String> = Vec::new();
        for method in self.0.grids.iter().flat_map(|g| &g.method) {
            if !all.contains(method) {
                all.push(method.clone());
            }
        }
        all
    }

    /// Records of a setting, by grid.
    #[getter]
    fn trials<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let trials = PyDict::new(py);
        for grid in &self.0.grids {
            trials.set_item(&grid.name, grid.trials)?;
        }
        Ok(trials)
    }

    /// Estimates in all.
    #[getter]
    fn estimates(&self, py: Python<'_>) -> PyResult<usize> {
        py.detach(|| study::Runner::untried(&self.0, &UNLIMITED_DISK).map(|r| r.estimates()))
            .or_raise(py)
    }

    /// The plan with these `grids` and `methods` only (none given: all). A method is named with its options in the plan, or without: then with any.
    #[pyo3(signature = (grids = Vec::new(), methods = Vec::new()))]
    fn only(&self, py: Python<'_>, grids: Vec<String>, methods: Vec<String>) -> PyResult<Self> {
        let mut plan = self.0.clone();
        plan.only(&grids, &methods).or_raise(py)?;
        Ok(Self(plan))
    }

    /// The plan with other `trials` in every grid, or another `seed`.
    #[pyo3(signature = (*, trials = None, seed = None))]
    fn replace(&self, trials: Option<usize>, seed: Option<u64>) -> PyResult<Self> {
        let mut plan = self.0.clone();
        if let Some(trials) = trials {
            if trials == 0 {
                return Err(PyValueError::new_err("trials is 0: give at least 1"));
            }
            plan.grids.iter_mut().for_each(|g| g.trials = trials);
        }
        plan.seed = seed.unwrap_or(plan.seed);
        Ok(Self(plan))
    }

    /// The plan as the text of a file, `deadtime/plan@1`.
    fn to_toml(&self, py: Python<'_>) -> PyResult<String> {
        self.0.to_toml().or_raise(py)
    }

    /// Writes the plan as the file `path`.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let text = self.to_toml(py)?;
        py.detach(|| write_atomic(&path, |out| out.write_all(text.as_bytes()))).or_raise(py)
    }

    /// The text of the plan without published numbers and aims, which no estimate depends on: for workers.
    fn _bare(&self, py: Python<'_>) -> PyResult<String> {
        study::Plan { published: Vec::new(), aims: Vec::new(), ..self.0.clone() }
            .to_toml()
            .or_raise(py)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __repr__(&self) -> String {
        let grids = match self.0.grids.as_slice() {
            [one] => format!("grid {}", one.name),
            many => format!("{} grids", many.len()),
        };
        let estimates = study::Runner::untried(&self.0, &UNLIMITED_DISK)
            .map_or_else(|e| e.to_string(), |r| format!("{} estimates", r.estimates()));
        format!(
            "<Plan {}: {}; {grids}, {} methods, {estimates}, seed {}>",
            self.0.name,
            self.0.about,
            self.methods().len(),
            self.0.seed
        )
    }

    /// Pickles by its text.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String, PathBuf))> {
        let plan = slf.get();
        Ok((slf.get_type().into_any(), (plan.to_toml(slf.py())?, plan.folder())))
    }
}

/// The plans that ship with the program: name and what each is for.
#[pyfunction]
pub(super) fn _plans<'py>(py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    for (name, text) in PLANS {
        all.set_item(name, study::Plan::parse(name, text, Path::new(".")).or_raise(py)?.about)?;
    }
    Ok(all)
}

/// The plants that plans name: name and what each is.
#[pyfunction]
pub(super) fn _plants(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    PLANTS.iter().try_for_each(|p| all.set_item(p.name, p.summary))?;
    Ok(all)
}

/// What a study found, as the crate holds it.
#[pyclass(frozen, module = "deadtime._native", name = "StudyResult")]
pub(super) struct StudyResult(study::Study);

#[pymethods]
impl StudyResult {
    /// From the text of `study.json`.
    #[new]
    fn new(text: &str) -> PyResult<Self> {
        serde_json::from_str(text).map(Self).map_err(|e| PyValueError::new_err(e.to_string()))
    }

    /// From `study.json` or its folder.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| study::Study::read(&path)).or_raise(py).map(Self)
    }

    /// `deadtime/study@1`.
    fn json(&self) -> PyResult<String> {
        text(&self.0)
    }

    /// Writes `study.json`.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.0.write(&path)).or_raise(py)
    }

    /// Writes what later runs are compared with.
    fn write_baseline(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.0.write_baseline(&path)).or_raise(py)
    }

    /// What was run, and the summary.
    fn headline(&self) -> String {
        report::headline(&self.0)
    }

    /// All that the command line prints.
    fn text(&self, plan: Option<&Bound<'_, Plan>>) -> String {
        report::text(&self.0, plan.map(|p| &p.get().0))
    }

    /// The summary as a table in HTML.
    fn html(&self) -> String {
        report::summary(&self.0).html()
    }

    /// The page `tables.md`.
    fn page(&self, plan: &Bound<'_, Plan>) -> String {
        report::page(&self.0, &plan.get().0)
    }

    /// Every published number of the plan with ours, as JSON: source, cells, statistic, kept_percent, published, ours, standing, why.
    fn published(&self, plan: &Bound<'_, Plan>) -> PyResult<String> {
        let rows: Vec<serde_json::Value> = (plan.get().0.published.iter().filter_map(|p| p.beside(&self.0)))
            .map(|beside| {
                let p = beside.published;
                serde_json::json!({
                    "source": p.source, "cells": p.cells.to_string(), "statistic": p.statistic, "kept_percent": p.kept_percent,
                    "published": p.value, "ours": beside.ours, "standing": beside.standing, "why": p.not_reproducible,
                })
            })
            .collect();
        text(&rows)
    }

    /// Every aim of the plan and what was reached, as JSON: aim, method, measure, at_least, at_most, reached, cell, met.
    fn aims(&self, plan: &Bound<'_, Plan>) -> PyResult<String> {
        let reached = |aim: &study::Aim| -> Vec<serde_json::Value> {
            let one = |r: study::Reached<'_>| {
                serde_json::json!({
                    "aim": aim.aim, "method": r.method, "measure": aim.measure, "at_least": aim.at_least, "at_most": aim.at_most,
                    "reached": r.value, "cell": r.cell.map(Cell::key), "met": r.met,
                })
            };
            aim.reached(&self.0).into_iter().map(one).collect()
        };
        text(&plan.get().0.aims.iter().flat_map(reached).collect::<Vec<_>>())
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((slf.get_type().into_any(), (slf.get().json()?,)))
    }
}

/// The limits of a study, those of the crate where none are given.
fn budget((memory_gb, disk_gb): (Option<f64>, Option<f64>)) -> study::Budget {
    let default = study::Budget::default();
    study::Budget {
        memory_gb: memory_gb.unwrap_or(default.memory_gb),
        disk_gb: disk_gb.unwrap_or(default.disk_gb),
    }
}

/// Tells of parts that were damaged.
fn warn(py: Python<'_>, damaged: &[study::Damaged]) -> PyResult<()> {
    let warnings = py.import("warnings")?;
    damaged
        .iter()
        .try_for_each(|d| warnings.call_method1("warn", (message(&d.to_string()),)).map(|_| ()))
}

/// Runs a plan on this machine and writes `study.json`, `estimates.csv`, `estimates.parquet`, `tables.md` and `report.html`; `progress` is called with (done, all).
#[pyfunction]
pub(super) fn _study(
    py: Python<'_>,
    plan: &Bound<'_, Plan>,
    folder: PathBuf,
    resume: bool,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
    limits_gb: (Option<f64>, Option<f64>),
) -> PyResult<StudyResult> {
    let plan = plan.get().0.clone();
    let count: Arc<Mutex<Option<Progress>>> = Arc::default();
    let heard = count.clone();
    let tell = |py: Python<'_>| {
        let Some(progress) = &progress else { return Ok(()) };
        let new = heard.lock().unwrap_or_else(PoisonError::into_inner).take();
        new.map_or(Ok(()), |p| progress.call1(py, (p.done, p.all)).map(|_| ()))
    };
    let run = move |stop: &deadtime::stop::Stop| {
        let runner = study::Runner::within(&plan, &budget(limits_gb))?;
        let begun = runner.begin(&folder, resume, stop)?;
        let damaged = begun.damaged().to_vec();
        let study = begun
            .run(stop, &|p| *count.lock().unwrap_or_else(PoisonError::into_inner) = Some(p))?;
        deadtime::report::save_study(&study, &plan, &folder)?;
        Ok((study, damaged))
    };
    let (study, damaged) = long_told(py, threads, tell, run)?;
    warn(py, &damaged)?;
    Ok(StudyResult(study))
}

/// The columns of files of estimates, one file after the other. A column is an array, or for words a list of the different ones and an array with the word of
/// every line.
#[pyfunction]
pub(super) fn _estimates(py: Python<'_>, paths: Vec<PathBuf>) -> PyResult<Bound<'_, PyDict>> {
    let columns = long(py, None, move |stop| Ok(study::columns(&paths, stop)?))?;
    let all = PyDict::new(py);
    for (name, values) in columns {
        match values {
            Values::Words(words, codes) => all.set_item(name, (words, codes.into_pyarray(py)))?,
            Values::Counts(counts) => all.set_item(name, counts.into_pyarray(py))?,
            Values::Numbers(numbers) => all.set_item(name, numbers.into_pyarray(py))?,
        }
    }
    Ok(all)
}

/// A plan made ready to run by blocks.
#[pyclass(frozen, module = "deadtime._native", name = "Runner")]
pub(super) struct Runner(Arc<study::Runner>);

#[pymethods]
impl Runner {
    /// Looks up everything that the plan names; with `tried`, makes one record of every setting.
    #[new]
    #[pyo3(signature = (plan, tried = true, max_memory_gb = None, max_disk_gb = None))]
    fn new(
        py: Python<'_>,
        plan: &Bound<'_, Plan>,
        tried: bool,
        max_memory_gb: Option<f64>,
        max_disk_gb: Option<f64>,
    ) -> PyResult<Self> {
        let plan = plan.get().0.clone();
        let budget = budget((max_memory_gb, max_disk_gb));
        let runner = long(py, None, move |_| {
            Ok(if tried {
                study::Runner::within(&plan, &budget)?
            } else {
                study::Runner::untried(&plan, &budget)?
            })
        })?;
        Ok(Self(Arc::new(runner)))
    }

    /// A digest of all that the estimates depend on.
    #[getter]
    fn stamp(&self) -> &str {
        self.0.stamp()
    }

    /// Blocks in all.
    #[getter]
    fn blocks(&self) -> usize {
        self.0.blocks()
    }

    /// Estimates in all.
    #[getter]
    fn estimates(&self) -> usize {
        self.0.estimates()
    }

    /// Estimates of the blocks from `first` up to `end`.
    fn estimates_of(&self, first: usize, end: usize) -> usize {
        self.0.estimates_of(first..end)
    }

    /// A setting of every kind, and the records of that kind.
    fn kinds(&self) -> Vec<(usize, usize)> {
        self.0.kinds()
    }

    /// What a record of this setting costs with all its estimates, s.
    fn cost(&self, py: Python<'_>, setting: usize) -> PyResult<f64> {
        let runner = self.0.clone();
        long(py, Some(1), move |stop| Ok(runner.cost(setting, stop)?))
    }

    /// Blocks put together to tasks of about `task_s`, if a record of kind k costs `cost_s[k]`: one past the last block of every task.
    fn tasks(&self, cost_s: Vec<f64>, task_s: f64) -> Vec<usize> {
        self.0.tasks(&cost_s, task_s)
    }

    /// The same with so many blocks in a task.
    fn tasks_of(&self, blocks: usize) -> Vec<usize> {
        self.0.tasks_of(blocks)
    }

    /// Makes the estimates of these blocks on one thread, as the bytes of a Parquet part.
    fn part<'py>(
        &self,
        py: Python<'py>,
        first: usize,
        end: usize,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let runner = self.0.clone();
        let part = long(py, Some(1), move |stop| Ok(runner.part(first..end, stop)?))?;
        Ok(PyBytes::new(py, &part))
    }

    /// The same, written to a file, all of it or none; returns the bytes of the file.
    fn write_part(
        &self,
        py: Python<'_>,
        first: usize,
        end: usize,
        path: PathBuf,
    ) -> PyResult<usize> {
        let runner = self.0.clone();
        long(py, Some(1), move |stop| {
            let part = runner.part(first..end, stop)?;
            write_atomic(&path, |out| out.write_all(&part))?;
            Ok(part.len())
        })
    }
}

/// Which blocks every task holds, and where their estimates are kept.
#[pyclass(frozen, module = "deadtime._native", name = "Tasks")]
pub(super) struct Tasks(study::Tasks);

#[pymethods]
impl Tasks {
    /// Begins a study in a folder.
    #[new]
    fn new(
        py: Python<'_>,
        runner: &Bound<'_, Runner>,
        folder: PathBuf,
        ends: Vec<usize>,
    ) -> PyResult<Self> {
        let runner = runner.get();
        py.detach(|| study::Tasks::new(&runner.0, &folder, ends)).or_raise(py).map(Self)
    }

    /// The tasks of a folder in which this study was begun, or None.
    #[staticmethod]
    fn open(
        py: Python<'_>,
        runner: &Bound<'_, Runner>,
        folder: PathBuf,
        resume: bool,
    ) -> PyResult<Option<Self>> {
        let runner = runner.get();
        Ok(py.detach(|| study::Tasks::open(&runner.0, &folder, resume)).or_raise(py)?.map(Self))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    /// The first block of a task, and one past its last.
    fn blocks(&self, task: usize) -> (usize, usize) {
        let blocks = self.0.blocks(task);
        (blocks.start, blocks.end)
    }

    /// Where a task's estimates are kept.
    fn path(&self, task: usize) -> PathBuf {
        self.0.path(task)
    }

    /// The tasks without a part that can be used; a warning names parts that are damaged.
    fn missing(&self, py: Python<'_>) -> PyResult<Vec<usize>> {
        let tasks = self.0.clone();
        let (missing, damaged) = long(py, None, move |stop| Ok(tasks.missing(stop)?))?;
        warn(py, &damaged)?;
        Ok(missing)
    }

    /// Writes a task's part, all of it or none.
    fn keep(&self, py: Python<'_>, task: usize, part: &[u8]) -> PyResult<()> {
        py.detach(|| self.0.keep(task, part)).or_raise(py)
    }

    /// Adds all parts up and writes `study.json`, `tables.md` and `report.html`.
    fn gather(
        &self,
        py: Python<'_>,
        runner: &Bound<'_, Runner>,
        threads: Option<usize>,
    ) -> PyResult<StudyResult> {
        let (tasks, runner) = (self.0.clone(), runner.get().0.clone());
        let gather = move |stop: &deadtime::stop::Stop| {
            let study = tasks.gather(&runner, stop)?;
            deadtime::report::save_study(&study, runner.plan(), tasks.folder())?;
            Ok(study)
        };
        long(py, threads, gather).map(StudyResult)
    }
}

/// What a gate found, as the crate holds it.
#[pyclass(frozen, module = "deadtime._native", name = "GateReport")]
pub(super) struct GateReport(study::GateReport);

#[pymethods]
impl GateReport {
    /// Compares results with their baseline.
    #[staticmethod]
    fn of(
        py: Python<'_>,
        results: &Bound<'_, StudyResult>,
        baseline: &Bound<'_, StudyResult>,
        alpha: Option<f64>,
        margin: Option<f64>,
        margin_samples: Option<f64>,
        margin_share: Option<f64>,
    ) -> PyResult<Self> {
        let default = study::Gate::default();
        let gate = study::Gate {
            alpha: alpha.unwrap_or(default.alpha),
            margin: margin.unwrap_or(default.margin),
            margin_samples: margin_samples.unwrap_or(default.margin_samples),
            margin_share: margin_share.unwrap_or(default.margin_share),
        };
        let (results, baseline) = (results.get(), baseline.get());
        py.detach(|| gate.compare(&results.0, &baseline.0)).or_raise(py).map(Self)
    }

    /// `deadtime/gate@1`.
    fn json(&self) -> PyResult<String> {
        text(&self.0)
    }

    /// As the command line prints it.
    fn text(&self) -> String {
        gate::text(&self.0)
    }

    /// As Markdown.
    fn markdown(&self) -> String {
        gate::markdown(&self.0)
    }

    /// As JUnit XML, a test case per method.
    fn junit(&self) -> String {
        junit::xml(&self.0)
    }

    /// What got worse, in a line each.
    fn lines(&self) -> Vec<String> {
        self.0.worse.iter().map(gate::line).collect()
    }
}
