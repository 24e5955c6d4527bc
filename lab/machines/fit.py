#!/usr/bin/env python3
"""Fits the numbers of examples/machines/*.toml that nobody has published, from the measured logs.

Every fit includes the effect that the model then leaves out, so that the simulator's other numbers are those of the machine and only that effect is
missing. The logs are not part of this repository. Usage: $(scripts/venv) lab/machines/fit.py [FOLDER] [NAME …]; FOLDER defaults to
../shared/data. It prints the numbers; they were copied into the model files by hand, rounded to four digits. No part depends on chance.
"""

import csv
import gzip
import pathlib
import sys

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent


def read(path: pathlib.Path) -> dict[str, np.ndarray]:
    """The columns of a log."""
    with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as text:
        rows = csv.reader(text)
        names = next(rows)
        values = np.array([[float(v) for v in row] for row in rows])
    return dict(zip(names, values.T))


def held(a, b, ts: float) -> tuple[np.ndarray, np.ndarray]:
    """exp(A·ts) and ∫exp(A·t)B dt: one step under a held input."""
    n, m = b.shape
    block = expm(np.block([[a, b], [np.zeros((m, n + m))]]) * ts)
    return block[:n, :n], block[:n, n:]


def linear(a, b, c, u, ts: float, delay: float = 0.0, start=None, d=None) -> np.ndarray:
    """Outputs (samples × outputs) of ẋ = Ax + Bu(t − delay), y = Cx + Du, the input (samples × inputs) held; at rest under u[0] before, or from `start`."""
    a, b, c, u = (np.atleast_2d(np.asarray(v, float)) for v in (a, b, c, u))
    whole, part = divmod(max(delay, 0.0), ts)
    late = np.vstack([np.repeat(u[:1], int(whole) + 1, axis=0), u])[: len(u) + 1]
    ad1, b_old = held(a, b, part)
    ad2, b_new = held(a, b, ts - part)
    x = np.linalg.solve(a, -b @ u[0]) if start is None else np.asarray(start, float)
    states = np.empty((len(u), len(x)))
    before, now = late[:-1] @ b_old.T, late[1:] @ b_new.T
    step = before @ ad2.T + now
    ad = ad2 @ ad1
    for k in range(len(u)):
        states[k] = x
        x = ad @ x + step[k]
    return states @ c.T + (0.0 if d is None else u @ np.atleast_2d(d).T)


def fit(name: str, residual, first: dict[str, float], scale: dict[str, float] | None = None) -> dict[str, float]:
    """Least squares from a first guess; prints each value with its standard deviation (white residuals assumed: optimistic)."""
    keys = list(first)
    unit = np.array([(scale or {}).get(k, abs(first[k]) or 1.0) for k in keys])
    found = least_squares(lambda p: residual(dict(zip(keys, p * unit))), np.array([first[k] for k in keys]) / unit, method="lm", max_nfev=400)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * 2 * found.cost / max(len(found.fun) - len(keys), 1)
    print(f"{name}: residual rms {np.sqrt(np.mean(found.fun**2)):.5g}")
    for key, value, std in zip(keys, found.x * unit, np.sqrt(np.diag(covariance)) * unit):
        print(f"    {key} = {value:.6g}  ± {std:.2g}")
    return dict(zip(keys, found.x * unit))


def hairdryer(data: pathlib.Path) -> None:
    """K·e^(−Ls)/((T1 s + 1)(T2 s + 1)) on the first half; L is left out of the model."""
    log = read(data / "hairdryer/hairdryer.csv")
    u, y = log["heater_voltage"][:500] - 4.91, log["outlet_temp"][:500]

    def residual(p):
        a = [[-1 / p["T1"], 0], [1 / p["T2"], -1 / p["T2"]]]
        return (p["y0"] + linear(a, [[p["K"] / p["T1"]], [0]], [[0, 1]], u[:, None], 0.08, p["L"])[:, 0] - y)[20:]

    fit("hairdryer", residual, {"K": 0.9, "T1": 0.3, "T2": 0.15, "L": 0.2, "y0": 4.9})


