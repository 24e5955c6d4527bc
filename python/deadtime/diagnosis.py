"""The gap between a simulator and reality: how large it is, where it lies, what causes it, how far it shrinks.

The simulator is a model (`deadtime/model@1`) or any function of Python.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, TypedDict

import numpy
from numpy.typing import NDArray

from . import _native, plotting
from ._native import Model
from .arguments import perhaps, whole
from .logs import LogLike, _is_one, as_log, read
from .models import ModelLike, as_model
from .results import FileResult, Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Array: TypeAlias = "NDArray[numpy.float64]"

#: How outputs are predicted: a free run, or one step ahead by a fixed observer.
Prediction: TypeAlias = Literal["simulation", "predictor"]
#: Called with what is done: the part that is over, 0 to 1, and what comes now.
Progress: TypeAlias = Callable[[float, str], object]
#: Channels: names, or name to unit.
Channels: TypeAlias = "str | Sequence[str] | Mapping[str, str | None]"
#: States: name to initial value and its standard deviation (None: unknown); a number alone is an initial value that is not known exactly. A channel of the log
#: in place of the value: the simulator is started again and again from there.
States: TypeAlias = "Mapping[str, float | str | tuple[float | str, float | None]]"
#: Parameters: name to nominal value, or to value and unit.
Parameters: TypeAlias = "Mapping[str, float | tuple[float, str | None]]"


class Simulate(Protocol):
    """A simulator: outputs, shape (N, p) or, of one output, (N,).

    `u`, shape (N, m), holds from its own time stamp to the next; `time`, shape (N,), counts from the log's first sample, s; `x0`, shape (n,), is the state
    there; `parameters` has every named parameter.
    """

    def __call__(self, u: _Array, time: _Array, x0: _Array, parameters: dict[str, float], /) -> Any: ...


class Parameter(TypedDict):
    """A parameter of an effect that was found."""

    name: str
    unit: str
    #: None for a limit that does not act.
    value: float | None
    #: Standard deviation; None at a bound, as is the interval.
    std: float | None
    ci95: tuple[float, float] | None


class FoundEffect(TypedDict):
    """An effect that was found to act."""

    effect: str
    channel: str
    parameters: list[Parameter]


class Nuisance(TypedDict):
    """A nuisance of the model file in one log, or the level of an output whose operating point is `"mean"`."""

    effect: str
    channel: str
    log: str
    parameter: str
    unit: str
    #: Given what was found.
    value: float
    #: Standard deviation.
    std: float
    #: Standard deviation of its prior.
    prior_std: float


class NotTried(TypedDict):
    """A candidate that was left out, and why."""

    effect: str
    why: str


class Check(TypedDict):
    """A check that needs no dynamics."""

    check: str
    #: "*": all.
    channel: str
    #: None where it is undecided.
    ok: bool | None
    finding: str


class Trace(TypedDict):
    """One output of one log; arrays of shape (N,), in the output's unit."""

    log: str
    output: str
    unit: str | None
    #: s from the log's first sample.
    time: _Array
    #: NaN where a sample is missing.
    measured: _Array
    #: Predicted by the simulator as it came.
    before: _Array
    #: Predicted with what was found; None where nothing was.
    after: _Array | None
    #: Training and held-out spans, s.
    train: tuple[float, float] | None
    held: tuple[float, float] | None
    #: Standard deviation of what no deterministic simulator can explain.
    floor: float


