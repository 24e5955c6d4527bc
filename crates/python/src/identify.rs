//! Models from logs: [`deadtime::identify::subspace`].

use pyo3::prelude::*;
use serde_json::Value;

use super::convert::{json as from_python, text as as_text};
use super::log::{Log, copies, sources};
use super::model::Model;
use super::work::long;
use deadtime::delay::{TakenOut, identify_behind_delays};
use deadtime::identify::subspace::Recordings;
use deadtime::model::ModelDocument;
use deadtime::progress::HowFar;
use deadtime::report::identify::Report;

/// The arguments: the keyword arguments of `deadtime.identify`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct Asked {
    name: String,
    inputs: Vec<String>,
    outputs: Vec<String>,
    method: String,
    /// `auto`, `none`, or empty where `delays` are given.
    delay: String,
    delays: Vec<(String, f64)>,
    continuous: bool,
    /// The slope of every record goes first.
    without_drift: bool,
    /// The share of each log that the model is fitted to where no other log is named for its validation.
    learnt: f64,
}

/// The model, the text of `deadtime/identify@1`, and the output of the command line.
#[pyfunction]
pub(super) fn _identify(
    py: Python<'_>,
    logs: Vec<PyRef<'_, Log>>,
    holdout: Vec<PyRef<'_, Log>>,
    options: &Bound<'_, PyAny>,
    asked: Asked,
    threads: Option<usize>,
) -> PyResult<(Model, String, String)> {
    let options: Value = from_python(options)?;
    let taken_out = match asked.delay.as_str() {
        "auto" => TakenOut::Estimated,
        "none" => TakenOut::Nothing,
        _ => TakenOut::Given(asked.delays.clone()),
    };
    let (logs, holdout) = (copies(&logs), copies(&holdout));
    let (file, data, text) = long(py, threads, move |stop| {
        let names: Vec<String> = asked.inputs.iter().chain(&asked.outputs).cloned().collect();
        let flat = |log: deadtime::log::Log| match asked.without_drift {
            true => log.without_drift(&names),
            false => Ok(log),
        };
        let logs = logs.into_iter().map(flat).collect::<Result<Vec<_>, _>>()?;
        let holdout = holdout.into_iter().map(flat).collect::<Result<Vec<_>, _>>()?;
        let all = Recordings::from_logs(&logs, &asked.inputs, &asked.outputs)?;
        let (learnt, judged, held_out) = if holdout.is_empty() {
            let (learnt, judged) = all.split(asked.learnt);
            let held_out = 100.0 * (1.0 - asked.learnt);
            (learnt, judged, format!("the last {held_out:.0} % of each record"))
        } else {
            let judged = Recordings::from_logs(&holdout, &asked.inputs, &asked.outputs)?;
            all.sample_time.must_equal(judged.sample_time)?;
            (all, judged, sources(&holdout).join(", "))
        };
        let found = identify_behind_delays(
            &learnt,
            &logs,
            &asked.method,
            &options,
            &taken_out,
            (stop, &HowFar::default()),
        )?;
        let file = found.model.file(&asked.name, &found.delays, asked.continuous)?;
        let judged = judged.behind_delays(&found.delays)?;
        let report = Report {
            logs: sources(&logs),
            model: &found.model,
            delays: &found.delays,
            delay_notes: found.notes,
            held_out,
            held_out_samples: judged.samples(),
            checks: found.model.check(&judged),
            judged: &judged,
            compared: None,
        };
        Ok((file, report.data()?, report.text()))
    })?;
    Ok((Model(ModelDocument::Lti(file)), as_text(&data)?, text.trim_end().to_owned()))
}
