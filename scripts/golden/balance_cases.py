"""Cases polynomials and balance: transfer functions of far-apart coefficients and systems in far-apart units, against exact rational arithmetic."""

from fractions import Fraction
from math import comb

import numpy as np
from scipy import linalg, signal

from . import exact
from .c2d_cases import TOOL
from .plants import _rational, _remainder, strip, transfer_function

# --- polynomials ----------------------------------------------------------------------------------------------------


def _lags(times) -> np.ndarray:
    """Coefficients of the product of (T s + 1)."""
    polynomial = np.array([1.0])
    for t in times:
        polynomial = np.polymul(polynomial, [t, 1.0])
    return polynomial


def _filters():
    for order in range(1, 13):
        for hertz in (1e-4, 3.0, 5e3, 1e8):
            yield f"butterworth{order}_{hertz:g}", *signal.butter(order, 2 * np.pi * hertz, analog=True), 2 * np.pi * hertz
    for order in range(1, 7):
        for hertz, width in ((1e-4, 0.5), (60e6, 0.3), (1e3, 0.1), (5e5, 0.02)):
            band = 2 * np.pi * hertz * np.array([1 - width / 2, 1 + width / 2])
            yield f"band{order}_{hertz:g}_{width:g}", *signal.butter(order, band, btype="bandpass", analog=True), 2 * np.pi * hertz
    for order in (2, 5, 8, 11):
        yield f"high{order}", *signal.butter(order, 2 * np.pi * 2e4, btype="highpass", analog=True), 2 * np.pi * 2e4
        yield f"ripple{order}", *signal.cheby1(order, 1.0, 2 * np.pi * 7e6, analog=True), 2 * np.pi * 7e6
        yield f"elliptic{order}", *signal.ellip(order, 1.0, 60.0, 2 * np.pi * 0.02, analog=True), 2 * np.pi * 0.02


def _lag_chains():
    for order in (2, 3, 4, 6, 9, 12):
        for t in (1e-8, 0.25, 86400.0, 1e8):
            yield f"lags{order}_{t:g}", [1.0], [float(comb(order, k)) * t ** (order - k) for k in range(order + 1)], 1 / t
    generator = np.random.default_rng(46)
    for index in range(12):
        times = 10.0 ** generator.uniform(-6, 6, 2 + index % 7)
        zero = [10.0 ** generator.uniform(-6, 6), 1.0] if index % 2 else [1.0]
        yield f"spread{index}", zero, _lags(times), 1 / float(np.exp(np.mean(np.log(times))))
    for damping in (1e-2, 1e-5):
        yield f"resonance_{damping:g}", [1.0, 0.0], np.polymul([1.0, 2 * damping * 3e4, 9e8], _lags([1e-2, 1e-2])), 3e4
    yield "integrators", [2.0, 3.0], [1e-9, 2e-3, 1.0, 0.0, 0.0], 1.0


def polynomials(stored: dict | None) -> dict:
    cases = []
    known = {case["id"]: case for case in stored["cases"]} if stored else {}
    for label, numerator, denominator, corner in [*_filters(), *_lag_chains()]:
        if label in known:
            numerator, denominator = known[label]["numerator"], known[label]["denominator"]
        numerator, denominator = ([float(v) for v in strip([Fraction(float(c)) for c in p])] for p in (numerator, denominator))
        omega = [float(corner * w) for w in (1e-3, 0.1, 0.5, 0.9, 0.99, 0.997, 1.0, 1.004, 1.01, 1.1, 2.0, 10.0, 1e3)]
        num, den = ([Fraction(c) for c in p] for p in (numerator, denominator))
        h = [exact.response(num, den, w) for w in omega]
        cases.append({"id": label, "numerator": numerator, "denominator": denominator, "omega_rad_s": omega,
                      "h_re": [v.real for v in h], "h_im": [v.imag for v in h]})
    return {"tool": TOOL, "tolerance": {"default": 1e-12}, "cases": cases}


# --- systems --------------------------------------------------------------------------------------------------------

ORDERS = (1, 2, 3, 5, 8, 12)


def _companion(zeros, poles, gain):
    a, b, c, d = signal.zpk2ss(zeros, poles, gain)
    return a, b, c, d


def _speeds(order: int, unit: float) -> tuple[np.ndarray, np.ndarray]:
    return -unit * (np.arange(1, order) + 0.5), -unit * np.arange(1.0, order + 1)


