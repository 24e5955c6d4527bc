"""Small pictures as SVG: curves over one axis, and points on a line. White paper, so that they read on a dark page, too."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

INK, GREY, RED, BLUE, LINE = "#1b1f24", "#6b7684", "#c2410c", "#1d5fbf", "#d5dae0"
FONT = "font-family='sans-serif' font-size='13'"


def picture(width: int, height: int, title: str, parts: Sequence[str]) -> str:
    head = f"<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='{height}' viewBox='0 0 {width} {height}' role='img' aria-label='{escape(title, quote=True)}'>"
    return "\n".join([head, f"<title>{escape(title)}</title>", f"<rect width='{width}' height='{height}' fill='#fff'/>", *parts, "</svg>", ""])


def text(x: float, y: float, words: str, anchor: str = "start", colour: str = INK) -> str:
    """Words at a place."""
    return f"<text x='{x:.1f}' y='{y:.1f}' text-anchor='{anchor}' fill='{colour}' {FONT}>{escape(words)}</text>"


def ticks(low: float, high: float) -> list[float]:
    """About five round numbers."""
    step = 10 ** math.floor(math.log10(max(high - low, 1e-12) / 4))
    step *= next(m for m in (1, 2, 5, 10) if (high - low) / (m * step) <= 6)
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def _number(value: float) -> str:
    return f"{value:g}" if abs(value) > 1e-12 else "0"


def curves(title: str, time: Sequence[float], lines: Sequence[tuple[str, Sequence[float], str, str]], unit: str, width: int = 760, height: int = 260) -> str:
    """Curves over time: (name, values, colour, dash pattern)."""
    left, right, top, bottom = 52, 12, 34, 38
    low, high = min(min(v) for _, v, _, _ in lines), max(max(v) for _, v, _, _ in lines)
    pad = 0.06 * (high - low) or 1.0
    low, high = low - pad, high + pad

    def across(t: float) -> float:
        return left + (width - left - right) * (t - time[0]) / (time[-1] - time[0])

    def up(v: float) -> float:
        return height - bottom - (height - top - bottom) * (v - low) / (high - low)

    parts = []
    for v in ticks(low, high):
        parts += [f"<path d='M{left} {up(v):.1f}H{width - right}' stroke='{LINE}'/>", text(left - 6, up(v) + 4, _number(v), "end", GREY)]
    for t in ticks(time[0], time[-1]):
        parts.append(text(across(t), height - bottom + 18, _number(t), "middle", GREY))
    parts.append(text(width - right, height - 4, f"seconds; upwards: {unit}", "end", GREY))
    at = left
    for name, values, colour, dash in lines:
        points = " ".join(f"{across(t):.1f},{up(v):.1f}" for t, v in zip(time, values, strict=True))
        pattern = f" stroke-dasharray='{dash}'" if dash else ""
        parts.append(f"<polyline points='{points}' fill='none' stroke='{colour}' stroke-width='2'{pattern}/>")
        parts += [f"<path d='M{at} 18h26' stroke='{colour}' stroke-width='3'{pattern}/>", text(at + 32, 22, name)]
        at += 60 + round(8 * len(name))
    return picture(width, height, title, parts)


def standing(title: str, groups: Sequence[tuple[str, float | None, Sequence[float]]], width: int = 760) -> str:
    """Where one value stands among others, on logarithmic lines: (name, its value, the others' values)."""
    every = [v for _, own, others in groups for v in [own, *others] if v is not None]
    low, high = math.floor(math.log10(max(min(every), 0.01))), math.ceil(math.log10(max(every)))
    left, right, step = 150, 20, 46
    height = 20 + step * len(groups) + 40

    def across(v: float) -> float:
        return left + (width - left - right) * (math.log10(max(v, 0.01)) - low) / (high - low)

    parts = []
    for power in range(low, high + 1):
        x, mark = across(10.0**power), "0.01 or less" if power == -2 else f"{10.0**power:g}"
        parts += [f"<path d='M{x:.1f} 12V{height - 40}' stroke='{LINE}'/>", text(x, height - 22, mark, "middle", GREY)]
    for row, (name, own, others) in enumerate(groups):
        y = 34 + step * row
        parts.append(text(left - 12, y + 4, name, "end"))
        parts += [f"<circle cx='{across(v):.1f}' cy='{y}' r='5' fill='none' stroke='{GREY}'/>" for v in others]
        if own is None:
            parts.append(text(width - right, y - 12, "no answer, or not made for it", "end", RED))
        else:
            parts.append(f"<circle cx='{across(own):.1f}' cy='{y}' r='7' fill='{RED}'/>")
            parts.append(text(across(own), y - 12, f"{own:.2f}", "middle", RED))
    parts.append(text(width - right, height - 4, "root mean square error, samples (logarithmic); grey: the other methods", "end", GREY))
    return picture(width, height, title, parts)
