"""Case delays_process: continuous models of one to three real poles with and without a zero, their slopes and the bounds that follow."""

import numpy as np
from scipy import integrate, optimize, special

from .discretise import assert_close
from .witness import TOOL, answer, as_records, binary, kept, noisy

SAMPLES, WINDOW, DELAY = 220, 20, 6.35
LAGS, ZERO = (9.0, 4.0, 2.0), 3.0  # samples
SHAPES = {"p1d": (1, False), "p2d": (2, False), "p3d": (3, False), "p1dz": (1, True), "p2dz": (2, True), "p3dz": (3, True)}


def residues(lags, zero: float):
    """Partial fractions of (1 + zero s)/prod(1 + T s)/s: step response = 1 + sum r e^(-t/T)."""
    lags = np.asarray(lags, dtype=float)
    r = np.array([-(t ** (len(lags) - 1)) * (1 - zero / t) / np.prod([t - o for j, o in enumerate(lags) if j != i]) for i, t in enumerate(lags)])
    return r, lags


def step(t, lags, zero=0.0):
    """The step response of unit gain, 0 before t = 0 and its right-hand value there."""
    r, lags = residues(lags, zero)
    after = np.maximum(t, 0.0)
    return np.where(t >= 0, 1 + np.exp(-after[..., None] / lags) @ r, 0.0)


def impulse(t, lags, zero=0.0):
    """Its derivative for t > 0."""
    r, lags = residues(lags, zero)
    return np.where(t > 0, np.exp(-np.maximum(t, 0.0)[..., None] / lags) @ (-r / lags), 0.0)


def held(u, kernel):
    """sum over jumps of u of jump * kernel(t - instant of the jump), from rest."""
    jumps = np.diff(np.concatenate([[0.0], u]))
    t = np.arange(len(u))
    return kernel(t[:, None] - t[None, :].astype(float)) @ jumps


def response(u, lags, delay, zero=0.0):
    return held(u, lambda t: step(t - delay, lags, zero))


def columns(u, lags, delay, zero: bool):
    """What K and K times the zero's time constant multiply."""
    plain = response(u, lags, delay)
    return np.column_stack([plain, response(u, lags, delay, 1.0) - plain] if zero else [plain])


def fit(u, y, poles: int, zero: bool):
    """(loss, delay): the least squares over gain, zero, level, poles and delay, started on a grid of delays and lags."""

    def rest(theta):
        # Time constants by positive steps from the fastest: equal ones have no partial fractions.
        lags = np.cumsum(np.exp(np.clip(theta[1:], -12, 12)))[::-1]
        basis = np.column_stack([columns(u, lags, theta[0], zero), np.ones(len(u))])
        linear = np.linalg.lstsq(basis, y, rcond=None)[0]
        return basis @ linear - y

    starts = [np.log(s[:poles]) for s in ([2.0, 2.0, 5.0], [4.0, 5.0, 2.0], [0.5, 3.0, 10.0])]
    if poles == 1 and zero:
        # A direct path: the jump shows at the next sample wherever within the last it came; whole delays only.
        found = []
        for delay in range(WINDOW + 1):
            best = min((optimize.least_squares(lambda s: rest([delay, *s]), start, xtol=1e-14, ftol=1e-14, gtol=1e-14) for start in starts), key=lambda f: f.cost)
            found.append(best.cost)
        return float(min(found)), float(np.argmin(found))
    best = None
    rough = sorted((np.sum(rest([d, *s]) ** 2), d, i) for d in np.arange(0, WINDOW, 0.5) for i, s in enumerate(starts))
    for _, d, i in rough[:6]:
        found = optimize.least_squares(rest, [d, *starts[i]], xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=300, diff_step=1e-7)
        if best is None or found.cost < best.cost:
            best = found
    return float(best.cost), float(best.x[0])


def record_of(poles: int, zero: bool):
    def make():
        generator = np.random.default_rng(900 + 10 * poles + zero)
        u = binary(SAMPLES, generator)
        delay = round(DELAY) if poles == 1 and zero else DELAY
        clean = columns(u, LAGS[:poles], delay, zero) @ ([1.7, 1.7 * ZERO] if zero else [1.7])
        return u, noisy(clean, 0.03, generator)

    return make


