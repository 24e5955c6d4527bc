"""Models from logs: states, how sure they are, and how they do on data that they have not seen."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy
from numpy.typing import NDArray

from . import _native, models
from ._native import Model, StateSpace
from .logs import LogLike, as_logs
from .results import PrintedResult

if TYPE_CHECKING:
    import control
    import scipy.signal

#: How a model is identified.
Identifier: TypeAlias = Literal["pbsidopt", "n4sid", "moesp", "riv", "srivc", "p1d", "p1dz", "p2d", "p2dz", "p0di", "p1di"]

_Array: TypeAlias = "NDArray[numpy.float64]"


class Identified(PrintedResult):
    """A linear model of n states, m inputs and p outputs, with how sure it is; printed, it is what `deadtime identify` prints.

    Made by `identify`. Inputs and outputs are deviations from their means in the data, `operating`.

    Parameters
    ----------
    model : Model
        The model as a model file has it.
    file : str
        The text of `deadtime/identify@1`.
    text : str
        What the command line prints.

    Attributes
    ----------
    model : Model
        The model, for `estimate`, `simulate` and `gap`.
    A, B, C, D, K : arrays, shapes (n, n), (n, m), (p, n), (p, m), (n, p)
        x(t + 1) = A x + B u + K e, y = C x + D u + e, u behind `input_delay_s`; always sampled, whatever `model` is.
    innovations_covariance : array, shape (p, p)
        Covariance of e.
    sample_time_s : float
        Sample time, s.
    inputs, outputs : list of str
        Their names.
    input_delay_s : dict of str to float
        The dead time of each input that was removed first, s; of transfer functions and process models the whole samples of the one that they found.
    operating : dict of str to float
        The mean of each input and output in the data.
    order : int
        Number of states.
    order_sure : str
        `clear`, `likely` or `unclear`: how many criteria agree on the order; `given` where it was.
    poles, zeros : list of dict
        Each with `re`, `im` and their standard deviations `std_re`, `std_im`, time constant, frequency and damping.
    frequency_responses : list of dict
        For each input and output the response with its 95 % bands.
    fits : list of dict
        For each output, on data that the model has not seen: `one_step` and `simulation` fits and the tests of the errors.
    structure : str or None
        The formula of a transfer function or process model; None of states alone.
    parameters : list of dict
        Its numbers, each with `name` (`K`, `T1`, `dead_time`, `b0`, ...), `value`, `unit`, `std`, `ci95` and, where it belongs to one, `input`; empty of states alone.
    first_guesses : list of dict
        Of a process model, read from a step response `by` areas and tangent: `gain`, `lag_s`, `dead_time_s`.
    """

    def __init__(self, model: Model, file: str, text: str) -> None:
        self.model, self._file, self._text = model, file, text
        data = self._data
        matrices = data["model"]
        self.inputs: list[str] = [channel["name"] for channel in data["inputs"]]
        self.outputs: list[str] = [channel["name"] for channel in data["outputs"]]
        self.order: int = data["order"]["order"]
        self.order_sure: str = data["order"]["sure"]
        n, m, p = self.order, len(self.inputs), len(self.outputs)
        shapes = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m), "K": (n, p), "innovations_covariance": (p, p)}
        arrays = {name: numpy.array(matrices[name], dtype=float).reshape(shape) for name, shape in shapes.items()}
        self.A, self.B, self.C, self.D, self.K = (arrays[name] for name in "ABCDK")
        self.innovations_covariance: _Array = arrays["innovations_covariance"]
        self.sample_time_s: float = data["sample_time_s"]
        self.input_delay_s: dict[str, float] = dict(zip(self.inputs, data["input_delay_s"], strict=True))
        means = [*matrices["operating"]["inputs"], *matrices["operating"]["outputs"]]
        self.operating: dict[str, float] = dict(zip([*self.inputs, *self.outputs], means, strict=True))
        self.poles: list[dict[str, Any]] = data["poles"]
        self.zeros: list[dict[str, Any]] = data["zeros"]
        self.frequency_responses: list[dict[str, Any]] = data["frequency_responses"]
        self.fits: list[dict[str, Any]] = data["held_out"]["outputs"]
        self.structure: str | None = data.get("structure")
        self.parameters: list[dict[str, Any]] = data.get("parameters", [])
        self.first_guesses: list[dict[str, Any]] = data.get("first_guesses", [])

    @property
    def system(self) -> StateSpace:
        """The model as a system, its delays at the inputs."""
        return self.model.system()

    def to_control(self) -> control.StateSpace:
        """The model as a `control.StateSpace`; whole samples of delay become states.

        Raises
        ------
        ImportError
            python-control is not installed.
        ValueError
            A continuous model with a delay, which python-control's systems do not have.

        Examples
        --------
        >>> import deadtime
        >>> found = deadtime.identify("examples/two_inputs.csv", ["heater", "fan"], "temperature", order=2, delay="none")
        >>> found.to_control().nstates
        2
        """
        return models.to_control(self.system)

    def to_scipy(self) -> scipy.signal.StateSpace:
        """The model as a `scipy.signal.StateSpace`; errors and delays as of `to_control`.

        Examples
        --------
        >>> import deadtime
        >>> found = deadtime.identify("examples/two_inputs.csv", ["heater", "fan"], "temperature", order=2, delay="none")
        >>> found.to_scipy().A.shape
        (2, 2)
        """
        return models.to_scipy(self.system)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the model file, TOML or JSON by the name's end; `to_json` has everything else.

        Parameters
        ----------
        path : path
            The file, `.toml` or `.json`.

        Raises
        ------
        ModelError
            A name with another end.
        FileError
            The operating system refused it.
        """
        self.model.write(path)


