"""Case regression: least squares on stored records (ARX scan, FIR, output error, state least squares)."""

import numpy as np
from scipy import linalg, optimize, signal

from .discretise import assert_close

TOOL = "numpy 2.3.5, scipy 1.17.1"
SAMPLES, DELAY, NOISE = 400, 4, 0.05
PLANT_B, PLANT_F = (0.4, 0.25), (1.0, -1.3, 0.6)
NA, NB, MAX_NK = 10, 5, 35
TAPS = 71
OE_MAX_NK = 15
POLISHED = 12  # of the grid's local minima
EXPLAINED = 0.8  # a loss above this share of mean y^2 explains next to nothing
STATE_LAGS, STATE_DELAYS = 16, (2, 9)


def record(stored: dict | None) -> tuple[np.ndarray, np.ndarray]:
    """u (random +-1) and y = z^-4 B/F u + white noise of 5 % of y's standard deviation; the committed one if there is one."""
    if stored is not None:
        return np.array(stored["u"], dtype=float), np.array(stored["y"], dtype=float)
    generator = np.random.default_rng(20240503)
    u = generator.choice([-1.0, 1.0], SAMPLES)
    clean = signal.lfilter(np.concatenate([np.zeros(DELAY), PLANT_B]), PLANT_F, u)
    return u, np.round(clean + NOISE * np.std(clean) * generator.standard_normal(SAMPLES), 9)


def lagged(series: np.ndarray, lags, rows: np.ndarray) -> np.ndarray:
    """Columns series[rows - lag]."""
    return np.column_stack([series[rows - lag] for lag in lags])


def arx_scan(u, y) -> list[dict]:
    """y[t] = -sum_i a_i y[t-i] + sum_j b_j u[t-nk-j], i = 1..na, j = 0..nb-1, on one common range of rows."""
    rows = np.arange(max(NA, MAX_NK + NB - 1), len(y))
    outputs = -lagged(y, range(1, NA + 1), rows)
    found = []
    for nk in range(MAX_NK + 1):
        matrix = np.hstack([outputs, lagged(u, range(nk, nk + NB), rows)])
        theta = np.linalg.lstsq(matrix, y[rows], rcond=None)[0]
        sse = float(np.sum((y[rows] - matrix @ theta) ** 2))
        normal = np.linalg.solve(matrix.T @ matrix, matrix.T @ y[rows])
        assert_close(theta, normal, 1e-9, "arx normal equations")
        found.append({"nk": nk, "loss": sse / len(rows), "a": theta[:NA], "b": theta[NA:]})
    return found


def fir(u, y) -> dict:
    """Impulse response of 71 taps with standard deviations sigma sqrt(diag (Phi'Phi)^-1)."""
    rows = np.arange(TAPS - 1, len(y))
    matrix = lagged(u, range(TAPS), rows)
    taps = np.linalg.lstsq(matrix, y[rows], rcond=None)[0]
    variance = float(np.sum((y[rows] - matrix @ taps) ** 2) / (len(rows) - TAPS))
    triangle = np.linalg.qr(matrix, mode="r")
    inverse = linalg.solve_triangular(triangle, np.eye(TAPS))
    deviations = np.sqrt(variance * np.sum(inverse**2, axis=1))
    by_normal = np.sqrt(variance * np.diag(np.linalg.inv(matrix.T @ matrix)))
    assert_close(deviations, by_normal, 1e-10, "FIR covariance")
    return {"taps": taps, "variance": variance, "standard_deviation": deviations, "rows": len(rows)}


# --- output error -----------------------------------------------------------------------------------------------


