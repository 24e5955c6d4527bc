"""Dead time between command and response, and the gap between simulator and reality, from a measured log.

Signals are NumPy arrays in SI units, time is in seconds. Where a log is asked for, a `Log`, the path of a CSV file, a pandas or polars frame will do.
"""

from __future__ import annotations

from . import blind, bounds, errors
from ._native import Log, Model, StateSpace, TransferFunction, __version__
from .comparing import Comparison, compare
from .delays import (
    Estimate,
    Estimates,
    Method,
    Pair,
    Verdict,
    estimate,
    estimate_delay,
    estimate_events,
    estimate_frf,
    estimate_impulse_response,
    methods,
    predict_precision,
    step_log,
)
from .diagnosis import Diagnosis, Inspection, Isolability, check, gap, isolability
from .errors import DeadtimeError
from .exports import Export, export
from .identification import Identified, identify
from .logs import as_log, as_logs, listing, read, read_records
from .models import (
    as_model,
    as_system,
    c2d,
    conversions,
    d2c,
    dare,
    dlqr,
    effects,
    impulse_response,
    lsim,
    simulate,
    step_response,
    to_control,
    to_scipy,
    uav,
)
from .responses import FrequencyResponse, frequency_response
from .signals import Excitation, add_noise, excitations, excite
from .structures import FittedParameter, StructuredFit, StructureMatch, identify_structure, match_structure
from .studies import GateResult, Plan, Study, gate, plans, plants, read_study, study
from .systems import Filter, care, dlqe, dlyap, era, feedback, kalman, lqe, lqr, lyap, markov, norm, nu_gap, okid, pade, parallel, series, thiran
from .tracking import Alarm, Tracker, Tracking

__all__ = ["DeadtimeError", "__version__", "blind", "bounds", "errors"]
# Logs.
__all__ += ["Log", "as_log", "as_logs", "listing", "read", "read_records"]
# Signals.
__all__ += ["Excitation", "add_noise", "excitations", "excite"]
# Models.
__all__ += ["Model", "StateSpace", "TransferFunction", "as_model", "as_system", "c2d", "conversions", "d2c", "dare", "dlqr", "effects"]
__all__ += ["impulse_response", "lsim", "simulate", "step_response", "to_control", "to_scipy", "uav"]
__all__ += ["Filter", "care", "dlqe", "dlyap", "era", "feedback", "kalman", "lqe", "lqr", "lyap", "markov", "norm", "nu_gap", "okid", "pade", "parallel", "series", "thiran"]
__all__ += ["FrequencyResponse", "Identified", "frequency_response", "identify"]
__all__ += ["FittedParameter", "StructureMatch", "StructuredFit", "identify_structure", "match_structure"]
# Dead time.
__all__ += ["Estimate", "Estimates", "Method", "Pair", "Verdict", "estimate", "estimate_delay", "estimate_events", "estimate_frf"]
__all__ += ["estimate_impulse_response", "step_log"]
__all__ += ["Alarm", "Tracker", "Tracking", "methods", "predict_precision"]
# Studies.
__all__ += ["GateResult", "Plan", "Study", "gate", "plans", "plants", "read_study", "study"]
# The gap.
__all__ += ["Comparison", "Diagnosis", "Export", "Inspection", "Isolability", "check", "compare", "export", "gap", "isolability"]
