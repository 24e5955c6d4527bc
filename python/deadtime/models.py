"""Models: linear systems, simulators with named channels, and what is computed from them.

A system is a `StateSpace`, a `TransferFunction` or `Model`, or one of python-control or scipy; these packages are never imported here unless a result is
asked for in their types.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, overload

import numpy
from numpy.typing import ArrayLike, NDArray

from . import _native, errors
from ._native import Log, Model, StateSpace, TransferFunction
from .arrays import Array, ComplexArray, TimeResponse
from .logs import LogLike, as_log

if TYPE_CHECKING:
    import control
    import scipy.signal

#: What passes for a model: a `Model`, the path of a model file, a dict with its keys, or a linear system.
ModelLike: TypeAlias = "Model | str | os.PathLike[str] | Mapping[str, Any] | SystemLike"
#: What passes for a linear system: ours, those of python-control and scipy, and tuples as scipy has them.
SystemLike: TypeAlias = (
    "StateSpace | TransferFunction | Model | control.StateSpace | control.TransferFunction | scipy.signal.lti | scipy.signal.dlti | tuple[Any, ...]"
)
Hold: TypeAlias = Literal["zero", "linear"]


# What passes for what


def as_model(model: ModelLike) -> Model:
    """A model from whatever passes for one.

    Parameters
    ----------
    model : Model, path, dict, or a linear system
        A model file's path (.toml or .json), a dict with its keys, or a system that `as_system` takes; its channels are named by its labels where
        python-control gives some, else u, y and x (`Model.from_system` names them).

    Raises
    ------
    ModelError, FileError
        What is wrong in it.

    Examples
    --------
    >>> import deadtime
    >>> model = deadtime.as_model(([1.0], [1.0, 1.0]))
    >>> model.inputs, model.outputs
    (['u'], ['y'])
    """
    if isinstance(model, Model):
        return model
    if isinstance(model, str | os.PathLike):
        return Model.read(model)
    if isinstance(model, Mapping):
        return Model.from_dict(model)
    return Model.from_system(model)


def as_system(system: SystemLike, sample_time: float | None = None) -> StateSpace:
    """A linear system from whatever passes for one.

    Parameters
    ----------
    system : StateSpace, TransferFunction, Model, control.StateSpace, control.TransferFunction, scipy.signal.lti, scipy.signal.dlti or tuple
        A tuple is read as `scipy.signal.lti` reads it: (num, den), (zeros, poles, gain) or (A, B, C, D), in continuous time, and as `scipy.signal.dlti`
        does with `sample_time`; (A, B, C, D, dt) has its own. A system of python-control with `dt=None` (unspecified) is read as continuous, as
        python-control itself does when it simulates. A model's effects and operating points are left out.
    sample_time : float, optional
        s: for a tuple, and for a sampled system that has no number for it (`dt=True`). Any other must have it already.

    Raises
    ------
    ModelError
        Matrices that do not fit, more zeros than poles, a sampled system without a sample time.
    TimeError
        A system of another sample time.
    TypeError
        Something else.

    Examples
    --------
    2/(s + 3):

    >>> import deadtime
    >>> float(deadtime.as_system(([2.0], [1.0, 3.0])).poles()[0].real)
    -3.0
    """
    ours = _as_system(system, sample_time)
    if sample_time is not None:
        _native._same_time(ours, sample_time)
    return ours


def _as_system(system: Any, sample_time: float | None) -> StateSpace:
    if isinstance(system, StateSpace):
        return system
    if isinstance(system, TransferFunction):
        return system.to_state_space()
    if isinstance(system, Model):
        return system.system()
    if isinstance(system, tuple):
        return _of_tuple(system, sample_time)
    # An object of a package can only be given where that package is loaded.
    if _is(system, "control", "StateSpace"):
        return StateSpace(system.A, system.B, system.C, system.D, _dt(system.dt, sample_time))
    if _is(system, "control", "TransferFunction"):
        return _of_polynomials(system.num_list, system.den_list, _dt(system.dt, sample_time))
    if _is(system, "scipy.signal", "lti", "dlti"):
        dt = _dt(system.dt, sample_time)
        if _is(system, "scipy.signal", "StateSpace"):
            return StateSpace(system.A, system.B, system.C, system.D, dt)
        if _is(system, "scipy.signal", "ZerosPolesGain"):
            return _of_roots(system.zeros, system.poles, system.gain, dt)
        return _of_scipy_polynomials(system.num, system.den, dt)
    raise TypeError(
        f"a system is a deadtime.StateSpace, TransferFunction or Model, a state-space model or transfer function of python-control or scipy.signal, "
        f"or a tuple as scipy has it, not {type(system).__name__}"
    )


def _is(value: object, module: str, *names: str) -> bool:
    """An object of one of these classes, without importing their module."""
    loaded = sys.modules.get(module)
    return loaded is not None and isinstance(value, tuple(getattr(loaded, name) for name in names))


def _dt(dt: Any, sample_time: float | None) -> float | None:
    """The sample time of a neighbour's system: 0 and None mean continuous time, True a time that nobody has named."""
    if dt is True:
        if sample_time is None:
            raise errors.ModelError("the system is sampled, but its dt is True, not a number of seconds; give sample_time")
        return sample_time
    return None if dt is None or dt == 0 else float(dt)


