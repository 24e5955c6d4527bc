"""Zero-pole matching and least squares: the two methods for single-input single-output models."""

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from .plants import Plant, zpk


@dataclass(frozen=True)
class SampledZpk:
    """gain * prod(z - zeros) / prod(z - poles)."""

    zeros: np.ndarray
    poles: np.ndarray
    gain: float

    def frequency_response(self, z: np.ndarray) -> np.ndarray:
        """H at the points z, shape [points, 1]."""
        top = np.prod(z[:, None] - self.zeros[None, :], axis=1)
        bottom = np.prod(z[:, None] - self.poles[None, :], axis=1)
        return (self.gain * top / bottom)[:, None]

    def simulate(self, u: np.ndarray) -> np.ndarray:
        """Response [N, 1] from rest, one pole (with its zero) after another."""
        signal = self.gain * np.asarray(u, dtype=complex)
        for index, pole in enumerate(self.poles):
            zero = self.zeros[index] if index < len(self.zeros) else None
            state, out = 0j, np.empty_like(signal)
            for k, value in enumerate(signal):
                out[k] = state if zero is None else value + (pole - zero) * state
                state = pole * state + value
            signal = out
        return signal.real[:, None]

    def as_json(self) -> dict:
        return {"zeros": self.zeros, "poles": self.poles, "gain": self.gain}


def matched(plant: Plant, sample_time: float) -> SampledZpk:
    """MATLAB's and Octave's rule: poles and zeros by exp(s Ts), zeros at infinity but one to -1, gain at one point."""
    zeros, poles, gain = zpk(plant)
    missing = max(len(poles) - len(zeros) - 1, 0)
    discrete_zeros = np.concatenate([np.exp(zeros * sample_time), -np.ones(missing)])
    discrete_poles = np.exp(poles * sample_time)
    point = 0.0
    while np.any(np.abs(np.concatenate([zeros, poles]) - point) < np.sqrt(np.finfo(float).eps)):
        point += 0.1 / sample_time
    z = np.exp(point * sample_time)
    continuous = gain * np.prod(point - zeros) / np.prod(point - poles)
    unscaled = np.prod(z - discrete_zeros) / np.prod(z - discrete_poles)
    return SampledZpk(discrete_zeros, discrete_poles, float((continuous / unscaled).real))


# --- least squares ----------------------------------------------------------------------------------------------

GRID_POINTS = 200


@dataclass(frozen=True)
class LeastSquaresFit:
    model: SampledZpk
    cost: float  # mean |G - H|^2 over the grid
    spread: float  # largest relative difference of H among the starts that reached this cost
    other_minima: list[float]  # costs of the other stationary points found, on the allowed side of the circle
    first_cost: float  # cost reached from the poles exp(p Ts) alone
    gradient: float  # largest scaled gradient component left


