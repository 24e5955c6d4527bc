"""Sampled models with input delays, as formulas written out; each is checked against an independent calculation.

A delay of tau = (whole + fraction) sample times, 0 <= fraction < 1, acts on the input. All time responses are those of
the transfer function H(z): zero state, u[k] = 0 for k < 0.
"""

from dataclasses import dataclass
from math import comb, floor

import numpy as np
from scipy import integrate, linalg, signal

from .plants import Plant


@dataclass(frozen=True)
class TappedModel:
    """x[k+1] = A x[k] + sum_j B[j] u[k-j],  y[k] = C x[k] + sum_j D[j] u[k-j]; B and D are keyed by the lag j."""

    a: np.ndarray
    b: dict[int, np.ndarray]
    c: np.ndarray
    d: dict[int, np.ndarray]

    def frequency_response(self, z: np.ndarray) -> np.ndarray:
        """H at the points z of the complex plane, shape [points, outputs] (one input)."""
        identity = np.eye(len(self.a))
        response = []
        for point in z:
            state = np.linalg.solve(point * identity - self.a, sum(b * point**-lag for lag, b in self.b.items()))
            response.append((self.c @ state + sum(d * point**-lag for lag, d in self.d.items()))[:, 0])
        return np.array(response)

    def simulate(self, u: np.ndarray) -> np.ndarray:
        """Response y [N, outputs] to u [N] from rest."""
        x = np.zeros(len(self.a))
        y = np.zeros((len(u), len(self.c)))
        for k in range(len(u)):
            past = lambda lag: u[k - lag] if k >= lag else 0.0
            y[k] = self.c @ x + sum(d[:, 0] * past(lag) for lag, d in self.d.items())
            x = self.a @ x + sum(b[:, 0] * past(lag) for lag, b in self.b.items())
        return y

    def delayed(self, lag: int) -> "TappedModel":
        """The model behind a pure delay of `lag` samples."""
        return TappedModel(self.a, {j + lag: b for j, b in self.b.items()}, self.c, {j + lag: d for j, d in self.d.items()})


def split(delay_samples: float) -> tuple[int, float]:
    """Whole and fractional part of a delay in samples."""
    whole = floor(delay_samples)
    return whole, delay_samples - whole


def half_up(value: float) -> int:
    return floor(value + 0.5)


def held(a: np.ndarray, b: np.ndarray, span: float) -> tuple[np.ndarray, np.ndarray]:
    """exp(A span) and the integral of exp(A s) B over [0, span]."""
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a * span, b * span
    exponential = linalg.expm(block)
    return exponential[:n, :n], exponential[:n, n:]


def ramped(a: np.ndarray, b: np.ndarray, span: float, sample_time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """exp(A span), the held integral, and the integral of exp(A (span - r)) B r / Ts over r in [0, span]."""
    n, m = b.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m] = a * span, b * span
    block[n : n + m, n + m :] = np.eye(m) * (span / sample_time)
    exponential = linalg.expm(block)
    return exponential[:n, :n], exponential[:n, n : n + m], exponential[:n, n + m :]


# --- the methods ------------------------------------------------------------------------------------------------


def zoh(plant: Plant, sample_time: float, delay: float) -> TappedModel:
    """Zero-order hold: the input is held between samples, then delayed."""
    whole, fraction = split(delay)
    early = fraction * sample_time
    phi, _ = held(plant.a, plant.b, sample_time)
    rest, newer = held(plant.a, plant.b, sample_time - early)
    _, older = held(plant.a, plant.b, early)
    if fraction == 0:
        return TappedModel(phi, {whole: newer}, plant.c, {whole: plant.d})
    return TappedModel(phi, {whole: newer, whole + 1: rest @ older}, plant.c, {whole + 1: plant.d})


def foh(plant: Plant, sample_time: float, delay: float) -> TappedModel:
    """Triangle hold: linear interpolation between all samples (u[k] = 0 before the first), then delayed.

    The state is the continuous one at the time of the last input sample that has arrived.
    """
    whole, fraction = split(delay)
    span = sample_time * (1 - fraction)
    phi, hold, ramp = ramped(plant.a, plant.b, sample_time, sample_time)
    part, part_hold, part_ramp = ramped(plant.a, plant.b, span, sample_time)
    older = plant.c @ (part_hold - part_ramp) + plant.d * fraction
    newer = plant.c @ part_ramp + plant.d * (1 - fraction)
    return TappedModel(phi, {whole + 1: hold - ramp, whole: ramp}, plant.c @ part, {whole + 1: older, whole: newer})


def impulse(plant: Plant, sample_time: float, delay: float, feedthrough: str) -> TappedModel | None:
    """H(z) = Ts sum_k h(k Ts - tau) z^-k with the full sample h(0) = C B; D kept beside it or dropped.

    None when D would have to be kept at a time between two samples.
    """
    whole, fraction = split(delay)
    phi = linalg.expm(plant.a * sample_time)
    first = linalg.expm(plant.a * (sample_time * (1 - fraction)))
    keep = feedthrough == "keep" and np.any(plant.d != 0)
    if fraction > 0 and keep:
        return None
    direct = sample_time * plant.c @ plant.b + (plant.d if keep else 0.0)
    return TappedModel(
        phi, {whole: sample_time * plant.b}, plant.c @ first, {} if fraction > 0 else {whole: direct}
    )