def _of_tuple(system: tuple[Any, ...], sample_time: float | None) -> StateSpace:
    match system:
        case (num, den):
            return _of_scipy_polynomials(num, den, sample_time)
        case (zeros, poles, gain):
            return _of_roots(zeros, poles, gain, sample_time)
        case (a, b, c, d):
            return StateSpace(a, b, c, d, sample_time)
        case (a, b, c, d, dt):
            return StateSpace(a, b, c, d, _dt(dt, sample_time))
    raise TypeError(f"a tuple of {len(system)} is no system: write (num, den), (zeros, poles, gain), (A, B, C, D) or (A, B, C, D, dt)")


def _of_roots(zeros: Any, poles: Any, gain: Any, sample_time: float | None) -> StateSpace:
    """A gain may be an array of one number, as scipy has it, and one gain for each output has the zeros of each in its row."""
    gains = _real("the gain", gain).reshape(-1)
    if gains.size == 1:
        return TransferFunction.from_zeros_poles_gain(numpy.reshape(zeros, -1), poles, float(gains[0]), sample_time).to_state_space()
    rows = numpy.atleast_2d(numpy.asarray(zeros))
    if len(rows) != gains.size:
        raise errors.ModelError(f"{gains.size} gains and {len(rows)} rows of zeros: write one row of zeros for each gain")
    pairs = [TransferFunction.from_zeros_poles_gain(row[numpy.isfinite(row)], poles, float(g), sample_time) for row, g in zip(rows, gains, strict=True)]
    return _of_polynomials([[pair.num] for pair in pairs], [[pair.den] for pair in pairs], sample_time)


def _real(what: str, values: Any) -> Array:
    """Complex numbers without an imaginary part are real ones."""
    array = numpy.asarray(values)
    if numpy.iscomplexobj(array):
        if numpy.any(array.imag):
            raise errors.ModelError(f"{what} has an imaginary part: a real system has none")
        array = array.real
    return numpy.asarray(array, dtype=float)


def _of_scipy_polynomials(num: Any, den: Any, sample_time: float | None) -> StateSpace:
    """A numerator of two dimensions has one row per output."""
    rows, den = numpy.atleast_2d(_real("the numerator", num)), _real("the denominator", den).reshape(-1)
    return _of_polynomials([[row] for row in rows], [[den]] * len(rows), sample_time)