def slopes(u) -> dict:
    """The response of a model of two poles and a zero, its derivative by the delay, and the joint bound from the information matrix itself."""
    gain, lags, zero, delay, sigma = 1.7, np.array(LAGS[:2]), ZERO, DELAY, 0.2
    at = lambda k, t1, t2, z, d: k * response(u, [t1, t2], d, z)
    by_delay = -gain * held(u, lambda t: impulse(t - delay, lags, zero))
    point = np.array([gain, *lags, zero])
    others = []
    for i in range(4):
        moved = [point + s * np.eye(4)[i] * 1e-4 * point[i] for s in (-2, -1, 1, 2)]
        f = [at(*p, delay) for p in moved]
        others.append((f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12e-4 * point[i]))
    jacobian = np.column_stack([by_delay, *others])
    # A jump that falls on no sample: the derivative by a central difference is the analytic one.
    difference = (at(*point, delay + 1e-6) - at(*point, delay - 1e-6)) / 2e-6
    assert_close(by_delay, difference, 1e-6, "derivative by the delay")
    information = jacobian.T @ jacobian / sigma**2
    scale = np.sqrt(np.diag(information))
    joint = np.sqrt(np.linalg.inv(information / np.outer(scale, scale))[0, 0]) / scale[0]
    return {
        "gain": gain, "lags": lags, "zero": zero, "delay": delay, "noise": sigma, "response": at(*point, delay), "by_delay": by_delay,
        "known": sigma / np.linalg.norm(by_delay), "joint": joint,
    }


def tail(x):
    return 0.5 * special.erfc(x / np.sqrt(2))


def bounds(u) -> dict:
    """Integrals of the published bounds by adaptive quadrature."""
    samples, snr, duration, band = 500, 4.0, 12.0, (0.0, 20.0)
    white = lambda f: (2 * np.pi * f) ** 2 * snr**2 / (1 + 2 * snr)
    two = (2 * samples * integrate.quad(white, 0, 0.5)[0]) ** -0.5
    coherence = lambda f: 0.9 / (1 + (f / 5.0) ** 2)
    shaped = lambda f: (2 * np.pi * f) ** 2 * coherence(f) / (1 - coherence(f))
    general = (2 * duration * integrate.quad(shaped, *band)[0]) ** -0.5
    known = (samples * snr * integrate.quad(lambda w: w**2, 0, np.pi)[0] / np.pi) ** -0.5
    spectrum = np.fft.fft(u)
    derivative = np.fft.ifft(2j * np.pi * np.fft.fftfreq(len(u)) * spectrum)
    window, slope, most = 20.0, 1.5, 6.0
    distance = lambda h: np.minimum(slope * h, most)
    filled = lambda h: (1 - h / window) * tail(distance(h) / 2)  # falls in h: its own largest value from h on
    ziv = np.sqrt(integrate.quad(lambda h: h * filled(h), 0, window, points=[most / slope], epsabs=1e-13)[0])
    peak, cells = 3.5, 40.0
    normal = lambda x: np.exp(-x * x / 2) / np.sqrt(2 * np.pi)
    anomaly = 1 - integrate.quad(lambda z: normal(z - peak) * (1 - tail(z)) ** (cells - 1), peak - 12, peak + 12, epsabs=1e-13)[0]
    return {
        "samples": samples, "snr": snr, "duration_s": duration, "band_hz": band, "two_sensors_white": two, "two_sensors": general,
        "reference_white": known, "reference": 0.3 / np.sqrt(np.sum(np.abs(derivative) ** 2)), "noise": 0.3,
        "window": window, "slope": slope, "most": most, "ziv_zakai": ziv, "peak": peak, "cells": cells, "anomaly": anomaly,
    }


def process(stored: dict | None) -> dict:
    records = {name: kept(stored, name, record_of(*shape)) for name, shape in SHAPES.items()}
    answers = []
    for name, (poles, zero) in SHAPES.items():
        loss, delay = fit(*records[name], poles, zero)
        assert_close(delay, DELAY, 0.15, name)
        answers.append(answer(name, name, WINDOW, 1, raw=delay, delay=delay))
    u = records["p2dz"][0]
    return {
        "tool": TOOL,
        "tolerance": {"default": 1e-7, "joint": 1e-6, "raw": 1e-5, "delay": 1e-5},
        "records": as_records(**records),
        "within": 1e-4,
        "answers": answers,
        "slopes": slopes(u),
        "bounds": bounds(u),
    }