def tustin(plant: Plant, sample_time: float, delay: int, prewarp: float | None = None) -> TappedModel:
    """Bilinear rule with Bd = Ts M B, Cd = C M; with prewarp, Ts is replaced by 2 tan(w Ts / 2) / w."""
    step = sample_time if prewarp is None else 2 * np.tan(prewarp * sample_time / 2) / prewarp
    half = plant.a * (step / 2)
    m = np.linalg.inv(np.eye(len(half)) - half)
    return TappedModel(
        m @ (np.eye(len(half)) + half), {delay: step * m @ plant.b},
        plant.c @ m, {delay: plant.d + step / 2 * plant.c @ m @ plant.b},
    )


@dataclass(frozen=True)
class AllPass:
    """z^-lag times an all-pass filter b(z^-1)/a(z^-1)."""

    lag: int
    b: np.ndarray
    a: np.ndarray

    def frequency_response(self, z: np.ndarray) -> np.ndarray:
        w = 1 / z
        return w**self.lag * np.polynomial.polynomial.polyval(w, self.b) / np.polynomial.polynomial.polyval(w, self.a)

    def filter(self, y: np.ndarray) -> np.ndarray:
        shifted = np.vstack([np.zeros((self.lag, y.shape[1])), y])[: len(y)]
        return signal.lfilter(self.b, self.a, shifted, axis=0)


def thiran(delay: float, max_order: int) -> AllPass:
    """Thiran's maximally flat all-pass of order min(max_order, floor(delay + 1/2)) behind whole samples of delay."""
    order = min(max_order, half_up(delay))
    if delay == floor(delay) or order == 0:
        return AllPass(half_up(delay), np.ones(1), np.ones(1))
    lag = half_up(delay - order)
    rest = delay - lag
    a = np.array([
        (-1) ** k * comb(order, k) * np.prod([(rest - order + i) / (rest - order + k + i) for i in range(order + 1)])
        for k in range(order + 1)
    ])
    filtered = AllPass(lag, a[::-1].copy(), a)
    slow = 1e-4
    assert np.all(np.abs(np.roots(a)) < 1)
    assert abs(-np.angle(filtered.frequency_response(np.exp(1j * np.array([slow]))))[0] / slow - delay) < 1e-6
    return filtered


# --- checks -----------------------------------------------------------------------------------------------------


def _continuous_input(u: np.ndarray, sample_time: float, hold: str, index: int):
    """The undelayed input on [index Ts, (index + 1) Ts), as a function of time."""
    at = lambda i: u[i] if 0 <= i < len(u) else 0.0
    if hold == "zoh":
        return lambda t: at(index)
    return lambda t: at(index) + (at(index + 1) - at(index)) * (t / sample_time - index)


def integrated(plant: Plant, sample_time: float, delay: float, u: np.ndarray, hold: str) -> np.ndarray:
    """y at the sample times by a Runge-Kutta solver that stops at every input edge and every sample."""
    tau = delay * sample_time
    first = -1 if hold == "foh" else 0
    edges = [(i * sample_time + tau, i) for i in range(first, len(u) + 1)]
    samples = sample_time * np.arange(len(u))
    stops = sorted({round(t, 12) for t, _ in edges} | {round(t, 12) for t in samples})
    x, now = np.zeros(len(plant.a)), stops[0]
    y = []
    wanted = list(np.round(samples, 12))
    for stop in stops:
        if stop > now:
            index = floor(((now + stop) / 2 - tau) / sample_time)
            drive = _continuous_input(u, sample_time, hold, index)
            slope = lambda t, x: plant.a @ x + plant.b[:, 0] * drive(t - tau)
            x = integrate.solve_ivp(slope, (now, stop), x, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
            now = stop
        if wanted and stop == wanted[0]:
            index = floor((stop - tau) / sample_time + 1e-9)
            drive = _continuous_input(u, sample_time, hold, index)
            y.append(plant.c @ x + plant.d[:, 0] * drive(stop - tau))
            wanted.pop(0)
    return np.array(y)


def assert_close(actual, expected, limit: float, what: str) -> None:
    """Largest difference relative to the largest expected magnitude."""
    actual, expected = np.asarray(actual), np.asarray(expected)
    scale = np.max(np.abs(expected), initial=0.0) or 1.0
    error = np.max(np.abs(actual - expected), initial=0.0) / scale
    assert error <= limit, f"{what}: {error:.3g} > {limit:.3g}"


def scipy_model(plant: Plant, sample_time: float, method: str) -> tuple:
    """A, B, C, D of scipy's cont2discrete (zoh, foh, impulse, tustin)."""
    name = {"tustin": "bilinear"}.get(method, method)
    return signal.cont2discrete((plant.a, plant.b, plant.c, plant.d), sample_time, name)[:4]


def scipy_response(model: tuple, sample_time: float, u: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequency response and time response of a sampled A, B, C, D."""
    plain = TappedModel(model[0], {0: model[1]}, model[2], {0: model[3]})
    _, y, _ = signal.dlsim((*model, sample_time), u)
    return plain.frequency_response(z), y