def _of_polynomials(num: Sequence[Sequence[Any]], den: Sequence[Sequence[Any]], sample_time: float | None) -> StateSpace:
    """All pairs side by side, each with states of its own: nothing is cancelled or shared."""
    outputs, inputs = len(num), len(num[0])
    pairs = [
        (i, j, TransferFunction(num[i][j], den[i][j], sample_time).to_state_space())
        for i in range(outputs)
        for j in range(inputs)
        if numpy.any(numpy.asarray(num[i][j]))
    ]
    if len(pairs) == outputs * inputs == 1:
        return pairs[0][2]
    order = sum(pair.order for _, _, pair in pairs)
    a, b = numpy.zeros((order, order)), numpy.zeros((order, inputs))
    c, d = numpy.zeros((outputs, order)), numpy.zeros((outputs, inputs))
    at = 0
    for i, j, pair in pairs:
        here = slice(at, at + pair.order)
        a[here, here], b[here, j], c[i, here], d[i, j] = pair.A, pair.B[:, 0], pair.C[0], pair.D[0, 0]
        at += pair.order
    return StateSpace(a, b, c, d, sample_time)


# Files


def _plain(value: object) -> object:
    """What JSON takes in place of NumPy's arrays and numbers, and of mappings."""
    if isinstance(value, numpy.ndarray | numpy.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"a model file holds numbers, strings, lists and tables, not {type(value).__name__}")


def _entry(name: str, units: Mapping[str, str], **more: Any) -> dict[str, Any]:
    """A channel, state or parameter of a model file; what is None is left out."""
    return {"name": name} | {key: value for key, value in {"unit": units.get(name), **more}.items() if value is not None}


def _known(what: str, given: Mapping[str, Any] | None, names: Sequence[str]) -> Mapping[str, Any]:
    """A mapping by name, all of whose names there are."""
    for name in given or {}:
        if name not in names:
            raise errors.ModelError(f"{what}: the model has no `{name}`; it has {', '.join(names)}")
    return given or {}


def _names(given: Sequence[str] | None, system: Any, labels: str, letter: str, count: int) -> list[str]:
    """Names as given, else python-control's labels, else letters with numbers."""
    if given is not None:
        names = [given] if isinstance(given, str) else list(given)
        if len(names) != count:
            raise errors.ModelError(f"{len(names)} {labels} named, the system has {count}")
        return names
    own = list(getattr(system, labels, None) or []) if _is(system, "control", "InputOutputSystem") else []
    # python-control writes u[0], u[1], … where nobody gave names.
    if len(own) == count and not all(re.fullmatch(r"[a-z]\[\d+\]", label) for label in own):
        return own
    return [letter] if count == 1 else [f"{letter}{i + 1}" for i in range(count)]


def _file_of_system(
    system: Any,
    inputs: Sequence[str] | None,
    outputs: Sequence[str] | None,
    states: Sequence[str] | None,
    name: str | None,
    units: Mapping[str, str] | None,
    operating: Mapping[str, float | Literal["mean"]] | None,
    initial: ArrayLike | None,
    initial_std: ArrayLike | None,
    sample_time: float | None,
) -> dict[str, Any]:
    """The keys of a model file for `Model.from_system`."""
    if isinstance(system, Model):
        raise TypeError("this is a Model already; Model.system() gives its linear system")
    ours = as_system(system, sample_time)
    inputs = _names(inputs, system, "input_labels", "u", ours.inputs)
    outputs = _names(outputs, system, "output_labels", "y", ours.outputs)
    states = _names(states, system, "state_labels", "x", ours.order)
    units = _known("units", units, [*inputs, *outputs, *states])
    operating = _known("operating", operating, [*inputs, *outputs])
    own = getattr(system, "name", None) if _is(system, "control", "InputOutputSystem") else None
    file: dict[str, Any] = {
        "format": "deadtime/model@1",
        "name": name or own or "model",
        "kind": "lti",
        "sample_time_s": ours.sample_time or 0.0,
        "inputs": [_entry(name, units, operating=operating.get(name)) for name in inputs],
        "states": [_entry(name, units) for name in states],
        "outputs": [_entry(name, units, operating=operating.get(name)) for name in outputs],
        "A": ours.A,
        "B": ours.B,
        "C": ours.C,
        "D": ours.D,
    }
    if ours.input_delay.any():
        file["input_delay_s"] = ours.input_delay
    for key, value in {"initial": initial, "initial_std": initial_std}.items():
        if value is not None:
            file[key] = numpy.atleast_1d(numpy.asarray(value, dtype=float))
    return file


