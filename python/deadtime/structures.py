"""Parameters of a model file: fitted to logs by time, or to an identified model by frequency."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from . import _native
from ._native import Model
from .identification import Identified
from .logs import LogLike, as_logs
from .models import ModelLike, as_model
from .results import PrintedResult

#: By what responses are compared.
MatchNorm: TypeAlias = Literal["wls", "h2", "hinf", "nu-gap"]


@dataclass(frozen=True)
class FittedParameter:
    """A parameter that was fitted.

    Attributes
    ----------
    name : str
        Its name.
    unit : str or None
        Its unit.
    nominal, value : float
        The file's value, and the one found.
    std : float or None
        Standard deviation; None where the identified model says nothing of its own.
    ci95 : (float, float) or None
        95 % interval.
    one_step : (float, float) or None
        Value and standard deviation of windows of one step.
    standing : str
        `physical`, `surrogate`, `open`, `held` or `unchecked`.
    """

    name: str
    unit: str | None
    nominal: float
    value: float
    std: float | None
    ci95: tuple[float, float] | None
    one_step: tuple[float, float] | None
    standing: str


def _pair(values: Sequence[float | None] | None) -> tuple[float, float] | None:
    # What is not finite is null in a file.
    if values is None:
        return None
    low, high = (float("nan") if v is None else v for v in values)
    return low, high


class _Fitted(PrintedResult):
    def __init__(self, model: Model, file: str, text: str) -> None:
        self.model, self._file, self._text = model, file, text
        each = [
            FittedParameter(
                p["name"], p["unit"], p["nominal"], p["value"], p["std"], _pair(p["interval"]), _pair(p.get("one_step")), p["standing"]
            )
            for p in self._data["parameters"]
        ]
        self.parameters: dict[str, FittedParameter] = {p.name: p for p in each}
        self.cannot_be_had: list[str] = [unseen["words"] for unseen in self._data["unseen"]]
        self.trades: list[str] = self._data["trades"]
        self.converged: bool = self._data["converged"]

    def __getitem__(self, name: str) -> float:
        return self.parameters[name].value


class StructuredFit(_Fitted):
    """Parameters of a model that were fitted to logs; printed, it is what `deadtime identify --structure` prints.

    Made by `identify_structure`. `fit["mass"]` is the value of the parameter `mass`.

    Parameters
    ----------
    model : Model
        The model with what was found.
    file : str
        The text of `deadtime/structure@1`.
    text : str
        What the command line prints.

    Attributes
    ----------
    model : Model
        The fitted model, for `simulate` and `gap`; `model.write(path)` writes its file.
    parameters : dict of str to FittedParameter
        The parameters by name.
    cannot_be_had : list of str
        Combinations that the logs do not show, in words.
    trades : list of str
        Pairs that are correlated, in words.
    converged : bool
        The search ended at a minimum.
    """

    @property
    def determined(self) -> float:
        """The number of parameters that the logs determine; shrinkage towards the file's values determines the rest."""
        value: float = self._data["determined"]
        return value


class StructureMatch(_Fitted):
    """Parameters of a model that were matched to an identified one; printed, it is what `deadtime identify --match` prints.

    Made by `match_structure`. `match["mass"]` is the value of the parameter `mass`.

    Parameters
    ----------
    model : Model
        The model with what was found.
    file : str
        The text of `deadtime/match@1`.
    text : str
        What the command line prints.

    Attributes
    ----------
    model : Model
        The matched model, for `simulate` and `gap`; `model.write(path)` writes its file.
    parameters : dict of str to FittedParameter
        The parameters by name.
    cannot_be_had : list of str
        Combinations that the response does not show, in words.
    trades : list of str
        Pairs that are correlated, in words.
    converged : bool
        The search ended at a minimum.
    nu_gap : float or None
        The nu-gap of the two models; None where it has no value.
    notes : list of str
        What a reader must know.
    """

    def __init__(self, model: Model, file: str, text: str) -> None:
        super().__init__(model, file, text)
        gap = self._data["nu_gap"]
        self.nu_gap: float | None = None if gap is None else gap["value"]
        self.notes: list[str] = self._data["notes"]


