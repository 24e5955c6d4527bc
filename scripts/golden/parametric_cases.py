"""Case delays_parametric: sampled models of low order, the delay a parameter of theirs."""

import numpy as np
from scipy import linalg, optimize, signal

from . import output_error as oe
from .discretise import assert_close
from .witness import TOOL, answer, as_records, binary, kept, lagged, noisy, shifted, two_poles

SAMPLES, WINDOW, START = 300, 10, 5
F = (-1.2, 0.45)
ARMAX = (3, 3, 2)
# Polynomials C of the search: complex pairs of zeros by radius and angle, denser where valleys are narrow, and pairs of real ones.
COMPLEX = [[np.array([-2 * r * np.cos(angle), r * r]) for angle in np.linspace(0.02, np.pi - 0.02, 90)] for r in (0.3, 0.6, 0.8, 0.9, 0.95, 0.98, 0.995)]
REAL = [[np.array([-(p + q), p * q]) for q in np.tanh(np.linspace(-3.5, 3.5, 15))] for p in np.tanh(np.linspace(-3.5, 3.5, 15))]
FOLLOWED = 6
NOISE_POLES, ROUNDS = 4, 60
PAST, ORDER = 20, 10
LAG, PART = 0.8, 0.35  # the pole and the dead time within a sample of the one-lag plant
SHARE = 0.4  # the second coefficient's share of the interpolated plant


def quiet():
    generator = np.random.default_rng(801)
    u = binary(SAMPLES, generator)
    return u, noisy(two_poles(u, 0.3, F, START), 0.1, generator)


