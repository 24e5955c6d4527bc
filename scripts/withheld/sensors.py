"""When sensors take their samples, and what they make of the values: everything between an output and the log."""

import math

import numpy as np

from .system import Names, output_values


def bend(quadratic: float, cubic: float):
    """y + quadratic*y^2 + cubic*y^3 as far as it rises from 0 on, level beyond."""
    turns = np.roots(np.trim_zeros([3.0 * cubic, 2.0 * quadratic, 1.0], "f"))
    # A double root is where the slope touches 0 without falling below it.
    real = np.sort(turns[np.abs(turns.imag) == 0.0].real) if 4.0 * quadratic**2 > 12.0 * cubic else np.array([])
    lower, upper = max(real[real < 0.0], default=-np.inf), min(real[real > 0.0], default=np.inf)

    def characteristic(values):
        inside = np.clip(values, lower, upper)
        return np.polyval([cubic, quadratic, 1.0, 0.0], inside)

    return characteristic


class Sensors:
    """`sampled_at(stamps)` gives the commands' clock times of the samples, `measure` the logged values."""

    def __init__(self, names: Names, effects: dict):
        ny = len(names.outputs)
        self.delay = np.array([sum(v) for v in output_values(effects, "output_delay", "delay", names)])
        self.gain = np.array([math.prod(v) for v in output_values(effects, "sensor_gain", "gain", names)])
        self.bias = np.array([sum(v) for v in output_values(effects, "sensor_bias", "offset", names)])
        self.drift = np.array([sum(v) for v in output_values(effects, "sensor_drift", "rate", names)])
        self.ratio = effects.get("clock_skew", {}).get("*", {}).get("ratio", 1.0)
        self.offset = effects.get("clock_offset", {}).get("*", {}).get("offset", 0.0)
        self.lower, self.upper = np.full(ny, -np.inf), np.full(ny, np.inf)
        for name, limits in effects.get("sensor_saturation", {}).items():
            j = names.outputs.index(name)
            self.lower[j], self.upper[j] = limits.get("lower", -np.inf), limits.get("upper", np.inf)
        self.bends = [(names.outputs.index(n), bend(p["quadratic"], p["cubic"])) for n, p in effects.get("static_nonlinearity", {}).items()]
        self.steps = [(names.outputs.index(n), p["step"]) for n, p in effects.get("sensor_quantisation", {}).items()]
        self.limits = bool(effects.get("sensor_saturation") or self.steps)

    def sampled_at(self, stamps: np.ndarray) -> np.ndarray:
        """[N, ny], s; never before 0."""
        return np.maximum((stamps[:, None] - self.offset) / self.ratio - self.delay, 0.0)

    def measure(self, values: np.ndarray, stamps: np.ndarray, noise=0.0) -> np.ndarray:
        """Rows of outputs at their sampling times as logged with these stamps (s)."""
        if self.bends:
            values = np.array(values, dtype=float)
            for j, characteristic in self.bends:
                values[..., j] = characteristic(values[..., j])
        return self.limit(values * self.gain + self.bias + stamps[:, None] * self.drift + noise)

    def limit(self, values: np.ndarray) -> np.ndarray:
        """Saturation, then quantisation."""
        if self.limits:
            values = np.clip(values, self.lower, self.upper)
        for j, step in self.steps:
            ratio = values[:, j] / step
            values[:, j] = step * np.sign(ratio) * np.floor(np.abs(ratio) + 0.5)
        return values
