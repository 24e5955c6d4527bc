//! The gap diagnosis, the checks and the isolability: [`deadtime::diagnose`], on models and on functions of Python.

use std::path::PathBuf;
use std::sync::mpsc::{Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use nalgebra::DMatrix;
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::{PyException, PyKeyError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

use super::convert::{Numbers, Table, array1, matrix, object, text, vector};
use super::error::{OrRaise, call, raise};
use super::log::{Log, channels, copies};
use super::model::Model;
use super::work::long;
use deadtime::diagnose::{
    Diagnosed, GapOptions, Mode, Stage, Subject, clocks, diagnose, inspect, isolability,
};
use deadtime::effect::{Applied, Chance};
use deadtime::log::{ReadOptions, open};
use deadtime::model::ModelDocument;
use deadtime::progress::HowFar;
use deadtime::report;
use deadtime::simulate::{Commands, Dynamics, Face, Port, Restart, Simulator, Start, System};
use deadtime::stop::Stop;

/// Converts the exception of a call into that of the caller: unchanged, where it was no ordinary one; else as the cause of ours.
#[derive(Debug, Clone, Default)]
struct Raised(Arc<Mutex<Option<Exception>>>);

#[derive(Debug)]
struct Exception {
    error: PyErr,
    /// `KeyError: 'ctrl'`.
    words: String,
    /// No `Exception`: the caller ends everything.
    ends: bool,
}

impl Raised {
    fn keep(&self, py: Python<'_>, error: PyErr) -> String {
        let name =
            error.get_type(py).name().map_or_else(|_| "exception".to_owned(), |n| n.to_string());
        let said = error.value(py).to_string();
        let words = if said.is_empty() { name } else { format!("{name}: {said}") };
        let ends = !error.is_instance_of::<PyException>(py);
        let mut slot = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if slot.as_ref().is_none_or(|before| !before.ends) {
            *slot = Some(Exception { error, words: words.clone(), ends });
        }
        words
    }

    /// An exception that ends everything, of any class.
    fn end(&self, error: PyErr) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) =
            Some(Exception { error, words: String::new(), ends: true });
    }

    /// The caller gets an exception that ends everything before its consequences.
    fn over<T>(&self, py: Python<'_>, result: PyResult<T>) -> PyResult<T> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(kept) = kept else { return result };
        if kept.ends {
            return Err(kept.error);
        }
        result.inspect_err(|error| {
            if error.value(py).to_string().contains(&kept.words) {
                error.set_cause(py, Some(kept.error.clone_ref(py)));
            }
        })
    }

    fn ends(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).as_ref().is_some_and(|e| e.ends)
    }
}

/// A function f(u, time, x0, parameters) → y of Python.
#[derive(Debug)]
struct Function {
    f: Py<PyAny>,
    parameters: Vec<String>,
    outputs: usize,
    raised: Raised,
}

impl Function {
    fn call(
        &self,
        py: Python<'_>,
        u: &DMatrix<f64>,
        time_s: &[f64],
        x0: &[f64],
        parameters: &[f64],
    ) -> Result<DMatrix<f64>, String> {
        if self.raised.ends() {
            return Err("it was interrupted".to_owned());
        }
        self.answer(py, u, time_s, x0, parameters).map_err(|e| self.raised.keep(py, e))
    }

    fn answer(
        &self,
        py: Python<'_>,
        u: &DMatrix<f64>,
        time_s: &[f64],
        x0: &[f64],
        parameters: &[f64],
    ) -> PyResult<DMatrix<f64>> {
        // Rows one after the other, as NumPy has it by default.
        let rows: Vec<f64> = u.transpose().as_slice().to_vec();
        let u = rows.into_pyarray(py).reshape([u.nrows(), u.ncols()])?;
        let named = PyDict::new(py);
        for (name, value) in self.parameters.iter().zip(parameters) {
            named.set_item(name, value)?;
        }
        let y = self.f.bind(py).call1((
            u,
            array1(py, time_s.to_vec()),
            array1(py, x0.to_vec()),
            named,
        ))?;
        numbers(&y, time_s.len(), self.outputs)
    }
}

