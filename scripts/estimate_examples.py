#!/usr/bin/env python3
"""Writes the logs of docs/estimating.md into examples/: dead times that are known, on records that are awkward.

Usage: scripts/estimate_examples.py [--check]; needs numpy (scripts/requirements.lock). Each plant is of first order, K/(T s + 1) or K/(s - p),
solved exactly between the instants at which its delayed input changes.
"""

import argparse
import io
import pathlib
import sys

import numpy as np

EXAMPLES = pathlib.Path(__file__).resolve().parent.parent / "examples"


def respond(at: np.ndarray, changes: np.ndarray, values: np.ndarray, gain: float, pole: float, delay: float) -> np.ndarray:
    """y at the times `at` of y' = pole*y + gain*u(t - delay), u being values[i] from changes[i] on and 0 before; at rest at the start."""
    changes = changes + delay
    events = np.unique(np.concatenate([at, changes]))
    held = np.concatenate([[0.0], values])[np.searchsorted(changes, events, side="right")]
    y, out = 0.0, np.zeros(len(events))
    for k in range(1, len(events)):
        grown = np.exp(pole * (events[k] - events[k - 1]))
        y = grown * y + gain * held[k - 1] * (grown - 1.0) / pole
        out[k] = y
    return out[np.searchsorted(events, at)]


def binary(rng: np.random.Generator, samples: int, hold: int) -> np.ndarray:
    """A random binary signal that may change every `hold` samples."""
    return np.repeat(rng.choice([-1.0, 1.0], samples // hold + 1), hold)[:samples]


def two_inputs() -> tuple[str, np.ndarray]:
    """Heater and fan act on one temperature after 0.35 s and 0.8 s; the fan follows the heater three times out of four."""
    rng, step, samples = np.random.default_rng(1), 0.1, 600
    time = step * np.arange(samples)
    heater = binary(rng, samples, 2)
    fan = np.where(np.repeat(rng.random(samples // 2) < 0.75, 2), heater, binary(rng, samples, 2))
    y = respond(time, time, heater, 1 / 1.2, -1 / 1.2, 0.35) + respond(time, time, fan, -0.6 / 0.8, -1 / 0.8, 0.8)
    return "time,heater [1],fan [1],temperature [K]", np.column_stack([time, heater, fan, y + 0.02 * rng.standard_normal(samples)])


def unstable_loop() -> tuple[str, np.ndarray]:
    """1/(s - 0.5) behind 0.25 s, held by u = r - 2 y; noise of the output goes round the loop."""
    rng, step, samples, pole, delay, gain = np.random.default_rng(2), 0.1, 800, 0.5, 0.25, 2.0
    whole = int(delay / step)
    rest = step - (delay - whole * step)
    a = np.exp(pole * step)
    new, old = (np.exp(pole * rest) - 1) / pole, (a - np.exp(pole * rest)) / pole
    r = binary(rng, samples, 3)
    u, y, x = np.zeros(samples), np.zeros(samples), 0.0
    for k in range(samples):
        if k > 0:
            x = a * x + sum(g * u[k - 1 - whole - i] for i, g in enumerate((new, old)) if k - 1 - whole - i >= 0)
        y[k] = x + 0.1 * rng.standard_normal()
        u[k] = r[k] - gain * y[k]
    return "time,torque [N*m],rate [rad/s]", np.column_stack([step * np.arange(samples), u, y])


def irregular() -> tuple[str, np.ndarray]:
    """Time stamps with a jitter of a third of the step and every tenth row lost; 0.4 s of dead time before 1/(0.6 s + 1)."""
    rng, step, samples = np.random.default_rng(3), 0.05, 900
    time = step * (np.arange(samples) + np.concatenate([[0.0], rng.uniform(-0.33, 0.33, samples - 1)]))
    time = time[np.sort(np.concatenate([[0], 1 + rng.permutation(samples - 1)[: samples - samples // 10]]))]
    valve = binary(rng, len(time), 4)
    y = respond(time, time, valve, 1 / 0.6, -1 / 0.6, 0.4)
    return "time,valve [1],pressure [bar]", np.column_stack([time, valve, y + 0.01 * rng.standard_normal(len(time))])


def missing() -> tuple[str, np.ndarray]:
    """One output sample in five was never measured, and a stretch of a second and a half; 0.3 s of dead time before 2/(0.5 s + 1)."""
    rng, step, samples = np.random.default_rng(4), 0.1, 700
    time = step * np.arange(samples)
    pump = binary(rng, samples, 2)
    level = respond(time, time, pump, 2 / 0.5, -1 / 0.5, 0.3) + 0.02 * rng.standard_normal(samples)
    level[rng.random(samples) < 0.2] = np.nan
    level[300:315] = np.nan
    return "time,pump [1],level [m]", np.column_stack([time, pump, level])


def moving() -> tuple[str, np.ndarray]:
    """0.1 s of dead time before 1/(0.12 s + 1) until 12.4 s, 0.3 s from then on."""
    rng, step, samples, jump = np.random.default_rng(5), 0.02, 1200, 12.4
    time = step * np.arange(samples)
    command = binary(rng, samples, 4)
    # Two plants whose inputs stop and begin at the jump: what acts from then on was commanded 0.3 s before.
    before = np.where(time + 0.1 < jump, command, 0.0)
    behind = np.where(time + 0.3 >= jump, command, 0.0)
    speed = respond(time, time, before, 1 / 0.12, -1 / 0.12, 0.1) + respond(time, time, behind, 1 / 0.12, -1 / 0.12, 0.3)
    return "time,command [1],speed [m/s]", np.column_stack([time, command, speed + 0.1 * rng.standard_normal(samples)])


def text(header: str, rows: np.ndarray) -> str:
    out = io.StringIO()
    out.write(header + "\n")
    for row in rows:
        out.write(",".join("" if np.isnan(v) else f"{v:.6g}" for v in row) + "\n")
    return out.getvalue()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare with what is there and write nothing")
    check = parser.parse_args().check
    wrong = []
    for make in (two_inputs, unstable_loop, irregular, missing, moving):
        path, fresh = EXAMPLES / f"{make.__name__}.csv", text(*make())
        if not check:
            temporary = path.with_suffix(".tmp")
            temporary.write_text(fresh)
            temporary.replace(path)
        elif not path.is_file() or path.read_text() != fresh:
            wrong.append(path.name)
    print(f"not as the script writes them: {', '.join(wrong)}" if wrong else "logs of the examples: " + ("as written" if check else "written"))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
