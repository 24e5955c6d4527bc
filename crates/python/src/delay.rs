//! Estimation of dead times: [`deadtime::delay`].

use std::collections::BTreeMap;

use nalgebra::Complex;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::convert::{Numbers, array1, json as from_python, object, text, vector};
use super::error::{OrRaise, call};
use super::log::{Log, channel, copies};
use super::model::Model;
use super::work::long;
use deadtime::delay::report::{Estimate, Pair, Report};
use deadtime::delay::{
    self, DelayError, EventsJob, Job, METHODS, Method, ResponseJob, Scope, chosen,
};
use deadtime::log::{EventTimes, FrequencyResponse, LogError, Quality, read_frequency_response};
use deadtime::model::{ModelDocument, ModelFile};
use deadtime::report::estimate::{full, preamble, warning};
use deadtime::report::terminal::short;
use deadtime::time::SampleTime;

/// A report as Python gets it: the text of `deadtime/estimate@1`, and the remarks that only readers are shown.
type Told<'py> = (String, Bound<'py, PyAny>);

/// The arguments, of samples: the keyword arguments of `deadtime.estimate`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct Asked {
    name: String,
    inputs: Vec<String>,
    outputs: Vec<String>,
    methods: Vec<String>,
    max_delay: Option<f64>,
    degree_bias: Option<usize>,
    detrend: String,
    r#loop: String,
    track: bool,
}

impl Asked {
    fn job(
        self,
        py: Python<'_>,
        logs: &[PyRef<'_, Log>],
        model: Option<&Model>,
        options: &Bound<'_, PyAny>,
    ) -> PyResult<Job> {
        let scopes: &[Scope] =
            if model.is_some() { &[Scope::Pair, Scope::States] } else { &[Scope::Pair] };
        Ok(Job {
            methods: chosen(&self.methods, &by_method(options)?, scopes).or_raise(py)?,
            detrend: choice("detrend", &self.detrend)?,
            feedback: choice("loop", &self.r#loop)?,
            model: model.map(|m| linear(py, m)).transpose()?,
            name: self.name,
            max_delay_s: self.max_delay,
            degree_bias: self.degree_bias,
            track: self.track,
            ..Job::new(copies(logs), self.inputs, self.outputs)
        })
    }
}

/// Every pair of inputs and outputs by every method.
#[pyfunction]
pub(super) fn _estimate<'py>(
    py: Python<'py>,
    logs: Vec<PyRef<'_, Log>>,
    model: Option<PyRef<'_, Model>>,
    options: &Bound<'py, PyAny>,
    asked: Asked,
    threads: Option<usize>,
) -> PyResult<Told<'py>> {
    let job = asked.job(py, &logs, model.as_deref(), options)?;
    let report = long(py, threads, move |stop| Ok(Job { stop: stop.clone(), ..job }.run()?))?;
    told(py, &report)
}

/// The delay between two sequences of event times, each with its name, unit and times; `paired`: the times of one place in both are one event.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(super) fn _estimate_events<'py>(
    py: Python<'py>,
    first: (String, Option<String>, Numbers<'py>),
    second: (String, Option<String>, Numbers<'py>),
    methods: Vec<String>,
    options: &Bound<'py, PyAny>,
    name: String,
    max_delay: Option<f64>,
    paired: bool,
) -> PyResult<Told<'py>> {
    let methods = chosen(&methods, &by_method(options)?, &[Scope::Events]).or_raise(py)?;
    let channels = [first.0.clone(), second.0.clone()];
    let events = [first, second].map(|(name, unit, times)| EventTimes {
        name,
        unit,
        times: vector(&times),
        in_rows: paired,
    });
    let job = EventsJob {
        name,
        channels,
        events,
        methods,
        max_delay_s: max_delay,
        stop: Default::default(),
    };
    let report = long(py, None, move |stop| Ok(EventsJob { stop: stop.clone(), ..job }.run()?))?;
    told(py, &report)
}

/// The delay in a frequency response: of a file, or of angular frequencies (rad/s), real and imaginary parts, and the known facts of their noise.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(super) fn _estimate_response<'py>(
    py: Python<'py>,
    path: Option<std::path::PathBuf>,
    omega: Numbers<'py>,
    real: Numbers<'py>,
    imag: Numbers<'py>,
    quality: (String, Numbers<'py>),
    methods: Vec<String>,
    options: &Bound<'py, PyAny>,
    max_delay: Option<f64>,
    threads: Option<usize>,
) -> PyResult<Told<'py>> {
    let response = match path {
        Some(path) => read_frequency_response(&path).or_raise(py)?,
        None => {
            let more = vector(&quality.1);
            let known = match quality.0.as_str() {
                "coherence" => Quality::Coherence(more),
                "std" => Quality::Std(more),
                _ => Quality::Unknown,
            };
            let values = vector(&real)
                .into_iter()
                .zip(vector(&imag))
                .map(|(re, im)| Complex::new(re, im))
                .collect();
            let file = "frequency response";
            FrequencyResponse::new(file, vector(&omega), values, known)
                .map_err(|error| LogError::Frequency { file: file.into(), error })
                .or_raise(py)?
        }
    };
    let job = ResponseJob {
        methods,
        options: by_method(options)?,
        max_delay_s: max_delay,
        ..ResponseJob::new(response)
    };
    let report =
        long(py, threads, move |stop| Ok(ResponseJob { stop: stop.clone(), ..job }.run()?))?;
    told(py, &report)
}

