"""Models with a sample time: x[k+1] = A x + B mean(input over the interval), y = C x + D input(t_k)."""

import math

import numpy as np

from .system import Names, output_values


def lag_piece(value: float, slope: float, tau: float, state: float, duration: float) -> tuple[float, float]:
    """State and integral after `duration` s of w' = (value + slope*t - w)/tau from w = state."""
    settled = value - slope * tau
    decay = math.exp(-duration / tau)
    end = settled + slope * duration + (state - settled) * decay
    return end, settled * duration + slope * duration**2 / 2 + (state - settled) * tau * (1.0 - decay)


class SampledPlant:
    def __init__(self, model: dict, names: Names, effects: dict):
        self.matrices = [np.array(model[key], dtype=float).reshape(shape) for key, shape in (
            ("A", (len(names.states), -1)), ("B", (len(names.states), -1)), ("C", (len(names.outputs), -1)), ("D", (len(names.outputs), -1)),
        )]
        self.step = names.sample_time
        self.input_operating = np.array([c.get("operating") or 0.0 for c in model["inputs"]])
        self.output_operating = np.array([c.get("operating") or 0.0 for c in model["outputs"]])
        lags = effects.get("actuator_lag", {})
        self.input_lags = [lags.get(name, {}).get("time_constant") for name in names.inputs]
        self.output_lags = [v[0] if v else None for v in output_values(effects, "sensor_lag", "time_constant", names)]
        turned = np.eye(len(names.outputs))
        for channel, p in effects.get("misalignment", {}).items():
            source, target = (names.outputs.index(part) for part in channel.split("->"))
            turned[target, source] += p["gain"]
        self.turned = turned

    def _effective(self, grid, values, slopes, tau) -> tuple[np.ndarray, np.ndarray]:
        """One input at each grid time (from the right) and its integral from 0 to there."""
        if tau is None:
            steps = np.diff(grid)
            return values, np.concatenate([[0.0], np.cumsum(steps * (values[:-1] + slopes[:-1] * steps / 2))])
        state, area, states, areas = values[0], 0.0, [values[0]], [0.0]
        for value, slope, duration in zip(values, slopes, np.diff(grid)):
            state, more = lag_piece(value, slope, tau, state, duration)
            area += more
            states.append(state), areas.append(area)
        return np.array(states), np.array(areas)

    def run(self, simulator, x0) -> np.ndarray:
        """Outputs [N, ny] at the simulator's sampling times, before gain and bias."""
        stamps = simulator.stamps
        if np.any(np.abs(stamps - self.step * np.arange(len(stamps))) > 0.05 * self.step):
            raise ValueError("the log's sample time is not the model's")
        count = max(len(stamps), int(math.ceil(simulator.end / self.step)) + 2)
        edges = np.arange(count + 1) * self.step
        grid, values, slopes = simulator.signals(0.0, edges[-1], edges)
        at = simulator.index(grid, edges)
        effective, mean = [], []
        for i, tau in enumerate(self.input_lags):
            signal, integral = self._effective(grid, values[:, i], slopes[:, i], tau)
            effective.append(signal[at[:-1]])
            mean.append(np.diff(integral[at]) / self.step)
        a, b, c, d = self.matrices
        direct = np.array(effective).T - self.input_operating
        drive = np.array(mean).T - self.input_operating
        x, y = np.array(x0, dtype=float), np.empty((count, len(c)))
        for k in range(count):
            y[k] = c @ x + d @ direct[k]
            x = a @ x + b @ drive[k]
        y = (y + self.output_operating) @ self.turned.T
        return np.column_stack([self._sensed(y[:, j], edges[:-1], tau, simulator.sampled_at[:, j]) for j, tau in enumerate(self.output_lags)])

    def _sensed(self, y, edges, tau, times) -> np.ndarray:
        """The output, linear between samples and lagged, at `times`."""
        if tau is None:
            return np.interp(times, edges, y)
        slopes = np.diff(y) / self.step
        state, lagged = y[0], []
        for value, slope in zip(y, slopes):
            lagged.append(state)
            state = lag_piece(value, slope, tau, state, self.step)[0]
        index = np.minimum(np.floor(times / self.step + 1e-9).astype(int), len(slopes) - 1)
        return np.array([lag_piece(y[i], slopes[i], tau, lagged[i], max(t - edges[i], 0.0))[0] for i, t in zip(index, times)])
