"""What a diagnosis of a function costs: calls by what the machine does, as a Markdown table.

The simulator is a drive, speed over voltage, in a few lines of NumPy; the machine is the same drive with one thing more. The table stands in
docs/black-box.md.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import deadtime

Array = NDArray[np.float64]

SAMPLE_TIME = 0.01  # s
PARAMETERS = {"time_constant": (0.25, "s"), "gain": (40.0, "rad/(s V)")}
NOMINAL = {name: value for name, (value, _) in PARAMETERS.items()}
SAMPLES = 800


def simulate(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
    """Speed and angle of the drive, exactly, for voltages that hold from sample to sample."""
    tau, gain = parameters["time_constant"], parameters["gain"]
    y = np.empty((len(time), 2))
    speed, angle = x0
    for k, volt in enumerate(u[:, 0]):
        y[k] = speed, angle
        step = time[k + 1] - time[k] if k + 1 < len(time) else 0.0
        target, decay = gain * volt, np.exp(-step / tau)
        angle += target * step + (speed - target) * tau * (1.0 - decay)
        speed = target + (speed - target) * decay
    return y


def volts(rng: np.random.Generator) -> Array:
    """Steps of many heights and lengths about 0."""
    return np.repeat(rng.uniform(-5.0, 5.0, SAMPLES), rng.integers(4, 40, SAMPLES))[:SAMPLES, None]


Machine = Callable[[Array, Array, Array], Array]


def exactly(u: Array, time: Array, x0: Array) -> Array:
    """The drive itself."""
    return simulate(u, time, x0, NOMINAL)


MACHINES: dict[str, Machine] = {
    "nothing": exactly,
    "input delay of 3 samples": lambda u, t, x0: exactly(np.vstack([np.repeat(u[:1], 3, axis=0), u[:-3]]), t, x0),
    "gain of 1.2 at the input": lambda u, t, x0: exactly(1.2 * u, t, x0),
    "dead zone of 1 V": lambda u, t, x0: exactly(np.sign(u) * np.maximum(np.abs(u) - 1.0, 0.0), t, x0),
    "sensor bias of 20 rad/s": lambda u, t, x0: exactly(u, t, x0) + [20.0, 0.0],
    "time constant of 0.35 s": lambda u, t, x0: simulate(u, t, x0, {**NOMINAL, "time_constant": 0.35}),
    "delay and sensor bias": lambda u, t, x0: exactly(np.vstack([np.repeat(u[:1], 3, axis=0), u[:-3]]), t, x0) + [20.0, 0.0],
    "a gust that is no effect": lambda u, t, x0: exactly(u + 2.0 * (np.sin(0.9 * t) > 0.5)[:, None] * np.sin(7.0 * t)[:, None], t, x0),
}


def record(name: str, seed: int, machine: Machine) -> deadtime.Log:
    """A log of the machine, with 3 % noise."""
    rng = np.random.default_rng(seed)
    time, u = SAMPLE_TIME * np.arange(SAMPLES), volts(rng)
    y = machine(u, time, np.array([rng.normal(0.0, 2.0), rng.normal(0.0, 0.05)]))
    y = np.asarray(y + 0.03 * y.std(axis=0) * rng.standard_normal(y.shape))
    return deadtime.Log(time, {"u": u[:, 0], "speed": y[:, 0], "angle": y[:, 1]}, {"u": "V", "speed": "rad/s", "angle": "rad"}, source=name)


def table() -> list[tuple[str, str, int]]:
    """What the machine does, what is said of it, and the calls that it took: one log to learn from, one held out."""
    rows = []
    for seed, (words, machine) in enumerate(MACHINES.items(), start=1):
        found = deadtime.gap(
            log=record("train", 10 * seed, machine),
            holdout=record("check", 10 * seed + 1, machine),
            simulate=simulate,
            inputs={"u": "V"},
            outputs={"speed": "rad/s", "angle": "rad"},
            states={"speed": (0.0, 2.0), "angle": (0.0, 0.05)},
            parameters=PARAMETERS,
        )
        named = " + ".join(f"`{e['effect']}:{e['channel']}`" for e in found.effects) or f"`{found.verdict}`"
        for first, *others in found.indistinguishable:
            named += f" ({first} or {' or '.join(others)})"
        rows.append((words, named, found.calls or 0))
    return rows


if __name__ == "__main__":
    print("| the machine has | verdict | calls |\n|---|---|---:|")
    for words, named, calls in table():
        print(f"| {words} | {named} | {calls} |")