/// The log of a step response: a column with a step of this size, and the response.
#[pyfunction]
pub(super) fn _of_step(
    py: Python<'_>,
    table: PyRef<'_, Log>,
    response: Option<String>,
    size: f64,
    time: Option<f64>,
) -> PyResult<Log> {
    deadtime::log::Log::of_step(&table.0, response.as_deref(), size, time).map(Log).or_raise(py)
}

/// The expected precision of each method, for each pair: (input, output, dict of method to dict or None).
#[pyfunction]
pub(super) fn _expected<'py>(
    py: Python<'py>,
    logs: Vec<PyRef<'_, Log>>,
    model: Option<PyRef<'_, Model>>,
    options: &Bound<'py, PyAny>,
    asked: Asked,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let job = asked.job(py, &logs, model.as_deref(), options)?;
    let expected =
        long(py, threads, move |stop| Ok(Job { stop: stop.clone(), ..job }.expected()?))?;
    let pairs: Vec<Value> = expected
        .iter()
        .map(|pair| {
            let methods: Vec<Value> =
                pair.methods.iter().map(|(name, richness)| json!([name, richness])).collect();
            json!({ "input": pair.input, "output": pair.output, "methods": methods })
        })
        .collect();
    object(py, &pairs)
}

/// The impulse response from one channel to another: coefficients and standard deviations, or None.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub(super) fn _impulse_response<'py>(
    py: Python<'py>,
    logs: Vec<PyRef<'_, Log>>,
    input: String,
    output: String,
    detrend: &str,
) -> PyResult<Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>> {
    let detrend = choice("detrend", detrend)?;
    let logs = copies(&logs);
    let response =
        long(py, None, move |_| Ok(delay::impulse_response(&logs, &input, &output, detrend)?))?;
    Ok(response.map(|r| (array1(py, r.values).into_any(), array1(py, r.std).into_any())))
}

/// A log of two arrays, `u` and `y`, NaN where a sample is missing.
#[pyfunction]
pub(super) fn _of_arrays(
    py: Python<'_>,
    u: Numbers<'_>,
    y: Numbers<'_>,
    sample_time: f64,
) -> PyResult<Log> {
    let step = SampleTime::new(sample_time).or_raise(py)?;
    let (u, y) = (vector(&u), vector(&y));
    let time_s = (0..u.len()).map(|k| step.to_seconds(k as f64)).collect();
    Ok(Log(deadtime::log::Log::new(
        "arrays",
        time_s,
        vec![channel("u", None, u), channel("y", None, y)],
    )
    .or_raise(py)?))
}

/// The list of methods, in order.
#[pyfunction]
pub(super) fn _methods(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let line = |m: &Method| {
        json!({
            "name": m.entry.name,
            "class": m.class,
            "title": m.class.title(),
            "scope": m.scope,
            "summary": m.entry.summary,
            "options": (m.entry.defaults)(),
            "withstands": m.withstands,
            "needs": m.needs,
            "blind_to": m.blind_to,
            "exempt": m.exempt.iter().map(|(law, why)| json!({ "law": law, "why": why })).collect::<Vec<_>>(),
        })
    };
    object(py, &METHODS.iter().map(line).collect::<Vec<_>>())
}

/// A word as one of the choices that an option has.
fn choice<T: DeserializeOwned>(option: &str, word: &str) -> PyResult<T> {
    serde_json::from_value(Value::String(word.to_owned()))
        .map_err(|e| PyValueError::new_err(format!("{option}: {e}")))
}

/// Options as they are written in Python, a dict per method.
fn by_method(options: &Bound<'_, PyAny>) -> PyResult<BTreeMap<String, Value>> {
    serde_json::from_value(from_python(options)?).map_err(|e| {
        PyValueError::new_err(format!("options: {e}; give a dict of options for each method"))
    })
}

/// The linear model in the form of the estimators.
fn linear(py: Python<'_>, model: &Model) -> PyResult<ModelFile> {
    match &model.0 {
        ModelDocument::Lti(file) => Ok(file.clone()),
        ModelDocument::Equations(file) => {
            Err(DelayError::Equations { model: file.name.clone() }).or_raise(py)
        }
    }
}

fn told<'py>(py: Python<'py>, report: &Report) -> PyResult<Told<'py>> {
    let report = report.clone().worded(call);
    let row = |e: &Estimate| json!({ "class_": e.class, "counts": e.counts(), "distrust": e.distrust, "contradicted": e.contradicted });
    let pair = |p: &Pair| {
        json!({
            "findings": p.findings.iter().map(|f| json!({ "condition": f.condition, "words": f.condition.words(), "evidence": f.evidence })).collect::<Vec<_>>(),
            "method": p.verdict.method,
            "warning": warning(p, report.sample_time_s),
            "estimates": p.estimates.iter().map(row).collect::<Vec<_>>(),
        })
    };
    let beside = json!({
        "preamble": preamble(&report),
        "text": short(&report).plain().trim_end(),
        "full": full(&report).trim_end(),
        "pairs": report.pairs.iter().map(pair).collect::<Vec<_>>(),
    });
    Ok((text(&report)?, object(py, &beside)?))
}
