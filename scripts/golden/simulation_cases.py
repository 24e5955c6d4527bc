"""Cases d2c_zoh and lsim."""

import control
import numpy as np
from scipy import integrate, linalg, signal

from .c2d_cases import SAMPLE_TIMES, TOOL
from .discretise import assert_close, scipy_model
from .plants import DYNAMICS, LATERAL, Plant, whole_uav

GRID_SLACK = 1e-9  # events closer than this share of a sample time are one


def d2c_zoh(stored: dict | None) -> dict:
    cases = []
    for plant in DYNAMICS:
        for ts in SAMPLE_TIMES:
            a, b, c, d = scipy_model(plant, ts, "zoh")
            n, m = b.shape
            block = np.block([[a, b], [np.zeros((m, n)), np.eye(m)]])
            back = linalg.logm(block).real / ts
            assert_close(back[:n, :n], plant.a, 1e-10, "logarithm A")
            assert_close(back[:n, n:], plant.b, 1e-10, "logarithm B")
            cases.append({
                "id": f"{plant.name}_ts{ts:g}", "dynamics": plant.name, "sample_time_s": ts,
                "sampled_A": a, "sampled_B": b, "sampled_C": c, "sampled_D": d,
                "A": plant.a, "B": plant.b, "C": plant.c, "D": plant.d,
            })
    return {"tool": TOOL, "tolerance": {"default": 1e-12}, "cases": cases}


# --- lsim -------------------------------------------------------------------------------------------------------


def delayed_input(u: np.ndarray, ts: float, hold: str, prehistory: str, t: float) -> tuple[float, float]:
    """Value and slope, just after time t, of one channel u [N]; held after the last sample."""
    position = t / ts
    nearest = np.round(position)
    if abs(position - nearest) < GRID_SLACK:
        position = nearest
    if position < 0:
        return (u[0] if prehistory == "hold" else 0.0), 0.0
    index = int(np.floor(position))
    if index >= len(u) - 1:
        return u[-1], 0.0
    if hold == "zoh":
        return u[index], 0.0
    slope = (u[index + 1] - u[index]) / ts
    return u[index] + slope * (position - index) * ts, slope


def events(samples: int, ts: float, delays: np.ndarray) -> np.ndarray:
    """Sorted times of all samples and delayed input edges in [0, (samples - 1) Ts]."""
    last = (samples - 1) * ts
    times = np.concatenate([np.arange(samples) * ts] + [np.arange(samples) * ts + delay for delay in delays])
    times = np.sort(times[times <= last * (1 + 1e-12)])
    return times[np.concatenate([[True], np.diff(times) > GRID_SLACK * ts])]


def exact(model: Plant, ts: float, x0, u, hold: str, delays_s, prehistory: str, solver: str = "expm"):
    """States and outputs at the samples: one matrix exponential (or Runge-Kutta call) between any two events."""
    x, n = np.array(x0, dtype=float), len(x0)
    states, k = [], 0
    times = events(len(u), ts, np.asarray(delays_s))
    for index, now in enumerate(times):
        if abs(now - k * ts) <= GRID_SLACK * ts:
            states.append(x.copy())
            k += 1
        if index + 1 == len(times):
            break
        span = times[index + 1] - now
        drive = np.array([delayed_input(u[:, j], ts, hold, prehistory, now - tau) for j, tau in enumerate(delays_s)])
        forced, rising = model.b @ drive[:, 0], model.b @ drive[:, 1]
        if solver == "expm":
            block = np.zeros((n + 2, n + 2))
            block[:n, :n], block[:n, n], block[:n, n + 1], block[n + 1, n] = model.a, forced, rising, 1.0
            x = (linalg.expm(block * span) @ np.concatenate([x, [1.0, 0.0]]))[:n]
        else:
            slope = lambda t, x: model.a @ x + forced + rising * t
            x = integrate.solve_ivp(slope, (0, span), x, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert len(states) == len(u)
    outputs = []
    for k, state in enumerate(states):
        now = [delayed_input(u[:, j], ts, hold, prehistory, k * ts - tau)[0] for j, tau in enumerate(delays_s)]
        outputs.append(model.c @ state + model.d @ np.array(now))
    return np.array(states), np.array(outputs)


def two_inputs() -> Plant:
    """A stable third-order model with two inputs and two outputs (a damped pair and a lag, coupled)."""
    return Plant(
        "two_inputs", ("x1", "x2", "x3"), ("u1", "u2"), ("y1", "y2"),
        np.array([[0.0, 1.0, 0.0], [-4.0, -0.8, 0.5], [0.0, -0.3, -1.5]]),
        np.array([[0.0, 0.2], [3.0, 0.0], [0.0, 1.2]]),
        np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -1.0]]), np.array([[0.0, 0.0], [0.5, -0.25]]),
    )


FEEDBACK = np.array([[0.00566, 0.01504, 0.05516]])  # lateral state feedback K


def stabilised_lateral() -> Plant:
    """Lateral dynamics under state feedback, K close to continuous lqr(Q = I, R = 1e4); y = (C - D K) x + D u."""
    closed = Plant(
        "lateral_stabilised", LATERAL.states, LATERAL.inputs, LATERAL.outputs,
        LATERAL.a - LATERAL.b @ FEEDBACK, LATERAL.b, LATERAL.c - LATERAL.d @ FEEDBACK, LATERAL.d,
    )
    assert np.all(closed.poles.real < -0.5)
    return closed