def _names(names: str | Sequence[str]) -> list[str]:
    return [names] if isinstance(names, str) else list(names)


def identify_structure(
    log: LogLike | Iterable[LogLike],
    model: ModelLike,
    free: str | Sequence[str],
    *,
    per_record: Sequence[str] = (),
    horizon: int = 50,
    stride: int | None = None,
    threshold: float = 1.345,
    balance: Literal["horizon", "group"] = "horizon",
    shrinkage: float | None = None,
    one_step: bool = True,
    holdout: LogLike | Iterable[LogLike] | None = None,
    threads: int | None = None,
) -> StructuredFit:
    """Many parameters of a model at once, from logs, as `deadtime identify --structure` fits them.

    Windows of `horizon` steps start from the log's own rows; the parameters are those whose predictions are nearest to the log.

    Parameters
    ----------
    log : log-like, or several
        Logs on one even grid; several are records of one machine.
    model : Model, path, dict, or a linear system
        What `as_model` takes. A linear model has the entries of A and B that are not 0 as parameters, `A_v_phi`.
    free : str or sequence of str
        Parameters to fit, or "delay:INPUT" for the dead time of an input, s; "all": every parameter that the model does not call known, and all dead times.
    per_record : sequence of str
        Parameters that may also stand off by record.
    horizon : int
        Steps that are predicted from each window's start.
    stride : int, optional
        Steps from one window's start to the next; default the horizon.
    threshold : float
        Errors above this many median errors count by their size (Huber); inf: never.
    balance : {"horizon", "group"}
        Each horizon counts by its own median error, or all of a group alike.
    shrinkage : float, optional
        Shrinkage towards the file's values, dead times excepted; default what predicts left-out records best.
    one_step : bool
        Fit single steps too, and tell physical values from surrogates.
    holdout : log-like, or several, optional
        Logs to judge the model on, which take no part in the fit.
    threads : int, optional
        Threads to use; default one for each core.

    Returns
    -------
    StructuredFit
        Values with intervals, what is not identifiable, and the errors before and after.

    Raises
    ------
    ModelError
        No such parameter, no window, a model with effects, logs of unlike sample times.
    LogError
        A channel that is not there.

    Examples
    --------
    >>> import deadtime, numpy
    >>> time = 0.1 * numpy.arange(400)
    >>> u = numpy.where(numpy.arange(400) // 23 % 2, 1.0, -1.0)
    >>> y = numpy.zeros(400)
    >>> for t in range(399):
    ...     y[t + 1] = numpy.exp(-0.2) * y[t] + 1.5 * (1 - numpy.exp(-0.2)) * u[t]
    >>> equations = {"format": "deadtime/model@1", "name": "lag", "kind": "equations", "inputs": [{"name": "u"}], "outputs": [{"name": "y"}],
    ...     "states": {"y": {}}, "parameters": {"gain": {"value": 1.0}, "rate": {"value": 1.0}},
    ...     "derivatives": {"y": "rate*(gain*u - y)"}, "output_equations": {"y": "y"}}
    >>> fit = deadtime.identify_structure({"time": time, "u": u, "y": y}, equations, "all")
    >>> round(fit["gain"], 3), round(fit["rate"], 3)
    (1.5, 2.0)
    """
    if balance not in ("horizon", "group"):
        raise ValueError(f"balance is {balance!r}; it must be 'horizon' or 'group'")
    if not threshold > 0.0:
        raise ValueError(f"threshold is {threshold}; it must be above 0 (inf for plain squares)")
    if shrinkage is not None and not 0.0 <= shrinkage < float("inf"):
        raise ValueError(f"shrinkage is {shrinkage}; it must be finite and not negative")
    for name, steps in (("horizon", horizon), ("stride", stride)):
        if steps is not None and steps < 1:
            raise ValueError(f"{name} is {steps}; it must be 1 or more")
    asked = {
        "free": _names(free),
        "per_record": list(per_record),
        "horizon": horizon,
        "stride": stride,
        "threshold": float(threshold),
        "alike": balance == "group",
        "shrinkage": shrinkage,
        "one_step": one_step,
    }
    judged = [] if holdout is None else as_logs(holdout)
    return StructuredFit(*_native._identify_structure(as_logs(log), judged, as_model(model), asked, threads))