class Diagnosis(Result):
    """What was found out about a simulator and its logs: `deadtime/diagnosis@3`, and the curves behind it."""

    def __init__(self, native: _native._Diagnosed) -> None:
        self._native = native

    def to_json(self) -> str:
        """The text of `diagnosis.json`."""
        return self._native.to_json()

    @property
    def verdict(self) -> str:
        """The leading effect, "none" or "unknown"."""
        verdict: str = self._data["cause"]["verdict"]
        return verdict

    @property
    def channel(self) -> str | None:
        """Where the leading effect acts."""
        channel: str | None = self._data["cause"]["channel"]
        return channel

    @property
    def effects(self) -> list[FoundEffect]:
        """All effects that were found to act, by what they contribute, with values, standard deviations and 95 % intervals."""
        effects: list[FoundEffect] = self._data["cause"]["effects"]
        return effects

    @property
    def explained(self) -> Literal["all", "mostly", "part", "nothing"]:
        """How much of the gap the causes explain."""
        explained: Literal["all", "mostly", "part", "nothing"] = self._data["cause"]["explained"]
        return explained

    @property
    def classes(self) -> list[dict[str, Any]]:
        """Alias classes of these logs: the `members` of each class, its `name`, share, and the calibrated `probability` that a member acts."""
        classes: list[dict[str, Any]] = self._data["cause"]["classes"]
        return classes

    @property
    def errors(self) -> dict[str, Any]:
        """Held-out errors before and after, nrmse: `one_step` ahead, over `horizons`, in `free_run`; None where a free run leaves all bounds."""
        errors: dict[str, Any] = self._data["errors"]
        return errors

    @property
    def contributions(self) -> list[dict[str, Any]]:
        """Everything that was found to act, whatever the verdict, each with its share of the gap and the `probability` of its class, most first."""
        contributions: list[dict[str, Any]] = self._data["cause"]["contributions"]
        return contributions

    @property
    def remainder(self) -> dict[str, Any]:
        """The residual of the gap: its share, how many times the noise floor it is, and where it lies."""
        remainder: dict[str, Any] = self._data["cause"]["remainder"]
        return remainder

    @property
    def ranking(self) -> list[dict[str, Any]]:
        """Every candidate with its probability and the training error that it leaves, and one row each for "none" and "unknown"."""
        ranking: list[dict[str, Any]] = self._data["cause"]["ranking"]
        return ranking

    @property
    def indistinguishable(self) -> list[list[str]]:
        """Classes of `effect:channel` that are aliases in these logs."""
        classes: list[list[str]] = self._data["cause"]["indistinguishable"]
        return classes

    @property
    def not_tried(self) -> list[NotTried]:
        """Candidates that were left out, with the reason."""
        left_out: list[NotTried] = self._data["cause"]["not_tried"]
        return left_out

    @property
    def next_experiment(self) -> str | None:
        """The excitation that would separate what these logs cannot; None where nothing is to be separated."""
        advice: str | None = self._data["cause"]["next_experiment"]
        return advice

    @property
    def prediction(self) -> dict[str, Any]:
        """`mode` and `why`, and over how many samples where there is a `horizon`."""
        prediction: dict[str, Any] = self._data["prediction"]
        return prediction

    @property
    def gap(self) -> dict[str, Any]:
        """The gap on the training logs: rms(measured - predicted) / std(measured) `before`, its noise `floor`, and the same by output."""
        gap: dict[str, Any] = self._data["gap"]
        return gap

    @property
    def where(self) -> dict[str, list[dict[str, Any]]]:
        """Shares of the gap by output, time, frequency band and range of another variable."""
        where: dict[str, list[dict[str, Any]]] = self._data["where"]
        return where

    @property
    def checks(self) -> list[Check]:
        """Checks that need no dynamics: signs, axes, units, clocks, stuck and clipped channels, excitation."""
        checks: list[Check] = self._data["checks"]
        return checks

    @property
    def shrink(self) -> dict[str, Any]:
        """How far the gap shrinks on held-out data: `before`, `after`, `floor`, `fraction`, `of_explainable`, `ci95`, `outputs`."""
        shrink: dict[str, Any] = self._data["shrink"]
        return shrink

    @property
    def nuisances(self) -> list[Nuisance]:
        """What the model file leaves unknown anew in every log, one entry per log: its nuisances, and levels of outputs whose operating point is `"mean"`."""
        nuisances: list[Nuisance] = self._data.get("nuisances", [])
        return nuisances

    @property
    def caveats(self) -> list[str]:
        """What weakens the diagnosis, as sentences."""
        return self._native.caveats

    @property
    def calls(self) -> int | None:
        """How often `simulate` was called; None for a model."""
        return self._native.calls

    @property
    def summary(self) -> str:
        """Sentences: cause, shrink, residual, next experiment, size and place."""
        return self._native.summary

    @property
    def model(self) -> Model | None:
        """The model with what was found; None for a function."""
        return self._native.model

    @property
    def simulator(self) -> _native._Simulator | None:
        """The function with what was found, itself a function f(u, time, x0, parameters): the next diagnosis may start from it. None for a model.

        A parameter that was found wrong is wrong by as much whatever value it is called with; lost commands are their mean.
        """
        return self._native.simulator

    @property
    def traces(self) -> list[Trace]:
        """Measured and predicted outputs, by output and then by log."""
        return self._native.traces

    def save(self, folder: str | os.PathLike[str]) -> list[str]:
        """Writes what `deadtime gap` writes: diagnosis.json, report.html and, of a model, model_with_effects.toml.

        Parameters
        ----------
        folder : path
            It need not exist.

        Returns
        -------
        list of str
            Names of the files.
        """
        os.makedirs(folder, exist_ok=True)
        return self._native.save(folder)

    def plot(self, log: str | None = None, span: tuple[float, float] | Literal["densest", "all"] = "densest") -> Figure:
        """Per output the measured, simulated and corrected curve, and the residual with the noise floor.

        Parameters
        ----------
        log : str, optional
            The log; without it the first that is held out as a whole, else the first.
        span : (float, float), "densest" or "all", optional
            Seconds to show; "densest" are those in which the gap is largest, so that a short delay can be seen.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        ImportError
            matplotlib is not there, and how to get it.
        ValueError
            There is no such log.
        """
        traces = self.traces
        names = list(dict.fromkeys(trace["log"] for trace in traces))
        if log is None:
            log = next((trace["log"] for trace in traces if trace["train"] is None), names[0] if names else None)
        elif log not in names:
            raise ValueError(f"there is no log {log!r}; there are {', '.join(names)}")
        chosen = [trace for trace in traces if trace["log"] == log]
        return _figure(chosen, self, _densest(chosen) if span == "densest" else None if span == "all" else span)

    def __repr__(self) -> str:
        lines = [self.summary, *(f"Caveat: {caveat}." for caveat in self.caveats)]
        if self.calls is not None:
            left_out: dict[str, list[str]] = {}
            for one in self.not_tried:
                left_out.setdefault(one["why"], []).append(one["effect"])
            lines.extend(f"Not tried: {', '.join(effects)}; {why}." for why, effects in left_out.items())
            lines.append(f"Calls of the simulator: {self.calls}.")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        def sentence(line: str) -> str:
            what, _, rest = line.partition(": ")
            return f"<p><b>{escape(what)}:</b> {escape(rest)}</p>"

        def percent(share: float | None) -> str:
            return "–" if share is None else f"{100 * share:.3g} %"

        rows = []
        for one in self.classes:
            cells = (one["name"].replace("`", ""), percent(one["share"]["learnt"]), percent(one["probability"]))
            rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
        head = "".join(f"<th>{h}</th>" for h in ("cause", "explains", "sure"))
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
        lines = repr(self).splitlines()
        picture = plotting.image(self.plot, lines[0]) if self.traces else ""
        # Where there is a picture, the cause stands above it and the other sentences fold away.
        said = next((line for line in lines if line.startswith("Cause")), lines[0])
        return (sentence(said) if picture else "") + plotting.folded(picture, "".join(map(sentence, lines)) + table)


