//! Models and the model file: [`deadtime::model`].

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::convert::{conversion, object};
use super::error::{OrRaise, raise};
use super::state_space::{Either, StateSpace};
use super::work::long;
use deadtime::effect::Applied;
use deadtime::model::uav::{self, Dynamics};
use deadtime::model::{
    CandidateEntry, Channel, EffectEntry, ModelDocument, ModelError, ModelFile, State,
};
use deadtime::registry::RegistryError;
use deadtime::simulate::System;

/// The name of a model without a file in error messages.
const NO_FILE: &str = "model";

/// A simulator: a model with the names, units, start and effects that a model file gives it (`deadtime/model@1`).
///
/// Made by `Model.read`, `Model.from_dict`, `Model.from_toml`, `Model.from_system` or `deadtime.as_model`; it does not change once made. Two models are
/// equal where their files are.
#[pyclass(frozen, module = "deadtime", name = "Model")]
#[derive(Clone)]
pub(super) struct Model(pub(super) ModelDocument);

#[pymethods]
impl Model {
    /// The model in the file at `path` (.toml or .json).
    ///
    /// Raises
    /// ------
    /// ModelError
    ///     What is wrong in the file, and where.
    /// FileError
    ///     The file cannot be read.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Ok(Self(ModelDocument::read(&path).or_raise(py)?))
    }

    /// The model that a `text` of TOML describes; `source` is what error messages call it.
    #[staticmethod]
    #[pyo3(signature = (text, source = "model"))]
    fn from_toml(py: Python<'_>, text: &str, source: &str) -> PyResult<Self> {
        Ok(Self(ModelDocument::from_toml(text, Path::new(source)).or_raise(py)?))
    }

    /// The model that a `text` of JSON describes; `source` is what error messages call it.
    #[staticmethod]
    #[pyo3(signature = (text, source = "model"))]
    fn from_json(py: Python<'_>, text: &str, source: &str) -> PyResult<Self> {
        Ok(Self(ModelDocument::from_json(text, Path::new(source)).or_raise(py)?))
    }

    /// The model that `data` describes, a dict with the keys of a model file. Arrays do for lists of numbers. `source` is what error messages call it.
    #[staticmethod]
    #[pyo3(signature = (data, source = "model"))]
    fn from_dict(py: Python<'_>, data: &Bound<'_, PyAny>, source: &str) -> PyResult<Self> {
        let plain = py.import("deadtime.models")?.getattr("_plain")?;
        let options = PyDict::new(py);
        options.set_item("default", plain)?;
        let text: String =
            py.import("json")?.call_method("dumps", (data,), Some(&options))?.extract()?;
        Self::from_json(py, &text, source)
    }

    /// A simulator from a linear system: one of ours, of python-control or of scipy.
    ///
    /// Parameters
    /// ----------
    /// system : StateSpace, TransferFunction, or what `deadtime.as_system` takes
    ///     The system.
    /// inputs, outputs, states : list of str, optional
    ///     Names, as the log's columns are called. Without them the system's own labels, where python-control gives some, else u, y, x with a number
    ///     where there are several.
    /// name : str, optional
    ///     The model's name.
    /// units : dict of str to str, optional
    ///     Units by name of an input, output or state.
    /// operating : dict of str to float or "mean", optional
    ///     Where the system was linearised, by input and output: it acts on u − operating and gives y − operating.
    /// initial : array_like, shape (n,), optional
    ///     The state when a log starts; 0 without it.
    /// initial_std : array_like, shape (n,), optional
    ///     How far `initial` is trusted, 0: exactly. Without it the start is unknown.
    /// sample_time : float, optional
    ///     s, as `deadtime.as_system` takes it.
    #[staticmethod]
    #[pyo3(signature = (system, inputs = None, outputs = None, states = None, *, name = None, units = None, operating = None, initial = None, initial_std = None, sample_time = None))]
    #[allow(clippy::too_many_arguments)]
    fn from_system(
        py: Python<'_>,
        system: &Bound<'_, PyAny>,
        inputs: Option<&Bound<'_, PyAny>>,
        outputs: Option<&Bound<'_, PyAny>>,
        states: Option<&Bound<'_, PyAny>>,
        name: Option<&str>,
        units: Option<&Bound<'_, PyAny>>,
        operating: Option<&Bound<'_, PyAny>>,
        initial: Option<&Bound<'_, PyAny>>,
        initial_std: Option<&Bound<'_, PyAny>>,
        sample_time: Option<f64>,
    ) -> PyResult<Self> {
        let file = py.import("deadtime.models")?.getattr("_file_of_system")?;
        let data = file.call1((
            system,
            inputs,
            outputs,
            states,
            name,
            units,
            operating,
            initial,
            initial_std,
            sample_time,
        ))?;
        Self::from_dict(py, &data, NO_FILE)
    }

    /// A nonlinear simulator from its equations.
    ///
    /// Parameters
    /// ----------
    /// derivatives : dict of str to str
    ///     dx/dt of each state, in the order of the states: expressions in states, inputs, parameters and `time` (s).
    /// outputs : dict of str to str
    ///     Each output, in the same names.
    /// inputs : list of str
    ///     Names of the inputs.
    /// parameters : dict of str to float, optional
    ///     Named numbers, which a diagnosis may find wrong.
    /// name : str
    ///     The model's name.
    /// units : dict of str to str, optional
    ///     Units by name of an input, output, state or parameter.
    /// initial : dict of str to float, optional
    ///     States when a log starts; 0 without it.
    /// initial_std : dict of str to float, optional
    ///     How far these are trusted, 0: exactly. A state without one has an unknown start.
    /// input_delay : dict of str to float, optional
    ///     Delays of inputs, s.
    #[staticmethod]
    #[pyo3(signature = (derivatives, outputs, inputs, parameters = None, *, name = "model", units = None, initial = None, initial_std = None, input_delay = None))]
    #[allow(clippy::too_many_arguments)]
    fn from_equations(
        py: Python<'_>,
        derivatives: &Bound<'_, PyAny>,
        outputs: &Bound<'_, PyAny>,
        inputs: &Bound<'_, PyAny>,
        parameters: Option<&Bound<'_, PyAny>>,
        name: &str,
        units: Option<&Bound<'_, PyAny>>,
        initial: Option<&Bound<'_, PyAny>>,
        initial_std: Option<&Bound<'_, PyAny>>,
        input_delay: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let file = py.import("deadtime.models")?.getattr("_file_of_equations")?;
        let data = file.call1((
            derivatives,
            outputs,
            inputs,
            parameters,
            name,
            units,
            initial,
            initial_std,
            input_delay,
        ))?;
        Self::from_dict(py, &data, name)
    }

    /// The keys of the model file, as dicts, lists and numbers.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        object(py, &self.0)
    }

    /// The text of the model file, as TOML.
    fn to_toml(&self, py: Python<'_>) -> PyResult<String> {
        self.0.to_toml().or_raise(py)
    }

    /// Writes the model file, as TOML or JSON by the path's extension.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.0.write(&path).or_raise(py)
    }

    /// The model with this list of effects in place of its own: dicts with `effect`, `channel` and `parameters`.
    ///
    /// Raises
    /// ------
    /// EffectError
    ///     An effect, channel or parameter that there is not, or a value outside its bounds.
    fn with_effects(&self, py: Python<'_>, effects: &Bound<'_, PyAny>) -> PyResult<Self> {
        let data = self.to_dict(py)?;
        data.set_item("effects", effects)?;
        let model = Self::from_dict(py, &data, self.0.name())?;
        model.check_effects(py)?;
        Ok(model)
    }

    /// The model with a term that it may lack, which a diagnosis then tries like any effect.
    ///
    /// Parameters
    /// ----------
    /// term : str
    ///     As ``"level2 += k*(level1 - level2); k in 0 to 1"``. Names that the model does not know are free parameters, 0 where the term is nothing. Behind
    ///     the semicolon are their ranges and, as ``w = 0.1 in 0.01 to 1``, the first value of a width or a power.
    ///
    /// Raises
    /// ------
    /// ModelError
    ///     A term that cannot be searched for: an unknown state, no free parameter, not nothing where its parameters are 0.
    ///
    /// Examples
    /// --------
    /// >>> tank = deadtime.Model.from_equations({"level": "u - 0.5*level"}, {"level": "level"}, ["u"])
    /// >>> tank.with_candidate("level += k*sqrt(abs(level))").to_dict()["candidates"]
    /// [{'state': 'level', 'adds': 'k*sqrt(abs(level))'}]
    fn with_candidate(&self, py: Python<'_>, term: &str) -> PyResult<Self> {
        let mut model = self.0.clone();
        CandidateEntry::from_text(term)
            .and_then(|candidate| model.suspect(candidate))
            .or_raise(py)?;
        Ok(Self(model))
    }

    /// The model's name.
    #[getter]
    fn name(&self) -> &str {
        self.0.name()
    }

    /// `lti` or `equations`.
    #[getter]
    fn kind(&self) -> &'static str {
        self.0.kind()
    }

    /// The sample time, s; None for a continuous model.
    #[getter]
    fn sample_time(&self) -> Option<f64> {
        match &self.0 {
            ModelDocument::Lti(file) if file.is_sampled() => Some(file.sample_time_s),
            _ => None,
        }
    }

    /// Names of the inputs, in order.
    #[getter]
    fn inputs(&self) -> Vec<String> {
        self.0.inputs().iter().map(|c| c.name.clone()).collect()
    }

    /// Names of the outputs, in order.
    #[getter]
    fn outputs(&self) -> Vec<String> {
        self.0.outputs().iter().map(|c| c.name.clone()).collect()
    }

    /// Names of the states, in order.
    #[getter]
    fn states(&self) -> Vec<String> {
        self.0.states().map(|(name, _)| name.to_owned()).collect()
    }

    /// Names of the parameters of equations, with their values.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let parameters = PyDict::new(py);
        if let ModelDocument::Equations(file) = &self.0 {
            for (name, entry) in &file.parameters {
                parameters.set_item(name, entry.value)?;
            }
        }
        Ok(parameters)
    }

    /// Units of those inputs and outputs that have one.
    #[getter]
    fn units<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let units = PyDict::new(py);
        for channel in self.0.inputs().iter().chain(self.0.outputs()) {
            if let Some(unit) = &channel.unit {
                units.set_item(&channel.name, unit)?;
            }
        }
        Ok(units)
    }

    /// Effects that belong to the simulator: a list of dicts with `effect`, `channel` and `parameters`.
    #[getter]
    fn effects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let effects: &[EffectEntry] = self.0.effects();
        object(py, &effects)
    }

    /// The linear system of a model of kind `lti`, without its effects and operating points.
    ///
    /// Raises
    /// ------
    /// ModelError
    ///     The model is one of equations.
    fn system(&self, py: Python<'_>) -> PyResult<StateSpace> {
        match &self.0 {
            ModelDocument::Lti(file) if file.is_sampled() => {
                Ok(StateSpace(Either::Sampled(file.sampled().or_raise(py)?)))
            }
            ModelDocument::Lti(file) => {
                Ok(StateSpace(Either::Continuous(file.continuous().or_raise(py)?)))
            }
            ModelDocument::Equations(file) => Err(raise(
                py,
                ModelError::NotLinear {
                    path: file.name.clone().into(),
                    kind: "equations".to_owned(),
                },
            )),
        }
    }

    /// The sampled model by a conversion and its options.
    fn _c2d(
        &self,
        py: Python<'_>,
        sample_time: f64,
        method: &str,
        options: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let ModelDocument::Lti(file) = self.0.clone() else {
            return Err(raise(
                py,
                ModelError::NotLinear { path: self.name().into(), kind: self.kind().to_owned() },
            ));
        };
        let (sample_time, conversion) = conversion(py, sample_time, method, options)?;
        Ok(Self(ModelDocument::Lti(long(py, None, move |_| {
            Ok(file.c2d(&*conversion, sample_time, None)?)
        })?)))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __repr__(&self) -> String {
        let time = self
            .sample_time()
            .map_or_else(|| "continuous".to_owned(), |ts| format!("every {ts} s"));
        let mut text = format!(
            "<Model {}: {}, {time}; {} -> {}",
            self.name(),
            self.kind(),
            self.inputs().join(", "),
            self.outputs().join(", ")
        );
        text += &format!("; {} states", self.states().len());
        if !self.0.effects().is_empty() {
            let effects: Vec<String> =
                self.0.effects().iter().map(|e| format!("{}:{}", e.effect, e.channel)).collect();
            text += &format!("; effects {}", effects.join(", "));
        }
        text + ">"
    }

    /// Pickles by its file.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String, String))> {
        let (py, model) = (slf.py(), slf.get());
        Ok((
            py.import("deadtime._native")?.getattr("_model")?,
            (model.to_toml(py)?, model.name().to_owned()),
        ))
    }
}