def loud():
    generator = np.random.default_rng(802)
    u = np.repeat(binary(SAMPLES // 4, generator), 4)
    return u, noisy(two_poles(u, 0.3, F, START), 2.0, generator)


def coloured():
    generator = np.random.default_rng(803)
    u = binary(SAMPLES, generator)
    clean = two_poles(u, 0.3, F, START)
    noise = signal.lfilter([1.0, 0.6], [1.0, -0.8], generator.standard_normal(SAMPLES + 200))[200:]
    return u, clean + 0.2 * np.std(clean) * noise / np.std(noise)


def one_lag():
    generator = np.random.default_rng(804)
    u = binary(SAMPLES, generator)
    first = 1 - LAG ** (1 - PART)
    return u, noisy(signal.lfilter([0.0] * START + [first, 1 - LAG - first], [1.0, -LAG], u), 0.03, generator)


def interpolated():
    generator = np.random.default_rng(805)
    u = binary(SAMPLES, generator)
    return u, noisy(signal.lfilter([0.0] * START + [1 - SHARE, SHARE], [1.0, *F], u), 0.03, generator)


# --- regressions -------------------------------------------------------------------------------------------------


def arx_losses(u, y, na, nb):
    """losses[nk][m - 1] of m input coefficients over rows that all delays share."""
    rows = np.arange(max(na, WINDOW + nb - 1), len(y))
    past = -lagged(y, range(1, na + 1), rows)

    def loss(nk, m):
        matrix = np.hstack([past, lagged(u, range(nk, nk + m), rows)])
        return float(np.mean((y[rows] - matrix @ np.linalg.lstsq(matrix, y[rows], rcond=None)[0]) ** 2))

    return np.array([[loss(nk, m) for m in range(1, nb + 1)] for nk in range(WINDOW + 1)]), len(rows)


def by_evidence(losses, rows) -> tuple[int, int]:
    """Delay of the smallest loss of all coefficients, and of the largest sum over m of V^(-N/2) N^(-m/2) (Schwarz)."""
    m = np.arange(1, losses.shape[1] + 1)
    logs = -0.5 * rows * np.log(losses) - 0.5 * m * np.log(rows)
    return int(np.argmin(losses[:, -1])), int(np.argmax(np.logaddexp.reduce(logs, axis=1)))


def elnaggar(u, y) -> int:
    rows = np.arange(WINDOW, len(y))
    past = lagged(u - u.mean(), range(WINDOW + 1), rows)
    cross = (y[rows] - y[rows - 1]) @ past
    return int(np.argmax(cross**2 / np.sum(past**2, axis=0)))


# --- ARMAX: the exact likelihood by the errors' covariance matrix -----------------------------------------------


class Armax:
    """A y - B u = C e given the first outputs: a moving average of e, whose covariance is a band matrix. Loss: e'e det^(1/n)/n, A and B by least squares."""

    def __init__(self, u, y, nk, na, m):
        self.rows = np.arange(max(na, WINDOW + ARMAX[1] - 1), len(y))
        self.target = y[self.rows]
        self.matrix = np.hstack([-lagged(y, range(1, na + 1), self.rows), lagged(u, range(nk, nk + m), self.rows)])

    def loss(self, c) -> tuple[float, np.ndarray]:
        c, n = np.concatenate([[1.0], c]), len(self.rows)
        band = np.zeros((len(c), n))
        for lag in range(len(c)):
            band[lag] = np.sum(c[lag:] * c[: len(c) - lag])
        factor = linalg.cholesky_banded(band, lower=True)
        white = lambda x: linalg.solve_banded((len(c) - 1, 0), factor, x)
        matrix, target = white(self.matrix), white(self.target)
        theta = np.linalg.lstsq(matrix, target, rcond=None)[0]
        log_det = 2 * np.sum(np.log(factor[0]))
        return float(np.mean((target - matrix @ theta) ** 2) * np.exp(log_det / n)), theta

    def fit(self):
        """C by its reflection coefficients, which keep it stable: a grid of its zeros, and the lowest minima of the grid followed to their bottom.

        A search by gradients from few starts ends in one valley or another by the processor's rounding.
        """

        def polynomial(r):
            c = np.array([1.0])
            for k in np.tanh(r):
                c = np.concatenate([c, [0.0]]) + k * np.concatenate([[0.0], c[::-1]])
            return c[1:]

        criterion = lambda r: np.log(self.loss(polynomial(r))[0])
        starts = [start for zeros in (COMPLEX, REAL) for start in minima(lambda c: np.log(self.loss(c)[0]), zeros)]
        starts = [start for _, start in sorted(starts, key=lambda s: s[0])[:FOLLOWED]]
        reflections = lambda c: np.arctanh([c[0] / (1 + c[1]), c[1]])
        options = {"xatol": 1e-10, "fatol": 1e-15, "maxiter": 2000}
        found = [optimize.minimize(criterion, reflections(c), method="Nelder-Mead", options=options) for c in starts]
        c = polynomial(min(found, key=lambda f: f.fun).x)
        loss, theta = self.loss(c)
        return loss, theta, c


def minima(criterion, grid):
    """(value, C) of the points of a grid of polynomials that none of their neighbours is below."""
    values = np.array([[criterion(c) for c in row] for row in grid])
    around = np.pad(values, 1, constant_values=np.inf)
    n, m = values.shape
    lowest = np.min([around[i : i + n, j : j + m] for i in range(3) for j in range(3)], axis=0)
    return [(values[i, j], grid[i][j]) for i, j in np.argwhere(values <= lowest)]


def armax(u, y):
    na, nb, _ = ARMAX
    fits = [[Armax(u, y, nk, na, m).fit() for m in range(1, nb + 1)] for nk in range(WINDOW + 1)]
    losses = np.array([[fit[0] for fit in counts] for counts in fits])
    rows = len(y) - max(na, WINDOW + nb - 1)
    loss, theta, c = fits[START][0]
    return losses, by_evidence(losses, rows), {"nk": START, "m": 1, "a": theta[:na], "b": theta[na:], "c": c}


# --- refined instrumental variables ----------------------------------------------------------------------------


def refined_iv(u, y, nk, nb=1, nf=2):
    """Rounds of: simulate B/F u; an autoregression D of the rest; F and B by instruments of signals filtered by D/F. The round with the smallest loss."""
    rows = np.arange(len(y))
    columns = lambda outputs, inputs: np.column_stack(
        [-shifted(outputs, i) for i in range(1, nf + 1)] + [shifted(inputs, nk + j) for j in range(nb)]
    )
    regressors = columns(y, u)
    f = np.linalg.solve(regressors.T @ regressors, regressors.T @ y)[:nf]
    d, best, last = np.zeros(0), None, np.inf

    def simulated(f, d):
        sources = [signal.lfilter([1.0], [1.0, *f], shifted(u, nk + j)) for j in range(nb)]
        white = lambda x: signal.lfilter([1.0, *d], [1.0], x)
        b = np.linalg.lstsq(np.column_stack([white(s) for s in sources]), white(y), rcond=None)[0]
        return b, np.column_stack(sources) @ b

    for _ in range(ROUNDS):
        roots = np.roots([1.0, *f])
        f = np.real(np.poly([1 / np.conj(r) if abs(r) > 1 else r for r in roots]))[1:]
        rest = y - simulated(f, d)[1]
        late = rows[NOISE_POLES:]
        d = np.linalg.lstsq(-lagged(rest, range(1, NOISE_POLES + 1), late), rest[late], rcond=None)[0]
        b, x = simulated(f, d)
        loss = float(np.mean(signal.lfilter([1.0, *d], [1.0], y - x)[NOISE_POLES:] ** 2))
        if best is None or loss < best[0]:
            best = (loss, b, f, d)
        through = lambda s: signal.lfilter([1.0, *d], [1.0, *f], s)
        uf, yf, xf = through(u), through(y), through(x)
        instruments = columns(xf, uf)
        f = np.linalg.solve(instruments.T @ columns(yf, uf), instruments.T @ yf)[:nf]
        if abs(loss - last) <= 1e-14 * loss:
            break
        last = loss
    return best


# --- whitening by a subspace model -----------------------------------------------------------------------------


def noise_filter(u, y):
    """C = det(I - (A - K C) q^-1) of PBSIDopt with states by Schwarz's criterion, D = 0, from the data matrices themselves."""
    rows = np.arange(PAST, len(y))
    window = lambda rows, lag: np.column_stack([x[rows - i] for i in range(lag, lag + PAST) for x in (u, y)])
    now, following = window(rows, 1), window(rows, 0)
    markov = np.linalg.lstsq(now, y[rows], rcond=None)[0]
    predict = np.array([np.concatenate([markov[2 * i :], np.zeros(2 * i)]) for i in range(PAST)])
    _, s, right = np.linalg.svd(now @ predict.T, full_matrices=False)
    best = None
    for n in range(1, ORDER + 1):
        states = np.diag(s[:n] ** -0.5) @ right[:n] @ predict
        x, after = now @ states.T, following @ states.T
        c = np.linalg.lstsq(x, y[rows], rcond=None)[0]
        e = y[rows] - x @ c
        moved = np.linalg.lstsq(np.column_stack([x, u[rows], e]), after, rcond=None)[0].T
        criterion = len(rows) * np.log(np.mean(e**2)) + 3 * n * np.log(len(rows))
        if best is None or criterion < best[0]:
            best = (criterion, np.linalg.eigvals(moved[:, :n] - np.outer(moved[:, n + 1], c)))
    return np.real(np.poly([1 / np.conj(r) if abs(r) > 1 else r for r in best[1]]))


def met1(u, y) -> int:
    rough, _ = arx_losses(u, y, 10, 1)
    lead = max(0, int(np.argmin(rough[:, 0])) - 1)
    c = noise_filter(u[: len(u) - lead], y[lead:])
    losses, _ = arx_losses(signal.lfilter([1.0], c, u), signal.lfilter([1.0], c, y), 10, 1)
    return int(np.argmin(losses[:, 0]))


# --- output error ------------------------------------------------------------------------------------------------


def effective(rest) -> float:
    """Independent ones among residuals: N/(1 + 2 sum rho) up to the first rho that is not positive."""
    total = 0.0
    for lag in range(1, len(rest) // 4):
        rho = np.sum(rest[lag:] * rest[:-lag]) / np.sum(rest**2)
        if rho <= 0:
            break
        total += rho
    return len(rest) / (1 + 2 * total)


def oe_posterior(u, y, nodes=48) -> tuple[float, int]:
    """Mean over delays of p(nk) ~ integral of V(nk, F)^(-N/2) p(F): a grid several times finer than a program can afford.

    Prior: real pairs and complex ones alike probable; time constants and 1/natural frequency log-uniform from 0.15 samples to a quarter of the record,
    damping uniform.
    """
    fits = [oe.fit(u, y, nk, 1, 2) for nk in range(WINDOW + 1)]
    best = int(np.argmin([fit[0] for fit in fits]))
    rest = oe.project([shifted(u, best)], y, fits[best][2])[1]
    independent = effective(rest)
    lags = np.exp(np.log(0.15) + np.log(0.25 * len(y) / 0.15) * (np.arange(nodes) + 0.5) / nodes)
    poles = np.exp(-1 / lags)
    real = [((-(p + q), p * q), 0.5 if i == j else 1.0) for i, p in enumerate(poles) for j, q in enumerate(poles[: i + 1])]
    complex_pairs = []
    for lag in lags:
        for damping in (np.arange(nodes // 2) + 0.5) / (nodes // 2):
            radius, angle = np.exp(-damping / lag), np.sqrt(1 - damping**2) / lag
            if angle < np.pi:
                complex_pairs.append(((-2 * radius * np.cos(angle), radius**2), 1.0))
    logs = np.full(WINDOW + 1, -np.inf)
    energy = np.sum(y**2)
    for kind in (real, complex_pairs):
        total = sum(weight for _, weight in kind)
        for f, weight in kind:
            x = signal.lfilter([1.0], [1.0, *f], u)
            for nk in range(WINDOW + 1):
                part = x[: len(x) - nk]
                loss = (energy - np.dot(part, y[nk:]) ** 2 / np.dot(part, part)) / len(y)
                logs[nk] = np.logaddexp(logs[nk], -0.5 * independent * np.log(loss) + np.log(0.5 * weight / total))
    p = np.exp(logs - logs.max())
    p /= p.sum()
    return float(p @ np.arange(WINDOW + 1)), int(np.argmax(p)), p


def two_step(u, y) -> float:
    """The least loss over delay, b and both poles at once."""

    def loss(delay):
        n = int(np.floor(delay))
        part = delay - n
        return oe.fit_sources([(1 - part) * shifted(u, n) + part * shifted(u, n + 1)], y, 2, oe.STARTS[1:4])[0]

    rough = np.arange(START - 2, START + 3, 0.25)
    at = rough[np.argmin([loss(d) for d in rough])]
    return float(optimize.minimize_scalar(loss, bounds=(at - 0.25, at + 0.25), method="bounded", options={"xatol": 1e-9}).x)


def sampling_zero(u, y) -> float:
    """L of the pole and the two coefficients of the best first-order model."""
    fits = [oe.fit(u, y, nk, 2, 1, ((0.5,), (0.9,), (0.1,))) for nk in range(WINDOW + 1)]
    nk = int(np.argmin([fit[0] for fit in fits]))
    _, (b1, b2), (f1,) = fits[nk]
    zero = -b2 / b1
    return nk + float(np.log((1 + zero / f1) / (1 - zero)) / -np.log(-f1))


def parametric(stored: dict | None) -> dict:
    records = {name: kept(stored, name, make) for name, make in
               [("quiet", quiet), ("loud", loud), ("coloured", coloured), ("one_lag", one_lag), ("interpolated", interpolated)]}
    whole = lambda method, record, raw, best: answer(method, record, WINDOW, 1, raw=raw, delay=best - 1)
    answers = []
    for method, record, orders in [("arxstruc", "quiet", (10, 5)), ("delayest", "quiet", (2, 2))]:
        answers.append(whole(method, record, *by_evidence(*arx_losses(*records[record], *orders))))
    losses, chosen, model = armax(*records["coloured"])
    answers.append(whole("armaxstruc", "coloured", *chosen))
    iv = [refined_iv(*records["coloured"], nk) for nk in range(WINDOW + 1)]
    best = int(np.argmin([fit[0] for fit in iv]))
    answers.append(whole("ivstruc", "coloured", best, best))
    for method, record, nk in [
        ("elnaggar", "quiet", elnaggar(*records["quiet"])),
        ("met1struc", "coloured", met1(*records["coloured"])),
        ("oestruc", "quiet", int(np.argmin([oe.fit(*records["quiet"], nk, 1, 2)[0] for nk in range(WINDOW + 1)]))),
    ]:
        answers.append(whole(method, record, nk, nk))
    mean, mode, p = oe_posterior(*records["loud"])
    answers.append(answer("oe_posterior", "loud", WINDOW, 1, raw=mode, delay=mean - 1, within=0.05))
    step, zero = two_step(*records["interpolated"]), sampling_zero(*records["one_lag"])
    assert_close([step, zero], [START + SHARE, START + PART], 0.02, "fractions")
    answers.append(answer("two_step", "interpolated", WINDOW, 1, raw=step, delay=step - 1, within=1e-4))
    answers.append(answer("sampling_zero", "one_lag", WINDOW, 1, raw=zero, delay=zero - 1, within=1e-5))
    settling = (START - 1, START)  # beyond the true delay the rounds go on without end, and the best of so many is not determined
    return {
        "tool": TOOL,
        "tolerance": {"default": 1e-6, "a": 1e-5, "b": 1e-5, "c": 1e-5, "f": 1e-4, "d": 1e-4, "probability": 1e-4},
        "records": as_records(**records),
        "within": 1e-6,
        "answers": answers,
        "armax": {"orders": list(ARMAX), "losses": losses, "model": model},
        "iv": [{"nk": nk, "loss": iv[nk][0], "b": iv[nk][1], "f": iv[nk][2], "d": iv[nk][3]} for nk in settling],
        "oe_posterior": {"probability": p},
    }
