"""The six c2d_* cases: reference.json, and octave.json where Octave's c2d knows the method."""

from functools import cache

import control
import numpy as np

from . import discretise, octave, plants, zpk_methods
from .discretise import assert_close, half_up, split
from .plants import DYNAMICS, Plant

SAMPLE_TIMES = (0.01, 0.1, 0.5)
DELAYS = (0.0, 1.5, 3.0)
TOOL = "numpy 2.3.5, scipy 1.17.1, python-control 0.10.2"
UNSTABLE_HORIZON = 12


def shared_input(stored: dict | None) -> np.ndarray:
    """The random +-1 sequence of 151 samples; the committed one when there is one."""
    if stored is not None:
        return np.array(stored["u"], dtype=float)
    return np.random.default_rng(20240501).choice([-1.0, 1.0], 151)


def frequencies(sample_time: float) -> np.ndarray:
    return np.geomspace(0.003 * np.pi / sample_time, 0.97 * np.pi / sample_time, 60)


def samples(sample_time: float) -> int:
    return 151 if sample_time <= 0.1 else 40


def grid():
    """(plant, sample time, delay in samples) of every case."""
    return [(p, ts, d) for p in DYNAMICS for ts in SAMPLE_TIMES for d in DELAYS]


def document(method: str, u: np.ndarray, cases: list[dict], **tolerance) -> dict:
    return {
        "method": method, "tool": TOOL, "tolerance": {"default": 1e-11, **tolerance},
        "plants": [p.as_json() for p in DYNAMICS], "u": u, "cases": cases,
    }


def _head(plant: Plant, ts: float, delay: float, **extra) -> dict:
    label = "_".join([plant.name, f"ts{ts:g}", f"delay{delay:g}", *(str(v) for v in extra.values() if v is not None)])
    return {"id": label, "dynamics": plant.name, "sample_time_s": ts, "delay_samples": delay, **extra}


def _matrices(model: tuple | None) -> dict:
    return dict(zip("ABCD", model if model is not None else (None,) * 4))


def _responses(h: np.ndarray | None, y: np.ndarray | None, omega: np.ndarray) -> dict:
    return {
        "omega_rad_s": omega, "h_re": None if h is None else h.real, "h_im": None if h is None else h.imag, "y": y,
    }


def _check_scipy(plant, ts, model, u, method) -> tuple:
    """scipy's matrices, after comparing their responses with the written-out formula."""
    reference = discretise.scipy_model(plant, ts, method)
    z = np.exp(1j * frequencies(ts) * ts)
    h, y = discretise.scipy_response(reference, ts, u, z)
    assert_close(model.frequency_response(z), h, 1e-11, f"{method} h")
    assert_close(model.simulate(u), y, 1e-10, f"{method} y")
    return reference


def _check_integration(plant, ts, delay, u, model, hold) -> None:
    short = u[: UNSTABLE_HORIZON]
    exact = discretise.integrated(plant, ts, delay, short, hold)
    assert_close(model.simulate(short), exact, 1e-9, f"{plant.name} {ts} {delay} {hold} integration")


def held_method(method: str, stored: dict | None) -> dict:
    """Zero- and first-order hold."""
    u, cases = shared_input(stored), []
    build = getattr(discretise, method)
    for plant, ts, delay in grid():
        omega, drive = frequencies(ts), u[: samples(ts)]
        model = build(plant, ts, delay)
        _check_integration(plant, ts, delay, drive, model, method)
        matrices = _check_scipy(plant, ts, model, drive, method) if delay == 0 else None
        h = model.frequency_response(np.exp(1j * omega * ts))
        cases.append({**_head(plant, ts, delay), **_matrices(matrices), **_responses(h, model.simulate(drive), omega)})
    return document(method, u, cases)


