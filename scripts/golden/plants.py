"""The quadrotor UAV's four dynamics, and exact rational transfer functions.

v' = Yv v + Yp p + g phi + Yd delta_lat, p' = Lv v + Lp p + Ld delta_lat, phi' = p, ay = Yv v + Yp p + Yd delta_lat;
u' = Xu u + Xq q - g theta + Xd delta_lon, q' = Mu u + Mq q + Md delta_lon, theta' = q, ax = Xu u + Xq q + Xd delta_lon;
r' = Nr r + Nd delta_dir, psi' = r; w' = Zw w + Zd delta_ver, az = Zw w + Zd delta_ver.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy import linalg

GRAVITY = 9.81
Y_V, Y_P, L_V, L_P, Y_D, L_D = -0.211, 0.0, -3.613, 0.0, 9.379, 851.287
X_U, X_Q, M_U, M_Q, X_D, M_D = -0.282, 0.0, 6.297, 0.0, -8.758, 473.061
N_R, N_D = -8.178, 255.59
Z_W, Z_D = -0.731, -34.35


@dataclass(frozen=True)
class Plant:
    """Continuous state space x' = A x + B u, y = C x + D u with the names of its channels."""

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray

    @property
    def poles(self) -> np.ndarray:
        return np.linalg.eigvals(self.a)

    @property
    def is_stable(self) -> bool:
        """No pole right of the imaginary axis (the heading integrator counts as stable)."""
        return bool(np.all(self.poles.real <= 1e-9))

    def output(self, index: int) -> "Plant":
        """The same plant with one output only."""
        row = slice(index, index + 1)
        return Plant(self.name, self.states, self.inputs, (self.outputs[index],), self.a, self.b, self.c[row], self.d[row])

    def as_json(self) -> dict:
        return {
            "dynamics": self.name, "states": list(self.states), "inputs": list(self.inputs),
            "outputs": list(self.outputs), "A": self.a, "B": self.b, "C": self.c, "D": self.d,
        }


def _plant(name, states, inputs, outputs, a, b, c, d) -> Plant:
    return Plant(name, states, inputs, outputs, *(np.array(m, dtype=float) for m in (a, b, c, d)))


LATERAL = _plant(
    "lateral", ("v", "p", "phi"), ("delta_lat",), ("p", "ay"),
    [[Y_V, Y_P, GRAVITY], [L_V, L_P, 0], [0, 1, 0]], [[Y_D], [L_D], [0]],
    [[0, 1, 0], [Y_V, Y_P, 0]], [[0], [Y_D]],
)
LONGITUDINAL = _plant(
    "longitudinal", ("u", "q", "theta"), ("delta_lon",), ("q", "ax"),
    [[X_U, X_Q, -GRAVITY], [M_U, M_Q, 0], [0, 1, 0]], [[X_D], [M_D], [0]],
    [[0, 1, 0], [X_U, X_Q, 0]], [[0], [X_D]],
)
DIRECTIONAL = _plant(
    "directional", ("r", "psi"), ("delta_dir",), ("r",),
    [[N_R, 0], [1, 0]], [[N_D], [0]], [[1, 0]], [[0]],
)
VERTICAL = _plant("vertical", ("w",), ("delta_ver",), ("az",), [[Z_W]], [[Z_D]], [[Z_W]], [[Z_D]])
DYNAMICS = (LATERAL, LONGITUDINAL, DIRECTIONAL, VERTICAL)


def whole_uav() -> Plant:
    """All four dynamics side by side: 9 states, 4 inputs, 6 outputs (p ay | q ax | r | az)."""
    def names(field):
        return tuple(name for plant in DYNAMICS for name in getattr(plant, field))

    def blocks(field):
        return linalg.block_diag(*(getattr(plant, field) for plant in DYNAMICS))

    return Plant("uav", names("states"), names("inputs"), names("outputs"), *(blocks(f) for f in "abcd"))