/// The returned value of a function, as samples × outputs.
fn numbers(y: &Bound<'_, PyAny>, samples: usize, outputs: usize) -> PyResult<DMatrix<f64>> {
    let py = y.py();
    let numpy = py.import("numpy")?;
    let needed = if outputs == 1 {
        format!("({samples},) or ({samples}, 1)")
    } else {
        format!("({samples}, {outputs})")
    };
    if y.is_none() {
        return Err(PyTypeError::new_err(format!(
            "simulate returned None; it must return an array of shape {needed}"
        )));
    }
    let array = numpy.call_method1("asarray", (y,))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if !"fiub".contains(&kind) {
        let what = array.getattr("dtype")?.str()?;
        return Err(PyTypeError::new_err(format!(
            "simulate returned an array of {what}; it must return numbers of shape {needed}"
        )));
    }
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    let fits = shape == [samples, outputs] || (outputs == 1 && shape == [samples]);
    if !fits {
        let told = shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
        let comma = if shape.len() == 1 { "," } else { "" };
        let hint =
            if shape == [outputs, samples] { "; samples come first: return y.T" } else { "" };
        return Err(PyValueError::new_err(format!(
            "simulate returned an array of shape ({told}{comma}) where {needed} is needed{hint}"
        )));
    }
    let array = array
        .call_method1("astype", ("float64",))?
        .call_method1("reshape", ((samples, outputs),))?;
    let view: PyReadonlyArray2<'_, f64> = array.cast::<PyArray2<f64>>()?.readonly();
    let view = view.as_array();
    Ok(DMatrix::from_fn(samples, outputs, |k, i| view[(k, i)]))
}

/// One call, and where its answer goes.
struct Call {
    u: DMatrix<f64>,
    time_s: Vec<f64>,
    x0: Vec<f64>,
    parameters: Vec<f64>,
    answer: SyncSender<Result<DMatrix<f64>, String>>,
}

/// A function that is called in one thread of its own, one call at a time. A waiting caller holds neither the interpreter's lock nor a place in the search's
/// work queue, so that the function is free in its actions.
#[derive(Debug)]
struct Served(Sender<Call>);

impl Served {
    fn new(function: Function) -> std::io::Result<Self> {
        let (sender, calls) = channel::<Call>();
        thread::Builder::new().name("deadtime simulate".to_owned()).stack_size(8 << 20).spawn(
            move || {
                for call in calls {
                    let answer = Python::try_attach(|py| {
                        function.call(py, &call.u, &call.time_s, &call.x0, &call.parameters)
                    });
                    // The caller may have gone.
                    let _ = call.answer.send(
                        answer.unwrap_or_else(|| Err("the interpreter has ended".to_owned())),
                    );
                }
                // Gone with the lock held; without an interpreter there is nothing to give back.
                let rest = Mutex::new(Some(function));
                if Python::try_attach(|_| {
                    drop(rest.lock().unwrap_or_else(PoisonError::into_inner).take())
                })
                .is_none()
                {
                    std::mem::forget(rest);
                }
            },
        )?;
        Ok(Self(sender))
    }
}

impl Simulator for Served {
    fn simulate(
        &self,
        u: &DMatrix<f64>,
        time_s: &[f64],
        x0: &[f64],
        parameters: &[f64],
    ) -> Result<DMatrix<f64>, String> {
        let (answer, answers) = sync_channel(1);
        let call = Call {
            u: u.clone(),
            time_s: time_s.to_vec(),
            x0: x0.to_vec(),
            parameters: parameters.to_vec(),
            answer,
        };
        let gone = || "the thread that calls simulate has ended".to_owned();
        self.0.send(call).map_err(|_| gone())?;
        answers.recv().map_err(|_| gone())?
    }
}

/// The same function called in the current thread.
#[derive(Debug)]
struct Direct(Arc<Function>);

impl Simulator for Direct {
    fn simulate(
        &self,
        u: &DMatrix<f64>,
        time_s: &[f64],
        x0: &[f64],
        parameters: &[f64],
    ) -> Result<DMatrix<f64>, String> {
        let answer = Python::try_attach(|py| self.0.call(py, u, time_s, x0, parameters));
        answer.unwrap_or_else(|| Err("the interpreter has ended".to_owned()))
    }
}

/// A function of Python with the names of its channels; called, it is the function with effects at work.
#[pyclass(frozen, module = "deadtime._native", name = "_Simulator")]
pub(super) struct PySimulator {
    f: Py<PyAny>,
    face: Face,
    effects: Vec<Applied>,
}

type Named = (String, Option<String>);