def _file_of_equations(
    derivatives: Mapping[str, str],
    outputs: Mapping[str, str],
    inputs: Sequence[str],
    parameters: Mapping[str, float] | None,
    name: str,
    units: Mapping[str, str] | None,
    initial: Mapping[str, float] | None,
    initial_std: Mapping[str, float] | None,
    input_delay: Mapping[str, float] | None,
) -> dict[str, Any]:
    """The keys of a model file for `Model.from_equations`."""
    inputs = [inputs] if isinstance(inputs, str) else list(inputs)
    parameters = parameters or {}
    units = _known("units", units, [*inputs, *outputs, *derivatives, *parameters])
    initial, initial_std = _known("initial", initial, list(derivatives)), _known("initial_std", initial_std, list(derivatives))
    delays = _known("input_delay", input_delay, inputs)

    def table(name: str, **values: Any) -> dict[str, Any]:
        entry = _entry(name, units, **values)
        del entry["name"]
        return entry

    file = {
        "format": "deadtime/model@1",
        "name": name,
        "kind": "equations",
        "inputs": [_entry(name, units) for name in inputs],
        "outputs": [_entry(name, units) for name in outputs],
        "states": {name: table(name, initial=initial.get(name, 0.0), initial_std=initial_std.get(name)) for name in derivatives},
        "parameters": {name: table(name, value=value) for name, value in parameters.items()},
        "derivatives": dict(derivatives),
        "output_equations": dict(outputs),
    }
    if delays:
        file["input_delay_s"] = [delays.get(name, 0.0) for name in inputs]
    return file


# Conversions


@overload
def c2d(system: Model, sample_time: float, method: str = "zoh", **options: Any) -> Model: ...
@overload
def c2d(system: SystemLike, sample_time: float, method: str = "zoh", **options: Any) -> StateSpace: ...
def c2d(system: SystemLike, sample_time: float, method: str = "zoh", **options: Any) -> StateSpace | Model:
    """The sampled model of a continuous one, by MATLAB's definitions.

    Parameters
    ----------
    system : SystemLike
        A continuous system, whatever `as_system` takes; its input delays may be fractions of a sample.
    sample_time : float
        s.
    method : str
        zoh, foh, impulse, tustin, matched or least_squares: `conversions` lists them.
    **options
        Of the conversion, such as `prewarp_rad_s=3.0` of tustin.

    Returns
    -------
    StateSpace, or Model of a Model
        Sampled. Whole samples of delay stay delays; what a fraction becomes depends on the conversion. A model keeps its names, and its start where the
        conversion keeps its states.

    Raises
    ------
    ModelError
        What the conversion cannot do for this system.
    RegistryError
        There is no such conversion or option.

    Examples
    --------
    1/(s + 1), held for 0.1 s: the pole is e^(−0.1).

    >>> import deadtime
    >>> sampled = deadtime.c2d(([1.0], [1.0, 1.0]), 0.1)
    >>> round(float(sampled.A[0, 0]), 6)
    0.904837
    """
    if isinstance(system, Model):
        return system._c2d(sample_time, method, options)
    return _native._c2d(as_system(system), sample_time, method, options)


def d2c(system: SystemLike, method: Literal["zoh", "tustin", "matched"] = "zoh") -> StateSpace:
    """The continuous model of a sampled one.

    Parameters
    ----------
    system : SystemLike
        Sampled; whole samples of delay become seconds.
    method : "zoh", "tustin" or "matched"
        The conversion of which this is the way back. "zoh": a simple pole on the negative real axis becomes a pair, and the order rises by one for each.
        "matched": poles and zeros by their logarithms, of one input and one output; zeros at −1 go.

    Raises
    ------
    ModelError
        A pole at z = 0 ("zoh"), at −1 ("tustin"), or at 0 and below ("matched"), which no real continuous model has.

    Examples
    --------
    >>> import deadtime
    >>> sampled = deadtime.c2d(([1.0], [1.0, 1.0]), 0.1)
    >>> round(float(deadtime.d2c(sampled).A[0, 0]), 6)
    -1.0
    """
    return _native._d2c(as_system(system), method)