def impulse(stored: dict | None) -> dict:
    u, cases = shared_input(stored), []
    for plant, ts, delay in grid():
        omega, drive = frequencies(ts), u[: samples(ts)]
        for feedthrough in ("keep", "drop"):
            head = _head(plant, ts, delay, feedthrough=feedthrough)
            model = discretise.impulse(plant, ts, delay, feedthrough)
            if model is None:
                note = "D cannot be kept between two samples"
                cases.append({**head, **_matrices(None), **_responses(None, None, omega), "note": note})
                continue
            matrices = None
            if delay == 0:
                matrices = _impulse_matrices(plant, ts, model, drive, feedthrough)
            h, y = model.frequency_response(np.exp(1j * omega * ts)), model.simulate(drive)
            assert_close(y, _impulse_convolution(plant, ts, delay, drive, feedthrough), 1e-11, "impulse convolution")
            cases.append({**head, **_matrices(matrices), **_responses(h, y, omega), "note": None})
    return document("impulse", u, cases)


def _impulse_matrices(plant, ts, model, u, feedthrough) -> tuple:
    """scipy's realisation (Bd = Ts exp(A Ts) B, Cd = C) with D = 0, and the kept D added."""
    bare = Plant(plant.name, plant.states, plant.inputs, plant.outputs, plant.a, plant.b, plant.c, 0 * plant.d)
    a, b, c, d = discretise.scipy_model(bare, ts, "impulse")
    assert_close(b, ts * a @ plant.b, 1e-13, "scipy's impulse B")
    if feedthrough == "keep":
        d = d + plant.d
    z = np.exp(1j * frequencies(ts) * ts)
    h, y = discretise.scipy_response((a, b, c, d), ts, u, z)
    assert_close(model.frequency_response(z), h, 1e-11, "impulse h")
    assert_close(model.simulate(u), y, 1e-10, "impulse y")
    return a, b, c, d


def _impulse_convolution(plant, ts, delay, u, feedthrough) -> np.ndarray:
    """The convolution sum with h(k Ts - tau), every sample from its own matrix exponential."""
    h = np.zeros((len(u), len(plant.c)))
    for k in range(len(u)):
        t = (k - delay) * ts
        if t >= 0:
            h[k] = ts * (plant.c @ discretise.linalg.expm(plant.a * t) @ plant.b)[:, 0]
            h[k] += plant.d[:, 0] if t == 0 and feedthrough == "keep" else 0.0
    return np.array([sum(h[i] * u[k - i] for i in range(k + 1)) for k in range(len(u))])


def tustin(stored: dict | None) -> dict:
    u, cases = shared_input(stored), []
    for plant, ts, delay in grid():
        omega, drive = frequencies(ts), u[: samples(ts)]
        z = np.exp(1j * omega * ts)
        for prewarp in (None, 0.3 * np.pi / ts):
            model = discretise.tustin(plant, ts, half_up(delay), prewarp)
            matrices = _tustin_matrices(plant, ts, model, drive, prewarp) if delay == 0 else None
            head = _head(plant, ts, delay, prewarp_rad_s=prewarp, thiran_order=None)
            head["id"] = head["id"].split("_delay")[0] + f"_delay{delay:g}" + ("_prewarp" if prewarp else "")
            cases.append({**head, **_matrices(matrices), **_responses(model.frequency_response(z), model.simulate(drive), omega)})
        for order in (1, 3) if split(delay)[1] else ():
            model, allpass = discretise.tustin(plant, ts, 0), discretise.thiran(delay, order)
            h = model.frequency_response(z) * allpass.frequency_response(z)[:, None]
            head = _head(plant, ts, delay, prewarp_rad_s=None, thiran_order=order)
            head["id"] = f"{plant.name}_ts{ts:g}_delay{delay:g}_thiran{order}"
            cases.append({**head, **_matrices(None), **_responses(h, allpass.filter(model.simulate(drive)), omega)})
    return document("tustin", u, cases)


