"""Commands and noise as an experimenter would see them."""

import numpy as np
from scipy import signal

SIZES = (0.3, 0.6, 1.0, 1.5)


def _size(rng) -> float:
    """A level of either sign; no two commands are the same to the last digit."""
    return float(rng.choice(SIZES) * rng.choice([-1, 1]) * rng.uniform(0.85, 1.15))


def _levels(rng, time, period):
    """Multilevel pseudo-random steps that hold between one and four periods."""
    values, k = np.empty(len(time)), 0
    while k < len(time):
        hold = max(1, int(round(period * rng.integers(1, 5) / (time[1] - time[0]))))
        values[k:k + hold] = _size(rng) if rng.random() < 0.9 else 0.0
        k += hold
    return values


def _multisine(rng, time, period):
    frequencies = rng.uniform(0.02, 0.6, 10) / period
    total = sum(np.sin(2 * np.pi * f * time + rng.uniform(0, 2 * np.pi)) / (1 + f * period) for f in frequencies)
    return 0.9 * total / np.std(total)


def _manoeuvres(rng, time, period):
    """Doublets and 3-2-1-1 of several sizes with rests between."""
    values, k, step = np.zeros(len(time)), 0, time[1] - time[0]
    while k < len(time):
        pattern = [(1, 1), (-1, 1)] if rng.random() < 0.5 else [(1, 3), (-1, 2), (1, 1), (-1, 1)]
        size, k = 1.35 * _size(rng), k + int(period * rng.uniform(1, 4) / step)
        for sign, length in pattern:
            samples = max(1, int(round(1.5 * length * period / step)))
            values[k:k + samples] = sign * size
            k += samples
    return values


def _steps(rng, time, period):
    return 0.9 * _levels(rng, time, 6 * period)


def _chirp(rng, time, period):
    sweep = signal.chirp(time - time[0], 0.01 / period, max(time[-1] - time[0], 1e-9), 0.4 / period, method="logarithmic", phi=rng.uniform(0, 360))
    return rng.uniform(0.8, 1.4) * sweep


def _binary(rng, time, period):
    """A two-level pseudo-random signal whose size changes often."""
    values, k, step, size = np.empty(len(time)), 0, time[1] - time[0], abs(_size(rng))
    while k < len(time):
        hold = max(1, int(round(period * rng.integers(1, 6) / 1.5 / step)))
        values[k:k + hold] = size * rng.choice([-1, 1])
        size, k = abs(_size(rng)) if rng.random() < 0.3 else size, k + hold
    return values


def _ramps(rng, time, period):
    """Straight lines between random corners, with rests."""
    corners = [0.0]
    while corners[-1] < time[-1] - time[0]:
        corners.append(corners[-1] + period * rng.uniform(1.0, 6.0))
    values = np.array([_size(rng) for _ in corners])
    rests = np.flatnonzero(rng.random(len(corners) - 1) < 0.25) + 1
    values[rests] = values[rests - 1]
    return np.interp(time - time[0], corners, values)


def _staircase(rng, time, period):
    """Up and down in equal steps."""
    steps = int(rng.integers(3, 7))
    level = np.concatenate([np.arange(-steps, steps + 1), np.arange(steps - 1, -steps, -1)]) * 1.5 / steps
    hold = period * rng.uniform(1.5, 4.0)
    return level[(np.floor((time - time[0]) / hold).astype(int) + steps) % len(level)] * rng.uniform(0.7, 1.1)


def _pulses(rng, time, period):
    """Short kicks out of rest, alternately long and short."""
    values, k, step = np.zeros(len(time)), 0, time[1] - time[0]
    while k < len(time):
        k += max(1, int(period * rng.uniform(1.0, 3.0) / step))
        samples = max(1, int(round(period * rng.uniform(0.3, 1.5) / step)))
        values[k:k + samples] = 1.5 * _size(rng)
        k += samples
    return values


def _by_hand(rng, time, period):
    """A person at a stick: low-passed noise."""
    step = time[1] - time[0]
    low = signal.butter(2, min(0.8, 2 * step * rng.uniform(0.1, 0.4) / period))
    series = signal.lfilter(*low, rng.standard_normal(len(time) + 2000))[2000:]
    return 0.9 * series / max(np.std(series), 1e-9)