#[pymethods]
impl PySimulator {
    #[new]
    #[pyo3(signature = (f, name, inputs, outputs, states, parameters, channels=None, restart_every=None))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        f: Py<PyAny>,
        name: String,
        inputs: Vec<Named>,
        outputs: Vec<Named>,
        states: Vec<(String, f64, Option<f64>)>,
        parameters: Vec<(String, Option<String>, f64)>,
        channels: Option<Vec<Option<String>>>,
        restart_every: Option<f64>,
    ) -> PyResult<Self> {
        let port = |(name, unit): Named| Port { name, unit };
        let face = Face {
            name,
            inputs: inputs.into_iter().map(port).collect(),
            outputs: outputs.into_iter().map(port).collect(),
            states: states
                .into_iter()
                .map(|(name, initial, std)| Start { port: Port { name, unit: None }, initial, std })
                .collect(),
            parameters: parameters
                .into_iter()
                .map(|(name, unit, value)| (Port { name, unit }, value))
                .collect(),
            restart: channels.map(|channels| Restart { channels, every_s: restart_every }),
        };
        let simulator = Self { f, face, effects: Vec::new() };
        simulator.direct(py, Raised::default()).or_raise(py)?;
        Ok(simulator)
    }

    /// f with the effects at work: outputs, shape (N, p).
    #[pyo3(signature = (u, time, x0, parameters))]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        u: &Bound<'py, PyAny>,
        time: Numbers<'py>,
        x0: Numbers<'py>,
        parameters: &Bound<'py, PyDict>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let time = vector(&time);
        let inputs: Vec<Vec<f64>> = match u.extract::<Table<'py>>() {
            Ok(table) => {
                matrix(&table).column_iter().map(|c| c.iter().copied().collect()).collect()
            }
            Err(_) => vec![vector(&u.extract::<Numbers<'py>>()?)],
        };
        let raised = Raised::default();
        let mut system = self.direct(py, raised.clone()).or_raise(py)?;
        let mut plan = Applied::plan(&system, &self.effects, Chance::Mean).or_raise(py)?;
        // A parameter error is the same at every requested value.
        let asked =
            self.face.parameters.iter().map(|(port, _)| match parameters.get_item(&port.name)? {
                Some(value) => value.extract::<f64>(),
                None => Err(PyKeyError::new_err(format!("parameters: `{}` is missing", port.name))),
            });
        let asked = asked.collect::<PyResult<Vec<f64>>>()?;
        if let (Dynamics::BlackBox(_, values), Dynamics::BlackBox(_, wrong)) =
            (&mut system.dynamics, &mut plan.dynamics)
        {
            for ((wrong, nominal), asked) in wrong.iter_mut().zip(values.iter_mut()).zip(asked) {
                *wrong = asked + (*wrong - *nominal);
                *nominal = asked;
            }
        }
        let start = time.first().copied().unwrap_or(0.0);
        let time: Vec<f64> = time.iter().map(|t| t - start).collect();
        let run = system
            .simulate(&plan, Commands { time_s: &time, inputs: &inputs }, &vector(&x0), None)
            .or_raise(py);
        let run = match (run, raised.0.lock().unwrap_or_else(PoisonError::into_inner).take()) {
            (Err(_), Some(kept)) => return Err(kept.error),
            (run, _) => run?,
        };
        let (rows, columns) = run.y.shape();
        run.y.transpose().as_slice().to_vec().into_pyarray(py).reshape([rows, columns])
    }

    /// The effects at work.
    #[getter]
    fn effects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        object(py, &self.effects.iter().map(Applied::to_entry).collect::<Vec<_>>())
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let effects: Vec<String> = self.effects.iter().map(Applied::key).collect();
        let with = if effects.is_empty() {
            String::new()
        } else {
            format!(" with {}", effects.join(" and "))
        };
        Ok(format!("<{}{with}>", self.f.bind(py).repr()?))
    }
}

impl PySimulator {
    fn function(&self, py: Python<'_>, raised: Raised) -> Function {
        let parameters = self.face.parameters.iter().map(|p| p.0.name.clone()).collect();
        Function { f: self.f.clone_ref(py), parameters, outputs: self.face.outputs.len(), raised }
    }

    fn direct(&self, py: Python<'_>, raised: Raised) -> deadtime::Result<System> {
        Ok(System::black_box(
            Arc::new(Direct(Arc::new(self.function(py, raised)))),
            self.face.clone(),
        )?)
    }

