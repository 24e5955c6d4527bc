"""Case delays_response: delays read from an estimated response: thresholds, cumulative sums, areas, moments, all-pass parts, Laguerre series."""

import numpy as np
from scipy import integrate, linalg, optimize, signal, stats

from . import output_error as oe
from .discretise import assert_close
from .witness import TOOL, answer, as_records, binary, kept, lagged, noisy, shifted, two_poles

SAMPLES, WINDOW, START, TAPS = 360, 12, 5, 50
BEYOND = 36  # coefficients behind the longest delay that areas and all-pass parts ask for
F = (-1.1, 0.28)
POLES = (0.0, 0.2, 0.35, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.94, 0.97)
LAGUERRE, FISCHER = 17, 40


def plant():
    generator = np.random.default_rng(1001)
    u = binary(SAMPLES, generator)
    return u, noisy(two_poles(u, 0.3, F, START), 0.02, generator)


def calm():
    """Slow enough for its variance, quiet enough for it to be told."""
    generator = np.random.default_rng(1004)
    u = binary(SAMPLES, generator)
    return u, noisy(two_poles(u, 0.3, (-1.3, 0.4), START), 0.003, generator)


def steps():
    """A step from rest, and back after the plant has settled."""
    generator = np.random.default_rng(1002)
    u = np.where((np.arange(SAMPLES) >= 60) & (np.arange(SAMPLES) < 220), 1.0, 0.0)
    return u, noisy(two_poles(u, 0.3, F, START), 0.02, generator)


def slow():
    """What Laguerre spectra see: a short slow input that leaves the record time to end at rest."""
    generator = np.random.default_rng(1003)
    u = np.where((np.arange(SAMPLES) >= 10) & (np.arange(SAMPLES) < 90), 1.0, 0.0) - np.where((np.arange(SAMPLES) >= 90) & (np.arange(SAMPLES) < 150), 0.7, 0.0)
    return u, noisy(two_poles(u, 0.3, F, START), 0.02, generator)


# --- finite impulse responses ------------------------------------------------------------------------------------


def fir(u, y, taps):
    """Coefficients and covariance, lags 0 .. taps - 1, rows taps - 1 on."""
    rows = np.arange(taps - 1, len(y))
    matrix = lagged(u, range(taps), rows)
    h = np.linalg.lstsq(matrix, y[rows], rcond=None)[0]
    variance = np.sum((y[rows] - matrix @ h) ** 2) / (len(rows) - taps)
    return h, variance * np.linalg.inv(matrix.T @ matrix), len(rows) - taps


def as_step(h, covariance):
    total = np.tril(np.ones((len(h), len(h))))
    return total @ h, total @ covariance @ total.T


def crossing(h, covariance, multiple) -> int:
    return int(np.argmax(np.abs(h)[: WINDOW + 1] > multiple * np.sqrt(np.diag(covariance))[: WINDOW + 1]))


def cusum(z, drift, level):
    """(first sample of the run, alarm) of the two-sided cumulative sum."""
    for alarm in range(1, len(z) + 1):
        for sign in (1, -1):
            # The largest sum of a run that ends here, by definition instead of by recursion.
            sums = [np.sum(sign * z[first:alarm] - drift) for first in range(alarm)]
            if max(sums) > level:
                return int(np.argmax(sums)), alarm - 1
    raise AssertionError("no alarm")


def change(h, std, first, alarm) -> int:
    """The start in the run at which a ramp from it leaves the least weighted square."""

    def misfit(start):
        k = np.arange(alarm + 1)
        ramp = np.where(k < start, 0.0, k - start + 1.0) / std[: alarm + 1]
        value = h[: alarm + 1] / std[: alarm + 1]
        return np.sum((value - ramp * (ramp @ value) / (ramp @ ramp)) ** 2)

    return min(range(first, alarm + 1), key=misfit)


