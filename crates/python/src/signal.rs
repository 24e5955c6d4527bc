//! Excitation and noise: [`deadtime::signal`].

use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde_json::json;

use super::convert::{Numbers, array1, json as from_python, object, vector};
use super::error::OrRaise;
use super::log::Log;
use deadtime::log::Channel;
use deadtime::signal::excitation::by_name;
use deadtime::signal::{EXCITATIONS, Noise};
use deadtime::time::SampleTime;

/// The first samples of an excitation, as `deadtime excite` makes them.
#[pyfunction]
pub(super) fn _excite<'py>(
    py: Python<'py>,
    kind: &str,
    samples: usize,
    seed: u64,
    options: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let signal = by_name(kind).or_raise(py)?.with(from_python(options)?).or_raise(py)?;
    let values = py
        .detach(|| signal.generate(samples, &mut ChaCha8Rng::seed_from_u64(seed)))
        .or_raise(py)?;
    Ok(array1(py, values))
}

/// A log of one channel on an even grid.
#[pyfunction]
pub(super) fn _of_channel(
    py: Python<'_>,
    channel: &str,
    values: Numbers<'_>,
    sample_time: f64,
) -> PyResult<Log> {
    let step = SampleTime::new(sample_time).or_raise(py)?;
    let values = vector(&values);
    let time_s = (0..values.len()).map(|k| step.to_seconds(k as f64)).collect();
    Ok(Log(deadtime::log::Log::new(
        "excitation",
        time_s,
        vec![Channel::new(channel, None, values)],
    )
    .or_raise(py)?))
}

/// The list of excitations, in order.
#[pyfunction]
pub(super) fn _excitations(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let line = |e: &deadtime::registry::Entry<dyn deadtime::signal::Excitation>| json!({ "name": e.name, "summary": e.summary, "options": (e.defaults)() });
    object(py, &EXCITATIONS.iter().map(line).collect::<Vec<_>>())
}

/// A signal with noise; `noise` holds its spectrum and scaling as a plan has them.
#[pyfunction]
pub(super) fn _add_noise<'py>(
    py: Python<'py>,
    signal: Numbers<'py>,
    snr: f64,
    noise: &Bound<'py, PyAny>,
    seed: u64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let noise: Noise = serde_json::from_value(from_python(noise)?)
        .map_err(|e| PyValueError::new_err(e.to_string()))?;
    let (noise, signal) = (Noise { snr, ..noise }, vector(&signal));
    let noisy =
        py.detach(|| noise.add(&signal, &mut ChaCha8Rng::seed_from_u64(seed))).or_raise(py)?;
    Ok(array1(py, noisy))
}
