"""Dead time between command and response, and the gap between simulator and reality, from a measured log.

Signals are NumPy arrays in SI units, time is in seconds. Where a log is asked for, a `Log`, the path of a CSV file, a pandas or polars frame will do.
"""

from __future__ import annotations

from . import bounds, errors
from ._native import Log, Model, __version__
from .delays import (
    Estimate,
    Estimates,
    Method,
    Pair,
    Verdict,
    estimate,
    estimate_delay,
    estimate_events,
    impulse_response,
    methods,
    predict_precision,
)
from .errors import DeadtimeError
from .logs import as_log, as_logs, read, read_records
from .models import as_model
from .signals import Excitation, add_noise, excitations, excite

__all__ = [
    "DeadtimeError",
    "Estimate",
    "Estimates",
    "Excitation",
    "Log",
    "Method",
    "Model",
    "Pair",
    "Verdict",
    "__version__",
    "add_noise",
    "as_log",
    "as_logs",
    "as_model",
    "bounds",
    "errors",
    "estimate",
    "estimate_delay",
    "estimate_events",
    "excitations",
    "excite",
    "impulse_response",
    "methods",
    "predict_precision",
    "read",
    "read_records",
]
