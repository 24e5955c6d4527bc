"""Logs from files, frames and arrays."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

from ._native import Log

if TYPE_CHECKING:
    import pandas
    import polars

#: What passes for a log: a `Log`, the path of a CSV file, a pandas or polars frame.
LogLike: TypeAlias = "Log | str | os.PathLike[str] | pandas.DataFrame | polars.DataFrame"


def read(path: str | os.PathLike[str]) -> Log:
    """The log in a CSV file (.csv or .csv.gz): a header row, `time` in seconds first, then channels as `name` or `name [unit]`.

    Raises
    ------
    LogError
        What is wrong, with file, row and channel.
    FileError
        The file cannot be read.
    """
    return Log._read(path)[0]


def read_records(path: str | os.PathLike[str], column: str) -> list[Log]:
    """The records of a CSV file, a new one at each new value of `column`.

    Raises
    ------
    LogError, FileError
        As `read`.
    """
    return Log._read(path, column)


def as_log(data: LogLike, units: Mapping[str, str] | None = None) -> Log:
    """A log from whatever passes for one.

    A frame has a column `time` (s), or its index is the time: numbers of seconds, or time stamps, counted from the first one then. Columns are called
    `name` or `name [unit]`; those that are no numbers are left out.
    """
    if isinstance(data, Log):
        return data
    if isinstance(data, str | os.PathLike):
        return read(data)
    return _of_frame(data, units or {})


def as_logs(data: LogLike | Iterable[LogLike]) -> list[Log]:
    """One log or several."""
    if isinstance(data, Log | str | os.PathLike) or hasattr(data, "columns"):
        return [as_log(data)]  # type: ignore[arg-type]
    return [as_log(one) for one in data]  # type: ignore[union-attr]


def _of_frame(frame: Any, units: Mapping[str, str]) -> Log:
    """A pandas or polars frame, by what they have in common: `columns`, and columns that can be turned into arrays."""
    raise NotImplementedError
