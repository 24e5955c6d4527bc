"""Logs from files, frames and arrays."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime, timedelta
from html import escape
from numbers import Number
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy
from numpy.typing import ArrayLike, NDArray

from . import _native, plotting
from ._native import Log
from .errors import LogError

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow

#: What passes for a log: a `Log`, the path of a CSV file, a pandas or polars frame, an Arrow table, a dict of arrays, a structured array.
LogLike: TypeAlias = (
    "Log | str | os.PathLike[str] | pandas.DataFrame | polars.DataFrame | polars.LazyFrame | pyarrow.Table | Mapping[str, ArrayLike] | NDArray[numpy.void]"
)


def _rows(columns: Iterable[str], where: tuple[str, object] | None) -> tuple[list[str], tuple[str, str] | None]:
    """Columns and rows of a text file as the native half takes them."""
    return list(columns), None if where is None else (where[0], str(where[1]))


def read(
    path: str | os.PathLike[str],
    *,
    channels: Mapping[str, str] | None = None,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    sample_time: float | None = None,
    time: str | None = None,
    time_unit: Literal["s", "ms", "us", "ns", "min", "h", "d", "iso", "dmy", "mdy"] | None = None,
    stamps: Literal["arrival", "header"] = "arrival",
    unchecked: bool = False,
    max_memory_gb: float | None = None,
    missing: Iterable[float] = (),
    columns: Iterable[str] = (),
    where: tuple[str, object] | None = None,
) -> Log:
    """The log in the file at `path`: text with a header row, a column `time` in seconds and channels as `name` or `name [unit]`, or another format
    (docs/logs.md). What was guessed, such as the unit of time, is a warning.

    A part of it is `log.window(start, stop)`, an even grid `log.resample(sample_time)`, other names `log.rename({"new": "old"})`.

    Parameters
    ----------
    path : path
        The file.
    channels : dict of str to str, optional
        Channels that are calculated from others: `name` or `name [unit]` to an expression (docs/logs.md); later ones may use earlier ones. A log that is no file takes
        them by `log.with_channels`.
    inputs, outputs : list of str, optional
        Of a file with several topics the channels that are wanted, by their whole names or the ends of them: inputs keep their value until the next one, outputs are
        interpolated. All are put onto the stamps of the first input's topic.
    sample_time : float, optional
        Puts the channels of several topics onto an even grid instead, s between samples.
    time : str, optional
        The column of time, where it is not called `time` or like it.
    time_unit : {"s", "ms", "us", "ns", "min", "h", "d", "iso", "dmy", "mdy"}, optional
        The unit of that column, where its name and the size of its numbers do not tell; `iso` are dates, `dmy` and `mdy` those with slashes.
    stamps : {"arrival", "header"}
        The clock of a ROS bag: when the recorder got a message, or what its sender wrote into it.
    unchecked : bool
        Also reads parts whose checksum does not match; else they are left out, with a warning.
    max_memory_gb : float, optional
        Memory that reading may take, in GB; default: 4 times the file and 64 MiB.
    missing : sequence of float
        Numbers that stand for a missing sample, such as -9999 or -999.25.
    columns : sequence of str
        The names of the columns of a text file without a header row.
    where : tuple of str and value, optional
        The rows of a text file that are read: those with this value in this column, such as ("I", 0).

    Raises
    ------
    LogError
        What is wrong, with file, row and channel, or with an expression.
    FileError
        The file cannot be read.

    Examples
    --------
    Thirty seconds, a sample every 0.02 s:

    >>> import deadtime
    >>> flight = deadtime.read("examples/uav_flight.csv")
    >>> len(flight), round(flight.sample_time, 6)
    (1500, 0.02)

    With a channel in degrees:

    >>> flight = deadtime.read("examples/uav_flight.csv", channels={"roll_deg [deg]": "deg(phi)"})
    >>> flight.units["roll_deg"]
    'deg'
    """
    wanted = None if inputs is None and outputs is None else (_names("inputs", inputs), _names("outputs", outputs))
    grid = None if sample_time is None else float(sample_time)
    read = Log._read(path, (time, time_unit, stamps), None, wanted, grid, unchecked, max_memory_gb, list(missing), _rows(columns, where))
    return _calculated(read[0], channels)


def _names(what: str, given: Iterable[str] | None) -> list[str]:
    if isinstance(given, str):
        raise TypeError(f"{what} is a list of names, {what}=[{given!r}]")
    return [str(name) for name in given or ()]


def _calculated(log: Log, channels: Mapping[str, str] | None) -> Log:
    return log if channels is None else log.with_channels(dict(channels))


def read_records(
    path: str | os.PathLike[str],
    column: str,
    *,
    channels: Mapping[str, str] | None = None,
    time: str | None = None,
    time_unit: Literal["s", "ms", "us", "ns", "min", "h", "d", "iso", "dmy", "mdy"] | None = None,
    unchecked: bool = False,
    max_memory_gb: float | None = None,
    missing: Iterable[float] = (),
    columns: Iterable[str] = (),
    where: tuple[str, object] | None = None,
) -> list[Log]:
    """The records of the CSV file at `path`, a new one at each new value of `column`.

    Parameters
    ----------
    path : path
        The file.
    column : str
        The column that tells records apart; time may start afresh in each.
    channels : dict of str to str, optional
        As `read` takes them.
    time, time_unit : str, optional
        As `read` takes them.
    unchecked : bool
        Also reads parts whose checksum does not match; else they are left out, with a warning.
    max_memory_gb : float, optional
        Memory that reading may take, in GB; default: 4 times the file and 64 MiB.
    missing : sequence of float
        Numbers that stand for a missing sample, such as -9999 or -999.25.
    columns : sequence of str
        The names of the columns of a text file without a header row.
    where : tuple of str and value, optional
        The rows of a text file that are read: those with this value in this column, such as ("I", 0).

    Raises
    ------
    LogError, FileError
        As `read`.

    Examples
    --------
    >>> import deadtime, pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "two.csv")
    ...     written = path.write_text("time,run,u\\n0,a,1\\n1,a,2\\n0,b,3\\n1,b,4\\n")
    ...     [log["u"].tolist() for log in deadtime.read_records(path, "run")]
    [[1.0, 2.0], [3.0, 4.0]]
    """
    read = Log._read(path, (time, time_unit, "arrival"), column, None, None, unchecked, max_memory_gb, list(missing), _rows(columns, where))
    return [_calculated(log, channels) for log in read]


def listing(
    path: str | os.PathLike[str],
    *,
    time: str | None = None,
    time_unit: Literal["s", "ms", "us", "ns", "min", "h", "d", "iso", "dmy", "mdy"] | None = None,
    stamps: Literal["arrival", "header"] = "arrival",
    unchecked: bool = False,
    max_memory_gb: float | None = None,
    missing: Iterable[float] = (),
    columns: Iterable[str] = (),
    where: tuple[str, object] | None = None,
) -> dict[str, Any]:
    """What the file at `path` holds: its topics with rates, gaps and channels, as `deadtime log FILE --json` prints it (docs/logs.md).

    Parameters
    ----------
    path : path
        The file, of any format that `read` takes.
    time, time_unit, stamps : str, optional
        As `read` takes them.
    unchecked : bool
        Also reads parts whose checksum does not match; else they are left out, with a warning.
    max_memory_gb : float, optional
        Memory that reading may take, in GB; default: 4 times the file and 64 MiB.
    missing : sequence of float
        Numbers that stand for a missing sample, such as -9999 or -999.25.
    columns : sequence of str
        The names of the columns of a text file without a header row.
    where : tuple of str and value, optional
        The rows of a text file that are read: those with this value in this column, such as ("I", 0).

    Raises
    ------
    LogError, FileError
        As `read`.

    Examples
    --------
    >>> import deadtime
    >>> found = deadtime.listing("examples/uav_flight.csv")
    >>> [channel["name"] for channel in found["topics"][0]["channels"]]
    ['r', 'p', 'ay', 'v', 'phi']
    """
    found = Log._listing(path, (time, time_unit, stamps), unchecked, max_memory_gb, list(missing), _rows(columns, where))
    return json.loads(found)  # type: ignore[no-any-return]


def as_log(data: LogLike, units: Mapping[str, str] | None = None) -> Log:
    """A log from whatever passes for one.

    Parameters
    ----------
    data : Log, path, frame, table, dict of arrays or structured array
        A frame (pandas, polars), an Arrow table, a dict or a structured array has a column `time`: numbers of seconds, or dates or time spans, which are
        counted from the first one. In place of it a pandas frame may have an index of dates or time spans, or one called `time`. Columns are called
        `name` or `name [unit]`; NaN and None mark missing samples; columns that are no numbers are left out.
    units : dict of str to str, optional
        Units by channel, for those whose column does not name one.

    Raises
    ------
    LogError
        No time, time that does not increase, two columns of one name, with the sample (counted from 0) and the remedy.
    FileError
        The file cannot be read.

    Examples
    --------
    >>> import deadtime
    >>> log = deadtime.as_log({"time": [0.0, 0.1, 0.2], "heater [V]": [0.0, 5.0, 5.0]})
    >>> log.channels, log.units
    (['heater'], {'heater': 'V'})
    """
    if isinstance(data, Log):
        return data
    if isinstance(data, str | os.PathLike):
        return read(data)
    return _of_frame(data, units or {})


def as_logs(data: LogLike | Iterable[LogLike]) -> list[Log]:
    """One log or several.

    Parameters
    ----------
    data : log-like, or an iterable of them
        As `as_log` takes them.

    Examples
    --------
    >>> import deadtime
    >>> len(deadtime.as_logs(["examples/drive_run_1.csv", "examples/drive_run_2.csv"]))
    2
    """
    if _is_one(data):
        return [as_log(data)]  # type: ignore[arg-type]
    if isinstance(data, numpy.ndarray) or not isinstance(data, Iterable):
        raise TypeError(f"a log is a deadtime.Log, the path of a CSV file, a frame, or a dict of arrays with a key `time`, not {type(data).__name__}")
    return [as_log(one) for one in data]


def _is_one(data: object) -> bool:
    structured = isinstance(data, numpy.ndarray) and data.dtype.names is not None
    return isinstance(data, Log | str | os.PathLike | Mapping) or hasattr(data, "columns") or hasattr(data, "column_names") or structured


def _of_frame(frame: Any, units: Mapping[str, str]) -> Log:
    """A frame, table, dict or structured array, by what they have in common: named columns that can be turned into arrays."""
    if hasattr(frame, "collect_schema") and hasattr(frame, "collect"):
        frame = frame.collect()
    time: Any = None
    columns: list[tuple[str, NDArray[numpy.float64]]] = []
    unusable: list[tuple[str, int, str]] = []
    attributes = getattr(frame, "attrs", None)
    units = (dict(attributes.get("units") or {}) if isinstance(attributes, Mapping) else {}) | dict(units)
    for header, values in _columns(frame):
        name, unit = _name_and_unit(header)
        if name == "time":
            if unit not in (None, "s"):
                raise LogError(f"frame: time is in `{unit}`; convert it to seconds and call the column `time` or `time [s]`")
            if time is not None:
                raise LogError("frame: two columns are called `time`; rename or delete one of them")
            time = values
            continue
        numbers = _numbers(values)
        if isinstance(numbers, _Stray):
            unusable.append((name, numbers.sample, numbers.text))
        else:
            columns.append((f"{name} [{units[name]}]" if unit is None and name in units else header, numbers))
    if time is None:
        time = _index(frame)
    return _native._of_columns("frame", _seconds(time), columns, unusable)


def _columns(frame: Any) -> Iterator[tuple[str, Any]]:
    """Header and values of each column, in order."""
    if isinstance(frame, Mapping):
        yield from ((str(name), values) for name, values in frame.items())
    elif isinstance(frame, numpy.ndarray) and frame.dtype.names is not None:
        yield from ((name, frame[name]) for name in frame.dtype.names)
    elif hasattr(frame, "column_names"):
        yield from ((str(name), frame.column(i)) for i, name in enumerate(frame.column_names))
    elif hasattr(frame, "iloc"):
        # By place, as names may repeat.
        yield from ((str(name), frame.iloc[:, i]) for i, name in enumerate(frame.columns))
    elif hasattr(frame, "columns"):
        yield from ((str(name), frame[name]) for name in frame.columns)
    else:
        raise TypeError(
            f"a log is a deadtime.Log, the path of a CSV file, a frame, or a dict of arrays with a key `time`, not {type(frame).__name__}"
        )


def _index(frame: Any) -> Any:
    """The index of a pandas frame where it is the time."""
    index = getattr(frame, "index", None)
    kind = getattr(getattr(index, "dtype", None), "kind", "")
    if kind in ("M", "m") or getattr(index, "name", None) in ("time", "time [s]"):
        return index
    raise LogError(
        "frame: no column is called `time`; name the column of time stamps so (seconds, dates or time spans), or make it the index"
    )


class _Stray(NamedTuple):
    """The first sample that is no number."""

    sample: int
    text: str


def _array(values: Any) -> NDArray[Any]:
    """A column as an array, whoever it belongs to."""
    kind = getattr(getattr(values, "dtype", None), "kind", "")
    if hasattr(values, "to_numpy"):
        if kind == "M" and getattr(values.dtype, "tz", None) is not None:
            return numpy.asarray(values.to_numpy(dtype="datetime64[ns]"))
        if kind in ("i", "u", "f", "b") and not isinstance(values.dtype, numpy.dtype):
            # pandas' nullable numbers.
            return numpy.asarray(values.to_numpy(dtype=float, na_value=numpy.nan))
        return numpy.asarray(values.to_numpy())
    if isinstance(values, numpy.ma.MaskedArray):
        return numpy.asarray(numpy.ma.filled(values.astype(float), numpy.nan))
    return numpy.asarray(values)


def _numbers(values: Any) -> NDArray[numpy.float64] | _Stray:
    """Samples, NaN where one is missing."""
    array = _array(values)
    if array.ndim != 1:
        return _Stray(0, f"an array of shape {array.shape}")
    if array.dtype.kind in "iufb":
        return array.astype(float)
    if array.dtype.kind != "O":
        return _Stray(0, str(array[0]) if len(array) else str(array.dtype))
    numbers = numpy.empty(len(array))
    for k, value in enumerate(array):
        if value is None or type(value).__name__ in ("NAType", "NaTType"):
            numbers[k] = numpy.nan
        elif isinstance(value, Number) and not isinstance(value, complex | numpy.complexfloating):
            numbers[k] = float(value)  # type: ignore[arg-type]
        else:
            return _Stray(k, str(value))
    return numbers


def _seconds(time: Any) -> NDArray[numpy.float64]:
    """Time stamps, s; dates and time spans are counted from the first."""
    array = _array(time)
    if array.dtype.kind == "O" and len(array) and all(isinstance(t, datetime | timedelta | None) for t in array):
        first = next((t for t in array if t is not None), None)
        return numpy.array([numpy.nan if t is None else (t - first) / timedelta(seconds=1) for t in array])
    if array.dtype.kind in "Mm":
        first = array[0] if len(array) else None
        # Whole nanoseconds first: dates as numbers of seconds would lose their fractions.
        return numpy.where(numpy.isnat(array), numpy.nan, (array - first).astype("timedelta64[ns]").astype(numpy.int64) / 1e9)
    numbers = _numbers(array)
    if isinstance(numbers, _Stray):
        raise LogError(f"frame, sample {numbers.sample}: channel `time` holds `{numbers.text}`, which is no number; give seconds, dates or time spans")
    return numbers


def _name_and_unit(header: str) -> tuple[str, str | None]:
    """`name [unit]` as the two."""
    name, unit = _native._name_and_unit(header)
    return name, unit


def _to_pandas(log: Log, headers: bool) -> pandas.DataFrame:
    import pandas

    frame = pandas.DataFrame(_as_columns(log, headers))
    frame.attrs["units"] = log.units
    return frame


def _to_polars(log: Log, headers: bool) -> polars.DataFrame:
    import polars

    # NaN is a number to polars, and null is what is missing.
    return polars.DataFrame(_as_columns(log, headers)).fill_nan(None)


def _as_columns(log: Log, headers: bool) -> dict[str, NDArray[numpy.float64]]:
    units = log.units if headers else {}
    return {"time": log.time} | {f"{name} [{units[name]}]" if name in units else name: log[name] for name in log.channels}


def _html(log: Log) -> str:
    grid = "uneven" if log.sample_time is None else f"every {log.sample_time:.6g} s"
    text = f"{escape(log.source)}: {len(log)} samples, {grid}, {log.duration:.6g} s"
    head = "".join(f"<th>{h}</th>" for h in ("channel", "unit", "least", "mean", "largest", "missing"))
    rows = []
    for name in log.channels:
        values = log[name]
        there = values[~numpy.isnan(values)]
        numbers = [f"{f(there):.6g}" if len(there) else "–" for f in (numpy.min, numpy.mean, numpy.max)]
        cells = [escape(name), escape(log.units.get(name, "")), *numbers, str(len(values) - len(there))]
        rows.append("<tr>" + "".join(f"<td>{c}</td>" for c in cells) + "</tr>")
    channels = {name: log[name] for name in log.channels}
    picture = plotting.image(lambda: plotting.log(log.time, channels, log.units), f"the course of {', '.join(log.channels)}")
    return f"<p>{text}</p>" + plotting.folded(picture, f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>")
