"""Case signals: the excitations sample by sample, and the correlations that random ones and the noise must have."""

import numpy as np
from scipy import signal

from .discretise import assert_close

TOOL = "numpy 2.3.5, scipy 1.17.1"
SAMPLES, LAGS = 200, 12
# A primitive polynomial of every order, as taps: bit(k) = sum of bit(k - t). scipy's register counts them from its other end.
TAPS = {3: (3, 2), 5: (5, 3), 7: (7, 6), 9: (9, 5), 11: (11, 9)}
COLOURS = {
    "white": ([], []),
    "ar1": ([-0.7], []),
    "ar2": ([-1.2, 0.72], []),
    "arma": ([-0.368, 1.671e-5], [0.5, -0.3]),
    "ma": ([], [0.9, 0.2]),
}
BANDS = ((0.0, 1.0), (0.0, 0.3), (0.1, 0.3), (0.5, 1.0))


def prbs(order: int):
    """Two periods of +-1, the register full of ones at first."""
    bits, _ = signal.max_len_seq(order, state=np.ones(order), length=2 * (2**order - 1), taps=[order - t for t in TAPS[order] if t != order])
    return 2.0 * bits - 1


def chirp(start, end, method):
    """Frequencies are fractions of the Nyquist frequency; scipy's chirp is a cosine."""
    t = np.arange(SAMPLES)
    return signal.chirp(t, start / 2, SAMPLES - 1, end / 2, method=method, phi=-90)


def multisine(period, lines, normalise):
    """Cosines with Schroeder's phases -pi j (j - 1)/M, added up one by one."""
    k = np.arange(period)
    x = sum(np.cos(2 * np.pi * h * k / period - np.pi * j * (j - 1) / len(lines)) for j, h in enumerate(lines, 1))
    return x / (np.max(np.abs(x)) if normalise == "peak" else np.sqrt(np.mean(x**2)))


def at(pieces, length=SAMPLES):
    u = np.zeros(length)
    for start, end, value in pieces:
        u[start:end] = value
    return u


def deterministic() -> list[dict]:
    ramps = np.concatenate([np.linspace(0, 0.01, 21), np.linspace(0.01, 0, 21)[1:], np.zeros(SAMPLES - 41)])
    made = [
        ("two_ramps", {}, ramps),
        ("impulse", {"at": 7, "amplitude": 0.5}, 0.5 * signal.unit_impulse(SAMPLES, 7)),
        ("step", {"at": 30, "amplitude": -2.0}, at([(30, SAMPLES, -2.0)])),
        ("staircase", {"pieces": [[0.0, 20], [1.0, 50], [-1.0, 60], [0.5, 10]]}, at([(20, 70, 1.0), (70, 130, -1.0), (130, SAMPLES, 0.5)])),
        ("doublet", {"at": 12, "width": 9, "amplitude": 1.5}, at([(12, 21, 1.5), (21, 30, -1.5)])),
        ("three_two_one_one", {"at": 5, "unit": 8}, at([(5, 29, 1.0), (29, 45, -1.0), (45, 53, 1.0), (53, 61, -1.0)])),
        ("chirp", {"from": 0.01, "to": 0.5}, chirp(0.01, 0.5, "linear")),
        ("chirp", {"from": 0.02, "to": 0.8, "sweep": "logarithmic"}, chirp(0.02, 0.8, "logarithmic")),
        ("multisine", {"period": 100, "band": [0.1, 0.6]}, np.tile(multisine(100, range(5, 31), "peak"), 2)),
        ("multisine", {"period": 200, "harmonics": "odd", "normalise": "rms"}, multisine(200, range(1, 100, 2), "rms")),
    ]
    made += [("prbs", {"order": order}, prbs(order)) for order in TAPS]
    return [{"id": f"{name} {i}", "excitation": name, "options": options, "u": u} for i, (name, options, u) in enumerate(made)]


def autocorrelation(b, a, length=6000):
    """Of unit white noise through b/a: the sum of products of the impulse response."""
    h = signal.lfilter(b, a, signal.unit_impulse(length))
    r = np.array([h[lag:] @ h[: len(h) - lag] for lag in range(LAGS + 1)])
    return r / r[0]


def band(low, high):
    """The sign of Gaussian noise of correlation rho has the correlation (2/pi) asin(rho)."""
    if (low, high) == (0.0, 1.0):
        return np.concatenate([[1.0], np.zeros(LAGS)])
    edges, kind = (high, "lowpass") if low == 0 else (low, "highpass") if high == 1 else ([low, high], "bandpass")
    sos = signal.butter(8, edges, kind, output="sos")
    h = signal.sosfilt(sos, signal.unit_impulse(6000))
    r = np.array([h[lag:] @ h[: len(h) - lag] for lag in range(LAGS + 1)])
    return 2 / np.pi * np.arcsin(np.clip(r / r[0], -1, 1))


def signals(stored: dict | None) -> dict:
    noise = []
    for name, (ar, ma) in COLOURS.items():
        r = autocorrelation([1.0, *ma], [1.0, *ar])
        w, h = signal.freqz([1.0, *ma], [1.0, *ar], 2**14, whole=True)
        power = np.abs(h) ** 2
        by_spectrum = np.array([np.mean(power * np.cos(w * lag)) for lag in range(LAGS + 1)])
        assert_close(r, by_spectrum / by_spectrum[0], 1e-10, name)
        noise.append({"id": name, "ar": ar, "ma": ma, "autocorrelation": r})
    return {
        "tool": TOOL,
        "tolerance": {"default": 1e-12},
        "cases": deterministic(),
        "noise": noise,
        "rbs": [{"id": f"rbs {low} {high}", "band": [low, high], "autocorrelation": band(low, high)} for low, high in BANDS],
    }
