//! Riccati and Lyapunov equations, norms, connections and delays as filters: [`deadtime::model`].

use nalgebra::DMatrix;
use numpy::{
    Complex64, IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray3,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::convert::array2;
use super::error::{OrRaise, raise};
use super::state_space::{Either, StateSpace, table};
use deadtime::identify::subspace::{Named, Recordings, Stretch};
use deadtime::identify::{era, markov, okid};
use deadtime::model::c2d::thiran;
use deadtime::model::{
    Filter, Lqr, ModelError, care, dlqe, dlyap, feedback, gdare, lqe, lqr, lyap, nu_gap, pade,
    parallel, series,
};
use deadtime::time::SampleTime;

type Matrix<'py> = Bound<'py, PyArray2<f64>>;
type Solution<'py> = (Matrix<'py>, Matrix<'py>, Bound<'py, PyArray1<Complex64>>);

fn of_lqr(py: Python<'_>, lqr: Lqr) -> PyResult<Solution<'_>> {
    Ok((array2(py, lqr.k)?, array2(py, lqr.x)?, lqr.poles.into_pyarray(py)))
}

fn of_filter(py: Python<'_>, filter: Filter) -> PyResult<Solution<'_>> {
    Ok((array2(py, filter.gain)?, array2(py, filter.covariance)?, filter.poles.into_pyarray(py)))
}

/// Four matrices and the cross weight, where there is one.
type Tables = ([DMatrix<f64>; 4], Option<DMatrix<f64>>);

/// Four matrices by their names, and one that may be absent.
fn tables(
    names: [&'static str; 4],
    given: [&Bound<'_, PyAny>; 4],
    cross: Option<&Bound<'_, PyAny>>,
) -> PyResult<Tables> {
    let one = |k: usize| table(names[k], given[k]);
    Ok(([one(0)?, one(1)?, one(2)?, one(3)?], cross.map(|n| table("N", n)).transpose()?))
}

/// The gain, the solution and the poles of the loop of the continuous regulator.
#[pyfunction]
#[allow(non_snake_case)]
pub(super) fn _lqr<'py>(
    py: Python<'py>,
    A: &Bound<'py, PyAny>,
    B: &Bound<'py, PyAny>,
    Q: &Bound<'py, PyAny>,
    R: &Bound<'py, PyAny>,
    N: Option<&Bound<'py, PyAny>>,
) -> PyResult<Solution<'py>> {
    let ([a, b, q, r], n) = tables(["A", "B", "Q", "R"], [A, B, Q, R], N)?;
    of_lqr(py, lqr(&a, &b, &q, &r, n.as_ref()).or_raise(py)?)
}

/// The solution of the continuous Riccati equation.
#[pyfunction]
#[allow(non_snake_case)]
pub(super) fn _care<'py>(
    py: Python<'py>,
    A: &Bound<'py, PyAny>,
    B: &Bound<'py, PyAny>,
    Q: &Bound<'py, PyAny>,
    R: &Bound<'py, PyAny>,
    N: Option<&Bound<'py, PyAny>>,
) -> PyResult<Matrix<'py>> {
    let ([a, b, q, r], n) = tables(["A", "B", "Q", "R"], [A, B, Q, R], N)?;
    array2(py, care(&a, &b, &q, &r, n.as_ref()).or_raise(py)?)
}

/// The solution of the generalised discrete Riccati equation.
#[pyfunction]
#[allow(non_snake_case)]
pub(super) fn _gdare<'py>(
    py: Python<'py>,
    A: &Bound<'py, PyAny>,
    B: &Bound<'py, PyAny>,
    Q: &Bound<'py, PyAny>,
    R: &Bound<'py, PyAny>,
    N: Option<&Bound<'py, PyAny>>,
    E: &Bound<'py, PyAny>,
) -> PyResult<Matrix<'py>> {
    let ([a, b, q, r], n) = tables(["A", "B", "Q", "R"], [A, B, Q, R], N)?;
    array2(py, gdare(&a, &b, &q, &r, n.as_ref(), &table("E", E)?).or_raise(py)?.x)
}

/// Gain, covariance and poles of Kalman's filter, continuous or sampled.
#[pyfunction]
#[allow(non_snake_case)]
pub(super) fn _filter<'py>(
    py: Python<'py>,
    A: &Bound<'py, PyAny>,
    C: &Bound<'py, PyAny>,
    Q: &Bound<'py, PyAny>,
    R: &Bound<'py, PyAny>,
    N: Option<&Bound<'py, PyAny>>,
    sampled: bool,
) -> PyResult<Solution<'py>> {
    let ([a, c, q, r], n) = tables(["A", "C", "Q", "R"], [A, C, Q, R], N)?;
    let filter = if sampled { dlqe } else { lqe };
    of_filter(py, filter(&a, &c, &q, &r, n.as_ref()).or_raise(py)?)
}

/// The solution of Lyapunov's equation, continuous or sampled.
#[pyfunction]
#[allow(non_snake_case)]
pub(super) fn _lyap<'py>(
    py: Python<'py>,
    A: &Bound<'py, PyAny>,
    Q: &Bound<'py, PyAny>,
    sampled: bool,
) -> PyResult<Matrix<'py>> {
    let solve = if sampled { dlyap } else { lyap };
    array2(py, solve(&table("A", A)?, &table("Q", Q)?).or_raise(py)?)
}

/// The H2 norm.
#[pyfunction]
pub(super) fn _norm_h2(system: &StateSpace) -> f64 {
    match &system.0 {
        Either::Continuous(sys) => sys.norm_h2(),
        Either::Sampled(sys) => sys.norm_h2(),
    }
}