def conversions() -> list[dict[str, Any]]:
    """The conversions that `c2d` knows: name, summary, and options with their defaults.

    Examples
    --------
    >>> import deadtime
    >>> [conversion["name"] for conversion in deadtime.conversions()]
    ['zoh', 'foh', 'impulse', 'tustin', 'gbt', 'euler', 'backward_diff', 'matched', 'least_squares']
    """
    return _native._conversions()


def uav(name: str | None = None) -> Model:
    """The quadrotor of the thesis that this project started from, about hover, as a model.

    Parameters
    ----------
    name : str, optional
        lateral, longitudinal, directional or vertical. Without it the whole vehicle: nine states, four inputs, six outputs.

    Examples
    --------
    >>> import deadtime
    >>> deadtime.uav("lateral").states
    ['v', 'p', 'phi']
    """
    return _native._uav(name)


def effects(model: ModelLike | None = None) -> list[dict[str, Any]]:
    """The effects that a simulator may lack.

    Parameters
    ----------
    model : ModelLike, optional
        Without it all effects in general: site, effect, channels (in words), parameters with their units, summary. With a model every channel of it on
        which each effect can act: site, effect, channel, parameters with their units, nominal values and bounds (None: without bound). Effects on the
        dynamics need a continuous model.

    Examples
    --------
    >>> import deadtime
    >>> [effect["channel"] for effect in deadtime.effects(deadtime.uav("lateral")) if effect["effect"] == "input_delay"]
    ['delta_lat']
    """
    return _native._effects(None if model is None else as_model(model))


# Responses


@dataclass(frozen=True, eq=False)
class Response:
    """A simulated response. It unpacks as scipy's, `time, y, x = lsim(…)`.

    Attributes
    ----------
    time : array, shape (N,)
        s.
    u : array, shape (N,) or (N, m)
        The input as it was given.
    y : array, shape (N, p), or (N,) where the system has one output
        The outputs.
    x : array, shape (N, n)
        The states.
    """

    time: Array
    u: Array
    y: Array
    x: Array

    def __iter__(self) -> Iterator[Array]:
        return iter((self.time, self.y, self.x))

    def __repr__(self) -> str:
        end = f"{self.time[0]:g} to {self.time[-1]:g} s" if len(self.time) else "no time"
        return f"<Response: {len(self.time)} samples, {end}; y {self.y.shape}, x {self.x.shape}>"


def lsim(
    system: SystemLike,
    u: ArrayLike,
    time: ArrayLike | None = None,
    sample_time: float | None = None,
    x0: ArrayLike | None = None,
    hold: Hold = "zero",
    prehistory: Literal["held", "rest"] = "held",
) -> Response:
    """The response of a linear system to an input: exact at the samples, delays of any size included.

    Parameters
    ----------
    system : SystemLike
        Continuous or sampled, whatever `as_system` takes.
    u : array_like, shape (N,) or (N, m)
        The input, samples first.
    time : array_like, shape (N,), optional
        s, increasing, even or uneven; a sampled system needs its own grid.
    sample_time : float, optional
        s: for an even grid from 0 on. A continuous system needs this or `time`.
    x0 : array_like, shape (n,), optional
        The state at the first sample; 0 without it.
    hold : "zero" or "linear"
        Between samples the input is held, or runs in straight lines; without meaning for a sampled system.
    prehistory : "held" or "rest"
        What a delayed input still sees from before the first sample: u[0], or 0.

    Raises
    ------
    SimulateError
        Shapes that do not fit, an input that is not finite, a time that does not increase, a state that leaves the range of numbers.

    Examples
    --------
    A step on 1/(s + 1): 1 − e^(−t).

    >>> import deadtime
    >>> deadtime.lsim(([1.0], [1.0, 1.0]), [1.0, 1.0, 1.0], sample_time=0.5).y.round(6)
    array([0.      , 0.393469, 0.632121])
    """
    ours = as_system(system)
    signal = numpy.asarray(u, dtype=float)
    if signal.ndim not in (1, 2):
        raise ValueError(f"u has {signal.ndim} dimensions; it has one, or two for several inputs: samples, then inputs")
    if time is None and sample_time is None and ours.sample_time is None:
        raise ValueError("a continuous system needs time or sample_time")
    if time is not None and sample_time is not None:
        raise ValueError("give time or sample_time, not both")
    stamps = None if time is None else numpy.asarray(time, dtype=float)
    y, x = _native._lsim(ours, signal[:, None] if signal.ndim == 1 else signal, stamps, sample_time, x0, hold, prehistory)
    if stamps is None:
        stamps = _grid(len(signal), sample_time or ours.sample_time or 1.0)
    return Response(stamps, signal, y[:, 0] if ours.outputs == 1 else y, x)


