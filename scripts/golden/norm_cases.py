"""Case norms: the largest gain over all frequencies and over a band, and the nu-gap, of models with poles on either side of the axis."""

import numpy as np
import slycot
from scipy import optimize

from .c2d_cases import TOOL
from .plants import DYNAMICS

RANDOM_SYSTEMS = 24
SAMPLE_TIME = 0.1
#: Points of the grids that the independent calculations start from.
GRID = 20001


def response(system, sample_time: float, omega: float) -> np.ndarray:
    a, b, c, d = system
    point = np.exp(1j * omega * sample_time) if sample_time else 1j * omega
    return c @ np.linalg.solve(point * np.eye(len(a)) - a, b) + d if len(a) else d.astype(complex)


def largest(function, low: float, high: float, at: list[float]) -> float:
    """The largest value between two frequencies: a grid (denser at the poles), then a bounded search about each of its local maxima."""
    grid = np.unique(np.clip(np.concatenate([np.linspace(low, high, GRID), *[p * np.linspace(0.9, 1.1, 401) for p in at]]), low, high))
    values = np.array([function(w) for w in grid])
    best = values.max()
    for k in range(1, len(grid) - 1):
        if values[k] >= max(values[k - 1], values[k + 1]) and values[k] > 0.9 * best:
            found = optimize.minimize_scalar(lambda w: -function(w), bounds=(grid[k - 1], grid[k + 1]), method="bounded", options={"xatol": 1e-13})
            best = max(best, -found.fun)
    return float(best)


def resonances(system, sample_time: float) -> list[float]:
    poles = np.linalg.eigvals(system[0]).astype(complex) if len(system[0]) else np.array([])
    poles = np.log(poles[np.abs(poles) > 1e-9]) / sample_time if sample_time else poles
    return [float(abs(p.imag)) for p in poles if p.imag > 0]


def inverse_root(m: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(m)
    return vectors @ np.diag(values**-0.5) @ vectors.conj().T


def chordal(one: np.ndarray, two: np.ndarray) -> float:
    left, right = np.eye(len(two)) + two @ two.conj().T, np.eye(one.shape[1]) + one.conj().T @ one
    return float(np.linalg.norm(inverse_root(left) @ (two - one) @ inverse_root(right), 2))


def unstable(system, sample_time: float) -> int:
    poles = np.linalg.eigvals(system[0])
    return int(np.sum(np.abs(poles) > 1) if sample_time else np.sum(poles.real > 0))


def nu_gap(one, two, sample_time: float) -> dict:
    """By the definition: the largest chordal distance, and the turns of det(I + P2* P1) counted by its phase from one frequency to the next.

    In continuous time frequencies are the tangents of a uniform grid of angles, as many as make the phase turn by less than a quarter at once; the path closes
    at infinity, where both models are their D. Upwards along the axis (against the clock round the circle) the phase turns forwards once for every unstable pole
    of the determinant and back for every unstable zero. 1/(s - e) and 1/(s + e), which are near, have two and one there: one turn, and one unstable pole more.
    """
    angles = np.linspace(-np.pi / 2, np.pi / 2, 2 * GRID)[1:-1]
    omegas = 2 * angles / sample_time if sample_time else np.tan(angles)

    def determinant(w: float) -> complex:
        p, q = response(one, sample_time, w), response(two, sample_time, w)
        return complex(np.linalg.det(np.eye(p.shape[1]) + q.conj().T @ p))

    values = np.array([determinant(w) for w in omegas])
    steps = np.angle(np.roll(values, -1) / values)
    assert np.max(np.abs(steps)) < np.pi / 2, "the grid is too coarse for the phase"
    turns = float(np.sum(steps) / (2 * np.pi))
    assert abs(turns - round(turns)) < 1e-6
    # Upwards along the imaginary axis encloses the right half plane clockwise, round the unit circle encloses its inside against the clock: both leave what is
    # unstable on the right hand, where poles turn the phase forwards.
    alike = round(turns) == unstable(one, sample_time) - unstable(two, sample_time)
    function = lambda angle: chordal(*(response(s, sample_time, 2 * angle / sample_time if sample_time else np.tan(angle)) for s in (one, two)))  # noqa: E731
    at = [a * sample_time / 2 if sample_time else np.arctan(a) for a in resonances(one, sample_time) + resonances(two, sample_time)]
    end = np.pi / 2 - (0 if sample_time else 1e-9)
    return {"pointwise": largest(function, 0.0, end, at), "alike": bool(alike)}


def case(label: str, system, other, sample_time: float, band: list[float]) -> dict:
    a, b, c, d = system
    n, m, p = len(a), b.shape[1], c.shape[0]
    gain, _ = slycot.ab13dd("D" if sample_time else "C", "I", "S", "D", n, m, p, a, np.eye(n), b, c, d, 1e-12)
    own = lambda w: float(np.linalg.norm(response(system, sample_time, w), 2))  # noqa: E731
    gap = nu_gap(system, other, sample_time)
    return {
        "id": label, "sample_time_s": sample_time, "A": a, "B": b, "C": c, "D": d, "band_rad_s": band,
        "gain": float(gain), "gain_in_band": largest(own, *band, resonances(system, sample_time)),
        "other": dict(zip("ABCD", other)), "pointwise": gap["pointwise"], "winds_alike": gap["alike"], "nu_gap": gap["pointwise"] if gap["alike"] else 1.0,
    }


def _draw(generator: np.random.Generator, index: int) -> tuple:
    """Order 1..6, 1-2 inputs and outputs; poles on both sides, D zero in every second; `other` is near in two of three."""
    order, sample_time = 1 + index % 6, SAMPLE_TIME if index % 2 else 0.0
    inputs, outputs = int(generator.integers(1, 3)), int(generator.integers(1, 3))
    shapes = [(order, order), (order, inputs), (outputs, order), (outputs, inputs)]
    a, b, c, d = (generator.standard_normal(shape) for shape in shapes)
    d = d * 0.3 * (index % 4 > 1)
    share = [0.05, 0.2, 1.0][index % 3]
    other = [m + share * generator.standard_normal(m.shape) * (m != 0) for m in (a, b, c, d)]
    if sample_time:
        a, other[0] = a / np.sqrt(order), other[0] / np.sqrt(order)
    return tuple(np.round(m, 4) for m in (a, b, c, d)), tuple(np.round(m, 4) for m in other), sample_time


def norms(stored: dict | None) -> dict:
    known = {c["id"]: c for c in stored["cases"]} if stored else {}
    generator = np.random.default_rng(20261125)
    cases = []
    for index in range(RANDOM_SYSTEMS):
        label, (system, other, sample_time) = f"random{index:02}", _draw(generator, index)
        if label in known:
            system, other = (tuple(np.array(k[key], dtype=float) for key in "ABCD") for k in (known[label], known[label]["other"]))
        cases.append(case(label, system, other, sample_time, [0.7, 4.0]))
    for plant in DYNAMICS:
        # The heading, which no output shows, is taken off: its pole at 0 is none of the response.
        keep = slice(0, 1) if plant.name == "directional" else slice(None)
        system = (plant.a[keep, keep], plant.b[keep], plant.c[:, keep], plant.d)
        other = (system[0] * 1.05, system[1] * 0.9, system[2], system[3])
        cases.append(case(plant.name, system, other, 0.0, [1.0, 30.0]))
    return {"tool": TOOL, "tolerance": {"default": 1e-8}, "cases": cases}
