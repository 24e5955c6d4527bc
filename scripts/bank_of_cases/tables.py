"""Scores of many cases, by group, and paired differences of two programs with bootstrap intervals."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from . import sets
from .judge import BINS, SCORES, Truth, judge, load

DRAWS, SEED = 2000, 1
WIDTH = {"ratio": 2, "calibration": 3 * BINS, "median": 1, "longest": 1}
TRAITS = ("linear", "equations", "sampled", "predictor", "closed loop")


def judged(answers: dict[str, dict], drawn: Path) -> dict[str, tuple[Truth, dict[str, list[float]]]]:
    """Truth and judgement of every answered case that is drawn."""
    truths = {name: load(drawn / name) for name in answers if (drawn / name).is_dir()}
    return {name: (truth, judge(answers[name], truth)) for name, truth in truths.items()}


def _rows(cases: list[dict], score: str) -> np.ndarray:
    """[cases, sums] of a score, NaN or 0 where a case has no part in it."""
    kind = SCORES[score][0]
    absent = [np.nan if kind in ("median", "longest") else 0.0] * WIDTH[kind]
    return np.array([case.get(score, absent) for case in cases]).reshape(len(cases), WIDTH[kind])


def _value(rows: np.ndarray, score: str) -> np.ndarray:
    """The score of [..., cases, sums]; NaN where no case has a part in it."""
    kind = SCORES[score][0]
    with np.errstate(all="ignore"):
        if kind in ("median", "longest"):
            values = np.ma.masked_invalid(rows[..., 0])
            return (np.ma.median(values, axis=-1) if kind == "median" else values.max(axis=-1)) + 0.0
        sums = rows.sum(axis=-2)
        if kind == "ratio":
            return sums[..., 0] / sums[..., 1]
        bins = sums.reshape(*sums.shape[:-1], BINS, 3)
        return np.abs(bins[..., 1] - bins[..., 2]).sum(axis=-1) / bins[..., 0].sum(axis=-1)


def _plain(value) -> float:
    return float(np.ma.filled(np.ma.asarray(value, dtype=float), np.nan))


def _number(value: float) -> str:
    return "–" if not np.isfinite(value) else f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"


def _parts(truths: dict[str, Truth], by: str) -> dict[str, list[str]]:
    """The cases of each column: groups or traits, then all."""
    belongs: Callable[[str, str], bool] = (lambda n, g: truths[n].group == g) if by == "group" else (lambda n, t: t in truths[n].traits)
    parts = {key: [n for n in truths if belongs(n, key)] for key in (sets.GROUPS if by == "group" else TRAITS)}
    return {key: names for key, names in parts.items() if names} | {"all": list(truths)}


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table that is aligned for a terminal, too."""
    widths = [max(len(row[k]) for row in [head, *rows]) for k in range(len(head))]
    lines = ["| " + " | ".join(cell.ljust(w) if k == 0 else cell.rjust(w) for k, (cell, w) in enumerate(zip(row, widths))) + " |" for row in [head, *rows]]
    return "\n".join([lines[0], "| " + " | ".join("-" * w if k == 0 else "-" * (w - 1) + ":" for k, w in enumerate(widths)) + " |", *lines[1:]])


def scores(answers: dict[str, dict], drawn: Path, by: str = "group") -> str:
    """The table of scores: a row for each, a column for each group or trait."""
    found = judged(answers, drawn)
    parts = _parts({name: truth for name, (truth, _) in found.items()}, by)
    rows = [["cases", *(str(len(names)) for names in parts.values())]]
    for score in SCORES:
        rows.append([score, *(_number(_plain(_value(_rows([found[n][1] for n in names], score), score))) for names in parts.values())])
    return markdown(["score", *parts], rows)


def values(answers: dict[str, dict], drawn: Path, names: tuple[str, ...]) -> list[str]:
    """Some scores of all cases."""
    cases = [judgement for _, judgement in judged(answers, drawn).values()]
    return [_number(_plain(_value(_rows(cases, score), score))) for score in names]


def summary(answers: dict[str, dict], drawn: Path) -> str:
    """The scores of all cases in one line."""
    cases = [judgement for _, judgement in judged(answers, drawn).values()]
    return ", ".join(f"{score} {_number(_plain(_value(_rows(cases, score), score)))}" for score in SCORES)


def compare(old: dict[str, dict], new: dict[str, dict], drawn: Path, by: str = "group") -> str:
    """Paired differences of the cases that both have: new less old, with the percentile interval of a bootstrap over cases."""
    both = [name for name in old if name in new]
    stored = {name: sets.sums(name) for name in sets.SEEDS}
    digest = [{n: of[n].get("drawn", stored.get(of[n].get("set"), {}).get(n)) for n in both} for of in (old, new)]
    if other := [n for n in both if digest[0][n] != digest[1][n]]:
        sys.exit(f"{len(other)} cases were drawn differently for the two programs, first {other[0]}: run both on one draw")
    before, after = (judged({n: answers[n] for n in both}, drawn) for answers in (old, new))
    parts, rows = _parts({name: truth for name, (truth, _) in before.items()}, by), []
    for part, names in parts.items():
        picks = np.random.default_rng(SEED).integers(len(names), size=(DRAWS, len(names)))
        for score, (_, better, _) in SCORES.items():
            one, other = (_rows([found[n][1] for n in names], score) for found in (before, after))
            values = [_plain(_value(rows_of, score)) for rows_of in (one, other)]
            if not np.any(np.isfinite(values)):
                continue
            drawn_differences = np.ma.filled(np.ma.asarray(_value(other[picks], score) - _value(one[picks], score)), np.nan)
            drawn_differences = drawn_differences[np.isfinite(drawn_differences)]
            low, high = np.quantile(drawn_differences, (0.025, 0.975)) if len(drawn_differences) else (np.nan, np.nan)
            changed = sum(a.get(score) != b.get(score) for a, b in ((before[n][1], after[n][1]) for n in names))
            word = "" if not (low > 0 or high < 0) else "better" if (low > 0) == (better > 0) else "WORSE"
            rows.append([part, score, str(len(names)), str(changed), *(_number(v) for v in (*values, values[1] - values[0])), f"{_number(low)} … {_number(high)}", word])
    return f"{len(before)} cases that both have\n\n" + markdown(["cases", "score", "of", "changed", "old", "new", "difference", "95 % interval", ""], rows)