    fn served(&self, py: Python<'_>, raised: Raised) -> PyResult<System> {
        System::black_box(Arc::new(Served::new(self.function(py, raised))?), self.face.clone())
            .or_raise(py)
    }

    fn with(&self, py: Python<'_>, effects: &[Applied]) -> Self {
        Self { f: self.f.clone_ref(py), face: self.face.clone(), effects: effects.to_vec() }
    }
}

/// The subject of a diagnosis.
enum What {
    Model(Box<ModelDocument>),
    Simulator(Box<System>),
}

impl What {
    fn new(subject: &Bound<'_, PyAny>, raised: &Raised) -> PyResult<Self> {
        if let Ok(model) = subject.cast::<Model>() {
            return Ok(Self::Model(Box::new(model.get().0.clone())));
        }
        let simulator = subject.cast::<PySimulator>()?;
        Ok(Self::Simulator(Box::new(simulator.get().served(subject.py(), raised.clone())?)))
    }

    fn subject(&self) -> Subject<'_> {
        match self {
            Self::Model(document) => document.as_ref().into(),
            Self::Simulator(system) => system.as_ref().into(),
        }
    }

    /// A function may itself use the threads that everybody shares: it must not wait for those that wait for it.
    fn threads(&self, asked: Option<usize>) -> Option<usize> {
        match self {
            Self::Model(_) => asked,
            Self::Simulator(_) => {
                asked.or_else(|| thread::available_parallelism().ok().map(usize::from))
            }
        }
    }
}

fn options(
    prediction: Option<&str>,
    horizon: Option<usize>,
    max_delay: Option<f64>,
    seed: u64,
    stop: &Stop,
) -> GapOptions {
    let prediction =
        prediction.map(|p| if p == "predictor" { Mode::Predictor } else { Mode::Simulation });
    GapOptions {
        prediction,
        horizon,
        longest_delay_s: max_delay,
        seed,
        stop: stop.clone(),
        ..GapOptions::default()
    }
}

fn mode(prediction: Option<&Bound<'_, PyString>>) -> PyResult<Option<String>> {
    match prediction.map(|p| p.to_string()) {
        Some(p) if p != "predictor" && p != "simulation" => Err(PyValueError::new_err(format!(
            "prediction is `{p}`; it is `simulation` or `predictor`, or None: chosen from the model"
        ))),
        p => Ok(p),
    }
}

/// The gap between a model or simulator and logs.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(super) fn _gap(
    py: Python<'_>,
    subject: &Bound<'_, PyAny>,
    logs: Vec<PyRef<'_, Log>>,
    holdout: Vec<PyRef<'_, Log>>,
    prediction: Option<&Bound<'_, PyString>>,
    horizon: Option<usize>,
    max_delay: Option<f64>,
    rows: usize,
    suggest: bool,
    seed: u64,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<PyDiagnosed> {
    let raised = Raised::default();
    let (what, prediction) = (What::new(subject, &raised)?, mode(prediction)?);
    let (logs, holdout) = (copies(&logs), copies(&holdout));
    let (listener, threads) = (raised.clone(), what.threads(threads));
    let work = move |stop: &Stop| {
        let tell = |stage: Stage| {
            let Some(progress) = &progress else { return };
            let told = Python::try_attach(|py| {
                progress
                    .call1(py, (stage.begins_at(), stage.to_string()))
                    .map_err(|error| listener.end(error))
                    .is_ok()
            });
            if told != Some(true) {
                stop.set();
            }
        };
        let options = GapOptions {
            rows,
            suggest,
            ..options(prediction.as_deref(), horizon, max_delay, seed, stop)
        };
        Ok(diagnose(what.subject(), &logs, &holdout, &options, &tell)?.worded(call))
    };
    let found = raised.over(py, long(py, threads, work))?;
    let simulator = match subject.cast::<PySimulator>() {
        Ok(simulator) => Some(Py::new(py, simulator.get().with(py, &found.handed_over))?),
        Err(_) => None,
    };
    Ok(PyDiagnosed { found, simulator })
}