def _tustin_matrices(plant, ts, model, u, prewarp) -> tuple:
    """python-control's matrices (scipy's without prewarp), compared with the formula and with s -> z by hand."""
    system = control.ss(plant.a, plant.b, plant.c, plant.d)
    sampled = control.sample_system(system, ts, "bilinear", prewarp_frequency=prewarp)
    reference = tuple(np.asarray(m) for m in (sampled.A, sampled.B, sampled.C, sampled.D))
    if prewarp is None:
        for ours, theirs in zip(reference, discretise.scipy_model(plant, ts, "tustin")):
            assert_close(ours, theirs, 1e-13, "control and scipy")
    z = np.exp(1j * frequencies(ts) * ts)
    factor = 2 / ts if prewarp is None else prewarp / np.tan(prewarp * ts / 2)
    s = factor * (z - 1) / (z + 1)
    by_hand = [(plant.c @ np.linalg.solve(v * np.eye(len(plant.a)) - plant.a, plant.b) + plant.d)[:, 0] for v in s]
    h, y = discretise.scipy_response(reference, ts, u, z)
    assert_close(h, by_hand, 1e-11, "s -> z")
    assert_close(model.frequency_response(z), h, 1e-11, "tustin h")
    assert_close(model.simulate(u), y, 1e-10, "tustin y")
    return reference


def _single_outputs():
    return [(p.output(i), p.outputs[i], ts, d) for p, ts, d in grid() for i in range(len(p.outputs))]


def _shift(y: np.ndarray, lag: int) -> np.ndarray:
    return np.vstack([np.zeros((lag, y.shape[1])), y])[: len(y)]


def matched(stored: dict | None) -> dict:
    u, cases = shared_input(stored), []
    for plant, output, ts, delay in _single_outputs():
        omega, drive, lag = frequencies(ts), u[: samples(ts)], half_up(delay)
        z = np.exp(1j * omega * ts)
        model = zpk_methods.matched(plant, ts)
        h = model.frequency_response(z) * (z**-lag)[:, None]
        zpk = model.as_json() if delay == 0 else dict.fromkeys(("zeros", "poles", "gain"))
        agrees = _control_matched_agrees(plant, ts, model) if delay == 0 else None
        y = _shift(model.simulate(drive), lag)
        assert_close(_by_recursion(model, drive), model.simulate(drive), 1e-7, "matched recursion")
        cases.append({
            **_head(plant, ts, delay, output=output), **_matrices(None), **zpk, "python_control_agrees": agrees,
            **_responses(h, y, omega),
        })
    return document("matched", u, cases)


def _by_recursion(model: zpk_methods.SampledZpk, u: np.ndarray) -> np.ndarray:
    """The difference equation of the multiplied-out polynomials."""
    top = np.atleast_1d(model.gain * np.poly(model.zeros).real)
    bottom = np.poly(model.poles).real
    top = np.concatenate([np.zeros(len(bottom) - len(top)), top])
    return discretise.signal.lfilter(top, bottom, u)[:, None]


def _control_matched_agrees(plant, ts, model) -> bool:
    """Whether python-control's 'matched' gives the same frequency response (it fails when G(0) is 0 or infinite)."""
    zeros, poles, gain = plants.zpk(plant)
    system = control.tf(gain * np.poly(zeros).real, np.poly(poles).real)
    z = np.exp(1j * frequencies(ts) * ts)
    with np.errstate(all="ignore"):
        try:
            sampled = control.sample_system(system, ts, "matched")
            h = sampled(z)
        except (ZeroDivisionError, ValueError, FloatingPointError):
            return False
    ours = model.frequency_response(z)[:, 0]
    return bool(np.all(np.abs(h - ours) <= 1e-6 * np.max(np.abs(ours))))


@cache
def _fit(dynamics: int, output: int, ts: float, fraction: float) -> zpk_methods.LeastSquaresFit:
    return zpk_methods.least_squares(DYNAMICS[dynamics].output(output), ts, fraction)