class Inspection(FileResult):
    """What `check` found: `deadtime/check@1`."""

    def __init__(self, text: str, words: str) -> None:
        self._text, self._words = text, words

    def to_json(self) -> str:
        """The file's text."""
        return self._text

    @property
    def checks(self) -> list[Check]:
        """All checks, in the order in which they are made."""
        checks: list[Check] = self._data["checks"]
        return checks

    @property
    def failed(self) -> list[Check]:
        """Those that need a look."""
        return [check for check in self.checks if check["ok"] is False]

    @property
    def logs(self) -> list[dict[str, Any]]:
        """Every log as the model sees it: samples, sample time, channels with units and missing samples."""
        logs: list[dict[str, Any]] = self._data["logs"]
        return logs

    @property
    def clocks(self) -> list[dict[str, Any]]:
        """Of every log that was given as a file the clocks of its topics: how even their stamps are, and by how much those of two that log one motion are apart."""
        clocks: list[dict[str, Any]] = self._data.get("clocks", [])
        return clocks

    @property
    def not_run(self) -> str | None:
        """Why the checks could not be made; None where they were."""
        why: str | None = self._data["not_run"]
        return why

    def __repr__(self) -> str:
        return self._words.rstrip()

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"


class Isolability(FileResult):
    """Which effects are distinguishable in logs: `deadtime/isolability@1`."""

    def __init__(self, text: str, words: str) -> None:
        self._text, self._words = text, words

    def to_json(self) -> str:
        """The file's text."""
        return self._text

    @property
    def effects(self) -> list[dict[str, Any]]:
        """Every candidate: whether it is visible, the smallest size that is, and its closest alternative."""
        effects: list[dict[str, Any]] = self._data["effects"]
        return effects

    @property
    def cosines(self) -> _Array:
        """Cosines between the candidates' signatures, shape (E, E), in the order of `effects`; 1: alike."""
        return numpy.array(self._data["cosines"], dtype=float)

    @property
    def classes(self) -> list[dict[str, Any]]:
        """Groups that are indistinguishable in these logs, `members` with the `next_experiment` that would."""
        classes: list[dict[str, Any]] = self._data["classes"]
        return classes

    @property
    def prediction(self) -> dict[str, str]:
        """`mode` and `why`."""
        prediction: dict[str, str] = self._data["prediction"]
        return prediction

    def __repr__(self) -> str:
        return self._words.rstrip()

    def plot(self) -> Figure:
        """How alike the signatures of the visible effects are: dark squares off the diagonal are pairs that are indistinguishable in these logs.

        Raises
        ------
        ImportError
            matplotlib is not there, and how to get it.
        """
        return plotting.isolability(self.effects, self.cosines)

    def _repr_html_(self) -> str:
        return plotting.folded(plotting.image(self.plot, "which effects are distinguishable in these logs"), f"<pre>{escape(repr(self))}</pre>")