def _drawn(generator, order, inputs=1):
    a = np.round(generator.standard_normal((order, order)), 4)
    b, c = np.round(generator.standard_normal((order, inputs)), 4), np.round(generator.standard_normal((inputs, order)), 4)
    return a, b, c, np.zeros((inputs, inputs))


def _modal(generator, order):
    a = np.zeros((order, order))
    for i in range(0, order - 1, 2):
        re, im = -np.round(generator.uniform(0.1, 2), 3), np.round(generator.uniform(0.5, 9), 3)
        a[i : i + 2, i : i + 2] = [[re, im], [-im, re]]
    if order % 2:
        a[-1, -1] = -0.75
    return a


def _unimodular(generator, order):
    """A matrix of whole numbers whose inverse is one too."""
    lower = np.tril(generator.integers(-1, 2, (order, order)), -1) + np.eye(order)
    upper = np.triu(generator.integers(-1, 2, (order, order)), 1) + np.eye(order)
    return lower @ upper, np.round(np.linalg.inv(upper) @ np.linalg.inv(lower))


def _in_units(system, generator, decades):
    a, b, c, d = system
    t = 10.0 ** np.round(generator.uniform(-decades, decades, len(a)), 1)
    return a * t[None, :] / t[:, None], b / t[:, None], c * t[None, :], d


def _systems():
    for order in ORDERS:
        g = np.random.default_rng(1000 + order)
        yield "companion", order, _companion(*_speeds(order, 100.0), 1.0)
        yield "companion_fast", order, _companion(*_speeds(order, 1e6), 1.0)
        yield "companion_slow", order, _companion(*_speeds(order, 1e-6), 1e-3)
        a, b, c, d = _companion(*_speeds(order, 100.0), 1.0)
        yield "observer", order, (a.T, c.T, b.T, d)
        yield "sampled", order, _companion(1 - 0.02 * (np.arange(1, order) + 0.5), 1 - 0.02 * np.arange(1.0, order + 1), 1e-3)
        drawn = _drawn(g, order)
        modal = _modal(g, order)
        yield "modal", order, (modal, drawn[1], drawn[2], drawn[3])
        yield "dense", order, drawn
        there, back = _unimodular(g, order)
        chain = np.diag(np.full(order, -2.0)) + np.diag(np.ones(order - 1), 1)
        yield "defective", order, (there @ chain @ back, drawn[1], drawn[2], drawn[3])
        stiff = np.diag(-(10.0 ** np.linspace(-4, 6, order)))
        yield "stiff", order, (there @ stiff @ back, drawn[1], drawn[2], drawn[3])
        yield "scaled_6", order, _in_units(drawn, g, 6)
        yield "scaled_12", order, _in_units(drawn, g, 12)
        two = _in_units(_drawn(g, order, 2), g, 6)
        direct = (3e4 * drawn[0], 3e4 * drawn[1], drawn[2], np.array([[0.375]]))
        yield "direct", order, direct
        yield "direct_6", order, _in_units(direct, g, 6)
        yield "channels", order, (1e5 * two[0], 1e5 * two[1] * [[1e-9, 1e7]], [[1e6], [1e-8]] * two[2], two[3])


def _zero_polynomial(numerators, denominator):
    """Numerator of the determinant of the transfer matrix times the characteristic polynomial: its roots are the invariant zeros."""
    if len(numerators) == 1:
        return strip(numerators[0][0])

    def product(p, q):
        total = [Fraction(0)] * (len(p) + len(q) - 1)
        for i, x in enumerate(p):
            for j, y in enumerate(q):
                total[i + j] += x * y
        return total

    one, two = product(numerators[0][0], numerators[1][1]), product(numerators[0][1], numerators[1][0])
    return strip(_remainder(strip([x - y for x, y in zip(one, two)]), denominator)[0])


def _worst(found, true) -> float:
    """Largest distance of matched roots, relative to each; to the largest for roots at the origin."""
    left, worst = list(found), 0.0
    size = max(map(abs, true), default=0.0)
    for root in sorted(true, key=abs):
        at = min(range(len(left)), key=lambda i: abs(left[i] - root))
        worst = max(worst, abs(left.pop(at) - root) / (abs(root) or size))
    return float(worst)