class OutputError:
    """y_hat = b z^-nk / F u (+ (c0 + c1 z^-1) / F times an impulse at t = 0); linear in all but F = 1 + f1 z^-1 + f2 z^-2."""

    def __init__(self, u: np.ndarray, y: np.ndarray, nk: int, estimated: bool):
        self.y, self.estimated = y, estimated
        impulse = np.zeros(len(u))
        impulse[0] = 1.0
        self.sources = [np.concatenate([np.zeros(nk), u])[: len(u)]]
        if estimated:
            self.sources += [impulse, np.roll(impulse, 1)]

    def project(self, f: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Linear parameters, residual y_hat - y and the model's output for fixed F."""
        basis = np.column_stack([signal.lfilter([1.0], [1.0, *f], s) for s in self.sources])
        scale = np.linalg.norm(basis, axis=0)
        linear = np.linalg.lstsq(basis / scale, self.y, rcond=None)[0] / scale
        fit = basis @ linear
        return linear, fit - self.y, fit

    def loss(self, f) -> float:
        return float(np.mean(self.project(f)[1] ** 2))

    def gradient(self, f) -> np.ndarray:
        """Exact gradient of the projected loss, each part over its column's norm: about the relative error left."""
        _, residual, fit = self.project(f)
        filtered = signal.lfilter([1.0], [1.0, *f], -fit)
        columns = [np.concatenate([np.zeros(lag), filtered])[: len(filtered)] for lag in (1, 2)]
        return np.array([c @ residual / np.linalg.norm(c) for c in columns]) / np.linalg.norm(self.y)


def is_stable(f) -> bool:
    """Both poles of 1 + f1 z^-1 + f2 z^-2 inside the unit circle."""
    return abs(f[1]) < 1 and abs(f[0]) < 1 + f[1]


def pole_tables() -> list[np.ndarray]:
    """(f1, f2) of complex pairs over radius and angle, dense near the circle, and of pairs of real poles."""
    radius = np.array([0.05, 0.2, 0.35, 0.5, 0.6, 0.7, 0.8, 0.86, 0.91, 0.95, 0.975, 0.99, 0.997])[:, None]
    angle = np.linspace(0, np.pi, 241)[None, :]
    pairs = np.stack(np.broadcast_arrays(-2 * radius * np.cos(angle), radius**2), axis=-1)
    real = np.tanh(np.linspace(-3.2, 3.2, 31))
    first, second = np.meshgrid(real, real)
    return [pairs, np.stack([-(first + second), first * second], axis=-1)]


def grid_losses(problem: OutputError, grid: np.ndarray) -> np.ndarray:
    """Loss at every grid point, all filters run side by side."""
    n, count = len(problem.y), len(grid)
    basis = np.zeros((count, n, len(problem.sources)))
    for j, source in enumerate(problem.sources):
        for t in range(n):
            basis[:, t, j] = source[t]
            if t >= 1:
                basis[:, t, j] -= grid[:, 0] * basis[:, t - 1, j]
            if t >= 2:
                basis[:, t, j] -= grid[:, 1] * basis[:, t - 2, j]
    q = np.linalg.qr(basis)[0]
    explained = np.sum(np.einsum("gtj,t->gj", q, problem.y) ** 2, axis=1)
    return (problem.y @ problem.y - explained) / n


def grid_minima(problem: OutputError, table: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """(loss, f) of the points of a two-dimensional table that no neighbour undercuts."""
    losses = grid_losses(problem, table.reshape(-1, 2)).reshape(table.shape[:2])
    padded = np.pad(losses, 1, constant_values=np.inf)
    height, width = losses.shape
    shifts = [(i, j) for i in (0, 1, 2) for j in (0, 1, 2)]
    lowest = np.all([losses <= padded[i : i + height, j : j + width] for i, j in shifts], axis=0)
    return list(zip(losses[lowest], table[lowest]))


def polish(problem: OutputError, start: np.ndarray) -> np.ndarray:
    """Trust-region least squares, then the root of the exact gradient."""
    def residual(f):
        return problem.project(f)[1] if is_stable(f) else np.full(len(problem.y), 1e3)

    found = optimize.least_squares(residual, start, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    guarded = lambda f: problem.gradient(f) if is_stable(f) else np.full(2, 1e3)
    root = optimize.root(guarded, found, options={"xtol": 1e-15}).x
    better = is_stable(root) and problem.loss(root) <= problem.loss(found) * (1 + 1e-9)
    return root if better else found


def oe_scan(u, y, estimated: bool) -> list[dict]:
    """The smallest loss for every nk.

    Where the model explains next to nothing, the loss has many minima of nearly the same height, some at the edge of
    stability: there only the smallest loss found is kept, an upper bound of the minimum.
    """
    tables, power, found = pole_tables(), float(np.mean(y**2)), []
    for nk in range(OE_MAX_NK + 1):
        problem = OutputError(u, y, nk, estimated)
        minima = sorted((m for table in tables for m in grid_minima(problem, table)), key=lambda m: m[0])
        best = min((polish(problem, f) for _, f in minima[:POLISHED]), key=problem.loss)
        linear, loss = problem.project(best)[0], problem.loss(best)
        determined = loss < EXPLAINED * power
        assert not determined or np.max(np.abs(problem.gradient(best))) < 1e-12, f"oe nk {nk}: not at a minimum"
        found.append({
            "nk": nk, "determined": determined, "loss": loss if determined else None,
            "b": linear[0] if determined else None, "f": best if determined else None,
            "initial": linear[1:] if estimated and determined else None, "loss_bound": loss,
        })
    return found


# --- state least squares ----------------------------------------------------------------------------------------


def state_record(stored: dict | None) -> dict:
    """A third-order sampled model driven by two inputs delayed by 2 and 9 samples, with white noise on the states."""
    if stored is not None:
        part = stored["state_least_squares"]
        return {key: np.array(part[key], dtype=float) for key in ("A", "B", "u", "x")}
    generator = np.random.default_rng(20240504)
    a = np.array([[0.9, 0.2, 0.0], [-0.2, 0.8, 0.1], [0.0, -0.1, 0.7]])
    b = np.array([[0.5, 0.1], [0.2, -0.4], [-0.3, 0.6]])
    u = generator.choice([-1.0, 1.0], (200, 2))
    x = np.zeros((200, 3))
    for k in range(199):
        now = [u[k - d, j] if k >= d else 0.0 for j, d in enumerate(STATE_DELAYS)]
        x[k + 1] = a @ x[k] + b @ now
    return {"A": a, "B": b, "u": u, "x": np.round(x + 0.02 * generator.standard_normal(x.shape), 9)}


def state_least_squares(stored: dict | None) -> dict:
    """x[k+1] - A x[k] = sum_j sum_l gamma_jl B_j u_j[k-l], l = 0..15, all states stacked, k = 15..N-2."""
    data = state_record(stored)
    a, b, u, x = (data[key] for key in ("A", "B", "u", "x"))
    rows = range(STATE_LAGS - 1, len(x) - 1)
    matrix = np.vstack([
        np.hstack([np.outer(b[:, j], u[k - np.arange(STATE_LAGS), j]) for j in range(b.shape[1])]) for k in rows
    ])
    target = np.concatenate([x[k + 1] - a @ x[k] for k in rows])
    gamma = np.linalg.lstsq(matrix, target, rcond=None)[0]
    residual = target - matrix @ gamma
    assert_close(gamma, np.linalg.solve(matrix.T @ matrix, matrix.T @ target), 1e-10, "gamma normal equations")
    gamma = gamma.reshape(b.shape[1], STATE_LAGS)
    assert tuple(np.argmax(gamma, axis=1)) == STATE_DELAYS
    return {
        **data, "delay_samples": list(STATE_DELAYS), "lags": STATE_LAGS, "rows": len(target), "gamma": gamma,
        "sse": float(residual @ residual),
    }


def regression(stored: dict | None) -> dict:
    u, y = record(stored)
    return {
        "tool": TOOL,
        "tolerance": {"default": 1e-10, "f": 1e-8, "initial": 1e-7, "loss_bound": 1e-2},
        "u": u, "y": y, "true_delay_samples": DELAY,
        "arx": {"na": NA, "nb": NB, "rows": len(y) - max(NA, MAX_NK + NB - 1), "scan": arx_scan(u, y)},
        "fir": fir(u, y),
        "oe_zero": oe_scan(u, y, estimated=False),
        "oe_estimated": oe_scan(u, y, estimated=True),
        "state_least_squares": state_least_squares(stored),
    }