LENGTHS = {0.01: 120, 0.1: 80, 0.37: 40}
FRACTIONAL = (0.7, 2.3, 1.0, 3.45)  # delays in samples of input 1, 2, ...


def _draw(inputs: int, states: int, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    return np.round(generator.standard_normal(states), 3), np.round(generator.standard_normal((samples, inputs)), 3)


def _variants(inputs: int):
    """(hold, delays in samples, prehistory)."""
    for hold in ("zoh", "linear"):
        yield hold, (0.0,) * inputs, "hold"
        yield hold, FRACTIONAL[:inputs], "hold"
    yield "zoh", FRACTIONAL[:inputs], "rest"
    yield "linear", FRACTIONAL[:inputs], "rest"
    yield "zoh", (2.0,) * inputs, "rest"


def _check_undelayed(model: Plant, ts, x0, u, hold, x, y) -> None:
    """scipy.signal.lsim, and for the linear hold python-control's forced_response."""
    t = np.arange(len(u)) * ts
    _, theirs, states = signal.lsim((model.a, model.b, model.c, model.d), u, t, X0=x0, interp=hold == "linear")
    assert_close(y, np.reshape(theirs, y.shape), 1e-10, "scipy lsim y")
    assert_close(x, np.reshape(states, x.shape), 1e-10, "scipy lsim x")
    if hold == "linear":
        answer = control.forced_response(control.ss(model.a, model.b, model.c, model.d), t, u.T, x0)
        assert_close(y, np.reshape(answer.outputs, (-1, len(u))).T, 1e-10, "control forced_response")


def _continuous_case(model: Plant, ts: float, hold, delays, prehistory, x0, u) -> dict:
    delays_s = np.array(delays) * ts
    x, y = exact(model, ts, x0, u, hold, delays_s, prehistory)
    if not any(delays):
        _check_undelayed(model, ts, x0, u, hold, x, y)
    few = u[:25]
    if ts > 0.02:  # the solver's own error, not ours, is seen on longer unstable runs
        xs, ys = exact(model, ts, x0, few, hold, delays_s, prehistory, "rk")
        xe, ye = exact(model, ts, x0, few, hold, delays_s, prehistory)
        assert_close(xe, xs, 1e-9, "integration x")
        assert_close(ye, ys, 1e-9, "integration y")
    return {"delay_s": delays_s, "x": x, "y": y}


def _sampled_case(model: tuple, ts: float, delays, prehistory, x0, u) -> dict:
    a, b, c, d = model
    x, states, outputs = np.array(x0, dtype=float), [], []
    before = u[0] if prehistory == "hold" else np.zeros(u.shape[1])
    for k in range(len(u)):
        now = np.array([u[k - lag, j] if k >= lag else before[j] for j, lag in enumerate(int(v) for v in delays)])
        states.append(x)
        outputs.append(c @ x + d @ now)
        x = a @ x + b @ now
    x, y = np.array(states), np.array(outputs)
    if not any(delays):
        _, theirs, state = signal.dlsim((a, b, c, d, ts), u, x0=x0)
        assert_close(y, theirs, 1e-11, "dlsim y")
        assert_close(x, state, 1e-11, "dlsim x")
    return {"delay_s": np.array(delays) * ts, "x": x, "y": y}


def lsim(stored: dict | None) -> dict:
    models = [*DYNAMICS, stabilised_lateral(), two_inputs(), whole_uav()]
    kept = {case["id"]: case for case in stored["cases"]} if stored else {}
    cases = []
    for number, model in enumerate(models):
        for ts, length in LENGTHS.items():
            for hold, delays, prehistory in _variants(len(model.inputs)):
                label = "fractional" if any(v % 1 for v in delays) else f"delay{delays[0]:g}"
                case = {
                    "id": f"{model.name}_ts{ts:g}_{hold}_{label}_{prehistory}", "model": model.name, "time": "continuous",
                    "sample_time_s": ts, "hold": hold, "delay_samples": list(delays), "prehistory": prehistory,
                }
                x0, u = _inputs(kept.get(case["id"]), len(model.inputs), len(model.a), length, 100 * number + int(100 * ts))
                cases.append({**case, "x0": x0, "u": u, **_continuous_case(model, ts, hold, delays, prehistory, x0, u)})
            sampled = scipy_model(model, ts, "zoh")
            for delays, prehistory in (((0,) * 4, "rest"), ((2, 0, 5, 1), "rest"), ((2, 0, 5, 1), "hold")):
                delays = delays[: len(model.inputs)]
                case = {
                    "id": f"{model.name}_ts{ts:g}_sampled_delay{delays[0]}_{prehistory}", "model": model.name, "time": "sampled",
                    "sample_time_s": ts, "hold": None, "delay_samples": [float(v) for v in delays], "prehistory": prehistory,
                }
                x0, u = _inputs(kept.get(case["id"]), len(model.inputs), len(model.a), length, 100 * number + int(100 * ts))
                matrices = dict(zip(("sampled_A", "sampled_B", "sampled_C", "sampled_D"), sampled))
                cases.append({**case, "x0": x0, "u": u, **_sampled_case(sampled, ts, delays, prehistory, x0, u), **matrices})
    return {
        "tool": TOOL, "tolerance": {"default": 1e-11}, "models": [m.as_json() for m in models], "cases": cases,
    }


def _inputs(case: dict | None, inputs: int, states: int, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    if case is not None:
        return np.array(case["x0"], dtype=float), np.array(case["u"], dtype=float)
    return _draw(inputs, states, samples, seed)