def _chopped(rng, time, period):
    """A sine whose size and frequency change from burst to burst."""
    values, k, step = np.zeros(len(time)), 0, time[1] - time[0]
    while k < len(time):
        frequency, cycles = rng.uniform(0.05, 0.4) / period, rng.integers(2, 6)
        samples = max(4, int(cycles / frequency / step))
        part = time[k:k + samples] - time[k]
        values[k:k + samples] = 1.2 * _size(rng) * np.sin(2 * np.pi * frequency * part)
        k += samples
    return values


BROAD = (_levels, _manoeuvres, _binary, _pulses)  # one of them is in every log: sharp edges, several sizes
KINDS = (*BROAD, _multisine, _steps, _chirp, _ramps, _staircase, _by_hand, _chopped)


def is_rich(columns: np.ndarray) -> bool:
    """At least five levels, and no combination of eight successive commands that vanishes."""
    for column in columns.T:
        stacked = np.lib.stride_tricks.sliding_window_view(column - column.mean(), 8)
        power = np.linalg.eigvalsh(stacked.T @ stacked)
        if power[0] < 1e-6 * power[-1] or len(np.unique(np.round(column / (np.abs(column).max() or 1.0), 6))) < 5:
            return False
    return True


def excitation(rng, time: np.ndarray, levels, settling: float) -> np.ndarray:
    """Commands about 0 [N, nu]: two or three kinds one after another, a short rest first, so that amplitudes and speeds vary."""
    columns = []
    for level in levels:
        kinds = list(rng.permutation(len(KINDS)))[: rng.integers(2, 4)]
        if not set(kinds) & set(range(len(BROAD))):
            kinds[rng.integers(len(kinds))] = rng.integers(len(BROAD))
        bounds = np.linspace(0, len(time), len(kinds) + 1).astype(int)
        parts = [KINDS[k](rng, time[a:b], settling * rng.uniform(0.8, 2.0)) for k, a, b in zip(kinds, bounds, bounds[1:])]
        column = np.concatenate(parts)
        column[: int(len(time) * rng.uniform(0.0, 0.03))] = 0.0
        columns.append(level * column)
    return np.stack(columns, axis=1)


def stamps(rng, step: float, duration: float, timing: str) -> np.ndarray:
    """Time stamps (s): `even`; `jitter`, each up to a quarter of a sample early or late; `missed`, now and then one to three cycles do not run."""
    count = int(duration / step)
    early = rng.integers(-4, 5, count) / 16 if timing == "jitter" else np.zeros(count)
    time = np.round((np.arange(count) + early) * step, 10)
    if timing == "missed":
        kept = np.ones(count, dtype=bool)
        for first in np.flatnonzero(rng.random(count) < 0.01):
            kept[first:first + rng.integers(1, 4)] = False
        kept[0] = True
        time = time[kept]
    return time - time[0]


def colour(rng) -> list[float]:
    """The denominator of a filter that colours white noise: none, first order, or a resonance."""
    kind = rng.choice(["white", "first", "second"], p=[0.4, 0.35, 0.25])
    if kind == "first":
        return [1.0, -float(rng.uniform(-0.3, 0.9))]
    if kind == "second":
        radius, angle = rng.uniform(0.5, 0.85), rng.uniform(0.1, 0.8) * np.pi
        return [1.0, float(-2 * radius * np.cos(angle)), float(radius**2)]
    return [1.0]


def noise(rng, samples: int, colours: list[list[float]], heavy: bool) -> np.ndarray:
    """Noise of unit standard deviation [N, ny], one colour per output; `heavy`: Student's t with 6 degrees of freedom drives it."""
    columns = []
    for denominator in colours:
        drive = rng.standard_t(6, samples + 300) / np.sqrt(1.5) if heavy else rng.standard_normal(samples + 300)
        impulse = signal.lfilter([1.0], denominator, np.eye(1, 400)[0])
        columns.append(signal.lfilter([1.0], denominator, drive)[300:] / np.sqrt(np.sum(impulse**2)))
    return np.stack(columns, axis=1)
