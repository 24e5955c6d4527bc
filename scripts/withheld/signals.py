"""Commands and noise as an experimenter would see them."""

import numpy as np
from scipy import signal


def _levels(rng, time, period):
    """Multilevel pseudo-random steps that hold between one and four periods."""
    values, k = np.empty(len(time)), 0
    while k < len(time):
        hold = max(1, int(round(period * rng.integers(1, 5) / (time[1] - time[0]))))
        values[k:k + hold] = rng.choice([-1.5, -1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0, 1.5])
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
        size, k = rng.choice([0.5, 0.9, 1.4, 2.0]) * rng.choice([-1, 1]), k + int(period * rng.uniform(1, 4) / step)
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


KINDS = (_levels, _multisine, _manoeuvres, _steps, _chirp)


def excitation(rng, time: np.ndarray, levels, settling: float) -> np.ndarray:
    """Commands about 0 [N, nu]: two or three kinds one after another, a short rest first, so that amplitudes and speeds vary."""
    columns = []
    for level in levels:
        kinds = list(rng.permutation(len(KINDS)))[: rng.integers(2, 4)]
        if not {0, 2} & set(kinds):
            kinds[0] = rng.choice([0, 2])
        bounds = np.linspace(0, len(time), len(kinds) + 1).astype(int)
        parts = [KINDS[k](rng, time[a:b], settling * rng.uniform(0.8, 2.0)) for k, a, b in zip(kinds, bounds, bounds[1:])]
        column = np.concatenate(parts)
        column[: int(len(time) * rng.uniform(0.0, 0.03))] = 0.0
        columns.append(level * column)
    return np.stack(columns, axis=1)


def noise(rng, samples: int, deviations: np.ndarray, colour: str) -> np.ndarray:
    """White noise, or noise through a first- or second-order filter, of the given standard deviations [ny]."""
    white = rng.standard_normal((samples + 300, len(deviations)))
    denominators = {"white": [1.0], "ar1": [1.0, -0.7], "ar2": [1.0, -1.2, 0.55]}
    coloured = signal.lfilter([1.0], denominators[colour], white, axis=0)
    impulse = signal.lfilter([1.0], denominators[colour], np.eye(1, 400)[0])
    return coloured[300:] / np.sqrt(np.sum(impulse**2)) * deviations