def _lapack_zeros(a, b, c, d, count):
    """QZ of the pencil in balanced states, time and channels; the infinite ones left out."""
    balanced, t = linalg.matrix_balance(a, permute=False)
    t = np.diag(t)
    b, c, time = b / t[:, None], c * t[None, :], np.linalg.norm(balanced)
    b, c = b / np.linalg.norm(b, axis=0), c / np.linalg.norm(c, axis=1)[:, None]
    n, m = len(a), b.shape[1]
    left = np.block([[balanced / time, b], [c, d]])
    right = np.block([[np.eye(n), np.zeros((n, m))], [np.zeros((m, n + m))]])
    found = linalg.eig(left, right, right=False, homogeneous_eigvals=True)
    with np.errstate(all="ignore"):
        values = found[0] / found[1] * time
    values = values[np.isfinite(values)]
    return values[np.argsort(np.abs(values))][:count]


def balance(stored: dict | None) -> dict:
    cases = []
    known = {case["id"]: case for case in stored["cases"]} if stored else {}
    for kind, order, (a, b, c, d) in _systems():
        if f"{kind}{order}" in known:
            a, b, c, d = (np.array(known[f"{kind}{order}"][key], dtype=float) for key in "ABCD")
        numerators, denominator = transfer_function(a, b, c, d)
        poles, zeros = exact.roots(denominator), exact.roots(_zero_polynomial(numerators, denominator))
        by_lapack = _lapack_zeros(a, b, c, d, len(zeros))
        cases.append({
            "id": f"{kind}{order}", "A": a, "B": b, "C": c, "D": d, "poles": poles, "zeros": zeros,
            "pole_error": _worst(np.linalg.eigvals(a), poles),
            "zero_error": _worst(by_lapack, zeros) if len(by_lapack) == len(zeros) else None,
        })
    return {"tool": TOOL, "tolerance": {"default": 1e-12, "pole_error": None, "zero_error": None}, "cases": cases}


# --- Lyapunov's equations ------------------------------------------------------------------------------------------


def _exact_lyapunov(a, q, sampled: bool) -> np.ndarray:
    """X of AX + XA' + Q = 0, or of AXA' - X + Q = 0, by exact elimination of the n² equations."""
    n = len(a)
    a, q = _rational(a), _rational(q)
    rows = []
    for i in range(n):
        for j in range(n):
            row = [Fraction(0)] * (n * n) + [-q[i][j]]
            if sampled:
                for k in range(n):
                    for m in range(n):
                        row[k * n + m] += a[i][k] * a[j][m]
                row[i * n + j] -= 1
            else:
                for k in range(n):
                    row[k * n + j] += a[i][k]
                    row[i * n + k] += a[j][k]
            rows.append(row)
    for i in range(n * n):
        pivot = next(k for k in range(i, n * n) if rows[k][i] != 0)
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [v / rows[i][i] for v in rows[i]]
        for k in range(n * n):
            if k != i and rows[k][i] != 0:
                factor = rows[k][i]
                rows[k] = [x - factor * y for x, y in zip(rows[k], rows[i])]
    return np.array([[float(rows[i * n + j][-1]) for j in range(n)] for i in range(n)])


def lyapunov(stored: dict | None) -> dict:
    cases = []
    known = {case["id"]: case for case in stored["cases"]} if stored else {}
    generator = np.random.default_rng(72)
    for index in range(24):
        order, sampled, far = 1 + index % 5, index % 2 == 0, index % 3 == 0
        a = np.round(generator.standard_normal((order, order)), 3)
        f = np.round(generator.standard_normal((order, order)), 3)
        a = np.round(0.7 * a / max(1.0, np.max(np.abs(np.linalg.eigvals(a)))), 4) if sampled else a - 2 * np.eye(order)
        q = f @ f.T if index % 4 else f
        q = (q + q.T) / 2 if index % 4 else q
        if far:
            t = 2.0 ** generator.integers(-30, 31, order)
            a, q = a * t[None, :] / t[:, None], q / np.outer(t, t)
        label = f"{'sampled' if sampled else 'continuous'}{index:02}"
        if label in known:
            a, q = (np.array(known[label][key], dtype=float) for key in "AQ")
        cases.append({"id": label, "sampled": sampled, "A": a, "Q": q, "X": _exact_lyapunov(a, q, sampled)})
    return {"tool": TOOL, "tolerance": {"default": 1e-12}, "cases": cases}
