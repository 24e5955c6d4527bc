"""Cases dlqr and dlqr_random: linear-quadratic regulators of sampled models."""

from fractions import Fraction

import control
import numpy as np
from scipy import linalg

from . import exact, octave
from .c2d_cases import SAMPLE_TIMES, TOOL
from .discretise import assert_close, scipy_model
from .plants import DYNAMICS, Plant

REALISATION = {
    "zoh": "Ad = exp(A Ts), Bd = integral of exp(A s) B over [0, Ts]",
    "tustin": "Bd = Ts·M·B, Cd = C·M, M = (I - A·Ts/2)^-1 (scipy/python-control)",
    "foh": "z = x - g2·u, Bd = g1 + Ad·g2 - g2 (scipy)",
    "impulse": "Ad = exp(A Ts), Bd = Ts·Ad·B, Cd = C (scipy)",
}


def gain(a, b, q, r, n, x) -> np.ndarray:
    """K = (R + B'XB)^-1 (B'XA + N')."""
    return np.linalg.solve(r + b.T @ x @ b, b.T @ x @ a + n.T)


def riccati_residual(a, b, q, r, n, x) -> float:
    """Residual of the discrete algebraic Riccati equation relative to X."""
    k = gain(a, b, q, r, n, x)
    return float(np.max(np.abs(a.T @ x @ a - (a.T @ x @ b + n) @ k + q - x)) / np.max(np.abs(x)))


def relative(new, old) -> float:
    return float(np.max(np.abs(new - old)) / np.max(np.abs(old)))


def ordered(values: np.ndarray) -> np.ndarray:
    """Eigenvalues by real part, then imaginary part."""
    values = np.asarray(values, dtype=complex)
    return values[np.lexsort((np.round(values.imag, 9), np.round(values.real, 9)))]


def solve(a, b, q, r, n) -> dict:
    """K, S, E of scipy's solver, and how far python-control's dlqr is from it."""
    s = linalg.solve_discrete_are(a, b, q, r, s=n)
    s = (s + s.T) / 2
    k = gain(a, b, q, r, n, s)
    k_control, s_control, _ = (np.asarray(v) for v in control.dlqr(a, b, q, r, n))
    e = ordered(np.linalg.eigvals(a - b @ k))
    assert np.all(np.abs(e) < 1), "not stabilising"
    return {"K": k, "S": s, "E": e, "disagreement": max(relative(k_control, k), relative(s_control, s))}


def condition(a, b, q, r, n, x, size: float = 1e-7, draws: int = 5) -> float:
    """Largest relative change of X per relative change of all data, over a few random perturbations."""
    generator = np.random.default_rng(11)
    worst = 0.0
    for _ in range(draws):
        changed = [m * (1 + size * generator.uniform(-1, 1, m.shape)) for m in (a, b, q, r, n)]
        changed[2], changed[3] = (changed[2] + changed[2].T) / 2, (changed[3] + changed[3].T) / 2
        other = linalg.solve_discrete_are(*changed[:4], s=changed[4])
        worst = max(worst, relative(other, x) / size)
    return worst


def cross_term(plant: Plant) -> np.ndarray:
    """A small N that keeps [[Q, N], [N', R]] positive definite for Q = I, R = I."""
    return np.array([[0.3 * (-1) ** i / (i + 1)] for i in range(len(plant.a))])


def _problems():
    for plant in DYNAMICS:
        for method in REALISATION:
            for ts in SAMPLE_TIMES:
                bare = Plant(plant.name, plant.states, plant.inputs, plant.outputs, plant.a, plant.b, plant.c, 0 * plant.d)
                a, b = scipy_model(bare, ts, method)[:2]
                yield plant, method, ts, a, b, np.zeros_like(b), f"{plant.name}_{method}_ts{ts:g}"
                yield plant, method, ts, a, b, cross_term(plant), f"{plant.name}_{method}_ts{ts:g}_cross"


def dlqr(stored: dict | None) -> dict:
    cases = []
    for plant, method, ts, a, b, n, label in _problems():
        q, r = np.eye(len(a)), np.eye(b.shape[1])
        answer = solve(a, b, q, r, n)
        assert answer["disagreement"] < 1e-9, label
        assert riccati_residual(a, b, q, r, n, answer["S"]) < 1e-10, label
        cases.append({
            "id": label, "dynamics": plant.name, "method": method, "sample_time_s": ts, "realisation": REALISATION[method],
            "A": a, "B": b, "Q": q, "R": r, "N": n, **answer, "condition": condition(a, b, q, r, n, answer["S"]),
        })
    return {"tool": TOOL, "tolerance": _tolerance(), "cases": cases}