def gap(
    model: ModelLike | None = None,
    log: LogLike | Iterable[LogLike] | None = None,
    holdout: LogLike | Iterable[LogLike] | None = None,
    *,
    simulate: Simulate | None = None,
    inputs: Channels | None = None,
    outputs: Channels | None = None,
    states: States | None = None,
    parameters: Parameters | None = None,
    prediction: Prediction | None = None,
    horizon: int | None = None,
    max_delay: float | None = None,
    rows: int = 100_000,
    suggest: bool = False,
    seed: int = 1,
    threads: int | None = None,
    progress: Progress | None = None,
    name: str | None = None,
    restart_every: float | None = None,
) -> Diagnosis:
    """Diagnoses the gap between a simulator and logs of the real machine: where it lies, which unmodelled effect causes it, how far it shrinks.

    Parameters
    ----------
    model : Model, path, dict or linear system, optional
        The simulator as a model; or give `simulate`.
    log : Log, path, frame, or several of them
        Logs to learn from, with the simulator's inputs and outputs as columns.
    holdout : Log, path, frame, or several of them, optional
        Held-out logs. Without one, the last 30 % of each log are held out.
    simulate : function, optional
        Any simulator, f(u, time, x0, parameters) -> y: `u`, shape (N, m), the inputs, each held from its own time stamp to the next; `time`, shape (N,), s,
        counted from the log's first sample, perhaps uneven; `x0`, shape (n,), the states there; `parameters`, a dict of name to float; `y`, shape (N, p) or
        (N,), the outputs at these times. The same call must give the same answer. It is called from another thread, one call at a time; equal calls
        are made once.
    inputs, outputs : list of str, or dict of str to unit
        Channels of the log, in the order of the columns of `u` and `y`; for `simulate` only. Units are held against the log's.
    states : dict of str to (float or str, float or None), optional
        What `x0` holds, in order: initial value and standard deviation (None: unknown). A channel of the log in place of the value: the simulator is started
        again and again from what the log says there, as a free run of an unstable one says nothing; None is then as far as the state moves.
    parameters : dict of str to float or (float, unit), optional
        Parameters that may be wrong, with their nominal values.
    prediction : "simulation" or "predictor", optional
        What predicted means; without it chosen from the model's poles. A function can only be simulated freely.
    horizon : int, optional
        Predict over so many samples at a time, each time from the state that an observer has estimated from the log; in place of `prediction`. The shrink then
        holds the error by horizon, `shrink["horizons"]`.
    max_delay : float, optional
        The longest delay and lag that are looked for, s; without it 35 samples, at most a tenth of the shortest log.
    rows : int
        Rows that are looked at, of all logs together. Of longer logs that is the first part, and a caveat says so.
    suggest : bool
        Try the five terms that best describe the residual as candidates, in a second diagnosis; for models only.
    seed : int
        Seed of the bootstrap.
    threads : int, optional
        Threads to work on; all without it.
    progress : function, optional
        Called with the part that is over (0 to 1) and what comes now.
    name : str, optional
        What a function is called in the diagnosis; without it its own name.
    restart_every : float, optional
        Seconds between two starts of a function whose states stand in the log; without it as long as a perturbation grows tenfold at most.

    Returns
    -------
    Diagnosis

    Raises
    ------
    GapError
        Simulator and logs do not fit; a call of `simulate` with the nominal parameters fails (its exception is the cause), or two equal calls differ.
    LogError, ModelError, FileError, SimulateError
        A log, a model or the names of a simulator cannot be used.

    Notes
    -----
    docs/gap.md says how it is done, docs/black-box.md what a function must do and what cannot be tried on it.

    Examples
    --------
    A flight that was made with a dead time of 0.13 s, and a simulator without:

    >>> import deadtime
    >>> diagnosis = deadtime.gap("examples/uav_lateral_stabilised.toml", "examples/uav_flight.csv")
    >>> diagnosis.verdict, round(diagnosis.effects[0]["parameters"][0]["value"], 3)
    ('input_delay', 0.13)
    """
    subject = _subject("gap", model, simulate, inputs, outputs, states, parameters, name, restart_every)
    wanted = _wanted(subject, inputs, outputs, states)
    native = _native._gap(
        subject,
        _logs("gap", log, wanted),
        [] if holdout is None else _logs("gap", holdout, wanted),
        prediction,
        perhaps("horizon", horizon, 1),
        None if max_delay is None else float(max_delay),
        whole("rows", rows, 1),
        bool(suggest),
        whole("seed", seed, 0),
        perhaps("threads", threads, 1),
        progress,
    )
    return Diagnosis(native)


