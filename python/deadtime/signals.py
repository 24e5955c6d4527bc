"""Signals: what excites a system, and the noise that a measurement adds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Literal, TypeAlias, overload

import numpy
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._native import Log
from .arguments import whole
from .delays import _flat, _plain

#: `white`; `{"ar": [a1, …]}` for noise through 1/A(q); `{"ar": […], "ma": [c1, …]}` for noise through C(q)/A(q). Coefficients begin at lag 1.
Colour: TypeAlias = 'Literal["white"] | Mapping[str, Sequence[float]]'


@overload
def excite(kind: str, samples: int, sample_time: float | None = None, *, seed: int = 1, channel: None = None, **options: Any) -> NDArray[numpy.float64]: ...


@overload
def excite(kind: str, samples: int, sample_time: float, *, seed: int = 1, channel: str, **options: Any) -> Log: ...


def excite(
    kind: str, samples: int, sample_time: float | None = None, *, seed: int = 1, channel: str | None = None, **options: Any
) -> NDArray[numpy.float64] | Log:
    """An excitation signal, the same numbers as `deadtime excite` writes.

    Parameters
    ----------
    kind : str
        Its name; `deadtime.excitations()` lists them with their options.
    samples : int
        Number of samples N.
    sample_time : float, optional
        Sample time, s; a log needs it, an array does not.
    seed : int
        Seed of the random signals: the same seed makes the same signal.
    channel : str, optional
        Makes a log of this one channel.
    **options
        Options of the signal, such as `band=[0, 0.3]` (as fractions of the Nyquist frequency) or `amplitude=0.01`.

    Returns
    -------
    array, shape (N,), or Log
        The signal; a `Log` where a channel was named.

    Raises
    ------
    RegistryError
        A name or option that there is not.
    SignalError
        An option out of its range, too few samples.

    Examples
    --------
    >>> import deadtime
    >>> deadtime.excite("doublet", 6, at=1, width=2)
    array([ 0.,  1.,  1., -1., -1.,  0.])
    """
    values = _signal(kind, samples, seed, options)
    if channel is None:
        return values
    if sample_time is None:
        raise ValueError("a log has a time: give sample_time with channel")
    return _native._of_channel(channel, values, sample_time)


def _signal(kind: str, samples: int, seed: int, options: Mapping[str, Any]) -> NDArray[numpy.float64]:
    return _native._excite(kind, whole("samples", samples, 0), whole("seed", seed, 0), _plain({kind: options})[kind])


@dataclass(frozen=True)
class Excitation:
    """One excitation of the list. Called, it makes the signal.

    Attributes
    ----------
    name : str
        Its name.
    summary : str
        What it is, in one line.
    options : dict
        Its options with their defaults.
    """

    name: str
    summary: str
    options: dict[str, Any]

    def __call__(self, samples: int, *, seed: int = 1, **options: Any) -> NDArray[numpy.float64]:
        """The signal, as `deadtime.excite` makes it."""
        return _signal(self.name, samples, seed, options)


class Excitations(dict[str, Excitation]):
    """The excitations by name."""

    def __repr__(self) -> str:
        width = max((len(name) for name in self), default=0)
        return "\n".join(f"{name:<{width}}  {e.summary}; {e.options}" for name, e in self.items())

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><td>{escape(e.name)}</td><td>{escape(e.summary)}</td><td>{escape(str(e.options))}</td></tr>" for e in self.values())
        return f"<table><thead><tr><th>signal</th><th>what it is</th><th>options</th></tr></thead><tbody>{rows}</tbody></table>"


def excitations() -> Excitations:
    """Every excitation there is, by name: a dict whose values describe it and can be called.

    Examples
    --------
    >>> import deadtime
    >>> deadtime.excitations()["step"].options["at"]
    10
    """
    return Excitations((e["name"], Excitation(e["name"], e["summary"], e["options"])) for e in _native._excitations())


def add_noise(
    signal: ArrayLike, snr: float, colour: Colour = "white", *, seed: int = 1, scaling: Literal["expected", "realised"] = "expected"
) -> NDArray[numpy.float64]:
    """A signal plus Gaussian noise at a signal-to-noise ratio.

    Parameters
    ----------
    signal : array, shape (N,)
        The signal without noise; it must vary.
    snr : float
        var(signal)/var(noise): a ratio of variances and not decibels, above 0; infinite means no noise.
    colour : "white", or dict
        The noise's spectrum: `{"ar": [a1, …]}` is noise through 1/(1 + a1·q⁻¹ + …), `{"ar": […], "ma": [c1, …]}` through (1 + c1·q⁻¹ + …)/(1 + a1·q⁻¹ + …).
    seed : int
        Seed: the same seed makes the same noise.
    scaling : {"expected", "realised"}
        Whether the ratio holds for the process' variance, or exactly for the very record drawn.

    Returns
    -------
    array, shape (N,)
        The signal with noise, in the signal's unit.

    Raises
    ------
    SignalError
        A signal that does not vary or is not finite, a ratio that is not above 0, noise whose filter is unstable.

    References
    ----------
    S. Björklund (2003), LiU-TEK-LIC-2003:60: this definition of the ratio.

    Examples
    --------
    Four times as much variance in the signal as in the noise:

    >>> import deadtime, numpy
    >>> signal = deadtime.excite("rbs", 200, seed=1)
    >>> noisy = deadtime.add_noise(signal, 4.0, scaling="realised")
    >>> round(float(numpy.var(signal) / numpy.var(noisy - signal)), 6)
    4.0
    """
    noise: dict[str, Any] = _plain({"noise": {"colour": _spectrum(colour), "scaling": scaling}})["noise"]
    return _native._add_noise(_flat(signal, "signal"), snr, noise, whole("seed", seed, 0))


def _spectrum(colour: Colour) -> Any:
    if isinstance(colour, str):
        if colour != "white":
            raise ValueError(f'colour {colour!r}: give "white", {{"ar": [...]}} or {{"ar": [...], "ma": [...]}}')
        return colour
    if not set(colour) <= {"ar", "ma"} or not colour:
        raise ValueError(f'colour {dict(colour)!r}: give "white", {{"ar": [...]}} or {{"ar": [...], "ma": [...]}}')
    ar = [float(a) for a in colour.get("ar", [])]
    if "ma" in colour:
        return {"arma": {"ar": ar, "ma": [float(c) for c in colour["ma"]]}}
    return {"ar": {"coefficients": ar}}
