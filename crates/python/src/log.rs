//! Measured logs: [`deadtime::log`].

use std::path::PathBuf;

use numpy::PyArray1;
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::convert::{Numbers, array1, compact, vector};
use super::error::{OrRaise, call};
use deadtime::log::{
    Channel, Log as Inner, ReadOptions, Stamps, TimeUnit, Wanted, csv, name_and_unit, open,
};
use deadtime::model::Derived;
use deadtime::time::SampleTime;

/// Inputs and outputs as arguments of a file: missing ones are left out, and their user reports them.
pub(super) fn channels(inputs: Vec<String>, outputs: Vec<String>) -> Vec<Wanted> {
    let held = inputs.into_iter().map(|name| Wanted { name, held: true, required: false });
    held.chain(outputs.into_iter().map(|name| Wanted { name, held: false, required: false }))
        .collect()
}

/// How time stamps are to be understood: the column of time, its unit, and the clock of bags.
fn read_options(
    (time, unit, stamps): (Option<String>, Option<String>, String),
) -> PyResult<ReadOptions> {
    let time_unit = match unit.as_deref() {
        None => None,
        Some("s") => Some(TimeUnit::S),
        Some("ms") => Some(TimeUnit::Ms),
        Some("us") => Some(TimeUnit::Us),
        Some("ns") => Some(TimeUnit::Ns),
        Some("min") => Some(TimeUnit::Min),
        Some("h") => Some(TimeUnit::H),
        Some("d") => Some(TimeUnit::D),
        Some("iso") => Some(TimeUnit::Iso),
        Some("dmy") => Some(TimeUnit::Dmy),
        Some("mdy") => Some(TimeUnit::Mdy),
        Some(other) => {
            return Err(PyValueError::new_err(format!(
                "time_unit is {other:?}; it is one of s, ms, us, ns, min, h, d, iso, dmy, mdy"
            )));
        }
    };
    let stamps = match stamps.as_str() {
        "arrival" => Stamps::Arrival,
        "header" => Stamps::Header,
        other => {
            return Err(PyValueError::new_err(format!(
                "stamps is {other:?}; it is one of arrival, header"
            )));
        }
    };
    Ok(ReadOptions { time, time_unit, stamps, ..ReadOptions::default() })
}

/// With the readable part of damaged files, the memory limit, and the numbers that mean missing samples.
fn limited(
    options: ReadOptions,
    (unchecked, max_memory_gb, missing): (bool, Option<f64>, Vec<f64>),
    (columns, only): TextRows,
) -> ReadOptions {
    let memory = max_memory_gb.map(|gb| (gb * 1e9) as u64);
    ReadOptions { unchecked, memory, missing, columns, only, ..options }
}

/// Of text files the names of the columns, where there is no header row, and the column and value of the rows that are read.
type TextRows = (Vec<String>, Option<(String, String)>);

/// A measured log: time stamps and named channels of as many samples.
///
/// Parameters
/// ----------
/// time : array, shape (N,)
///     Time stamps, s, strictly increasing, perhaps uneven.
/// channels : dict of str to array, shape (N,)
///     Samples by channel. NaN marks a missing one, which only an output may have.
/// units : dict of str to str, optional
///     Units by channel.
/// source : str
///     What error messages call the log.
///
/// Raises
/// ------
/// LogError
///     Time that does not increase, channels of other lengths, infinite samples.
#[pyclass(frozen, module = "deadtime", name = "Log")]
#[derive(Clone)]
pub(super) struct Log(pub(super) Inner);