def match_structure(
    identified: Identified | Model | str | os.PathLike[str],
    model: ModelLike,
    free: str | Sequence[str],
    *,
    norm: MatchNorm = "wls",
    band_rad_s: tuple[float, float] | None = None,
    starts: int = 8,
    prior: float | None = None,
    units: Mapping[str, float] | None = None,
    at: Mapping[str, float] | None = None,
    threads: int | None = None,
) -> StructureMatch:
    """Parameters of a model whose frequency response is nearest to an identified one, as `deadtime identify --structure --match` finds them.

    Parameters
    ----------
    identified : Identified, Model or path
        What `identify` gave, with its uncertainty; a linear model, or the file of either.
    model : Model, path, dict, or a linear system
        What `as_model` takes.
    free : str or sequence of str
        Parameters to find, or "delay:INPUT" for the dead time of an input; "all": every parameter that the model does not call known, and all dead times.
    norm : {"wls", "h2", "hinf", "nu-gap"}
        By what responses are compared: squares in standard deviations, energy, largest gain, largest chordal distance.
    band_rad_s : (float, float), optional
        The frequencies that count, rad/s; default those that the data show.
    starts : int
        Starts of the search, the file's values first.
    prior : float, optional
        How far the model's values may be off, as a share of each (one standard deviation), by `wls` and `h2`; `inf`: not held. Default what the
        evidence says, from 0.1 to 10. What the responses do not fix stays at the model's value then. Dead times are not held.
    units : dict of str to float, optional
        What counts as one of a channel in gains (`h2`, `hinf`, `nu-gap`).
    at : dict of str to float, optional
        Where equations are linearised, by state or input; default initial states, and the identified model's operating inputs.
    threads : int, optional
        Threads to use; default one for each core.

    Returns
    -------
    StructureMatch
        Values with intervals, what is not identifiable, and the distance of the responses.

    Raises
    ------
    ModelError
        Channels or units that do not fit, no such parameter, a pole on a frequency of the band, a search that ends at no minimum.
    RegistryError
        An unknown norm.

    Examples
    --------
    >>> import deadtime
    >>> lag = deadtime.Model.from_system(([3.0], [0.5, 1.0]), inputs=["u"], outputs=["y"])
    >>> structure = {"format": "deadtime/model@1", "name": "lag", "kind": "equations", "inputs": [{"name": "u"}], "outputs": [{"name": "y"}],
    ...     "states": {"x": {}}, "parameters": {"gain": {"value": 1.0}, "lag": {"value": 1.0}},
    ...     "derivatives": {"x": "(gain*u - x)/lag"}, "output_equations": {"y": "x"}}
    >>> match = deadtime.match_structure(lag, structure, ["gain", "lag"])
    >>> round(match["gain"], 6), round(match["lag"], 6)
    (3.0, 0.5)
    """
    given: Model | str | Path
    if isinstance(identified, Identified):
        given = identified.to_json()
    elif isinstance(identified, Model):
        given = identified
    else:
        given = Path(identified)
    if starts < 1:
        raise ValueError(f"starts is {starts}; it must be 1 or more")
    asked = {
        "free": _names(free),
        "norm": norm,
        "band": None if band_rad_s is None else [float(end) for end in band_rad_s],
        "starts": starts,
        "prior": None if prior is None else float(prior),
        "units": [(name, float(value)) for name, value in (units or {}).items()],
        "at": [(name, float(value)) for name, value in (at or {}).items()],
    }
    return StructureMatch(*_native._match_structure(given, as_model(model), asked, threads))
