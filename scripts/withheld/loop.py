"""Linearisation, controllers and the one-step predictor's gain, all from the nominal model."""

import numpy as np
from scipy import linalg

from .system import Names, System


def linearised(model: dict, trim, step: float) -> tuple[np.ndarray, ...]:
    """A, B, C, D about the initial state and the trim command, A and B for inputs held over `step` s."""
    names = Names(model)
    system = System(model, names, {})
    x0, u0 = np.array(names.initial), np.array(trim if len(trim) else [0.0] * len(names.inputs), dtype=float)
    n, nu = len(x0), len(u0)

    def slope(function, count):
        columns = []
        for i in range(n + nu):
            size = 1e-5 * max(1e-2, abs(np.concatenate([x0, u0])[i]))
            ends = []
            for sign in (1, -1):
                point = np.concatenate([x0, u0])
                point[i] += sign * size
                ends.append(np.array(function(point[:n].tolist(), (0.0, *point[n:], *[0.0] * nu))))
            columns.append((ends[0] - ends[1]) / (2 * size))
        return np.array(columns).T.reshape(count, n + nu)

    rates = slope(lambda x, seg: system.f(0.0, x, seg, system.parameters, ()), n)
    outputs = slope(lambda x, seg: system.g(0.0, x, seg, system.parameters), len(names.outputs))
    held = linalg.expm(step * np.vstack([rates, np.zeros((nu, n + nu))]))
    return held[:n, :n], held[:n, n:], outputs[:, :n], outputs[:, n:]


def kalman_gain(a, c, process, measurement) -> np.ndarray:
    """Predictor gain [n, ny]: x[k+1] = A x[k] + A L e[k] with this L, of the steady state."""
    p = linalg.solve_discrete_are(a.T, c.T, process, measurement)
    return p @ c.T @ np.linalg.inv(c @ p @ c.T + measurement)


def predictor_gain(model: dict, trim, step: float, levels, sigma) -> np.ndarray:
    """Steady-state Kalman gain with hardly any process noise (1 % of the usual commands): unstable poles come out mirrored."""
    a, b, c, _ = linearised(model, trim, step)
    drive = b * (0.01 * np.array(levels))
    process = drive @ drive.T
    process += 1e-9 * max(np.trace(process), 1e-30) * np.eye(len(a))
    return kalman_gain(a, c, process, np.diag(np.square(sigma)))


class Regulator:
    """LQG: state estimate from measured outputs up to t_k-1, feedback on it, and the excitation on top."""

    def __init__(self, model: dict, trim, step: float, levels, excitation: np.ndarray, output_scale: np.ndarray, effort: float):
        self.a, self.b, self.c, self.d = linearised(model, trim, step)
        n = len(self.a)
        weight_y, weight_u = np.diag(1.0 / output_scale**2), np.diag(1.0 / (effort * np.array(levels)) ** 2)
        q = self.c.T @ weight_y @ self.c
        q += 1e-6 * np.trace(q) * np.eye(n)
        s = linalg.solve_discrete_are(self.a, self.b, q, weight_u)
        self.k = np.linalg.solve(weight_u + self.b.T @ s @ self.b, self.b.T @ s @ self.a)
        drive = self.b * np.array(levels)
        process = drive @ drive.T * 0.3
        process += 1e-6 * np.trace(process) * np.eye(n)
        self.l = self.a @ kalman_gain(self.a, self.c, process, np.diag((0.1 * output_scale) ** 2))
        names = Names(model)
        system = System(model, names, {})
        u0 = trim if len(trim) else [0.0] * len(names.inputs)
        self.y0 = np.array(system.g(0.0, names.initial, (0.0, *u0, *[0.0] * len(u0)), system.parameters))
        self.u0 = np.array(u0, dtype=float)
        self.excitation, self.x, self.last = excitation, np.zeros(n), np.zeros(len(self.u0))

    def __call__(self, k: int, measured: np.ndarray) -> np.ndarray:
        if k:
            y = measured[-1][: len(self.y0)] - self.y0
            self.x = self.a @ self.x + self.b @ self.last + self.l @ (y - self.c @ self.x - self.d @ self.last)
        self.last = self.excitation[k] - self.k @ self.x
        return self.u0 + self.last