class Regularised:
    """h ~ N(0, c lambda^max(i, j)) from lag `start` on: the marginal likelihood by the outputs' own covariance matrix."""

    def __init__(self, u, y, taps):
        self.rows = np.arange(taps - 1, len(y))
        self.matrix, self.y, self.taps = lagged(u, range(taps), self.rows), y[self.rows], taps

    def prior(self, decay, start):
        power = np.arange(self.taps) - start
        return np.where((power[:, None] >= 0) & (power[None, :] >= 0), decay ** np.maximum(power[:, None], power[None, :]).astype(float), 0.0)

    def misfit(self, decay, scale, start=0):
        covariance = np.eye(len(self.y)) + scale * self.matrix @ self.prior(decay, start) @ self.matrix.T
        factor = linalg.cholesky(covariance, lower=True)
        white = linalg.solve_triangular(factor, self.y, lower=True)
        return len(self.y) * np.log(white @ white) + 2 * np.sum(np.log(np.diag(factor)))

    def tune(self, start=0):
        at = lambda x: self.misfit(np.exp(-np.exp(x[0])), np.exp(x[1]), start)
        best = min(((at((d, s)), d, s) for d in (-0.5, -1.5, -2.5) for s in (-2.0, 1.0, 4.0)))
        x = optimize.minimize(at, best[1:], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9}).x
        return float(np.exp(-np.exp(x[0]))), float(np.exp(x[1]))

    def posterior(self, decay, scale):
        prior = scale * self.prior(decay, 0)
        covariance = np.eye(len(self.y)) + self.matrix @ prior @ self.matrix.T
        gain = np.linalg.solve(covariance, self.matrix @ prior).T
        mean = gain @ self.y
        variance = self.y @ np.linalg.solve(covariance, self.y) / len(self.y)
        return mean, variance * (prior - gain @ self.matrix @ prior), variance


def impulseest(u, y) -> tuple[int, int]:
    """First coefficient beyond the bound for all of them, and the start of the largest marginal likelihood under the prior tuned at it."""
    model = Regularised(u, y, TAPS)
    mean, covariance, _ = model.posterior(*model.tune())
    bound = stats.norm.ppf(1 - 0.5 * (1 - 0.99 ** (1 / TAPS)))
    first = start = crossing(mean, covariance, bound)
    for _ in range(4):
        tuned = model.tune(start)
        following = int(np.argmin([model.misfit(*tuned, k) for k in range(WINDOW + 1)]))
        if following == start:
            break
        start = following
    return first, start


# --- areas and moments -------------------------------------------------------------------------------------------


def by_area(step, gain, residence, lags) -> float:
    """Dead time = average residence time - c A1/K, A1 the area under straight lines between the samples up to the residence time; c = e or e^2/2."""
    line = lambda t: np.interp(t, np.arange(len(step)), step)
    knots = [k for k in range(len(step)) if 0 < k < residence]
    area = integrate.quad(line, 0, residence, points=knots, limit=400)[0]
    return residence - (np.e if lags == 1 else np.e**2 / 2) * area / gain


def of_response(h, lags) -> float:
    """Residence time = integral of (unit step - response/gain), straight lines between the samples, the one that ends at sample 0 included."""
    gain, step = np.sum(h), np.cumsum(h)
    ends = np.concatenate([[0.0], step])
    rises = integrate.quad(lambda t: np.interp(t, np.arange(-1, len(step)), ends) / gain, -1, 0)[0]
    return by_area(step, gain, float(np.trapezoid(1 - step / gain)) - rises, lags)


def moment(h) -> float:
    j, gain = np.arange(len(h)), np.sum(h)
    mean = j @ h / gain
    variance = ((j - mean) ** 2) @ h / gain
    return float(mean - 0.5 - np.sqrt(variance + 0.25))