def _tolerance() -> dict:
    return {"default": 1e-10, "disagreement": None, "condition": None}


def dlqr_octave(stored: dict | None) -> dict:
    tool = octave.versions()
    problems = list(_problems())
    script = []
    for i, (_, _, _, a, b, n, _) in enumerate(problems):
        q, r = np.eye(len(a)), np.eye(b.shape[1])
        arguments = ", ".join(octave.literal(m) for m in (a, b, q, r, n))
        script.append(f"[k, s, e] = dlqr({arguments}); put('c{i}.K', k); put('c{i}.S', s); put('c{i}.E', e(:).');")
    found = octave.run("\n".join(script))
    cases = [
        {
            "id": label, "dynamics": plant.name, "method": method, "sample_time_s": ts, "realisation": REALISATION[method],
            "K": found[f"c{i}.K"].real, "S": found[f"c{i}.S"].real, "E": ordered(found[f"c{i}.E"].ravel()),
        }
        for i, (plant, method, ts, _, _, _, label) in enumerate(problems)
    ]
    return {"tool": tool, "tolerance": {"default": 1e-9}, "cases": cases}


# --- random systems ---------------------------------------------------------------------------------------------

RANDOM_SYSTEMS = 200
WORST_CONDITION = 1e4


def _draw(generator: np.random.Generator, index: int) -> tuple[np.ndarray, ...]:
    """A random problem of order 1..12: spectral radius 0.3..1.4, 1-3 inputs, Q of random rank, every second with N."""
    order = 1 + index % 12
    inputs = int(generator.integers(1, 4))
    a = generator.standard_normal((order, order))
    a *= generator.uniform(0.3, 1.4) / np.max(np.abs(np.linalg.eigvals(a)))
    b = generator.standard_normal((order, inputs))
    rank = int(generator.integers(max(1, order // 2), order + 1))
    factor = np.round(8 * generator.standard_normal((rank, order + inputs))) / 32  # the product has no rounding
    weights = factor.T @ factor
    weights[order:, order:] += 0.5 * np.eye(inputs)
    q, r, n = weights[:order, :order], weights[order:, order:], weights[:order, order:]
    if index % 2 == 0:
        n = np.zeros((order, inputs))
    return np.round(a, 6), np.round(b, 6), q, r, n


def _accepted(problem) -> bool:
    """Whether rounding leaves the weights valid and the problem is well enough conditioned."""
    a, b, q, r, n = problem
    try:
        answer = solve(*problem)
        measured = condition(*problem, answer["S"])
    except (np.linalg.LinAlgError, AssertionError, ValueError, control.ControlArgument):
        return False
    fine = np.max(np.abs(answer["E"])) < 0.995 and riccati_residual(*problem, answer["S"]) < 1e-12
    return bool(fine and measured < WORST_CONDITION and answer["disagreement"] < 1e-11)


def _random_problems() -> list[tuple[np.ndarray, ...]]:
    generator = np.random.default_rng(20240502)
    found = []
    while len(found) < RANDOM_SYSTEMS:
        problem = _draw(generator, len(found))
        if _accepted(problem):
            found.append(problem)
    return found


def dlqr_random(stored: dict | None) -> dict:
    if stored is None:
        problems = _random_problems()
    else:
        problems = [tuple(np.array(case[key], dtype=float) for key in "ABQRN") for case in stored["cases"]]
    cases = []
    for i, problem in enumerate(problems):
        answer = solve(*problem)
        cases.append({
            "id": f"random{i:03}", "order": len(problem[0]), "inputs": problem[1].shape[1], **dict(zip("ABQRN", problem)),
            **answer, "condition": condition(*problem, answer["S"]),
        })
    return {"tool": TOOL, "tolerance": {"default": 1e-10, "E": 1e-8, "disagreement": None, "condition": None}, "cases": cases}


# --- far-apart weights and units, to 80 digits ------------------------------------------------------------------

FAR = 150


class _Decimals:
    """Products and solutions of matrices of decimals."""

    @staticmethod
    def of(m) -> np.ndarray:
        return np.array([[exact.decimal(Fraction(float(v))) for v in row] for row in np.atleast_2d(m)], dtype=object)

    @staticmethod
    def solve(a, b) -> np.ndarray:
        a, b = a.copy(), b.copy()
        for i in range(len(a)):
            pivot = max(range(i, len(a)), key=lambda k: abs(a[k, i]))
            a[[i, pivot]], b[[i, pivot]] = a[[pivot, i]], b[[pivot, i]]
            for k in range(len(a)):
                if k != i:
                    factor = a[k, i] / a[i, i]
                    a[k], b[k] = a[k] - factor * a[i], b[k] - factor * b[i]
        return b / a.diagonal()[:, None]


def _doubled(a, b, q, r) -> np.ndarray:
    """The stabilising solution by structure-preserving doubling in 150 digits."""
    one = _Decimals.of(np.eye(len(a)))
    g, h = b.dot(_Decimals.solve(r, b.T)), q
    for _ in range(40):
        w = one + g.dot(h)
        wa, wg = _Decimals.solve(w, a), _Decimals.solve(w, g)
        step = a.T.dot(h).dot(wa)
        g, a, h = g + a.dot(wg).dot(a.T), a.dot(wa), h + step
        if max(abs(step).ravel()) <= exact.Decimal("1e-70") * max(abs(h).ravel()):
            return h
    raise ArithmeticError("doubling did not end")


def _apart(x, y) -> float:
    """Largest difference of entries, relative to the diagonal: the same in all units."""
    size = np.array([exact.decimal(Fraction(float(v))).sqrt() for v in np.array(y, dtype=float).diagonal()])
    return float(max((abs(np.array(x) - y) / np.outer(size, size)).ravel()))


def _gain(a, b, r, x) -> np.ndarray:
    return _Decimals.solve(r + b.T.dot(x).dot(b), b.T.dot(x).dot(a))


def _gains_apart(k, truth, x) -> float:
    """Largest difference of a row in units of the states, relative to the row's largest entry."""
    size = np.array([v.sqrt() for v in x.diagonal()])
    return max(float(max(abs((one - other) / size)) / max(abs(other / size))) for one, other in zip(k, truth))


def _far_problem(generator, index):
    order, inputs = 1 + index % 8, int(generator.integers(1, 4))
    a = generator.standard_normal((order, order))
    a *= generator.uniform(0.3, 1.4) / np.max(np.abs(np.linalg.eigvals(a)))
    b = generator.standard_normal((order, inputs))
    f, g = generator.standard_normal((order, order)), generator.standard_normal((inputs, inputs))
    weight = 10.0 ** generator.uniform(-8, 8, 2)
    q, r = weight[0] * f @ f.T, weight[1] * (g @ g.T + 0.1 * np.eye(inputs))
    if index % 2:
        t = 10.0 ** generator.uniform(-9, 9, order)
        a, b, q = a * t[None, :] / t[:, None], b / t[:, None], q * np.outer(t, t)
    return a, b, (q + q.T) / 2, (r + r.T) / 2


def dlqr_far(stored: dict | None) -> dict:
    generator = np.random.default_rng(20261127)
    problems = [_far_problem(generator, index) for index in range(FAR)]
    if stored:
        problems = [tuple(np.array(case[key], dtype=float) for key in "ABQR") for case in stored["cases"]]
    cases = []
    for problem in problems:
        a, b, q, r = (_Decimals.of(m) for m in problem)
        x = _doubled(a, b, q, r)
        k = _gain(a, b, r, x)
        size, conditions = exact.Decimal("1e-30"), []
        for _ in range(5):
            moved = [m * (1 + size * _Decimals.of(generator.uniform(-1, 1, m.shape))) for m in (a, b, q, r)]
            moved[2], moved[3] = (moved[2] + moved[2].T) / 2, (moved[3] + moved[3].T) / 2
            moved_x = _doubled(*moved)
            conditions.append((_apart(moved_x, x) / 1e-30, _gains_apart(_gain(moved[0], moved[1], moved[3], moved_x), k, x) / 1e-30))
        condition, gain_condition = (max(values) for values in zip(*conditions))
        try:
            scipy_error = _apart(_Decimals.of(linalg.solve_discrete_are(*problem)), x)
        except (np.linalg.LinAlgError, ValueError):
            scipy_error = None
        cases.append({
            "id": f"far{len(cases):03}", **dict(zip("ABQR", problem)), "S": x.astype(float), "K": k.astype(float),
            "condition": condition, "gain_condition": gain_condition, "scipy_error": scipy_error,
        })
    tolerance = {"default": 1e-12, "condition": None, "gain_condition": None, "scipy_error": None}
    return {"tool": TOOL, "tolerance": tolerance, "cases": cases}