def least_squares(stored: dict | None) -> dict:
    u, cases = shared_input(stored), []
    for index, plant in enumerate(DYNAMICS):
        for ts in SAMPLE_TIMES:
            for delay in DELAYS:
                for i, output in enumerate(plant.outputs):
                    whole, fraction = split(delay)
                    fit = _fit(index, i, ts, fraction)
                    omega, drive = frequencies(ts), u[: samples(ts)]
                    z = np.exp(1j * omega * ts)
                    attained = bool(np.all(np.abs(fit.model.poles) < 1e6))
                    h = fit.model.frequency_response(z) * (z**-whole)[:, None]
                    y = _shift(fit.model.simulate(drive), whole) if attained else None
                    zpk = fit.model.as_json() if attained else dict.fromkeys(("zeros", "poles", "gain"))
                    cases.append({
                        **_head(plant, ts, delay, output=output), **_matrices(None), **zpk, "attained": attained,
                        "J": fit.cost, "J_from_matched_poles": fit.first_cost, "other_J": fit.other_minima,
                        "spread": fit.spread, **_responses(h, y, omega),
                    })
    tolerance = {"other_J": None, "spread": None, "J": 1e-8, "J_from_matched_poles": None}
    return {**document("least_squares", u, cases, **tolerance), "tolerance": {"default": 1e-8, **tolerance}}


# --- Octave -----------------------------------------------------------------------------------------------------

OCTAVE_METHODS = {"zoh": "zoh", "foh": "foh", "tustin": "tustin", "matched": "matched"}


def octave_file(method: str):
    def build(stored: dict | None) -> dict:
        tool = octave.versions()
        heads, script = [], []
        variants = (None, 0.3) if method == "tustin" else (None,)
        for plant in DYNAMICS:
            for ts in SAMPLE_TIMES:
                outputs = range(len(plant.outputs)) if method == "matched" else (None,)
                for warp in variants:
                    for output in outputs:
                        heads.append(_octave_head(plant, ts, warp, output, method))
                        script.append(_octave_case(f"c{len(heads) - 1}", plant, ts, warp, output, method))
        found = octave.run("\n".join(script))
        cases = []
        for index, head in enumerate(heads):
            part = {key.split(".", 1)[1]: value for key, value in found.items() if key.startswith(f"c{index}.")}
            h = part.pop("h")
            if method == "matched":
                numbers = {"zeros": part["zeros"].ravel(), "poles": part["poles"].ravel(), "gain": float(part["gain"].real[0, 0])}
            else:
                numbers = {key: part[key].real for key in "ABCD"}
            cases.append({**head, **numbers, "omega_rad_s": frequencies(head["sample_time_s"]), "h_re": h.real, "h_im": h.imag})
        return {"method": method, "tool": tool, "tolerance": {"default": 1e-10}, "cases": cases}

    return build


def _octave_head(plant, ts, warp, output, method) -> dict:
    head = {"id": f"{plant.name}_ts{ts:g}_delay0", "dynamics": plant.name, "sample_time_s": ts, "delay_samples": 0.0}
    if method == "matched":
        head["output"] = plant.outputs[output]
        head["id"] += f"_{plant.outputs[output]}"
    if method == "tustin":
        head["prewarp_rad_s"] = None if warp is None else warp * np.pi / ts
        head["id"] += "_prewarp" if warp else ""
    return head


def _octave_case(name, plant, ts, warp, output, method) -> str:
    w = octave.literal(frequencies(ts))
    if method == "matched":
        zeros, poles, gain = plants.zpk(plant.output(output))
        num, den = octave.literal(gain * np.poly(zeros).real), octave.literal(np.poly(poles).real)
        return (
            f"s = c2d(tf({num}, {den}), {ts!r}, 'matched'); [z, p, k] = zpkdata(s, 'vector');\n"
            f"put('{name}.zeros', z(:).'); put('{name}.poles', p(:).'); put('{name}.gain', k); put_response('{name}.h', s, {w});"
        )
    system = f"ss({', '.join(octave.literal(m) for m in (plant.a, plant.b, plant.c, plant.d))})"
    rule = f"'prewarp', {warp * np.pi / ts!r}" if warp else f"'{OCTAVE_METHODS[method]}'"
    return f"put_model('{name}', c2d({system}, {ts!r}, {rule}), {w});"
