"""Case delays_events: the five criteria of Kekäläinen (2019) over all offsets, and the delay of the events paired by time."""

import numpy as np

from .discretise import assert_close
from .witness import TOOL

EVENTS, DELAY, WINDOW = 120, 3.4, 8.0
LEAST = 10


def sequences(missed: bool):
    generator = np.random.default_rng(55 if missed else 54)
    first = 5 + np.cumsum(generator.uniform(0.5, 1.5, EVENTS))
    second = first + DELAY + 0.01 * generator.standard_normal(EVENTS)
    if missed:
        first, second = np.delete(first, [100]), np.delete(second, [108, 115])
    return np.round(first, 9), np.round(second, 9)


CRITERIA = {
    "event_average_difference": lambda delay, a, b: np.mean(np.abs(b - a)),
    "event_quadratic_difference": lambda delay, a, b: np.mean((b - a) ** 2),
    "event_variance_difference": lambda delay, a, b: np.mean((b - a) ** 2) - np.mean(b - a) ** 2,
    "event_delay_variance": lambda delay, a, b: np.mean(delay**2) - np.mean(delay) ** 2,
    "event_correlation": lambda delay, a, b: -(np.mean(a * b) - np.mean(a) * np.mean(b)) / np.sqrt((np.mean(a * a) - np.mean(a) ** 2) * (np.mean(b * b) - np.mean(b) ** 2)),
}


def pairs(first, second, k):
    """t(i) and T(i + k) of all i that have both."""
    both = [(first[i], second[i + k]) for i in range(len(first)) if 0 <= i + k < len(second)]
    return np.array(both).reshape(-1, 2)


def raw(first, second, criterion) -> tuple[int, float]:
    """Best offset and its mean delay, of offsets whose mean delay lies in the window (half an interval beside it)."""
    typical = np.median(np.diff(first))
    best = None
    for k in range(-len(first), len(second)):
        both = pairs(first, second, k)
        if len(both) <= LEAST:
            continue
        delay = both[:, 1] - both[:, 0]
        if not -0.5 * typical <= delay.mean() <= WINDOW + 0.5 * typical:
            continue
        value = criterion(delay, np.diff(both[:, 0]), np.diff(both[:, 1]))
        if best is None or value < best[0]:
            best = (value, k, float(delay.mean()))
    return best[1:]


def by_time(first, second, k) -> float:
    """Each event with the nearest one about the typical delay of the half whose intervals agree most, within a quarter of an interval; strays left out."""
    both = pairs(first, second, k)
    apart = np.abs(np.diff(both[:, 1]) - np.diff(both[:, 0]))
    agree = np.argsort(apart, kind="stable")[: (len(apart) + 1) // 2]
    typical = np.median((both[1:, 1] - both[1:, 0])[agree])
    gate = 0.25 * np.median(np.diff(first))
    delays = []
    for t in first:
        nearest = second[np.argmin(np.abs(second - t - typical))]
        if abs(nearest - t - typical) <= gate:
            delays.append(nearest - t)
    delays = np.array(delays)
    spread = np.median(np.abs(delays - np.median(delays))) / 0.6745
    return float(np.mean(delays[np.abs(delays - np.median(delays)) <= 6 * spread]))


def events(stored: dict | None) -> dict:
    if stored is None:
        records = {"all": sequences(False), "missed": sequences(True)}
    else:
        records = {name: (np.array(r["first"]), np.array(r["second"])) for name, r in stored["records"].items()}
    answers = []
    for record, (first, second) in records.items():
        for method, criterion in CRITERIA.items():
            k, mean = raw(first, second, criterion)
            delay = by_time(first, second, k)
            assert_close(delay, DELAY, 0.01, f"{method}, {record}")
            answers.append({"id": f"{method}, {record}", "method": method, "record": record, "raw": mean, "delay": delay})
    return {
        "tool": TOOL,
        "tolerance": {"default": 1e-10},
        "window_s": WINDOW,
        "records": {name: {"first": a, "second": b} for name, (a, b) in records.items()},
        "answers": answers,
    }