class _Problem:
    """Variable projection in d = (z - 1) / Ts: the numerator is linear, the denominator a product of real factors.

    A factor of order 1 is d + c, one of order 2 is d^2 + c1 d + c0; poles inside and outside the unit circle never
    share one. The factor of the poles outside is written in m = (1/z - 1) / Ts: there a real pole that goes to infinity and
    comes back with the other sign passes an ordinary point.
    """

    def __init__(self, plant: Plant, sample_time: float, fraction: float):
        zeros, poles, gain = zpk(plant)
        self.sample_time = sample_time
        self.omega = (np.arange(GRID_POINTS) + 0.5) * np.pi / (GRID_POINTS * sample_time)
        s = 1j * self.omega
        self.target = gain * np.prod(s[:, None] - zeros, axis=1) / np.prod(s[:, None] - poles, axis=1)
        self.target = self.target * np.exp(-s * fraction * sample_time)
        self.d = (np.exp(s * sample_time) - 1) / sample_time
        z = np.exp(s * sample_time)
        self.m = (1 / z - 1) / sample_time
        self.sides = self._group(np.exp(poles * sample_time))
        self.turn = z ** -sum(len(group) for inside, group in self.sides if not inside)
        self.order = len(poles)
        self.powers = self.d[:, None] ** np.arange(self.order, -1, -1)

    @staticmethod
    def _group(poles: np.ndarray) -> list[tuple[bool, np.ndarray]]:
        """(inside, poles or, outside, their reciprocals) per factor; this data only needs one factor on either side."""
        groups = [(True, poles[np.abs(poles) < 1]), (False, 1 / poles[np.abs(poles) > 1])]
        groups = [(inside, group) for inside, group in groups if len(group)]
        assert all(len(group) <= 2 for _, group in groups) and sum(len(g) for _, g in groups) == len(poles)
        return groups

    def start(self) -> np.ndarray:
        """The parameters of the poles exp(p Ts)."""
        return np.concatenate([np.poly((g - 1) / self.sample_time).real[1:] for _, g in self.sides])

    def factors(self, c: np.ndarray) -> list[np.ndarray]:
        parts, at = [], 0
        for _, group in self.sides:
            parts.append(np.concatenate([[1.0], c[at : at + len(group)]]))
            at += len(group)
        return parts

    def values(self, c: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """(variable, factor) of every side at all frequencies."""
        variables = [self.d if inside else self.m for inside, _ in self.sides]
        return [(x, np.polyval(factor, x)) for x, factor in zip(variables, self.factors(c))]

    def roots(self, c: np.ndarray) -> list[np.ndarray]:
        """Poles inside, reciprocals of the poles outside."""
        return [1 + self.sample_time * np.roots(f).astype(complex) for f in self.factors(c)]

    def poles(self, c: np.ndarray) -> np.ndarray:
        return np.concatenate([r if inside else 1 / r for r, (inside, _) in zip(self.roots(c), self.sides)])

    def allowed(self, c: np.ndarray) -> bool:
        return bool(np.all(np.abs(np.concatenate(self.roots(c))) < 1))

    def project(self, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Numerator, residual and denominator for fixed poles."""
        denominator = np.prod([value for _, value in self.values(c)], axis=0)
        basis = self.powers * (self.turn / denominator)[:, None]
        stacked = np.vstack([basis.real, basis.imag])
        scale = np.linalg.norm(stacked, axis=0)
        solution = np.linalg.lstsq(stacked / scale, np.concatenate([self.target.real, self.target.imag]), rcond=None)[0]
        numerator = solution / scale
        return numerator, basis @ numerator - self.target, denominator

    def cost(self, c: np.ndarray) -> float:
        return float(np.mean(np.abs(self.project(c)[1]) ** 2))

    def jacobian(self, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """d H / d c at the projected numerator, and the residual."""
        numerator, residual, _ = self.project(c)
        fit = residual + self.target
        columns = []
        for (x, value), (_, group) in zip(self.values(c), self.sides):
            columns += [-fit * x**power / value for power in range(len(group) - 1, -1, -1)]
        return np.array(columns).T, residual

    def gradient(self, c: np.ndarray) -> np.ndarray:
        """Exact gradient of the projected cost (the numerator's part vanishes), scaled to be about the relative error."""
        jacobian, residual = self.jacobian(c)
        return (jacobian.conj().T @ residual).real / np.linalg.norm(jacobian, axis=0) / np.linalg.norm(self.target)

    def model(self, c: np.ndarray) -> SampledZpk:
        numerator = self.project(c)[0]
        first = next(i for i, v in enumerate(numerator) if v != 0)
        zeros = 1 + self.sample_time * np.roots(numerator[first:]).astype(complex)
        turned = np.prod([np.prod(-r) for r, (inside, _) in zip(self.roots(c), self.sides) if not inside]).real
        return SampledZpk(zeros, self.poles(c), float(numerator[first]) * self.sample_time**first / turned)


def _descend(problem: _Problem, start: np.ndarray) -> np.ndarray | None:
    """A stationary point on the allowed side of the circle, or None."""
    def residual(c):
        if not problem.allowed(c):
            return np.full(2 * GRID_POINTS, 1e3 * np.max(np.abs(problem.target)))
        r = problem.project(c)[1]
        return np.concatenate([r.real, r.imag])

    found = optimize.least_squares(residual, start, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=400).x
    scale = np.maximum(np.abs(found), 1e-12)
    polished = optimize.root(lambda q: problem.gradient(q * scale), found / scale, options={"xtol": 1e-15}).x * scale
    better = problem.allowed(polished) and problem.cost(polished) <= problem.cost(found) * (1 + 1e-9)
    result = polished if better else found
    return result if problem.allowed(result) else None


def _starts(problem: _Problem) -> list[np.ndarray]:
    """exp(p Ts), that with changed sizes of the coefficients, and random poles on the right side: pairs and real ones."""
    first = problem.start()
    generator = np.random.default_rng(7)
    starts = [first] + [first * (1 + size * generator.standard_normal(len(first))) for size in (1e-3, 0.03, 0.1, 0.3, 0.3)]
    for number in range(72):
        parts = []
        for _, group in problem.sides:
            radius, angle = generator.uniform(0.05, 0.99), generator.uniform(0, np.pi)
            if len(group) == 2 and number % 3:
                poles = radius * np.exp(1j * np.array([angle, -angle]))
            else:
                poles = generator.uniform(-0.99, 0.99, len(group))
            parts.append(np.poly((poles - 1) / problem.sample_time).real[1:])
        starts.append(np.concatenate(parts))
    return [s for s in starts if problem.allowed(s)]


def least_squares(plant: Plant, sample_time: float, fraction: float) -> LeastSquaresFit:
    """The sampled model of the plant's order that minimises the mean |G exp(-j w f) - H|^2 over the grid."""
    problem = _Problem(plant, sample_time, fraction)
    found = [c for c in (_descend(problem, s) for s in _starts(problem)) if c is not None]
    power = float(np.mean(np.abs(problem.target) ** 2))
    first_cost = problem.cost(_descend(problem, problem.start()))
    found.sort(key=problem.cost)
    best = found[0]
    cost = problem.cost(best)
    same = [c for c in found if problem.cost(c) <= cost * (1 + 1e-6) + 1e-24 * power]
    others = sorted({float(f"{problem.cost(c):.6g}") for c in found[len(same):] if np.max(np.abs(problem.gradient(c))) < 1e-9})
    z = np.exp(1j * problem.omega * sample_time)
    reference = problem.model(best).frequency_response(z)
    stationary = [c for c in same if np.max(np.abs(problem.gradient(c))) < 1e-12]
    spread = max(
        (np.max(np.abs(problem.model(c).frequency_response(z) - reference)) / np.max(np.abs(reference)) for c in stationary),
        default=0.0,
    )
    return LeastSquaresFit(problem.model(best), cost, float(spread), others, first_cost, float(np.max(np.abs(problem.gradient(best)))))