def tclab_step(data: pathlib.Path) -> None:
    """K/((T1 s + 1)(T2 s + 1)) on the first half, above the temperature before the first step; T2 is left out. With a dead time in its place for comparison."""
    log = read(data / "tclab/tclab_step_test_siso.csv")
    t = np.arange(0, 286.0)
    u = log["heater_pwm"][np.searchsorted(log["time"], t, side="right") - 1][:, None]
    y = np.interp(t, log["time"], log["temp_kelvin"])

    def lag(p):
        a = [[-1 / p["T1"], 0], [1 / p["T2"], -1 / p["T2"]]]
        return p["y0"] + linear(a, [[p["K"] / p["T1"]], [0]], [[0, 1]], u, 1.0)[:, 0] - y

    def delay(p):
        return p["y0"] + linear([[-1 / p["T1"]]], [[p["K"] / p["T1"]]], [[1]], u, 1.0, p["L"])[:, 0] - y

    fit("tclab_step, lag", lag, {"K": 0.36, "T1": 140.0, "T2": 14.0, "y0": 299.5})
    fit("tclab_step, dead time", delay, {"K": 0.36, "T1": 140.0, "L": 14.0, "y0": 299.5})


def march(derivative, x, u, ts: float, steps: int = 1) -> np.ndarray:
    """States (samples × states) of ẋ = derivative(x, u), Runge-Kutta of fourth order, the input held."""
    states = np.empty((len(u), len(x)))
    h = ts / steps
    for k, now in enumerate(u):
        states[k] = x
        for _ in range(steps):
            k1 = derivative(x, now)
            k2 = derivative(x + 0.5 * h * k1, now)
            k3 = derivative(x + 0.5 * h * k2, now)
            k4 = derivative(x + h * k3, now)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return states


def tclab_dual(data: pathlib.Path) -> None:
    """The course's energy balance of both heaters with their exchange and a lag of sensor 1, on the whole log."""
    log = read(data / "tclab/tclab_dual_10min.csv")
    t = np.arange(0, 598.0)
    at = np.searchsorted(log["time"], t, side="right") - 1
    u = np.column_stack([log["heater1_pct"][at], log["heater2_pct"][at]])
    y = np.column_stack([np.interp(t, log["time"], log[f"temp{i}_degC"]) for i in (1, 2)])
    heat, sigma = 0.004 * 500.0, 0.9 * 5.67e-8

    def residual(p):
        ambient = p["Ta"] + 273.15

        def derivative(x, now):
            h1, h2 = x[0] + 273.15, x[1] + 273.15
            exchange = p["Us"] * 2e-4 * (h2 - h1) + sigma * 2e-4 * (h2**4 - h1**4)
            loss = lambda h: p["U"] * 1e-3 * (ambient - h) + sigma * 1e-3 * (ambient**4 - h**4)
            return np.array([(loss(h1) + exchange + p["alpha1"] * now[0]) / heat, (loss(h2) - exchange + p["alpha2"] * now[1]) / heat,
                             (x[0] - x[2]) / p["lag"]])

        x = march(derivative, np.array([y[0, 0], y[0, 1], y[0, 0]]), u, 1.0)
        return (x[:, [2, 1]] - y).ravel()

    fit("tclab_dual", residual, {"U": 10.0, "Us": 10.0, "alpha1": 0.01, "alpha2": 0.0075, "Ta": 20.5, "lag": 15.0})


def heating_system(data: pathlib.Path) -> None:
    """A lamp over a plate: (K1/(T1 s + 1) + K2/(T2 s + 1))·e^(−Ls) about 6 V on the whole log; L is left out of the model."""
    log = read(data / "heating_system/heating.csv")
    u, y = (log["lamp_voltage"] - 6.0)[:, None], log["plate_temp"]

    def residual(p):
        a = [[-1 / p["T1"], 0], [0, -1 / p["T2"]]]
        b = [[p["K1"] / p["T1"]], [p["K2"] / p["T2"]]]
        return (p["y0"] + linear(a, b, [[1, 1]], u, 2.0, p["L"], [p["x1"], p["x2"]])[:, 0] - y)[10:]

    fit("heating_system", residual, {"K1": 9.0, "T1": 18.0, "K2": 12.0, "T2": 125.0, "L": 4.0, "y0": 130.0, "x1": 0.0, "x2": 0.0})


def heat_exchanger(data: pathlib.Path) -> None:
    """y0 + K·(w + q·w·|w|)/(T s + 1)² of the deviation w from a mean flow, on the first half; the log pairs y[k] with what the flow of sample k
    has done by the end of that sample. The curve q and that sample are left out of the model."""
    log = read(data / "heat_exchanger/exchanger.csv")
    w, y = log["flow_rate"][:2001] - 0.369, log["outlet_temp"][:2000]

    def residual(p):
        a = [[-1 / p["T"], 0], [1 / p["T"], -1 / p["T"]]]
        bent = (w + p["q"] * w * np.abs(w))[:, None]
        return (p["y0"] + linear(a, [[p["K"] / p["T"]], [0]], [[0, 1]], bent, 1.0)[1:, 0] - y)[100:]

    fit("heat_exchanger", residual, {"K": -20.0, "T": 2.0, "q": -0.1, "y0": 97.0})