impl Model {
    /// Every effect can act on this model, with these parameters.
    fn check_effects(&self, py: Python<'_>) -> PyResult<()> {
        // Where operating points are a log's means, their values do not matter here.
        let system = System::new(&self.0, |_| Ok(0.0)).or_raise(py)?;
        self.0
            .effects()
            .iter()
            .try_for_each(|entry| Applied::from_entry(&system, entry).map(drop))
            .map_err(|e| raise(py, e))
    }
}

/// The quadrotor of the thesis: one of its four dynamics, or the whole.
#[pyfunction]
pub(super) fn _uav(py: Python<'_>, name: Option<&str>) -> PyResult<Model> {
    let (name, sys, parts) = match name {
        None => ("uav", uav::model(), Dynamics::ALL.to_vec()),
        Some(name) => match Dynamics::ALL.into_iter().find(|d| d.name() == name) {
            Some(dynamics) => (dynamics.name(), dynamics.model(), vec![dynamics]),
            None => {
                let known = Dynamics::ALL.iter().map(|d| d.name()).collect();
                return Err(raise(
                    py,
                    RegistryError::Unknown { kind: "dynamics", name: name.to_owned(), known },
                ));
            }
        },
    };
    let channel = |name: &str, unit: &str| Channel::plain(name, Some(unit));
    let inputs = parts.iter().map(|d| channel(d.input(), "1")).collect();
    let states = parts
        .iter()
        .flat_map(|d| d.states())
        .map(|(n, u)| State { name: (*n).to_owned(), unit: Some((*u).to_owned()) })
        .collect();
    let outputs = parts.iter().flat_map(|d| d.outputs()).map(|(n, u)| channel(n, u)).collect();
    Ok(Model(ModelDocument::Lti(
        ModelFile::from_continuous(name, &sys, inputs, states, outputs).or_raise(py)?,
    )))
}

/// A model from the text of its file, for pickle.
#[pyfunction]
pub(super) fn _model(py: Python<'_>, text: &str, source: &str) -> PyResult<Model> {
    Model::from_toml(py, text, source)
}