def step_response(
    system: SystemLike, duration: float | None = None, sample_time: float | None = None, x0: ArrayLike | None = None
) -> TimeResponse:
    """The response to a step of each input from 0 to 1 at time 0, from rest, delays included.

    Parameters
    ----------
    system : SystemLike
        Continuous or sampled.
    duration : float, optional
        s. Without it as long as the slowest motion needs to settle, or an unstable one to grow a thousandfold.
    sample_time : float, optional
        s, of the result for a continuous system; without it a five-hundredth of the duration. A sampled system has its own.
    x0 : array_like, shape (n,), optional
        The state at time 0, whose free motion adds to the response to every input; from rest without it.

    Examples
    --------
    1/(s + 1): 1 − e^(−t).

    >>> import deadtime
    >>> deadtime.step_response(([1.0], [1.0, 1.0]), 1.0, 0.5).y.round(6)
    array([0.      , 0.393469, 0.632121])
    """
    return _response(as_system(system), duration, sample_time, StateSpace._step_response, x0)


def impulse_response(
    system: SystemLike, duration: float | None = None, sample_time: float | None = None, x0: ArrayLike | None = None
) -> TimeResponse:
    """The response to an impulse of unit area at each input at time 0, from rest or from `x0`, delays included.

    The arguments `system`, `duration` (s) and `sample_time` (s) are those of `step_response`.

    In continuous time the impulse that a direct path passes on is not shown, and the value at the impulse is the one right after it. In sampled time
    the pulse is one sample long and 1/sample_time high, as MATLAB and python-control have it: the Markov parameters over the sample time.

    Examples
    --------
    1/(s + 1): e^(−t).

    >>> import deadtime
    >>> deadtime.impulse_response(([1.0], [1.0, 1.0]), 1.0, 0.5).y.round(6)
    array([1.      , 0.606531, 0.367879])
    """
    return _response(as_system(system), duration, sample_time, StateSpace._impulse_response, x0)


def _response(system: StateSpace, duration: float | None, sample_time: float | None, response: Any, x0: ArrayLike | None) -> TimeResponse:
    step = system.sample_time if sample_time is None else sample_time
    if duration is None:
        duration = _settling(system) if step is None else max(_settling(system), 10 * step)
    if not (numpy.isfinite(duration) and duration >= 0):
        raise ValueError(f"duration is {duration} s; it is a finite number of seconds, 0 or more")
    if step is None:
        step = duration / 500 if duration > 0 else 1.0
    # A last sample that only rounding puts behind the end belongs to it.
    samples = int(numpy.floor(duration / step * (1 + 1e-12) + 1e-9)) + 1 if step > 0 else 1
    y = response(system, step, samples)
    if x0 is not None:
        still = numpy.zeros((samples, system.inputs))
        y = y + _native._lsim(system, still, None, step, x0, "zero", "rest")[0][:, :, None]
    return TimeResponse(_grid(samples, step), y[:, 0, 0] if y.shape[1:] == (1, 1) else y)


def _grid(samples: int, step: float) -> Array:
    """Time stamps from 0 on, s."""
    return numpy.arange(samples, dtype=numpy.float64) * step


