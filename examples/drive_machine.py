"""The machine that the tutorials pretend to have: the drive of drive.toml with something that the model lacks.

`python drive_machine.py` writes the logs that find_my_gap.py reads. A reader who wants to find the gap himself should stop here.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESISTANCE, CONSTANT, INERTIA, VISCOUS = 1.2, 0.05, 4e-4, 3e-4  # ohm, V s/rad, kg m^2, N m s/rad
SAMPLE_TIME = 0.01  # s
NOISE = 0.5  # rad/s
STEPS = 50  # of the motor per sample: delays are multiples of 0.2 ms


def drive(voltage: Array, seed: int, delay: float = 0.0, dead_zone: float = 0.0) -> tuple[Array, Array]:
    """Time (s) and measured speed (rad/s) under commands (V) that are held for a sample each.

    They come late by `delay` (s), and do nothing below `dead_zone` (V).
    """
    late = round(delay * STEPS / SAMPLE_TIME)
    held = np.repeat(voltage, STEPS)
    arriving = np.concatenate([np.full(late, voltage[0]), held[: len(held) - late]])
    arriving = np.sign(arriving) * np.maximum(np.abs(arriving) - dead_zone, 0.0)
    rate = (CONSTANT**2 / RESISTANCE + VISCOUS) / INERTIA
    decay = np.exp(-rate * SAMPLE_TIME / STEPS)
    final = CONSTANT / RESISTANCE / INERTIA / rate * arriving
    speed, now = np.empty(len(voltage)), 0.0
    for k in range(len(arriving)):
        if k % STEPS == 0:
            speed[k // STEPS] = now
        now = decay * now + (1.0 - decay) * final[k]
    time = np.arange(len(voltage), dtype=np.float64) * SAMPLE_TIME
    return time, speed + NOISE * np.random.default_rng(seed).standard_normal(len(voltage))


def run(number: int) -> Array:
    """One run of find_my_gap.py as it is logged: time, volts held for a tenth of a second each, speed in revolutions per minute."""
    voltage = np.repeat(np.random.default_rng(10 + number).uniform(-12.0, 12.0, 100), 10).round(2)
    time, speed = drive(voltage, number, delay=0.012)
    return np.column_stack([time, voltage, speed * 60.0 / (2.0 * np.pi)])


def write(folder: Path) -> None:
    """The logs of find_my_gap.py."""
    for number in (1, 2):
        rows = [f"{t:.2f},{u:.2f},{y:.2f}\n" for t, u, y in run(number)]
        (folder / f"drive_run_{number}.csv").write_text("time,voltage [V],speed\n" + "".join(rows), encoding="utf-8")


if __name__ == "__main__":
    write(Path(__file__).parent)