# --- transfer functions, exact in rational arithmetic (Faddeev-LeVerrier) ---------------------------------------

Polynomial = list[Fraction]  # highest power first


def _rational(matrix: np.ndarray) -> list[list[Fraction]]:
    return [[Fraction(float(value)) for value in row] for row in matrix]


def _product(left, right):
    return [[sum((l * r for l, r in zip(row, column)), Fraction(0)) for column in zip(*right)] for row in left]


def transfer_function(a, b, c, d) -> tuple[list[list[Polynomial]], Polynomial]:
    """Numerators [ny][nu] and the characteristic polynomial of C (sI - A)^-1 B + D, without rounding or cancellation."""
    a, b, c, d = (_rational(m) for m in (a, b, c, d))
    n = len(a)
    adjugate = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    denominator: Polynomial = [Fraction(1)]
    terms = []
    for k in range(1, n + 1):
        terms.append(_product(_product(c, adjugate), b))
        moved = _product(a, adjugate)
        coefficient = -sum((moved[i][i] for i in range(n)), Fraction(0)) / k
        denominator.append(coefficient)
        adjugate = [[moved[i][j] + (coefficient if i == j else 0) for j in range(n)] for i in range(n)]
    numerators = [
        [
            [d[i][j] * denominator[0]] + [terms[k][i][j] + d[i][j] * denominator[k + 1] for k in range(n)]
            for j in range(len(d[0]))
        ]
        for i in range(len(d))
    ]
    return numerators, denominator


def strip(polynomial: Polynomial) -> Polynomial:
    """Without leading zero coefficients."""
    first = next((i for i, value in enumerate(polynomial) if value != 0), len(polynomial))
    return polynomial[first:]


def _remainder(dividend: Polynomial, divisor: Polynomial) -> tuple[Polynomial, Polynomial]:
    quotient, rest = [], list(dividend)
    while len(rest) >= len(divisor):
        factor = rest[0] / divisor[0]
        quotient.append(factor)
        rest = [r - factor * (divisor[i] if i < len(divisor) else 0) for i, r in enumerate(rest)][1:]
    return quotient, strip(rest)


def cancelled(numerator: Polynomial, denominator: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Numerator and monic denominator without their common factors (Euclid's algorithm, exact)."""
    high, low = strip(denominator), strip(numerator)
    while low:
        high, low = low, _remainder(high, low)[1]
    num, den = _remainder(strip(numerator), high)[0], _remainder(strip(denominator), high)[0]
    return [v / den[0] for v in num], [v / den[0] for v in den]


def roots(polynomial: Polynomial) -> np.ndarray:
    """Roots of an exact polynomial: numpy's, then Newton steps; exact zeros at the origin stay exact, pairs stay conjugate."""
    polynomial = strip(polynomial)
    origin = next(i for i, value in enumerate(reversed(polynomial)) if value != 0)
    coefficients = np.array([float(v) for v in polynomial[: len(polynomial) - origin]])
    found = np.roots(coefficients).astype(complex)
    for _ in range(3):
        found = found - np.polyval(coefficients, found) / np.polyval(np.polyder(coefficients), found)
    real = found[np.abs(found.imag) <= 1e-9 * np.abs(found)].real
    upper = found[found.imag > 1e-9 * np.abs(found)]
    ordered = np.concatenate([np.sort(real), *([p, p.conjugate()] for p in upper), np.zeros(origin)])
    assert len(ordered) == len(polynomial) - 1
    return ordered.astype(complex)


def zpk(plant: Plant) -> tuple[np.ndarray, np.ndarray, float]:
    """Zeros, poles and gain of a single-input single-output plant, common factors cancelled."""
    numerators, denominator = transfer_function(plant.a, plant.b, plant.c, plant.d)
    num, den = cancelled(numerators[0][0], denominator)
    return roots(num), roots(den), float(num[0])
