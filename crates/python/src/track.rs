//! Delays that move: [`deadtime::delay::track`].

use pyo3::prelude::*;

use super::error::OrRaise;
use deadtime::delay::track::{Alarm, Tracker, TrackerOptions};
use deadtime::time::SampleTime;

/// Time, dead time, its band, and the alarm: its kind, the dead time before and now, and its beginning.
type Told =
    (f64, Option<f64>, Option<[f64; 2]>, Option<(&'static str, Option<f64>, Option<f64>, f64)>);

/// The tracker of a running machine, whose face is `deadtime.Tracker`.
#[pyclass(name = "_Tracker", module = "deadtime._native")]
pub(super) struct Running(Tracker);

#[pymethods]
impl Running {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        sample_time: f64,
        max_delay: usize,
        bias: usize,
        na: usize,
        nb: usize,
        learn: usize,
        forget: usize,
        alarm: f64,
    ) -> PyResult<Self> {
        let ts = SampleTime::new(sample_time).or_raise(py)?;
        Ok(Self(
            Tracker::new(ts, TrackerOptions { max_delay, bias, na, nb, learn, forget, alarm })
                .or_raise(py)?,
        ))
    }

    /// One sample; not a number as the response: it was not measured.
    fn push(&mut self, py: Python<'_>, u: f64, y: f64) -> PyResult<Told> {
        let told = self.0.push(u, Some(y).filter(|y| !y.is_nan())).or_raise(py)?;
        let alarm = told.alarm.map(|alarm| match alarm {
            Alarm::DelayChanged { from_s, to_s, since_s } => {
                ("delay_changed", Some(from_s), Some(to_s), since_s)
            }
            Alarm::ResponseChanged { since_s } => ("response_changed", None, None, since_s),
        });
        Ok((told.time_s, told.delay_s, told.band_s, alarm))
    }
}
