"""Figures, with matplotlib, which is loaded when the first one is asked for."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .arrays import Array

#: Standard deviations that the band around an impulse response shows, as `threshold` has by default.
_BAND = 5.0
#: As many methods as a person reads at a glance.
_A_HANDFUL = 8
#: As many channels as one picture holds.
_CHANNELS = 12


@dataclass(frozen=True)
class Answer:
    """One method's dead time in a figure."""

    method: str
    outcome: str
    #: s.
    delay_s: float | None
    #: s.
    ci95_s: tuple[float, float] | None
    #: What the method's original definition returns, s.
    raw_delay_s: float | None
    #: It is used in the verdict.
    counts: bool


@dataclass(frozen=True)
class PairAnswers:
    """The dead times of one input and output in a figure."""

    input: str
    output: str
    answers: Sequence[Answer]
    #: The verdict, s.
    delay_s: float | None
    #: Its interval, s.
    ci95_s: tuple[float, float] | None
    #: Lags in s, coefficients of the impulse response, their standard deviations; None where there is none.
    response: tuple[Array, Array, Array] | None


def figure(width: float, height: float) -> Figure:
    """An empty figure.

    Parameters
    ----------
    width, height : float
        Size, inches.

    Raises
    ------
    ImportError
        matplotlib is not there, and how to get it.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as missing:
        raise ImportError("figures need matplotlib: pip install deadtime[plot]") from missing
    return Figure(figsize=(width, height), layout="constrained")


def image(draw: Callable[[], Figure], words: str) -> str:
    """A figure as an image inside HTML, for notebooks and saved pages alike; nothing where matplotlib is not there.

    Parameters
    ----------
    draw : callable
        Makes the figure.
    words : str
        What it shows, for who cannot see it.
    """
    bytes_ = io.BytesIO()
    try:
        from matplotlib import rc_context

        # A channel may be called `$a$`: names are text and no formulas.
        with rc_context({"text.parse_math": False}):
            draw().savefig(bytes_, format="png", dpi=80, facecolor="white")
    except ImportError:
        return ""
    data = base64.b64encode(bytes_.getvalue()).decode("ascii")
    return f'<img alt="{escape(words)}" style="max-width: 100%" src="data:image/png;base64,{data}">'


def folded(picture: str, rest: str) -> str:
    """A picture with the numbers folded away beneath it; the numbers alone where there is no picture."""
    return f"{picture}<details><summary>All numbers</summary>{rest}</details>" if picture else rest


def estimates(pairs: Sequence[PairAnswers], sample_time_s: float) -> Figure:
    """Every method's dead time with its interval above the estimated impulse response, pair by pair.

    Parameters
    ----------
    pairs : sequence of PairAnswers
        The answers, one entry per input and output.
    sample_time_s : float
        Sample time of the records, s.
    """
    heights: list[float] = []
    for pair in pairs:
        heights.append(0.9 + 0.24 * max(len(_shown(pair)), 2))
        if pair.response is not None:
            heights.append(2.3)
    drawn = figure(9.0, max(sum(heights), 1.0))
    if not heights:
        return drawn
    axes = iter(drawn.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0])
    for pair in pairs:
        reaches = [max(e.ci95_s[1], e.raw_delay_s) for e in _shown(pair) if e.counts and e.ci95_s is not None and e.raw_delay_s is not None]
        longest = max([4.0 * sample_time_s, *reaches])
        # Both parts share one time axis, so that a delay stands above the sample where the response begins.
        span = (-0.05 * longest, 2.5 * longest)
        _answers(next(axes), pair, span)
        if pair.response is not None:
            _impulse(next(axes), pair.response, span)
    return drawn


def _shown(pair: PairAnswers) -> list[Answer]:
    """The answers that are drawn: of many methods those that have a delay."""
    return [e for e in pair.answers if len(pair.answers) <= _A_HANDFUL or e.delay_s is not None]


def _answers(axis: Axes, pair: PairAnswers, span: tuple[float, float]) -> None:
    """One line per method: the interval as a bar, the dead time as a dot; the verdict as a band behind them."""
    shown = _shown(pair)
    if pair.delay_s is not None and pair.ci95_s is not None:
        axis.axvspan(*pair.ci95_s, color="#e1ecf7", zorder=0)
        axis.axvline(pair.delay_s, color="#5a8cbe", linewidth=1, zorder=1)
    for place, e in enumerate(shown):
        bar, dot = ("#282828", "#c83c28") if e.counts else ("#bebebe", "#969696")
        if e.delay_s is None or e.ci95_s is None:
            axis.annotate(e.outcome.replace("_", " "), (0.01, place), xycoords=("axes fraction", "data"), va="center", color="#6e6e6e", fontsize=8)
            continue
        axis.plot(e.ci95_s, (place, place), color=bar, linewidth=2.5, solid_capstyle="butt", zorder=2)
        axis.plot(e.delay_s, place, "o", color=dot, markersize=5, zorder=3)
    target = "the states" if pair.output == "*" else pair.output
    axis.set_title(f"{pair.input} to {target}: dead time by method, 95 % intervals (grey: not counted)", fontsize=10)
    axis.set_yticks(range(len(shown)), [e.method for e in shown], fontsize=8)
    axis.set(ylim=(max(len(shown), 1) - 0.5, -0.5), xlim=span, xlabel="seconds")


def _impulse(axis: Axes, response: tuple[Array, Array, Array], span: tuple[float, float]) -> None:
    """The coefficients as stems, their threshold as a band."""
    lag, height, std = (part[response[0] <= span[1]] for part in response)
    outside = numpy.abs(height) > _BAND * std
    axis.fill_between(lag, -_BAND * std, _BAND * std, color="#cdcdcd", linewidth=0)
    for which, colour in ((outside, "#c83c28"), (~outside, "#464646")):
        axis.vlines(lag[which], 0.0, height[which], color=colour, linewidth=1.5)
        axis.plot(lag[which], height[which], "o", color=colour, markersize=3)
    axis.set_title(f"estimated impulse response; grey: {_BAND:g} standard deviations (the dead time ends before the first stem outside)", fontsize=9)
    axis.set(xlim=span, xlabel="seconds")


def log(time: Array, channels: Mapping[str, Array], units: Mapping[str, str]) -> Figure:
    """The course of every channel, one above the other.

    Parameters
    ----------
    time : numpy.ndarray
        Time stamps, s.
    channels : dict of str to numpy.ndarray
        The channels by name; of more than twelve the first twelve are drawn.
    units : dict of str to str
        The units of those channels that have one.
    """
    names = list(channels)[:_CHANNELS]
    drawn = figure(9.0, 0.6 + 0.9 * max(len(names), 1))
    if not names:
        return drawn
    axes = drawn.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for axis, name in zip(axes, names, strict=True):
        axis.plot(time, channels[name], color="#1d5fbf", linewidth=0.8)
        unit = units.get(name)
        axis.set_ylabel(name if unit is None else f"{name}\n[{unit}]", fontsize=8, rotation=0, ha="right", va="center")
        axis.tick_params(labelsize=7)
    axes[-1].set_xlabel("time [s]", fontsize=8)
    return drawn


def isolability(effects: Sequence[Mapping[str, Any]], cosines: Array) -> Figure:
    """How alike the signatures of the visible effects are: dark squares off the diagonal are indistinguishable pairs.

    Parameters
    ----------
    effects : list of dict
        The candidates: `effect`, `channel` and `visible`.
    cosines : numpy.ndarray
        Cosines between their signatures, shape (E, E), in the same order.
    """
    seen = [k for k, effect in enumerate(effects) if effect["visible"]]
    names = [f"{effects[k]['effect']} {effects[k]['channel']}" for k in seen]
    drawn = figure(2.5 + 0.24 * max(len(seen), 4), 2.0 + 0.24 * max(len(seen), 4))
    if not seen:
        return drawn
    axis = drawn.subplots()
    shown = axis.imshow(numpy.abs(cosines[numpy.ix_(seen, seen)]), cmap="Blues", vmin=0.0, vmax=1.0)
    axis.set_xticks(range(len(seen)), names, rotation=90, fontsize=7)
    axis.set_yticks(range(len(seen)), names, fontsize=7)
    drawn.colorbar(shown, label="cosine between signatures (1: alike)", shrink=0.6)
    return drawn


def study(name: str, seed: int, cells: Sequence[Mapping[str, Any]]) -> Figure:
    """RMS error by method and its bound, and coverage of the 95 % intervals: a point per cell, a diamond at the median.

    Parameters
    ----------
    name : str
        The study's name.
    seed : int
        Its seed.
    cells : list of dict
        Its cells: `method`, `options`, `rms_samples`, `bound_rms_samples` and `coverage95`.
    """
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for cell in cells:
        options = "".join(f" {key}={value}" for key, value in cell["options"].items())
        groups.setdefault(cell["method"] + options, []).append(cell)
    names = list(groups)
    drawn = figure(11.0, 2.0 + 0.3 * len(names))
    axes = drawn.subplots(1, 2, sharey=True)
    # Without error at all there is no place on a logarithmic axis.
    seen = [c["rms_samples"] for c in cells if c["rms_samples"]]
    least = min(seen, default=1.0) / 2
    for row, group in enumerate(groups.values()):
        rms = [max(c["rms_samples"], least) for c in group if c["rms_samples"] is not None]
        limits = [c["bound_rms_samples"] for c in group if c["bound_rms_samples"]]
        held = [100 * c["coverage95"] for c in group if c["coverage95"] is not None]
        axes[0].plot(rms, [row] * len(rms), "o", color="C0", alpha=0.5, label="RMS error" if row == 0 else None)
        axes[0].plot(limits, [row] * len(limits), "|", color="C3", markersize=12, label="Cramér-Rao bound" if row == 0 else None)
        for axis, values in ((axes[0], rms), (axes[1], held)):
            if values:
                axis.plot([sorted(values)[len(values) // 2]], [row], "D", color="black", markersize=5)
        axes[1].plot(held, [row] * len(held), "o", color="C0", alpha=0.5)
    axes[0].set(xscale="log", xlabel="RMS error, samples (diamond: median of the cells)", yticks=range(len(names)), yticklabels=names)
    axes[0].set(ylim=(max(len(names), 1) - 0.5, -0.5))
    drawn.legend(*axes[0].get_legend_handles_labels(), loc="outside lower left", ncols=2)
    axes[1].axvline(95, color="C2", linestyle="--")
    axes[1].set(xlim=(-3, 103), xlabel="truth inside the 95 % interval, %")
    drawn.suptitle(f"{name}, seed {seed}")
    return drawn