def _settling(system: StateSpace) -> float:
    """How long a response is worth looking at, s: seven time constants of the slowest pole, after the longest delay."""
    poles = system.poles()
    if system.sample_time is not None:
        with numpy.errstate(divide="ignore"):
            rates = numpy.abs(numpy.log(numpy.abs(poles))) / system.sample_time
    else:
        rates = numpy.abs(poles.real)
    # An integrator has no time constant; the other poles decide.
    sizes = numpy.abs(poles) if system.sample_time is None else numpy.ones(len(poles)) / system.sample_time
    moving = rates[numpy.isfinite(rates) & (rates > 1e-6 * sizes)]
    slowest = 7.0 / moving.min() if moving.size else 10.0 * (system.sample_time or 1.0)
    return float(slowest + system.input_delay.max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Simulation:
    """What a model says to the inputs of a log.

    Attributes
    ----------
    log : Log
        The log's time and inputs with the simulated outputs, and the states where they were asked for.
    nrmse : dict of str to float or None
        Of every output that the log has too: rms(measured − simulated)/std(measured); None where the measurement stands still or has no sample.
    """

    log: Log
    nrmse: dict[str, float | None]

    def __repr__(self) -> str:
        errors = ", ".join(f"{name} {'none' if value is None else format(value, '.4f')}" for name, value in self.nrmse.items())
        return f"<Simulation {self.log.source}: {len(self.log)} samples; nrmse {errors or 'of no output'}>"


def simulate(
    model: ModelLike,
    log: LogLike,
    hold: Hold = "zero",
    delay: Mapping[str, float] | None = None,
    states: bool = False,
    snr: float | None = None,
    seed: int = 1,
) -> Simulation:
    """Simulates a model with its effects on the inputs of a log, and compares the outputs that the log has.

    Parameters
    ----------
    model : ModelLike
        Whatever `as_model` takes.
    log : LogLike
        Whatever `as_log` takes: its channels are called as the model's inputs.
    hold : "zero" or "linear"
        Between samples the inputs are held, or run in straight lines.
    delay : dict of str to float, optional
        Delays by input, s, added to the model's own.
    states : bool
        Put the states into the simulated log too.
    snr : float, optional
        Add white noise to every simulated signal, at this ratio of variances.
    seed : int
        Of all chance: the noise, the losses of `dropped_commands` and the delays of `delay_jitter`.

    Raises
    ------
    SimulateError, EffectError, LogError, ModelError
        What stops the simulation.

    Examples
    --------
    The flight was made with a dead time of 0.13 s, and noise of a tenth of the motion:

    >>> import deadtime
    >>> late = deadtime.simulate("examples/uav_lateral_stabilised.toml", "examples/uav_flight.csv", delay={"r": 0.13})
    >>> {name: round(error, 1) for name, error in late.nrmse.items()}
    {'p': 0.1, 'ay': 0.1}
    """
    return Simulation(*_native._simulate(as_model(model), as_log(log), hold, list((delay or {}).items()), states, snr, seed))


# Optimal gains


class Lqr(NamedTuple):
    """A linear-quadratic regulator."""

    #: The gain of u = −K x, shape (m, n).
    K: Array
    #: The stabilising solution of the Riccati equation, shape (n, n).
    S: Array
    #: The poles of A − B K, shape (n,).
    E: ComplexArray


def dlqr(*arguments: Any, N: ArrayLike | None = None) -> Lqr:
    """The gain K that minimises Σ xᵀQx + uᵀRu + 2xᵀNu over x[k+1] = A x[k] + B u[k] by u = −K x: `dlqr(A, B, Q, R, N)` or `dlqr(system, Q, R, N)`.

    Parameters
    ----------
    *arguments
        A (n, n), B (n, m), Q, R and perhaps N; or a sampled system without delays, whatever `as_system` takes, in place of A and B.
    Q, R : array_like, shapes (n, n), (m, m)
        Symmetric; R positive definite, or singular where every input moves a state that costs.
    N : array_like, shape (n, m), optional
        The cross term; 0 without it.

    Returns
    -------
    Lqr
        K, S and E, to be unpacked. The gain belongs to the state's realisation: two realisations of one transfer function have different gains.

    Raises
    ------
    ModelError
        Weights that are not symmetric or not positive, or the assumption that fails where there is no stabilising solution.

    Notes
    -----
    Structure-preserving doubling: Chu, Fan, Lin and Wang (2004), Int. J. Control 77(8), 767-788, doi:10.1080/00207170410001714988.

    Examples
    --------
    An integrator with equal weights has the golden ratio's inverse for its gain:

    >>> import deadtime
    >>> round(float(deadtime.dlqr([[1.0]], [[1.0]], [[1.0]], [[1.0]]).K[0, 0]), 6)
    0.618034
    """
    given = list(arguments)
    if N is not None:
        given.append(N)
    as_matrices = given and not isinstance(given[0], tuple) and not _is_system(given[0])
    needed = 4 if as_matrices else 3
    if not needed <= len(given) <= needed + 1:
        raise TypeError("dlqr takes (A, B, Q, R) or (system, Q, R), and perhaps N")
    if not as_matrices:
        system = as_system(given.pop(0))
        if system.sample_time is None:
            raise errors.ModelError("dlqr needs a sampled system; this one is continuous: convert it with c2d first")
        if system.input_delay.any():
            raise errors.ModelError("dlqr needs a system without delays: with_delays_as_states makes states of them, which Q then weighs too")
        given = [system.A, system.B, *given]
    a, b, q, r, *n = given
    return Lqr(*_native._dlqr(a, b, q, r, n[0] if n else None))


def _is_system(value: object) -> bool:
    ours = isinstance(value, StateSpace | TransferFunction | Model)
    return ours or _is(value, "control", "StateSpace", "TransferFunction") or _is(value, "scipy.signal", "lti", "dlti")


def dare(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None = None, E: ArrayLike | None = None) -> Array:
    """The stabilising solution X of AᵀXA − EᵀXE − (AᵀXB + N)(R + BᵀXB)⁻¹(BᵀXA + Nᵀ) + Q = 0.

    Arguments as of `dlqr`; N is what scipy and MATLAB's `idare` call S, and E, shape (n, n), regular, is the identity without it. R may be singular where
    R + BᵀXB is not.

    Returns
    -------
    array, shape (n, n)
        Symmetric.

    Examples
    --------
    An integrator with equal weights has the golden ratio for its solution:

    >>> import deadtime
    >>> round(float(deadtime.dare([[1.0]], [[1.0]], [[1.0]], [[1.0]])[0, 0]), 6)
    1.618034
    """
    return _native._dare(A, B, Q, R, N) if E is None else _native._gdare(A, B, Q, R, N, E)


# Neighbours


def to_control(system: SystemLike) -> control.StateSpace:
    """The system as a `control.StateSpace`; whole samples of delay become states.

    Raises
    ------
    ImportError
        python-control is not installed.
    ValueError
        A delay in continuous time, which python-control's systems do not have.

    Examples
    --------
    >>> import deadtime
    >>> float(deadtime.to_control(([2.0], [1.0, 3.0])).poles()[0].real)
    -3.0
    """
    import control

    ours = as_system(system).with_delays_as_states()
    return control.StateSpace(ours.A, ours.B, ours.C, ours.D, ours.sample_time or 0)


def to_scipy(system: SystemLike) -> scipy.signal.StateSpace:
    """The system as a `scipy.signal.StateSpace`; errors and delays as of `to_control`.

    Examples
    --------
    >>> import deadtime
    >>> float(deadtime.to_scipy(([2.0], [1.0, 3.0])).A[0, 0])
    -3.0
    """
    import scipy.signal

    ours = as_system(system).with_delays_as_states()
    sampled = {} if ours.sample_time is None else {"dt": ours.sample_time}
    return scipy.signal.StateSpace(ours.A, ours.B, ours.C, ours.D, **sampled)