def check(
    model: ModelLike | None = None,
    log: LogLike | Iterable[LogLike] | None = None,
    *,
    simulate: Simulate | None = None,
    inputs: Channels | None = None,
    outputs: Channels | None = None,
    states: States | None = None,
    parameters: Parameters | None = None,
    name: str | None = None,
    restart_every: float | None = None,
) -> Inspection:
    """Looks at a simulator and logs before anyone diagnoses: names, units, time stamps, signs, axes, clocks, stuck and clipped channels, excitation, operating point.

    Parameters
    ----------
    model, simulate, inputs, outputs, states, parameters, name, restart_every
        The simulator, as `gap` takes it.
    log : Log, path, frame, or several of them
        The logs.

    Raises
    ------
    ModelError, SimulateError, FileError
        The simulator cannot be used; what is wrong with a log is part of the answer.

    Examples
    --------
    A speed in revolutions per minute where the model wants rad/s:

    >>> import deadtime
    >>> report = deadtime.check("examples/drive.toml", "examples/drive_run_1.csv")
    >>> [check["check"] for check in report.failed]
    ['unit']
    """
    subject = _subject("check", model, simulate, inputs, outputs, states, parameters, name, restart_every)
    wanted = _wanted(subject, inputs, outputs, states)
    logs = _logs("check", log, wanted)
    files = [one for one in _each(log) if _is_path(one)]  # type: ignore[arg-type]
    return Inspection(*_native._check(subject, logs, files, wanted))


def isolability(
    model: ModelLike | None = None,
    log: LogLike | Iterable[LogLike] | None = None,
    *,
    simulate: Simulate | None = None,
    inputs: Channels | None = None,
    outputs: Channels | None = None,
    states: States | None = None,
    parameters: Parameters | None = None,
    prediction: Prediction | None = None,
    horizon: int | None = None,
    max_delay: float | None = None,
    threads: int | None = None,
    name: str | None = None,
    restart_every: float | None = None,
) -> Isolability:
    """Which effects are distinguishable in these logs; nothing is fitted, and nothing is diagnosed.

    Parameters
    ----------
    model, simulate, inputs, outputs, states, parameters, name, restart_every
        The simulator, as `gap` takes it.
    log : Log, path, frame, or several of them
        The logs.
    prediction, horizon, max_delay, threads
        As in `gap`.

    Raises
    ------
    GapError, LogError, ModelError, FileError, SimulateError
        As `gap`.

    Examples
    --------
    A late command and a shifted clock make the same curves:

    >>> import deadtime
    >>> found = deadtime.isolability("examples/uav_lateral_stabilised.toml", "examples/uav_flight.csv")
    >>> any({"input_delay:r", "clock_offset:*"} <= set(group["members"]) for group in found.classes)
    True
    """
    subject = _subject("isolability", model, simulate, inputs, outputs, states, parameters, name, restart_every)
    found = _native._isolability(
        subject,
        _logs("isolability", log, _wanted(subject, inputs, outputs, states)),
        prediction,
        perhaps("horizon", horizon, 1),
        None if max_delay is None else float(max_delay),
        perhaps("threads", threads, 1),
    )
    return Isolability(*found)