def area1(u, y) -> float:
    """Both steps as one response, each weighed by its height; the gain from the last quarter, the integral up to five residence times."""
    held = max(71, WINDOW + BEYOND)
    edges = [0, *[t for t in range(1, len(u)) if u[t] != u[t - 1]], len(u)]
    parts = []
    for before, at, end in zip(edges, edges[1:], edges[2:]):
        if at - before >= (10 if before == 0 else held) and end - at >= held:
            settled = y[at - max((at - before) // 4, min(10, at - before)) : at]
            parts.append((u[at] - u[at - 1], y[at:end] - settled.mean()))
    assert len(parts) == 2
    length = min(len(part) for _, part in parts)
    step = sum(height * part[:length] for height, part in parts) / sum(height**2 for height, _ in parts)
    end = length - length // 4
    gain = step[end:].mean()
    until = end
    for _ in range(3):
        residence = np.sum(1 - step[:until] / gain) - 0.5
        until = min(int(max(5 * residence, 5)), end)
    return by_area(step, gain, np.sum(1 - step[:until] / gain) - 0.5, 1)


# --- all-pass parts ----------------------------------------------------------------------------------------------


def all_pass(b, longest) -> float:
    """sum of Re (1 + x)/(1 - x) over the zeros of sum b x^k inside the unit circle, those that alone add more than `longest` left out."""
    zeros = np.roots(b[::-1])
    adds = ((1 + zeros) / (1 - zeros)).real
    return float(np.sum(adds[(np.abs(zeros) < 1) & (adds <= longest)]))


def arxdap(u, y, na=10, nb=5) -> float:
    lags = WINDOW + nb
    u, y = u[: len(u) - 1], y[1:]  # the hold's sample
    rows = np.arange(max(na, lags - 1), len(y))
    theta = np.linalg.lstsq(np.hstack([lagged(y, range(1, na + 1), rows), lagged(u, range(lags), rows)]), y[rows], rcond=None)[0]
    return 1 + all_pass(theta[na:], WINDOW)


def oedap(u, y, nb=5) -> float:
    """Numerator of WINDOW + 5 coefficients over two poles; the first nb - 1 samples are no rows, and the record begins at rest."""
    lags = WINDOW + nb
    u, y = u[: len(u) - 1], y[1:]
    first = max(2, lags - 1)

    def solve(f):
        x = signal.lfilter([1.0], [1.0, *f], u)
        basis = np.column_stack([shifted(x, k) for k in range(lags)])[first:]
        b = np.linalg.lstsq(basis, y[first:], rcond=None)[0]
        return b, basis @ b - y[first:]

    # Steiglitz and McBride's rounds find the valley (17 zeros over two poles leave several), a general optimiser its bottom.
    f, rows = np.zeros(2), np.arange(first, len(y))
    for _ in range(10):
        v, w = signal.lfilter([1.0], [1.0, *f], u), signal.lfilter([1.0], [1.0, *f], y)
        f = np.linalg.lstsq(np.hstack([-lagged(w, (1, 2), rows), lagged(v, range(lags), rows)]), w[rows], rcond=None)[0][:2]
    rest = lambda f: solve(f)[1] if oe.stable(f) else np.full(len(y) - first, 1e3)
    best = optimize.least_squares(rest, f, xtol=1e-15, ftol=1e-15, gtol=1e-15, diff_step=1e-7)
    return 1 + all_pass(solve(best.x)[0], WINDOW)


def laguerre_fit(u, y, a):
    """(loss, c): least squares on the outputs of sqrt(1 - a^2)/(z - a) ((1 - a z)/(z - a))^(k-1)."""
    column = signal.lfilter([0.0, np.sqrt(1 - a * a)], [1.0, -a], u)
    columns = [column]
    for _ in range(LAGUERRE - 1):
        columns.append(signal.lfilter([-a, 1.0], [1.0, -a], columns[-1]))
    basis = np.column_stack(columns)
    c = np.linalg.lstsq(basis, y, rcond=None)[0]
    return float(np.mean((y - basis @ c) ** 2)), c


def lagudap(u, y, poles=POLES):
    """The pole that fits best of those whose series does not outlast half the record."""
    fits = {a: laguerre_fit(u, y, a) for a in poles if LAGUERRE * (1 + a) <= 0.5 * len(u) * (1 - a)}
    a = min(fits, key=lambda a: fits[a][0])
    scale = (1 + a) / (1 - a)
    return 1 + scale * all_pass(fits[a][1], WINDOW / scale)


def fischer(u, y) -> int:
    """A delay of d samples is ((w + a)/(1 + a w))^d in the variable of the Laguerre spectra: the output-error model of two poles behind each, its loss."""
    each = max(0.8 * len(u) / FISCHER, 1.0)
    a = (each - 1) / (each + 1)
    order = min(FISCHER, int(0.8 * len(u) / each))
    impulse = np.zeros(len(u))
    impulse[0] = np.sqrt(1 - a * a)
    sequence = signal.lfilter([1.0], [1.0, -a], impulse)
    sequences = [sequence]
    for _ in range(order - 1):
        sequences.append(signal.lfilter([-a, 1.0], [1.0, -a], sequences[-1]))
    of_u, of_y = np.array(sequences) @ u, np.array(sequences) @ y
    source = signal.lfilter(np.convolve([1.0, a], [1.0, a]), [1.0], of_u)
    losses = []
    for _ in range(WINDOW + 1):
        losses.append(oe.fit_sources([source], of_y, 2)[0])
        source = signal.lfilter([a, 1.0], [1.0, a], source)
    return int(np.argmin(losses))


def response(stored: dict | None) -> dict:
    records = {name: kept(stored, name, make) for name, make in [("plant", plant), ("calm", calm), ("steps", steps), ("slow", slow)]}
    u, y = records["plant"]
    h, covariance, _ = fir(u, y, TAPS)
    s, of_step = as_step(h, covariance)
    taps, level = {"taps": TAPS}, 12.0
    exactly = lambda method, raw, delay=None, options=taps, record="plant", bias=1, **more: answer(method, record, WINDOW, bias, options, raw=raw, delay=delay, **more)
    first, step_first = crossing(h, covariance, 5), crossing(s, of_step, 5)
    answers = [exactly("threshold", first, first - 1), exactly("threshold_step", step_first, step_first - 1)]
    std = np.sqrt(np.diag(covariance))
    for method, values, spread in [("cusum", h, std), ("cusum_step", s, np.sqrt(np.diag(of_step)))]:
        begin, alarm = cusum((values / spread)[: WINDOW + 1], 1.0, level)
        answers.append(exactly(method, begin, change(h, std, begin, alarm) - 1, taps | {"level": level}))
    crossed, start = impulseest(u, y)
    answers.append(exactly("impulseest", crossed, start - 1))
    g = fir(u, y, max(TAPS, WINDOW + BEYOND))[0]
    for method, value in [("area2", of_response(g, 1)), ("area3", of_response(g, 2))]:
        answers.append(exactly(method, value, value))
    value = moment(fir(*records["calm"], max(TAPS, WINDOW + BEYOND))[0])
    answers.append(exactly("moment", value, value, record="calm"))
    answers.append(exactly("area1", area1(*records["steps"]), options={}, record="steps"))
    ahead = 1 + all_pass(fir(u[:-1], y[1:], max(TAPS, WINDOW + BEYOND))[0], WINDOW)
    answers.append(exactly("firdap", ahead))
    answers.append(exactly("arxdap", arxdap(u, y), options={}))
    answers.append(exactly("oedap", oedap(u, y), options={}, within=1e-4))
    answers.append(exactly("lagudap", lagudap(u, y), options={"order": LAGUERRE}))
    answers.append(exactly("lagudap", lagudap(u, y, [0.6]), options={"order": LAGUERRE, "pole": 0.6}) | {"id": "lagudap, pole 0.6"})
    at = fischer(*records["slow"])
    answers.append(exactly("fischer", at, at - 1, {"order": FISCHER}, "slow"))
    for case in answers:
        near = case["raw"] if case["raw"] is not None else case["delay"]
        assert_close(near, START - 0.5, 0.9, case["method"])
    model = Regularised(u, y, TAPS)
    decay, scale = model.tune()
    mean, spread, variance = model.posterior(decay, scale)
    return {
        "tool": TOOL,
        "tolerance": {"default": 1e-6, "decay": 1e-4, "scale": 1e-3, "raw": 1e-5, "delay": 1e-5, "coefficients": 1e-4, "std": 1e-4},
        "records": as_records(**records),
        "within": 1e-6,
        "answers": answers,
        "regularised": {"taps": TAPS, "decay": decay, "scale": scale, "variance": variance, "coefficients": mean, "std": np.sqrt(np.diag(spread))},
    }