#[pymethods]
impl Log {
    #[new]
    #[pyo3(signature = (time, channels, units = None, source = "log"))]
    fn new(
        py: Python<'_>,
        time: Numbers<'_>,
        channels: &Bound<'_, PyDict>,
        units: Option<&Bound<'_, PyDict>>,
        source: &str,
    ) -> PyResult<Self> {
        let mut columns = Vec::with_capacity(channels.len());
        for (name, samples) in channels {
            let (name, samples): (String, Numbers<'_>) = (name.extract()?, samples.extract()?);
            let unit: Option<String> = match units {
                Some(units) => units.get_item(&name)?.map(|u| u.extract()).transpose()?.flatten(),
                None => None,
            };
            columns.push(channel(&name, unit.as_deref(), vector(&samples)));
        }
        if let Some(units) = units {
            for (name, _) in units {
                if !channels.contains(&name)? {
                    return Err(PyKeyError::new_err(format!(
                        "units: there is no channel {}",
                        name.repr()?
                    )));
                }
            }
        }
        Ok(Self(Inner::new(source, vector(&time), columns).or_raise(py)?))
    }

    /// The records of a CSV file (.csv or .csv.gz), one without `records`, else one per new value of that column. With the names of inputs and outputs the channels
    /// of several topics are put together, on an even grid where `sample_time` is given. `clock` is the column of time, its unit and which stamps of bags.
    #[staticmethod]
    #[pyo3(signature = (path, clock, records = None, wanted = None, sample_time = None, unchecked = false, max_memory_gb = None, missing = Vec::new(), rows = (Vec::new(), None)))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn _read(
        py: Python<'_>,
        path: PathBuf,
        clock: (Option<String>, Option<String>, String),
        records: Option<String>,
        wanted: Option<(Vec<String>, Vec<String>)>,
        sample_time: Option<f64>,
        unchecked: bool,
        max_memory_gb: Option<f64>,
        missing: Vec<f64>,
        rows: TextRows,
    ) -> PyResult<Vec<Self>> {
        let grid = sample_time.map(SampleTime::new).transpose().or_raise(py)?;
        let options = limited(read_options(clock)?, (unchecked, max_memory_gb, missing), rows);
        let read = || match records {
            Some(column) => csv::records(&path, &column, &options),
            None => {
                let mut recording = open(&path, &options)?;
                let mut notes = std::mem::take(&mut recording.notes);
                let Some((inputs, outputs)) = wanted else {
                    return Ok((vec![recording.into_log()?], notes));
                };
                let wanted = channels(inputs, outputs);
                let (log, more) = if recording.topics.iter().any(|topic| !topic.name.is_empty()) {
                    recording.together(&wanted, grid)?
                } else {
                    recording.into_log_of(&wanted)?
                };
                notes.extend(more);
                Ok((vec![log], notes))
            }
        };
        let (logs, notes) = py.detach(read).or_raise(py)?;
        // Guesses are reported.
        for note in notes {
            py.import("warnings")?
                .call_method1("warn", (format!("{}: {}", path.display(), note.worded(call)),))?;
        }
        Ok(logs.into_iter().map(Self).collect())
    }

    /// What a file holds, `deadtime/log@1`, as JSON text.
    #[staticmethod]
    #[pyo3(signature = (path, clock, unchecked = false, max_memory_gb = None, missing = Vec::new(), rows = (Vec::new(), None)))]
    fn _listing(
        py: Python<'_>,
        path: PathBuf,
        clock: (Option<String>, Option<String>, String),
        unchecked: bool,
        max_memory_gb: Option<f64>,
        missing: Vec<f64>,
        rows: TextRows,
    ) -> PyResult<String> {
        let options = limited(read_options(clock)?, (unchecked, max_memory_gb, missing), rows);
        let mut listing = py
            .detach(|| open(&path, &options).map(|recording| recording.listing()))
            .or_raise(py)?;
        listing.notes = listing.notes.worded(call);
        compact(&listing)
    }