def _subject(
    caller: str,
    model: ModelLike | None,
    simulate: Simulate | None,
    inputs: Channels | None,
    outputs: Channels | None,
    states: States | None,
    parameters: Parameters | None,
    name: str | None,
    restart_every: float | None = None,
) -> Model | _native._Simulator:
    """The model, or the function with the names of its channels."""
    if (model is None) == (simulate is None):
        raise TypeError(f"{caller} needs a model or a function, and not both: {caller}(model, log=...) or {caller}(simulate=f, inputs=..., outputs=..., log=...)")
    faces = {"inputs": inputs, "outputs": outputs, "states": states, "parameters": parameters, "name": name, "restart_every": restart_every}
    if model is not None:
        for what, given in faces.items():
            if given is not None:
                raise TypeError(f"{what} goes with simulate; a model has its own")
        return as_model(model)
    if not callable(simulate):
        raise TypeError(f"simulate is {type(simulate).__name__}, not a function f(u, time, x0, parameters)")
    starts, channels = _states(states)
    if restart_every is not None and not any(channels):
        raise TypeError("restart_every goes with states that name the log's channels, states={'theta': 'angle'}")
    return _native._Simulator(
        simulate,
        str(name if name is not None else _name(simulate)),
        _channels("inputs", inputs),
        _channels("outputs", outputs),
        starts,
        _parameters(parameters),
        channels if any(channels) else None,
        None if restart_every is None else _number("restart_every", restart_every),
    )


def _name(simulate: Any) -> str:
    """What a function is called, where that says something."""
    name = str(getattr(simulate, "__name__", type(simulate).__name__))
    return "simulator" if name in ("simulate", "f", "<lambda>", "partial", "_Simulator") else name


def _channels(what: str, given: Channels | None) -> list[tuple[str, str | None]]:
    if given is None:
        raise TypeError(f"{what} is missing: name the log's columns, {what}=['u'] or {what}={{'u': 'V'}}")
    if isinstance(given, str):
        return [(given, None)]
    if isinstance(given, Mapping):
        return [(str(name), None if unit is None else str(unit)) for name, unit in given.items()]
    return [(str(name), None) for name in given]


def _states(given: States | None) -> tuple[list[tuple[str, float, float | None]], list[str | None]]:
    """The starts, and the channels of the log that hold them."""
    if given is not None and not isinstance(given, Mapping):
        raise TypeError("states is a dict of name to (initial value or channel, standard deviation or None)")
    states: list[tuple[str, float, float | None]] = []
    channels: list[str | None] = []
    for name, value in (given or {}).items():
        initial, std = value if isinstance(value, tuple | list) and len(value) == 2 else (value, None)
        channels.append(initial if isinstance(initial, str) else None)
        value = 0.0 if isinstance(initial, str) else _number(f"states: {name}", initial)
        states.append((str(name), value, None if std is None else _number(f"states: {name}", std)))
    return states, channels


def _parameters(given: Parameters | None) -> list[tuple[str, str | None, float]]:
    if given is not None and not isinstance(given, Mapping):
        raise TypeError("parameters is a dict of name to value, or to (value, unit)")
    parameters: list[tuple[str, str | None, float]] = []
    for name, value in (given or {}).items():
        number, unit = value if isinstance(value, tuple | list) and len(value) == 2 else (value, None)
        parameters.append((str(name), None if unit is None else str(unit), _number(f"parameters: {name}", number)))
    return parameters


def _number(what: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError) as wrong:
        raise TypeError(f"{what} is {value!r}, not a number") from wrong


def _logs(caller: str, log: LogLike | Iterable[LogLike] | None, wanted: Wanted) -> list[_native.Log]:
    if log is None:
        raise TypeError(f"{caller} needs at least one log: log=...")
    return [read(one, inputs=wanted[0], outputs=wanted[1]) if _is_path(one) else as_log(one) for one in _each(log)]  # type: ignore[arg-type]


def _is_path(log: object) -> bool:
    return isinstance(log, str | os.PathLike)


def _each(log: LogLike | Iterable[LogLike]) -> list[Any]:
    """One log or several, as they were given."""
    return [log] if _is_one(log) or not isinstance(log, Iterable) or isinstance(log, numpy.ndarray) else list(log)


