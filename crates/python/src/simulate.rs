//! Conversions, simulation and optimal gains of linear systems: [`deadtime::model`] and [`deadtime::simulate`].

use nalgebra::{DMatrix, DVector};
use numpy::{Complex64, IntoPyArray, PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::convert::{array2, conversion, object};
use super::error::{OrRaise, raise};
use super::log::Log;
use super::model::Model;
use super::state_space::{Either, StateSpace, numbers, table};
use super::work::long;
use deadtime::effect::{OnLog, check_units};
use deadtime::model::c2d::CONVERSIONS;
use deadtime::model::{D2c, ModelError, d2c_by, dare, dlqr};
use deadtime::simulate::{Grid, Hold, Options, Prehistory, lsim};
use deadtime::time::SampleTime;

fn domain(what: &'static str, needed: &'static str, found: &'static str) -> ModelError {
    ModelError::Domain { what, needed, name: "system".to_owned(), found }
}

#[pyfunction]
pub(super) fn _c2d(
    py: Python<'_>,
    system: &StateSpace,
    sample_time: f64,
    method: &str,
    options: &Bound<'_, PyAny>,
) -> PyResult<StateSpace> {
    let Either::Continuous(sys) = system.0.clone() else {
        return Err(raise(py, domain("c2d", "continuous", "sampled")));
    };
    let (sample_time, conversion) = conversion(py, sample_time, method, options)?;
    Ok(StateSpace(Either::Sampled(long(
        py,
        None,
        move |_| Ok(conversion.c2d(&sys, sample_time)?),
    )?)))
}

#[pyfunction]
pub(super) fn _d2c(py: Python<'_>, system: &StateSpace, method: &str) -> PyResult<StateSpace> {
    let way = match method {
        "zoh" => D2c::ZeroOrderHold,
        "tustin" => D2c::Tustin,
        "matched" => D2c::Matched,
        other => {
            return Err(PyValueError::new_err(format!(
                "method is `{other}`; it is `zoh`, `tustin` or `matched`"
            )));
        }
    };
    match &system.0 {
        Either::Sampled(sys) => Ok(StateSpace(Either::Continuous(d2c_by(sys, way).or_raise(py)?))),
        Either::Continuous(_) => Err(raise(py, domain("d2c", "sampled", "continuous"))),
    }
}

/// Conversions with their options and defaults.
#[pyfunction]
pub(super) fn _conversions(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let lines: Vec<_> = CONVERSIONS.iter().map(deadtime::registry::Entry::data).collect();
    object(py, &lines)
}

/// The system is sampled with this sample time.
#[pyfunction]
pub(super) fn _same_time(py: Python<'_>, system: &StateSpace, sample_time: f64) -> PyResult<()> {
    let sample_time = SampleTime::new(sample_time).or_raise(py)?;
    match &system.0 {
        Either::Sampled(sys) => sys.sample_time().must_equal(sample_time).or_raise(py),
        Either::Continuous(_) => Err(raise(py, domain("a sample time", "sampled", "continuous"))),
    }
}

fn hold_of(name: &str) -> PyResult<Hold> {
    match name {
        "zero" => Ok(Hold::Zero),
        "linear" => Ok(Hold::Linear),
        other => Err(PyValueError::new_err(format!("hold is `{other}`; it is `zero` or `linear`"))),
    }
}

/// Outputs and states of a system under an input of samples × inputs.
#[pyfunction]
#[allow(clippy::type_complexity, clippy::too_many_arguments)]
pub(super) fn _lsim<'py>(
    py: Python<'py>,
    system: &StateSpace,
    u: &Bound<'py, PyAny>,
    time: Option<&Bound<'py, PyAny>>,
    sample_time: Option<f64>,
    x0: Option<&Bound<'py, PyAny>>,
    hold: &str,
    prehistory: &str,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)> {
    let u = table("u", u)?;
    let options = Options {
        initial: x0.map(|x0| numbers("x0", x0)).transpose()?.map(DVector::from_vec),
        hold: hold_of(hold)?,
        prehistory: match prehistory {
            "held" => Prehistory::Held,
            "rest" => Prehistory::Rest,
            other => {
                return Err(PyValueError::new_err(format!(
                    "prehistory is `{other}`; it is `held` or `rest`"
                )));
            }
        },
    };
    let time_s = time.map(|time| numbers("time", time)).transpose()?;
    let system = system.0.clone();
    let response = long(py, None, move |_| {
        Ok(match (&system, &time_s) {
            // A stamp for every sample is required before stamps are read as a grid.
            (Either::Continuous(sys), Some(time_s)) if time_s.len() == u.nrows() => {
                lsim(sys, &u, Grid::of(time_s), &options)?
            }
            (Either::Continuous(sys), Some(time_s)) => lsim(sys, &u, time_s.as_slice(), &options)?,
            (Either::Continuous(sys), None) => {
                lsim(sys, &u, SampleTime::new(sample_time.unwrap_or(f64::NAN))?, &options)?
            }
            (Either::Sampled(sys), None) => {
                if let Some(seconds) = sample_time {
                    sys.sample_time().must_equal(SampleTime::new(seconds)?)?;
                }
                lsim(sys, &u, sys.sample_time(), &options)?
            }
            (Either::Sampled(sys), Some(time_s)) => lsim(sys, &u, time_s.as_slice(), &options)?,
        })
    })?;
    Ok((array2(py, response.y)?, array2(py, response.x)?))
}