/// The largest gain over a band, rad/s, for any poles, and its frequency.
#[pyfunction]
pub(super) fn _norm_linf(system: &StateSpace, band: [f64; 2]) -> Option<(f64, f64)> {
    let peak = match &system.0 {
        Either::Continuous(sys) => sys.norm_linf(band),
        Either::Sampled(sys) => sys.norm_linf(band),
    };
    peak.map(|p| (p.gain, p.omega_rad_s))
}

/// The same of two systems that share their time.
macro_rules! both {
    ($py:expr, $what:expr, $one:expr, $two:expr, $operation:expr) => {
        match (&$one.0, &$two.0) {
            (Either::Continuous(one), Either::Continuous(two)) => {
                Ok(StateSpace(Either::Continuous($operation(one, two).or_raise($py)?)))
            }
            (Either::Sampled(one), Either::Sampled(two)) => {
                Ok(StateSpace(Either::Sampled($operation(one, two).or_raise($py)?)))
            }
            _ => Err(raise($py, mixed($what))),
        }
    };
}

fn mixed(what: &'static str) -> ModelError {
    let name = "second system".to_owned();
    ModelError::Domain { what, needed: "of the first system's time", name, found: "of the other" }
}

/// The nu-gap of two systems and where it is, rad/s.
#[pyfunction]
pub(super) fn _nu_gap(py: Python<'_>, one: &StateSpace, two: &StateSpace) -> PyResult<f64> {
    match (&one.0, &two.0) {
        (Either::Continuous(one), Either::Continuous(two)) => {
            Ok(nu_gap(one, two).or_raise(py)?.value)
        }
        (Either::Sampled(one), Either::Sampled(two)) => Ok(nu_gap(one, two).or_raise(py)?.value),
        _ => Err(raise(py, mixed("the nu-gap"))),
    }
}

/// Two systems in series, side by side, or in a loop of this sign.
#[pyfunction]
pub(super) fn _connect(
    py: Python<'_>,
    how: &str,
    one: &StateSpace,
    two: &StateSpace,
    sign: f64,
) -> PyResult<StateSpace> {
    match how {
        "series" => both!(py, "a series", one, two, series),
        "parallel" => both!(py, "a sum", one, two, parallel),
        "feedback" => both!(py, "a loop", one, two, |one, two| feedback(one, two, sign)),
        other => Err(PyValueError::new_err(format!("no connection is called {other}"))),
    }
}

/// A delay as an all-pass filter, in continuous time by Padé.
#[pyfunction]
pub(super) fn _pade(py: Python<'_>, delay: f64, order: usize) -> PyResult<StateSpace> {
    Ok(StateSpace(Either::Continuous(pade(delay, order).or_raise(py)?)))
}

/// The same in sampled time by Thiran.
#[pyfunction]
pub(super) fn _thiran(
    py: Python<'_>,
    delay: f64,
    sample_time: f64,
    order: Option<usize>,
) -> PyResult<StateSpace> {
    let ts = SampleTime::new(sample_time).or_raise(py)?;
    Ok(StateSpace(Either::Sampled(thiran(delay, ts, order).or_raise(py)?)))
}

/// Records of samples × channels.
fn recordings(u: &Bound<'_, PyAny>, y: &Bound<'_, PyAny>) -> PyResult<Recordings> {
    let (u, y) = (table("u", u)?, table("y", y)?);
    if u.nrows() != y.nrows() {
        let told = format!("u has {} samples, y {}; they are of one length", u.nrows(), y.nrows());
        return Err(PyValueError::new_err(told));
    }
    let named = |letter: &str, count: usize| {
        (1..=count).map(|i| Named { name: format!("{letter}{i}"), unit: None }).collect()
    };
    Ok(Recordings {
        sample_time: SampleTime::new(1.0).map_err(|e| PyValueError::new_err(e.to_string()))?,
        inputs: named("u", u.ncols()),
        outputs: named("y", y.ncols()),
        stretches: vec![Stretch { u: u.transpose(), y: y.transpose() }],
    })
}

/// Markov parameters of records, count × p × m; with a past by an observer.
#[pyfunction]
pub(super) fn _markov<'py>(
    py: Python<'py>,
    u: &Bound<'py, PyAny>,
    y: &Bound<'py, PyAny>,
    count: usize,
    past: Option<usize>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let records = recordings(u, y)?;
    let found = match past {
        None => markov(&records, count),
        Some(past) => okid(&records, past, count),
    };
    let found = found.or_raise(py)?;
    let shape = [found.len(), records.outputs.len(), records.inputs.len()];
    let rows = found.iter().flat_map(|h| h.transpose().as_slice().to_vec());
    rows.collect::<Vec<f64>>().into_pyarray(py).reshape(shape)
}

/// The model of so many states with these Markov parameters, count × p × m.
#[pyfunction]
pub(super) fn _era(
    py: Python<'_>,
    markov: PyReadonlyArray3<'_, f64>,
    order: usize,
    sample_time: f64,
) -> PyResult<StateSpace> {
    let all = markov.as_array();
    let (count, p, m) = all.dim();
    let matrices: Vec<DMatrix<f64>> =
        (0..count).map(|k| DMatrix::from_fn(p, m, |i, j| all[[k, i, j]])).collect();
    let ts = SampleTime::new(sample_time).or_raise(py)?;
    Ok(StateSpace(Either::Sampled(era(&matrices, order, ts).or_raise(py)?)))
}