def servo(data: pathlib.Path) -> None:
    """The author's structure with his tau and the real angles of all rollouts, everything over the armature, a dead time included, which is left out of the model."""
    log = read(data / "servo_real_and_sim/servo_action_real_sim.csv")
    records = [np.flatnonzero(log["rollout"] == r) for r in np.unique(log["rollout"])]
    longest, fine = max(map(len, records)), 5
    u = np.array([np.pad(log["action_rad"][r], (0, longest - len(r)), mode="edge") for r in records])
    y = np.array([np.pad(log["real_angle_rad"][r], (0, longest - len(r)), constant_values=np.nan) for r in records])
    ts, tau = 0.02, 0.013808
    h = ts / fine
    # The held command's mean over a step that lies `delay` earlier, from its integral: smooth in the delay.
    edges = np.arange(longest + 1) * ts
    integral = np.hstack([np.zeros((len(u), 1)), np.cumsum(u, axis=1) * ts])

    def mean(at):
        def area(t):
            return np.array([np.interp(t, edges, row) for row in integral]) + np.minimum(t, 0.0) * u[:, 0]

        return (area(at + h) - area(at)) / h

    def residual(p):
        c, angle, speed = y[:, 0].copy(), y[:, 0].copy(), np.zeros(len(u))
        out = np.empty_like(y)
        rate = lambda c, angle, speed: (
            np.clip(p["kp"] * (c - angle) - p["kv"] * speed, -p["limit"], p["limit"]) - p["damping"] * speed - p["dry"] * np.tanh(speed / 0.02))
        for k in range(longest):
            out[:, k] = angle
            for i in range(fine):
                now = mean(np.array(k * ts + i * h - p["delay"]))
                c_next = now + (c - now) * np.exp(-h / tau)
                half = 0.5 * (c + c_next)
                k1 = rate(c, angle, speed)
                k2 = rate(half, angle + h / 2 * speed, speed + h / 2 * k1)
                k3 = rate(half, angle + h / 2 * (speed + h / 2 * k1), speed + h / 2 * k2)
                k4 = rate(c_next, angle + h * (speed + h / 2 * k2), speed + h * k3)
                angle, speed, c = angle + h * speed + h * h / 6 * (k1 + k2 + k3), speed + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), c_next
        return (out - y)[np.isfinite(y)]

    fit("servo (per armature)", residual, {"kp": 436.5, "kv": 22.5, "limit": 25.0, "damping": 12.2, "dry": 0.5, "delay": 0.02})


def silverbox(data: pathlib.Path) -> None:
    """ÿ + d·ẏ + k1·y + k3·y³ = b·u on 8 s of the multisine part, the input also into ẏ's integral (half a sample of hold); k3 is left out of the model."""
    log = read(data / "silverbox/snls80mv.csv.gz")
    ts = 0.0016384
    span = slice(46000, 51000)
    u, y = log["force_v1"][span], log["displacement_v2"][span]
    first = {"d": 20.0, "k1": 1.7e5, "k3": 6e5, "b": 1.0e5, "b1": 0.0, "feed": 0.0, "y0": 0.0, "x1": y[0], "x2": (y[1] - y[0]) / ts}
    scale = {"d": 20.0, "k1": 1e4, "k3": 1e5, "b": 1e4, "b1": 50.0, "feed": 0.05, "y0": 0.01, "x1": 0.01, "x2": 5.0}
    keys = list(first)

    def run(columns):
        """All columns of parameters at once."""
        d, k1, k3, b, b1, feed, y0, x1, x2 = columns
        q, v = x1.copy(), x2.copy()
        out = np.empty((len(u), columns.shape[1]))
        for k, now in enumerate(u):
            out[k] = q + feed * now + y0
            for _ in range(2):
                h = ts / 2
                f = lambda q, v: (v + b1 * now, b * now - d * v - k1 * q - k3 * q**3)
                q1, v1 = f(q, v)
                q2, v2 = f(q + h / 2 * q1, v + h / 2 * v1)
                q3, v3 = f(q + h / 2 * q2, v + h / 2 * v2)
                q4, v4 = f(q + h * q3, v + h * v3)
                q, v = q + h / 6 * (q1 + 2 * q2 + 2 * q3 + q4), v + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
        return out

    unit = np.array([scale[k] for k in keys])
    p = np.array([first[k] for k in keys])
    damping = 1e-3
    cost = np.inf
    # A Levenberg-Marquardt of its own: one run gives all columns of the Jacobian.
    for _ in range(40):
        steps = np.diag(1e-5 * unit)
        out = run(np.column_stack([p, p[:, None] + steps]))
        e = out[:, 0] - y
        jacobian = (out[:, 1:] - out[:, :1]) / 1e-5
        gram, slope = jacobian.T @ jacobian, jacobian.T @ e
        cost = e @ e
        while True:
            trial = p - unit * np.linalg.solve(gram + damping * np.diag(np.diag(gram)), slope)
            new = run(trial[:, None])[:, 0] - y
            if new @ new < cost or damping > 1e8:
                break
            damping *= 10
        gained = cost - new @ new
        p, damping = trial, damping / 10
        if gained < 1e-10 * cost:
            break
    std = unit * np.sqrt(np.diag(np.linalg.inv(gram)) * cost / len(y))
    print(f"silverbox: residual rms {np.sqrt(cost / len(y)):.5g}")
    for key, value, s in zip(keys, p, std):
        print(f"    {key} = {value:.6g}  ± {s:.2g}")


