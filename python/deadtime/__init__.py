"""Dead time between command and response, and the gap between simulator and reality, from a measured log.

Signals are NumPy arrays in SI units, time is in seconds. Where a log is asked for, a `Log`, the path of a CSV file, a pandas or polars frame will do.
"""

from __future__ import annotations

from . import blind, errors
from ._native import Log, __version__
from .errors import DeadtimeError
from .logs import as_log, as_logs, read, read_records
from .studies import GateResult, Plan, Study, gate, plans, plants, read_study, study

__all__ = ["DeadtimeError", "Log", "__version__", "as_log", "as_logs", "blind", "errors", "read", "read_records"]
__all__ += ["GateResult", "Plan", "Study", "gate", "plans", "plants", "read_study", "study"]