    /// Writes the log to `path` as CSV (.csv, or .csv.gz), under a temporary name until it is whole.
    fn write_csv(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.0.write_csv(&path)).or_raise(py)
    }

    /// The part from `start` to `stop`, seconds from the log's first sample.
    #[pyo3(signature = (start = None, stop = None))]
    fn window(&self, py: Python<'_>, start: Option<f64>, stop: Option<f64>) -> PyResult<Self> {
        Ok(Self(self.0.window(start, stop).or_raise(py)?))
    }

    /// The log on an even grid with `sample_time` s between samples: the channels named in `held` keep their value between samples, the others are interpolated.
    #[pyo3(signature = (sample_time, held = Vec::new()))]
    fn resample(&self, py: Python<'_>, sample_time: f64, held: Vec<String>) -> PyResult<Self> {
        let held: Vec<&str> = held.iter().map(String::as_str).collect();
        let sample_time = SampleTime::new(sample_time).or_raise(py)?;
        Ok(Self(self.0.resample(sample_time, &held).or_raise(py)?))
    }

    /// The log with other channel names: `names` maps a new name to the one it replaces, as `--map NEW=OLD` does.
    fn rename(&self, py: Python<'_>, names: &Bound<'_, PyDict>) -> PyResult<Self> {
        let map: Vec<(String, String)> = names
            .iter()
            .map(|(new, old)| Ok((new.extract()?, old.extract()?)))
            .collect::<PyResult<_>>()?;
        Ok(Self(self.0.clone().rename(&map).or_raise(py)?))
    }

    /// The log with channels that are calculated from others, one after the other: `name` or `name [unit]` to an expression, as `--channel NAME=EXPRESSION` takes it.
    fn with_channels(&self, py: Python<'_>, channels: &Bound<'_, PyDict>) -> PyResult<Self> {
        let mut log = self.0.clone();
        for (name, expression) in channels {
            let text = format!("{}={}", name.extract::<String>()?, expression.extract::<String>()?);
            log = Derived::parse(&text).or_raise(py)?.add_to(log).or_raise(py)?;
        }
        Ok(Self(log))
    }

    /// The log as a pandas frame: `time` and a column a channel, NaN where a sample is missing. Units are in `frame.attrs["units"]`, and, with `headers`, in the
    /// names of the columns, as `name [unit]`.
    #[pyo3(signature = (headers = false))]
    fn to_pandas<'py>(slf: &Bound<'py, Self>, headers: bool) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("deadtime.logs")?.call_method1("_to_pandas", (slf, headers))
    }

    /// The log as a polars frame: `time` and a column a channel, null where a sample is missing. With `headers` the columns are called `name [unit]`.
    #[pyo3(signature = (headers = false))]
    fn to_polars<'py>(slf: &Bound<'py, Self>, headers: bool) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("deadtime.logs")?.call_method1("_to_polars", (slf, headers))
    }

    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("deadtime.logs")?.call_method1("_html", (slf,))
    }

    /// What error messages call the log.
    #[getter]
    fn source(&self) -> &str {
        self.0.source()
    }

    /// Time stamps, s, shape (N,): a copy.
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.time_s())
    }

    /// Names of the channels, in order.
    #[getter]
    fn channels(&self) -> Vec<String> {
        self.0.names().map(str::to_owned).collect()
    }

    /// Units of those channels that have one.
    #[getter]
    fn units<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let units = PyDict::new(py);
        for channel in self.0.channels() {
            if let Some(unit) = channel.unit() {
                units.set_item(channel.name(), unit)?;
            }
        }
        Ok(units)
    }

    /// From the first sample to the last, s.
    #[getter]
    fn duration(&self) -> f64 {
        self.0.duration_s()
    }

    /// The sample time, s, of a log on an even grid; None where it is uneven.
    #[getter]
    fn sample_time(&self) -> Option<f64> {
        self.0.even_grid().ok().map(SampleTime::seconds)
    }

    /// A channel's samples, shape (N,), NaN where one is missing: a copy.
    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let channel = self.0.channel(name).map_err(|e| PyKeyError::new_err(e.to_string()))?;
        let samples = channel.samples();
        Ok(match samples.present {
            None => PyArray1::from_slice(py, samples.values),
            Some(_) => {
                array1(py, (0..self.0.len()).map(|k| samples.get(k).unwrap_or(f64::NAN)).collect())
            }
        })
    }

    fn __contains__(&self, name: &str) -> bool {
        self.0.names().any(|n| n == name)
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __repr__(&self) -> String {
        let grid =
            self.sample_time().map_or_else(|| "uneven".to_owned(), |ts| format!("every {ts} s"));
        let channels: Vec<String> = self.0.channels().map(Channel::header).collect();
        format!(
            "<Log {}: {} samples, {grid}, {:.6} s; {}>",
            self.0.source(),
            self.0.len(),
            self.0.duration_s(),
            channels.join(", ")
        )
    }

    /// Pickles by its samples.
    #[allow(clippy::type_complexity)]
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(
        Bound<'py, PyAny>,
        (Bound<'py, PyArray1<f64>>, Bound<'py, PyDict>, Bound<'py, PyDict>, String),
    )> {
        let (py, log) = (slf.py(), slf.get());
        let channels = PyDict::new(py);
        for name in log.0.names() {
            channels.set_item(name, log.__getitem__(py, name)?)?;
        }
        Ok((
            slf.get_type().into_any(),
            (log.time(py), channels, log.units(py)?, log.0.source().to_owned()),
        ))
    }
}

/// Copies of logs, for work without the interpreter's lock.
pub(super) fn copies(logs: &[PyRef<'_, Log>]) -> Vec<Inner> {
    logs.iter().map(|log| log.0.clone()).collect()
}

/// The names of logs in error messages.
pub(super) fn sources(logs: &[Inner]) -> Vec<String> {
    logs.iter().map(|log| log.source().to_owned()).collect()
}

/// A channel of samples, NaN where one is missing.
pub(super) fn channel(name: &str, unit: Option<&str>, values: Vec<f64>) -> Channel {
    match marked(values) {
        (values, None) => Channel::new(name, unit, values),
        (values, Some(present)) => Channel::partial(name, unit, values, present),
    }
}

/// Samples and, where one is NaN, which are there.
fn marked(values: Vec<f64>) -> (Vec<f64>, Option<Vec<bool>>) {
    let present =
        values.iter().any(|v| v.is_nan()).then(|| values.iter().map(|v| !v.is_nan()).collect());
    (values, present)
}

/// A log of columns headed `name` or `name [unit]`, NaN where a sample is missing, and of columns that hold something else at a sample.
#[pyfunction]
pub(super) fn _of_columns(
    py: Python<'_>,
    source: &str,
    time: Numbers<'_>,
    columns: Vec<(String, Numbers<'_>)>,
    unusable: Vec<(String, usize, String)>,
) -> PyResult<Log> {
    let channel = |(header, values): &(String, Numbers<'_>)| {
        let (values, present) = marked(vector(values));
        Channel::headed(header, values, present)
    };
    let mut log =
        Inner::new(source, vector(&time), columns.iter().map(channel).collect()).or_raise(py)?;
    for (name, sample, text) in unusable {
        log = log.without_numbers(name, sample, text).or_raise(py)?;
    }
    Ok(Log(log))
}

/// `name [unit]` as the two.
#[pyfunction]
pub(super) fn _name_and_unit(header: &str) -> (&str, Option<&str>) {
    name_and_unit(header)
}
