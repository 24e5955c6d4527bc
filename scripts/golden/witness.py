"""What the cases of the estimators share: stored records, and the answer that a method is to give on one.

Every calculation here and in the modules that import it is written from the published formula, with dense matrices, direct sums or a general optimiser;
nothing is taken from the crate.
"""

import numpy as np
from scipy import signal

TOOL = "numpy 2.3.5, scipy 1.17.1"


def kept(stored: dict | None, name: str, make) -> tuple[np.ndarray, np.ndarray]:
    """The record `name` of the committed file, or a new one of `make`."""
    if stored is not None:
        record = stored["records"][name]
        return np.array(record["u"], dtype=float), np.array(record["y"], dtype=float)
    u, y = make()
    return np.round(u, 9), np.round(y, 9)


def as_records(**records) -> dict:
    return {name: {"u": u, "y": y} for name, (u, y) in records.items()}


def answer(method: str, record: str, max_delay: int, bias: int, options: dict | None = None, **expected) -> dict:
    """What `method` is to answer: `raw` and `delay` in samples (null: not compared), and how near (`within`, samples)."""
    case = {"id": method, "method": method, "record": record, "max_delay": max_delay, "bias": bias, "options": options or {}}
    return case | {"raw": None, "delay": None} | expected


def noisy(clean: np.ndarray, share: float, generator) -> np.ndarray:
    """Plus white noise of this share of its standard deviation."""
    return clean + share * np.std(clean) * generator.standard_normal(len(clean))


def binary(samples: int, generator) -> np.ndarray:
    return generator.choice([-1.0, 1.0], samples)


def lagged(series: np.ndarray, lags, rows: np.ndarray) -> np.ndarray:
    """Columns series[rows - lag]."""
    return np.column_stack([series[rows - lag] for lag in lags])


def shifted(series: np.ndarray, lag: int) -> np.ndarray:
    """`lag` samples later, zero before."""
    return np.concatenate([np.zeros(lag), series])[: len(series)]


def two_poles(u: np.ndarray, b: float, f, delay: int) -> np.ndarray:
    return signal.lfilter([0.0] * delay + [b], [1.0, *f], u)
