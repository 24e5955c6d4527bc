//! How well a delay can be known at all: [`deadtime::delay::bound`].

use std::cell::RefCell;

use pyo3::prelude::*;

use super::convert::{Numbers, vector};
use deadtime::delay::bound;

/// Runs a bound over a Python function of one number; exceptions of the function are raised.
fn over(
    function: &Bound<'_, PyAny>,
    bound: impl FnOnce(&dyn Fn(f64) -> f64) -> f64,
) -> PyResult<f64> {
    let raised = RefCell::new(None);
    let call = |x: f64| {
        if raised.borrow().is_some() {
            return f64::NAN;
        }
        function.call1((x,)).and_then(|y| y.extract()).unwrap_or_else(|e| {
            *raised.borrow_mut() = Some(e);
            f64::NAN
        })
    };
    let value = bound(&call);
    raised.into_inner().map_or(Ok(value), Err)
}

#[pyfunction]
pub(super) fn _two_sensors_white(samples: usize, snr: f64) -> f64 {
    bound::two_sensors_white(samples, snr)
}

#[pyfunction]
pub(super) fn _two_sensors(
    duration_s: f64,
    band_hz: [f64; 2],
    coherence: &Bound<'_, PyAny>,
) -> PyResult<f64> {
    over(coherence, |f| bound::two_sensors(duration_s, band_hz, f))
}

#[pyfunction]
pub(super) fn _reference_white(samples: usize, snr: f64) -> f64 {
    bound::reference_white(samples, snr)
}

#[pyfunction]
pub(super) fn _reference(signal: Numbers<'_>, noise_std: f64) -> f64 {
    bound::reference(&vector(&signal), noise_std)
}

#[pyfunction]
pub(super) fn _known_model(slope: Numbers<'_>, noise_std: f64) -> f64 {
    bound::known_model(&vector(&slope), noise_std)
}

/// The derivatives are of one length, which the Python side sees to.
#[pyfunction]
pub(super) fn _joint(slope: Numbers<'_>, others: Vec<Numbers<'_>>, noise_std: f64) -> Option<f64> {
    let others: Vec<Vec<f64>> = others.iter().map(vector).collect();
    bound::joint(&vector(&slope), &others, noise_std)
}

#[pyfunction]
pub(super) fn _first_order_step(
    height: f64,
    lag_s: f64,
    sample_time_s: f64,
    noise_std: f64,
) -> (f64, f64) {
    let step = bound::FirstOrderStep { height, lag_s, sample_time_s, noise_std };
    (step.known(), step.joint())
}

#[pyfunction]
pub(super) fn _ziv_zakai(window: f64, distance: &Bound<'_, PyAny>) -> PyResult<f64> {
    over(distance, |f| bound::ziv_zakai(window, f))
}

#[pyfunction]
pub(super) fn _anomaly_probability(peak: f64, cells: f64) -> f64 {
    bound::anomaly_probability(peak, cells)
}

#[pyfunction]
pub(super) fn _with_anomalies(std: f64, window: f64, probability: f64) -> f64 {
    bound::with_anomalies(std, window, probability)
}