def winding(data: pathlib.Path) -> None:
    """Two tensions, each of first order in all five inputs, the second also driven by the first (which is left out of the model); on the first half."""
    log = read(data / "winding/winding.csv.gz")
    u = np.column_stack([values for name, values in log.items() if name[0] == "u"])[:1250]
    y = np.column_stack([log["y1_tension12"], log["y2_tension23"]])[:1250]

    def residual(p):
        a = [[-p["a1"], 0], [p["a21"], -p["a2"]]]
        b = [[p[f"b{i}{j}"] for j in range(1, 6)] for i in (1, 2)]
        return (linear(a, b, np.eye(2), u, 0.1, start=y[0])[20:] - y[20:]).ravel()

    first = {"a1": 2.0, "a2": 6.0, "a21": 0.0} | {f"b{i}{j}": 0.0 for i in (1, 2) for j in range(1, 6)}
    fit("winding", residual, first, {f"b{i}{j}": 1.0 for i in (1, 2) for j in range(1, 6)})


def px4(data: pathlib.Path) -> None:
    """The closed rate loop as K·e^(−Ls)/(T s + 1) from roll rate set point to gyro, 20 s to 50 s; L is left out of the model."""
    log = read(data / "px4_logs/px4_fmu_v6c.csv.gz")
    t = np.arange(20.0, 50.0, 0.005)
    u = log["roll_rate_sp"][np.searchsorted(log["time"], t, side="right") - 1]
    y = np.interp(t, log["time"], log["gyro_x"])

    def residual(p):
        return (p["y0"] + linear([[-1 / p["T"]]], [[p["K"] / p["T"]]], [[1]], u[:, None], 0.005, p["L"])[:, 0] - y)[100:]

    fit("px4", residual, {"K": 0.8, "T": 0.03, "L": 0.02, "y0": 0.0}, {"y0": 0.01})


def nanobench(data: pathlib.Path) -> None:
    """Specific force k·Σ(PWM·V)² + c behind a lag (or, for comparison, a dead time) in the air; the lag is left out of the model."""
    log = read(data / "nanobench/B2_circle_fast_rep2.csv.gz")
    span = slice(500, 3500)
    z = sum((log[f"pwm_m{i}"] / 65536 * log["vbat"]) ** 2 for i in range(1, 5))[span][:, None]
    y = log["acc_z"][span]

    def lag(p):
        return (p["c"] + linear([[-1 / p["T"]]], [[p["k"] / p["T"]]], [[1]], z, 0.01)[:, 0] - y)[50:]

    def delay(p):
        return (p["c"] + p["k"] * np.interp(np.arange(len(z)) - p["L"] / 0.01, np.arange(len(z)), z[:, 0]) - y)[50:]

    fit("nanobench, lag", lag, {"k": 0.02, "c": 0.3, "T": 0.05})
    fit("nanobench, dead time", delay, {"k": 0.02, "c": 0.3, "L": 0.02})


FITS = {f.__name__: f for f in (hairdryer, tclab_step, tclab_dual, heating_system, heat_exchanger, servo, winding, px4, nanobench, silverbox)}


def main() -> int:
    arguments = sys.argv[1:]
    data = pathlib.Path(arguments[0]) if arguments else ROOT.parent / "shared" / "data"
    if not data.is_dir():
        print(f"no folder {data}", file=sys.stderr)
        return 2
    for name in arguments[1:] or FITS:
        FITS[name](data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