#: The channels that a file is asked for: inputs, and outputs with the states that stand in the log.
Wanted: TypeAlias = "tuple[list[str], list[str]]"


def _wanted(subject: Model | _native._Simulator, inputs: Channels | None, outputs: Channels | None, states: States | None) -> Wanted:
    if isinstance(subject, Model):
        return list(subject.inputs), list(subject.outputs)
    named = [name for name, _ in _channels("outputs", outputs)]
    return [name for name, _ in _channels("inputs", inputs)], [*named, *(c for c in _states(states)[1] if c is not None and c not in named)]


#: Samples that a picture shows well.
_WINDOW = 150


def _densest(traces: Sequence[Trace]) -> tuple[float, float] | None:
    """The seconds of `_WINDOW` samples in which the squared error over all outputs is largest; None where the log is not longer."""
    if not traces or len(traces[0]["time"]) <= _WINDOW:
        return None
    time = traces[0]["time"]
    total = numpy.zeros(len(time))
    for trace in traces:
        error = numpy.nan_to_num(trace["measured"] - trace["before"]) if len(trace["time"]) == len(time) else 0.0
        seen = trace["measured"][numpy.isfinite(trace["measured"])]
        spread = float(seen.std()) if len(seen) else 0.0
        total += (error / spread) ** 2 if spread > 0.0 else 0.0
    sums = numpy.cumsum(numpy.concatenate([[0.0], total]))
    first = int(numpy.argmax(sums[_WINDOW:] - sums[:-_WINDOW]))
    return float(time[first]), float(time[first + _WINDOW - 1])


def _figure(traces: Sequence[Trace], diagnosis: Diagnosis, span: tuple[float, float] | None) -> Figure:
    """A panel of curves and one of the residual, per output, over some seconds or all."""
    figure = plotting.figure(10.0, 3.2 * max(len(traces), 1))
    if not traces:
        return figure
    named = " and ".join(f"{e['effect']} on {e['channel']}" for e in diagnosis.effects) or diagnosis.verdict
    figure.suptitle(f"{traces[0]['log']}: {named}")
    axes = figure.subplots(2 * len(traces), 1, sharex=True, squeeze=False, height_ratios=[2.0, 1.0] * len(traces))[:, 0]
    for at, trace in enumerate(traces):
        curves, left = axes[2 * at], axes[2 * at + 1]
        time, unit = trace["time"], f" [{trace['unit']}]" if trace["unit"] else ""
        curves.plot(time, trace["measured"], color="0.6", linewidth=2.2, label="measured")
        curves.plot(time, trace["before"], color="#c2410c", linewidth=1.0, label="simulated")
        left.axhspan(-trace["floor"], trace["floor"], color="0.85", label="noise floor", linewidth=0.0)
        left.plot(time, trace["measured"] - trace["before"], color="#c2410c", linewidth=0.8, label="measured - simulated")
        if trace["after"] is not None:
            curves.plot(time, trace["after"], color="#1d5fbf", linewidth=1.0, label="with what was found")
            left.plot(time, trace["measured"] - trace["after"], color="#1d5fbf", linewidth=0.8, label="the same with what was found")
        for axis in (curves, left):
            if trace["held"] is not None and trace["train"] is not None:
                axis.axvspan(*trace["held"], color="#7a8694", alpha=0.12, linewidth=0.0)
            axis.legend(loc="upper right", fontsize="small")
        curves.set_ylabel(f"{trace['output']}{unit}")
        left.set_ylabel(f"left{unit}")
    axes[-1].set_xlabel("time [s]")
    if span is not None:
        axes[-1].set_xlim(*span)
        _fit_height(axes, span)
    return figure


def _fit_height(axes: Any, span: tuple[float, float]) -> None:
    """The height of each panel is that of its curves in the seconds shown."""
    for axis in axes:
        lines = [(line.get_xdata(), line.get_ydata()) for line in axis.get_lines()]
        shown = numpy.concatenate([numpy.asarray(y, dtype=float)[(numpy.asarray(x) >= span[0]) & (numpy.asarray(x) <= span[1])] for x, y in lines])
        shown = shown[numpy.isfinite(shown)]
        if len(shown):
            low, high = float(shown.min()), float(shown.max())
            axis.set_ylim(low - 0.06 * (high - low or 1.0), high + 0.06 * (high - low or 1.0))
