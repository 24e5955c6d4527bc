"""Dead time between command and response, and the gap between simulator and reality, from a measured log.

Signals are NumPy arrays in SI units, time is in seconds. Where a log is asked for, a `Log`, the path of a CSV file, a pandas or polars frame will do.
"""

from __future__ import annotations

from . import errors
from ._native import Log, Model, StateSpace, TransferFunction, __version__
from .errors import DeadtimeError
from .logs import as_log, as_logs, read, read_records
from .models import (
    as_model,
    as_system,
    c2d,
    conversions,
    d2c,
    dare,
    dlqr,
    impulse_response,
    lsim,
    step_response,
    to_control,
    to_scipy,
    uav,
)

__all__ = [
    "DeadtimeError",
    "Log",
    "Model",
    "StateSpace",
    "TransferFunction",
    "__version__",
    "as_log",
    "as_logs",
    "as_model",
    "as_system",
    "c2d",
    "conversions",
    "d2c",
    "dare",
    "dlqr",
    "errors",
    "impulse_response",
    "lsim",
    "read",
    "read_records",
    "step_response",
    "to_control",
    "to_scipy",
    "uav",
]