/// The checks of a model or simulator and logs without a diagnosis: deadtime/check@1 as text, and the output of the command line.
#[pyfunction]
pub(super) fn _check(
    py: Python<'_>,
    subject: &Bound<'_, PyAny>,
    logs: Vec<PyRef<'_, Log>>,
    files: Vec<PathBuf>,
    wanted: (Vec<String>, Vec<String>),
) -> PyResult<(String, String)> {
    let raised = Raised::default();
    let (what, logs) = (What::new(subject, &raised)?, copies(&logs));
    let threads = what.threads(None);
    let wanted = channels(wanted.0, wanted.1);
    let work = move |stop: &Stop| {
        let mut found = inspect(what.subject(), &logs, stop, &HowFar::default())?;
        // The clocks are those of the files' topics.
        for file in &files {
            found.clocks.push(clocks(&open(file, &ReadOptions::default())?, &wanted));
        }
        Ok(found.worded(call))
    };
    let found = raised.over(py, long(py, threads, work))?;
    Ok((text(&found)?, report::checks::text(&found)))
}

/// Distinguishable effects of logs: deadtime/isolability@1 as text, and the output of the command line.
#[pyfunction]
pub(super) fn _isolability(
    py: Python<'_>,
    subject: &Bound<'_, PyAny>,
    logs: Vec<PyRef<'_, Log>>,
    prediction: Option<&Bound<'_, PyString>>,
    horizon: Option<usize>,
    max_delay: Option<f64>,
    threads: Option<usize>,
) -> PyResult<(String, String)> {
    let raised = Raised::default();
    let (what, prediction, logs) = (What::new(subject, &raised)?, mode(prediction)?, copies(&logs));
    let threads = what.threads(threads);
    let work = move |stop: &Stop| {
        Ok(isolability(
            what.subject(),
            &logs,
            &options(prediction.as_deref(), horizon, max_delay, 1, stop),
            &HowFar::default(),
        )?)
    };
    let found = raised.over(py, long(py, threads, work))?;
    Ok((text(&found)?, report::isolability::text(&found)))
}

/// A diagnosis with its inputs.
#[pyclass(frozen, module = "deadtime._native", name = "_Diagnosed")]
pub(super) struct PyDiagnosed {
    found: Diagnosed,
    simulator: Option<Py<PySimulator>>,
}

#[pymethods]
impl PyDiagnosed {
    /// deadtime/diagnosis@3.
    fn to_json(&self) -> PyResult<String> {
        text(&self.found.diagnosis)
    }

    /// The sentences.
    #[getter]
    fn summary(&self) -> String {
        report::diagnosis::summary(&self.found)
    }

    #[getter]
    fn caveats(&self) -> Vec<String> {
        self.found.caveats.iter().map(ToString::to_string).collect()
    }

    #[getter]
    fn calls(&self) -> Option<usize> {
        self.found.calls
    }

    /// The model with the found effects.
    #[getter]
    fn model(&self) -> Option<Model> {
        self.found.model.clone().map(Model)
    }

    /// The simulator with the found effects.
    #[getter]
    fn simulator(&self, py: Python<'_>) -> Option<Py<PySimulator>> {
        self.simulator.as_ref().map(|s| s.clone_ref(py))
    }

    /// The page that the command line writes.
    fn page(&self) -> String {
        report::page::gap(&self.found)
    }

    /// Writes the files of the command line; returns their names.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<Vec<&'static str>> {
        py.detach(|| report::save(&self.found, &folder)).map_err(|e| raise(py, e))
    }

    /// The curves, by output and then by log.
    #[getter]
    fn traces<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let one = |trace: &deadtime::diagnose::Trace| {
            let dict = PyDict::new(py);
            dict.set_item("log", &trace.log)?;
            dict.set_item("output", &trace.output)?;
            dict.set_item("unit", &trace.unit)?;
            dict.set_item("time", array1(py, trace.time_s.clone()))?;
            dict.set_item(
                "measured",
                array1(py, trace.measured.iter().map(|v| v.unwrap_or(f64::NAN)).collect()),
            )?;
            dict.set_item("before", array1(py, trace.before.clone()))?;
            dict.set_item("after", trace.after.clone().map(|after| array1(py, after)))?;
            dict.set_item("train", trace.train.map(|[from, to]| (from, to)))?;
            dict.set_item("held", trace.held.map(|[from, to]| (from, to)))?;
            dict.set_item("floor", trace.floor)?;
            Ok(dict)
        };
        self.found.traces.iter().map(one).collect()
    }
}
