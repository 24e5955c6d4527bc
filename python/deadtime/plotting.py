"""Figures, with matplotlib, which is loaded when the first one is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .delays import Estimate, Estimates, Pair, _Response

#: Standard deviations that the band around an impulse response shows, as `threshold` has by default.
_BAND = 5.0
#: As many methods as a person reads at a glance.
_A_HANDFUL = 8


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


def estimates(result: Estimates) -> Figure:
    """Every method's dead time with its interval above the estimated impulse response, pair by pair.

    Parameters
    ----------
    result : Estimates
        The answers.
    """
    heights: list[float] = []
    responses = [result._response(pair) for pair in result.pairs]
    for pair, response in zip(result.pairs, responses, strict=True):
        heights.append(0.9 + 0.24 * max(len(_shown(pair)), 2))
        if response is not None:
            heights.append(2.3)
    drawn = figure(9.0, max(sum(heights), 1.0))
    if not heights:
        return drawn
    axes = iter(drawn.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0])
    for pair, response in zip(result.pairs, responses, strict=True):
        reaches = [max(e.ci95_s[1], e.raw_delay_s) for e in _shown(pair) if e.counts and e.ci95_s is not None and e.raw_delay_s is not None]
        longest = max([4.0 * result.sample_time_s, *reaches])
        # Both parts share one time axis, so that a delay stands above the sample where the response begins.
        span = (-0.05 * longest, 2.5 * longest)
        _answers(next(axes), pair, span)
        if response is not None:
            _impulse(next(axes), response, span)
    return drawn


def _shown(pair: Pair) -> list[Estimate]:
    """The answers that are drawn: of many methods those that have a delay."""
    return [e for e in pair.estimates if len(pair.estimates) <= _A_HANDFUL or e.delay_s is not None]


def _answers(axis: Axes, pair: Pair, span: tuple[float, float]) -> None:
    """One line per method: the interval as a bar, the dead time as a dot; the verdict as a band behind them."""
    shown = _shown(pair)
    if pair.verdict.delay_s is not None and pair.verdict.ci95_s is not None:
        axis.axvspan(*pair.verdict.ci95_s, color="#e1ecf7", zorder=0)
        axis.axvline(pair.verdict.delay_s, color="#5a8cbe", linewidth=1, zorder=1)
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


def _impulse(axis: Axes, response: _Response, span: tuple[float, float]) -> None:
    """The coefficients as stems, their threshold as a band."""
    lag, height, std = (part[response[0] <= span[1]] for part in response)
    outside = numpy.abs(height) > _BAND * std
    axis.fill_between(lag, -_BAND * std, _BAND * std, color="#cdcdcd", linewidth=0)
    for which, colour in ((outside, "#c83c28"), (~outside, "#464646")):
        axis.vlines(lag[which], 0.0, height[which], color=colour, linewidth=1.5)
        axis.plot(lag[which], height[which], "o", color=colour, markersize=3)
    axis.set_title(f"estimated impulse response; grey: {_BAND:g} standard deviations (the dead time ends before the first stem outside)", fontsize=9)
    axis.set(xlim=span, xlabel="seconds")
