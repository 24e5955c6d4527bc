//! The check on withheld effects: [`deadtime::blind`].

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;

use super::convert::text;
use super::error::{OrRaise, call};
use super::work::{long, long_told};
use deadtime::blind::{
    BlindScore as Inner, CaseFiles, Existing, Limit, Outcome, RunOptions, find, load, run,
    run_case, score,
};
use deadtime::diagnose::{GapOptions, diagnose_files};
use deadtime::remedy::Remedied;
use deadtime::report::blind;

/// How a case went: its name, `done`, `kept` or `failed`, the time that its diagnosis took, s, and why it failed.
type Told = (String, &'static str, Option<f64>, Option<String>);

fn told(id: &str, outcome: &Outcome) -> Told {
    let (word, time_s, error) = match outcome {
        Outcome::Done { time_s, .. } => ("done", Some(*time_s), None),
        Outcome::Kept => ("kept", None, None),
        Outcome::Failed(error) => ("failed", None, Some(error.message().worded(call))),
    };
    (id.to_owned(), word, time_s, error)
}

fn existing(fresh: bool) -> Existing {
    if fresh { Existing::Redo } else { Existing::Keep }
}

/// Diagnoses every case of a folder; `progress` is called with (id, outcome, time_s, error) after each.
#[pyfunction]
#[pyo3(signature = (cases, verdicts, jobs, fresh, seed, threads, progress))]
#[allow(clippy::too_many_arguments)]
pub(super) fn _blind_run(
    py: Python<'_>,
    cases: PathBuf,
    verdicts: PathBuf,
    jobs: usize,
    fresh: bool,
    seed: u64,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<Told>> {
    let news: Arc<Mutex<Vec<Told>>> = Arc::default();
    let heard = news.clone();
    let tell = |py: Python<'_>| {
        let Some(progress) = &progress else { return Ok(()) };
        let new = std::mem::take(&mut *heard.lock().unwrap_or_else(PoisonError::into_inner));
        new.into_iter().try_for_each(|one| progress.call1(py, one).map(|_| ()))
    };
    let summary = long_told(py, threads, tell, move |stop| {
        let gap = GapOptions { seed, stop: stop.clone(), ..GapOptions::default() };
        let options = RunOptions {
            jobs,
            existing: existing(fresh),
            stop: stop.clone(),
            ..RunOptions::default()
        };
        let diagnose = |case: &CaseFiles| {
            Ok(diagnose_files(&case.model, &case.logs, &case.holdout, &gap)?.worded(call).diagnosis)
        };
        let progress = |id: &str, outcome: &Outcome| {
            news.lock().unwrap_or_else(PoisonError::into_inner).push(told(id, outcome))
        };
        Ok(run(&cases, &verdicts, &options, &diagnose, &progress)?)
    })?;
    Ok(summary.cases.iter().map(|(id, outcome)| told(id, outcome)).collect())
}

/// The names of all cases in a folder, in order.
#[pyfunction]
pub(super) fn _blind_cases(py: Python<'_>, cases: PathBuf) -> PyResult<Vec<String>> {
    Ok(py.detach(|| find(&cases)).or_raise(py)?.into_iter().map(|(id, _)| id).collect())
}

/// Diagnoses one case, as `_blind_run` does each.
#[pyfunction]
pub(super) fn _blind_case(
    py: Python<'_>,
    case: PathBuf,
    id: String,
    verdicts: PathBuf,
    fresh: bool,
    seed: u64,
    threads: Option<usize>,
) -> PyResult<Told> {
    long(py, threads, move |stop| {
        let gap = GapOptions { seed, stop: stop.clone(), ..GapOptions::default() };
        let diagnose = |case: &CaseFiles| {
            Ok(diagnose_files(&case.model, &case.logs, &case.holdout, &gap)?.worded(call).diagnosis)
        };
        match run_case(&id, CaseFiles::of(case, &id), &verdicts, existing(fresh), &diagnose) {
            Outcome::Failed(deadtime::study::Error::Stopped(stopped)) => Err(stopped.into()),
            outcome => Ok(told(&id, &outcome)),
        }
    })
}

/// A report card as the crate holds it.
#[pyclass(frozen, module = "deadtime._native", name = "BlindScore")]
pub(super) struct BlindScore(Inner);

#[pymethods]
impl BlindScore {
    /// Reads verdicts and labels, checks every commitment, and scores.
    #[staticmethod]
    fn of(
        py: Python<'_>,
        verdicts: PathBuf,
        labels: PathBuf,
        cases: Option<PathBuf>,
    ) -> PyResult<Self> {
        long(py, None, move |_| Ok(score(&load(&verdicts, &labels, cases.as_deref())?))).map(Self)
    }

    /// `deadtime/blind-score@1`.
    fn json(&self) -> PyResult<String> {
        text(&self.0)
    }

    /// As the command line prints it.
    fn text(&self) -> String {
        blind::text(&self.0)
    }

    /// As Markdown.
    fn markdown(&self) -> String {
        blind::markdown(&self.0)
    }

    /// The messages on the limits, `NAME>=VALUE` or `NAME<=VALUE`, that are violated.
    fn unmet(&self, py: Python<'_>, require: Vec<String>) -> PyResult<Vec<String>> {
        let limits: Vec<Limit> =
            require.iter().map(|text| text.parse()).collect::<Result<_, _>>().or_raise(py)?;
        Ok(limits.iter().filter_map(|limit| limit.unmet(&self.0)).collect())
    }

    /// Raises for a limit that is not written as one.
    #[staticmethod]
    fn check(py: Python<'_>, require: Vec<String>) -> PyResult<()> {
        require.iter().try_for_each(|text| text.parse::<Limit>().map(|_| ())).or_raise(py)
    }
}