/// A model on the inputs of a log: the simulated log, and the nrmse of each output that the log has too. None where the log has none.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(super) fn _simulate<'py>(
    py: Python<'py>,
    model: &Model,
    log: &Log,
    hold: &str,
    delay: Vec<(String, f64)>,
    states: bool,
    snr: Option<f64>,
    seed: u64,
) -> PyResult<(Log, Bound<'py, PyDict>)> {
    let (model, log, hold) = (model.0.clone(), log.0.clone(), hold_of(hold)?);
    let (simulated, comparison) = long(py, None, move |_| {
        let log = model.complete(log)?;
        check_units(&model, &log)?;
        let mut simulation = OnLog::new(&model, &log)?;
        (simulation.hold, simulation.seed) = (hold, seed);
        for (input, seconds) in &delay {
            simulation.delay(input, *seconds)?;
        }
        let response = simulation.response()?;
        let source = format!("{} on {}", model.name(), log.source());
        let comparison = simulation
            .nrmse(&response)?
            .into_iter()
            .map(|(name, nrmse)| (name.to_owned(), nrmse.ok()))
            .collect::<Vec<_>>();
        Ok((simulation.to_log(&response, &source, states, snr)?, comparison))
    })?;
    let nrmse = PyDict::new(py);
    for (name, value) in comparison {
        nrmse.set_item(name, value)?;
    }
    Ok((Log(simulated), nrmse))
}

#[pyfunction]
#[allow(non_snake_case, clippy::type_complexity)]
pub(super) fn _dlqr<'py>(
    py: Python<'py>,
    A: &Bound<'py, PyAny>,
    B: &Bound<'py, PyAny>,
    Q: &Bound<'py, PyAny>,
    R: &Bound<'py, PyAny>,
    N: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<Complex64>>)>
{
    let [a, b, q, r] =
        [("A", A), ("B", B), ("Q", Q), ("R", R)].map(|(name, value)| table(name, value));
    let n = N.map(|n| table("N", n)).transpose()?;
    let lqr = dlqr(&a?, &b?, &q?, &r?, n.as_ref()).or_raise(py)?;
    Ok((array2(py, lqr.k)?, array2(py, lqr.x)?, lqr.poles.into_pyarray(py)))
}

#[pyfunction]
#[allow(non_snake_case)]
pub(super) fn _dare<'py>(
    py: Python<'py>,
    A: &Bound<'py, PyAny>,
    B: &Bound<'py, PyAny>,
    Q: &Bound<'py, PyAny>,
    R: &Bound<'py, PyAny>,
    N: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let [a, b, q, r] =
        [("A", A), ("B", B), ("Q", Q), ("R", R)].map(|(name, value)| table(name, value));
    let n = N.map(|n| table("N", n)).transpose()?;
    let x: DMatrix<f64> = dare(&a?, &b?, &q?, &r?, n.as_ref()).or_raise(py)?;
    array2(py, x)
}
