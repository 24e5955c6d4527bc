//! Parameters of a model file, from logs and from an identified model: [`deadtime::identify::structured`] and [`deadtime::identify::matching`].

use std::path::{Path, PathBuf};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde::Serialize;

use super::convert::compact;
use super::error::OrRaise;
use super::log::Log;
use super::model::Model;
use super::work::long;
use deadtime::identify::matching::{Matching, Target};
use deadtime::identify::structured::{Balance, Structured};
use deadtime::model::{EquationsFile, ModelDocument};
use deadtime::report;

/// The arguments: the keyword arguments of `deadtime.identify_structure`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct ByTime {
    free: Vec<String>,
    per_record: Vec<String>,
    horizon: usize,
    stride: Option<usize>,
    threshold: f64,
    /// Horizons are weighed all alike, not each by its own error.
    alike: bool,
    shrinkage: Option<f64>,
    one_step: bool,
}

/// The arguments: the keyword arguments of `deadtime.match_structure`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct ByFrequency {
    free: Vec<String>,
    norm: Option<String>,
    band: Option<[f64; 2]>,
    starts: usize,
    prior: Option<f64>,
    units: Vec<(String, f64)>,
    at: Vec<(String, f64)>,
}

/// An identified model: a model, the text of `deadtime/identify@1`, or a file of either.
#[derive(FromPyObject)]
pub(super) enum Given<'py> {
    Model(PyRef<'py, Model>),
    Text(String),
    File(PathBuf),
}

type Found = (Model, String, String);

fn found(model: Option<EquationsFile>, data: &impl Serialize, text: &str) -> PyResult<Found> {
    let model = model.ok_or_else(|| PyValueError::new_err("the fit gave no model"))?;
    Ok((Model(ModelDocument::Equations(model)), compact(data)?, text.trim_end().to_owned()))
}

/// The fitted model, the text of `deadtime/structure@1`, and the output of the command line.
#[pyfunction]
pub(super) fn _identify_structure(
    py: Python<'_>,
    logs: Vec<PyRef<'_, Log>>,
    holdout: Vec<PyRef<'_, Log>>,
    model: &Model,
    asked: ByTime,
    threads: Option<usize>,
) -> PyResult<Found> {
    let file = model.0.structure().or_raise(py)?;
    let complete = |logs: &[PyRef<'_, Log>]| {
        logs.iter().map(|log| model.0.complete(log.0.clone())).collect::<Result<Vec<_>, _>>()
    };
    let (logs, holdout) = (complete(&logs).or_raise(py)?, complete(&holdout).or_raise(py)?);
    let mut answer = long(py, threads, move |stop| {
        let options = Structured {
            free: asked.free,
            per_record: asked.per_record,
            horizon: asked.horizon,
            stride: asked.stride,
            threshold: asked.threshold,
            balance: if asked.alike { Balance::Group } else { Balance::Horizon },
            shrinkage: asked.shrinkage,
            one_step: asked.one_step,
            stop: stop.clone(),
            ..Structured::default()
        };
        let found = options.fit(&file, &logs, &holdout)?;
        Ok(deadtime::identify::structured::StructuredFit { name: file.name.clone(), ..found })
    })?;
    let model = answer.model.take();
    found(model, &answer, &report::structured::text(&answer))
}

/// The matched model, the text of `deadtime/match@1`, and the output of the command line.
#[pyfunction]
pub(super) fn _match_structure(
    py: Python<'_>,
    identified: Given<'_>,
    model: &Model,
    asked: ByFrequency,
    threads: Option<usize>,
) -> PyResult<Found> {
    let target = match identified {
        Given::Model(identified) => match &identified.0 {
            ModelDocument::Lti(file) => Target::from_file(file),
            ModelDocument::Equations(_) => {
                return Err(PyValueError::new_err(
                    "the identified model is one of equations; give a linear one",
                ));
            }
        },
        Given::Text(text) => Target::from_identify(&text, Path::new("identified")),
        Given::File(path) => Target::read(&path),
    };
    let (target, file) = (target.or_raise(py)?, model.0.structure().or_raise(py)?);
    let mut answer = long(py, threads, move |_| {
        let default = Matching::default();
        let options = Matching {
            free: asked.free,
            norm: asked.norm.unwrap_or(default.norm),
            band: asked.band,
            starts: asked.starts,
            prior: asked.prior,
            units: asked.units,
            at: asked.at,
        };
        Ok(options.fit(&file, &target)?)
    })?;
    let model = answer.model.take();
    found(model, &answer, &report::matching::text(&answer))
}