def identify(
    log: LogLike | Iterable[LogLike],
    inputs: str | Sequence[str],
    outputs: str | Sequence[str],
    *,
    method: Identifier = "pbsidopt",
    order: int | None = None,
    past: int | None = None,
    delay: Literal["auto", "none"] | Mapping[str, float] = "auto",
    direct: bool = False,
    detrend: Literal["mean", "line"] = "mean",
    continuous: bool = False,
    holdout: LogLike | Iterable[LogLike] | None = None,
    learn: float = 0.7,
    options: Mapping[str, Any] | None = None,
    name: str = "identified",
    threads: int | None = None,
) -> Identified:
    """A linear model of inputs and outputs from logs, as `deadtime identify` makes it.

    Parameters
    ----------
    log : log-like, or several
        A `Log`, the path of a CSV file, a frame, a dict of arrays with a key `time`; several are records of one machine on one even grid.
    inputs, outputs : str or sequence of str
        Channels: commands and responses.
    method : {"pbsidopt", "n4sid", "moesp", "riv", "srivc", "p1d", "p1dz", "p2d", "p2dz", "p0di", "p1di"}
        States by `pbsidopt` (also under feedback and for unstable plants), `n4sid` or `moesp`; a transfer function of one output by `riv`, in continuous time by `srivc`; a process model of one input
        and one output with one or two lags, with a zero (z) or behind an integrator (i).
    order : int, optional
        Number of states; default by Schwarz's criterion. Of `riv` the number of poles; default 2.
    past : int, optional
        Samples of the past that predict; default by Akaike's criterion. Of states only.
    delay : "auto", "none" or dict of str to float
        Dead times that are removed first: estimated, none, or by input, s. `riv` and process models find them themselves.
    direct : bool
        Estimate D too: the input acts within the sample. Not of process models.
    detrend : "mean" or "line"
        What is taken off every channel first: its mean, or the slope of the straight line through each log too.
    continuous : bool
        The model is the continuous one behind a zero-order hold; the matrices stay those of the sampled one. Of process models it always is.
    holdout : log-like, or several, optional
        Logs to judge the model on, which take no part in the fit; default the last part of each log.
    learn : float
        The share of each log that is fitted where there is no `holdout`, between 0 and 1.
    options : dict, optional
        Further options of the method: `{"max_order": 20}`.
    name : str
        What the model is called.
    threads : int, optional
        Threads to use; default one for each core.

    Returns
    -------
    Identified
        The model, with standard deviations, and how it does on held-out data.

    Raises
    ------
    ModelError
        Too few samples, channels that do not move, a continuous model of what has none.
    LogError, RegistryError, DelayError
        Unknown channels, methods or options; a delay of something that is no input.

    Examples
    --------
    >>> import deadtime
    >>> found = deadtime.identify("examples/two_inputs.csv", ["heater", "fan"], "temperature", order=2, delay="none")
    >>> found.A.shape, found.B.shape, found.order
    ((2, 2), (2, 2), 2)
    >>> found = deadtime.identify("examples/two_inputs.csv", "heater", "temperature", method="p1d")
    >>> [p["name"] for p in found.parameters]
    ['K', 'T1', 'dead_time']
    """
    if not 0.0 < learn < 1.0:
        raise ValueError(f"learn is {learn}; it must be between 0 and 1")
    chosen = dict(options or {})
    chosen |= {key: value for key, value in (("order", order), ("past", past)) if value is not None}
    if direct:
        chosen["direct"] = "free"
    if isinstance(delay, str) and delay not in ("auto", "none"):
        raise ValueError(f"delay is {delay!r}; it must be 'auto', 'none', or a dict of seconds by input")
    if detrend not in ("mean", "line"):
        raise ValueError(f"detrend is {detrend!r}; it must be 'mean' or 'line'")
    asked = {
        "name": name,
        "inputs": [inputs] if isinstance(inputs, str) else list(inputs),
        "outputs": [outputs] if isinstance(outputs, str) else list(outputs),
        "method": method,
        "delay": delay if isinstance(delay, str) else "",
        "delays": [] if isinstance(delay, str) else [(key, float(value)) for key, value in delay.items()],
        "continuous": continuous,
        "without_drift": detrend == "line",
        "learnt": learn,
    }
    judged = [] if holdout is None else as_logs(holdout)
    return Identified(*_native._identify(as_logs(log), judged, chosen, asked, threads))
