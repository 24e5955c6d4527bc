"""Residuals of a model with effects on several logs, the initial states integrated out, and a Levenberg-Marquardt fit of parameters.

Predictions are free simulations, or one-step predictions where a predictor gain is given. Residuals are divided by the noise's standard
deviation per output; a log's start is free under its prior (linearised), the same for every rival.
"""

from dataclasses import dataclass

import numpy as np

from .catalogue import bounds
from .simulate import Simulator

TOLERANCE = 1e-7  # of the integration inside fits; data are made at 1e-10


@dataclass
class Record:
    """One log: time [N] (s), commands u [N, nu], outputs y [N, ny] (NaN = missing), predictor gain or None, lost commands or None."""

    time: np.ndarray
    u: np.ndarray
    y: np.ndarray
    gain: np.ndarray | None = None
    drops: np.ndarray | None = None


class Problem:
    def __init__(self, model: dict, records: list[Record], sigma: np.ndarray, prior: np.ndarray, initial: list[float]):
        self.model, self.records, self.sigma, self.initial = model, records, sigma, np.array(initial, dtype=float)
        self.prior = np.maximum(np.asarray(prior, dtype=float), 1e-12)
        self.count = sum(int(np.isfinite(r.y).sum()) for r in records)
        self.bases: list[np.ndarray] | None = None

    def raw(self, record: Record, effects: list[dict], x0) -> np.ndarray:
        """Residuals [N, ny] in units of the noise."""
        run = Simulator(self.model, record.time, effects, list(x0), record.drops, tolerance=TOLERANCE, rng=np.random.default_rng(0))
        predicted = run.open_loop(record.u) if record.gain is None else run.predictor(record.u, record.y, record.gain)
        result = (record.y - predicted) / self.sigma
        result[~np.isfinite(record.y)] = 0.0
        return result

    def sensitivities(self, record: Record, effects: list[dict]) -> np.ndarray:
        """d residual / d start [N ny, n], starts in units of their prior."""
        def at(i, share):
            x0 = self.initial.copy()
            x0[i] += share * self.prior[i]
            return self.raw(record, effects, x0).ravel()

        if Simulator(self.model, record.time[:2], effects, drops=np.zeros((2, record.u.shape[1]))).linear:
            middle = at(0, 0.0)
            return np.array([at(i, 0.3) - middle for i in range(len(self.prior))]).T / 0.3
        return np.array([at(i, 0.3) - at(i, -0.3) for i in range(len(self.prior))]).T / 0.6

    def linearise(self, effects: list[dict]) -> None:
        """Takes the directions that a start can explain from the model with these effects."""
        self.bases = []
        for record in self.records:
            z = self.sensitivities(record, effects)
            stacked = np.vstack([z, np.eye(z.shape[1])])
            self.bases.append(np.linalg.qr(stacked)[0])

    def reduced(self, effects: list[dict]) -> np.ndarray:
        """Residuals of all logs after the best start (with the prior's own terms), one vector."""
        parts = []
        for record, basis in zip(self.records, self.bases):
            r = np.concatenate([self.raw(record, effects, self.initial).ravel(), np.zeros(len(self.initial))])
            parts.append(r - basis @ (basis.T @ r))
        return np.concatenate(parts)

    def rms(self, residual: np.ndarray) -> float:
        return float(np.sqrt(residual @ residual / self.count))

    def best_start(self, record: Record, effects: list[dict], turns: int = 2) -> np.ndarray:
        """The posterior mean of one log's start, Gauss-Newton."""
        x0 = self.initial.copy()
        z = self.sensitivities(record, effects)
        stacked = np.vstack([z, np.eye(len(x0))])
        for _ in range(turns):
            r = np.concatenate([self.raw(record, effects, x0).ravel(), (x0 - self.initial) / self.prior])
            x0 = x0 - self.prior * np.linalg.lstsq(stacked, r, rcond=None)[0]
        return x0


def _replaced(effects: list[dict], free: list[tuple[int, str]], values) -> list[dict]:
    changed = [{**item, "parameters": dict(item["parameters"])} for item in effects]
    for (index, name), value in zip(free, values):
        changed[index]["parameters"][name] = float(value)
    return changed


def free_parameters(effects: list[dict]) -> list[tuple[int, str]]:
    return [
        (i, name) for i, item in enumerate(effects) for name, value in item["parameters"].items()
        if value is not None and item["effect"] not in ("dropped_commands", "delay_jitter", "multi_rate") and name != "time"
    ]


def fit(problem: Problem, effects: list[dict], scales: list[float], good_enough: float = 0.0, hopeless: float = np.inf, turns: int = 15):
    """Effects with fitted parameters and the rms residual. `scales`: size of each free parameter, for steps and damping.

    Stops below `good_enough`, or when after four steps it is still above `hopeless` (rms, units of the noise).
    """
    free = free_parameters(effects)
    values = np.array([effects[i]["parameters"][name] for i, name in free], dtype=float)
    limits = np.array([bounds(effects[i]["effect"], name) for i, name in free]).reshape(-1, 2)
    scales = np.maximum(np.abs(np.array(scales, dtype=float)), 1e-12)
    residual = problem.reduced(effects)
    best, damping, stalls = residual @ residual, 1e-3, 0
    for turn in range(turns if free else 0):
        if np.sqrt(best / problem.count) <= good_enough or (turn >= 4 and np.sqrt(best / problem.count) > hopeless):
            break
        columns = []
        for p, scale in enumerate(scales):
            moved = values.copy()
            step = 3e-3 * scale
            moved[p] += step if moved[p] + step <= limits[p, 1] else -step
            try:
                columns.append((problem.reduced(_replaced(effects, free, moved)) - residual) / (moved[p] - values[p]) * scale)
            except (ArithmeticError, ValueError):
                columns.append(np.zeros_like(residual))
        jacobian = np.array(columns).T
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ residual
        improved = False
        for _ in range(5):
            regularised = normal + damping * np.diag(np.diag(normal) + 1e-12)
            step = -scales * np.linalg.lstsq(regularised, gradient, rcond=None)[0]
            trial = np.clip(values + step, limits[:, 0], limits[:, 1])
            try:
                new = problem.reduced(_replaced(effects, free, trial))
                cost = new @ new
            except (ArithmeticError, ValueError):
                cost = np.inf
            if cost < best:
                stalls = stalls + 1 if cost > best * (1 - 1e-3) else 0
                values, residual, best, damping, improved = trial, new, cost, max(damping / 8, 1e-9), True
                break
            damping *= 6
        if not improved or stalls >= 2:
            break
    return _replaced(effects, free, values), float(np.sqrt(best / problem.count))
