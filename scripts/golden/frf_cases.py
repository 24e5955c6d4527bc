"""Case delays_frf: frequency responses of python-control's plants with a delay and noise of known standard deviation, fitted by scipy's least squares."""

import control
import numpy as np
from scipy import optimize

TOOL = "numpy 2.3.5, scipy 1.17.1, python-control 0.10.2"
POINTS = 70


def mode(frequency_hz: float, damping: float):
    w = 2 * np.pi * frequency_hz
    return control.tf([w**2], [1, 2 * damping * w, w**2])


#: Plant, delay (s), band (Hz), noise as a share of each magnitude. The orders (poles, zeros) are those of the plant.
PLANTS = {
    "lag": (control.tf([2.0], [0.3, 1]), 0.05, (0.1, 20.0), 0.02),
    "two_lags": (control.tf([1.0], [0.3, 1]) * control.tf([1.0], [0.02, 1]), 0.0314, (0.1, 30.0), 0.02),
    "resonance": (mode(8.0, 0.02) * control.tf([1.0], [0.05, 1]), 0.013, (0.3, 40.0), 0.02),
    "two_modes": (mode(5.0, 0.03) + 0.5 * mode(14.0, 0.03), 0.021, (0.3, 40.0), 0.01),
    "right_zero": (control.tf([-0.04, 1], [0.3, 1]) * control.tf([1.0], [0.05, 1]), 0.05, (0.1, 20.0), 0.02),
    "integrator": (control.tf([3.0], [0.1, 1, 0]), 0.12, (0.05, 5.0), 0.02),
}


def fit(omega, h, std, plant, delay):
    """Delay and its standard deviation: all coefficients and the delay by `least_squares` in powers of s over the band's middle, from the truth."""
    num, den = np.atleast_1d(np.squeeze(plant.num[0][0])), np.atleast_1d(np.squeeze(plant.den[0][0]))
    unit = np.sqrt(omega[0] * omega[-1])
    num, den = num * unit ** np.arange(len(num) - 1, -1, -1.0), den * unit ** np.arange(len(den) - 1, -1, -1.0)
    num, den = np.trim_zeros(num, "f") / den[0], den / den[0]
    s = 1j * omega / unit

    def rest(p):
        b, a = p[: len(num)], np.concatenate([[1.0], p[len(num) : -1]])
        e = (h - np.exp(-s * p[-1]) * np.polyval(b, s) / np.polyval(a, s)) / std
        return np.concatenate([e.real, e.imag])

    start = np.concatenate([num, den[1:], [delay * unit]])
    scale = np.maximum(np.abs(start), 1e-3)
    found = optimize.least_squares(rest, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale=scale, max_nfev=2000)
    freedom = len(found.fun) - len(start)
    jacobian = found.jac * scale
    covariance = np.linalg.inv(jacobian.T @ jacobian) * np.outer(scale, scale) * 2 * found.cost / freedom
    return found.x[-1] / unit, np.sqrt(covariance[-1, -1]) / unit, len(den) - 1, len(num) - 1


def frf(stored: dict | None) -> dict:
    known = {case["id"]: case for case in stored["cases"]} if stored is not None else {}
    generator = np.random.default_rng(1717)
    cases = []
    for name, (plant, delay, band, share) in PLANTS.items():
        omega = 2 * np.pi * np.geomspace(*band, POINTS)
        clean = plant(1j * omega) * np.exp(-1j * omega * delay)
        std = share * np.abs(clean) / np.sqrt(2)
        if name in known:
            h = np.array(known[name]["h_re"]) + 1j * np.array(known[name]["h_im"])
            std, omega = np.array(known[name]["std"]), np.array(known[name]["omega_rad_s"])
        else:
            h = clean + std * (generator.standard_normal(POINTS) + 1j * generator.standard_normal(POINTS))
        found, deviation, poles, zeros = fit(omega, h, std, plant, delay)
        assert abs(found - delay) < 5 * deviation, (name, found, delay, deviation)
        cases.append({
            "id": name, "true_delay_s": delay, "omega_rad_s": omega, "h_re": h.real, "h_im": h.imag, "std": std,
            "poles": poles, "zeros": zeros, "delay_s": found, "std_s": deviation,
        })
    return {"tool": TOOL, "tolerance": {"default": 1e-9, "delay_s": 1e-6, "std_s": 1e-4}, "cases": cases}
