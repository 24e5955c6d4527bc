"""Roots and values of polynomials with rational coefficients, to many digits: square-free factors by Yun, then Aberth's iteration in decimal arithmetic."""

from decimal import Decimal, getcontext
from fractions import Fraction
from math import cos, sin, tau

import numpy as np

from .plants import Polynomial, _remainder, strip

getcontext().prec = 150
getcontext().Emax, getcontext().Emin = 10**9, -(10**9)


def decimal(value: Fraction) -> Decimal:
    return Decimal(value.numerator) / Decimal(value.denominator)


def derivative(p: Polynomial) -> Polynomial:
    n = len(p) - 1
    return [c * (n - i) for i, c in enumerate(p[:-1])]


def gcd(p: Polynomial, q: Polynomial) -> Polynomial:
    p, q = strip(p), strip(q)
    while q:
        p, q = q, _remainder(p, q)[1]
        q = [c / q[0] for c in q] if q else q
    return [c / p[0] for c in p]


def square_free(p: Polynomial) -> list[tuple[Polynomial, int]]:
    """Factors without repeated roots, and how often each stands in p (Yun)."""
    p = [c / p[0] for c in p]
    slope = derivative(p)
    common = gcd(p, slope)
    b, c = _remainder(p, common)[0], _remainder(slope, common)[0]
    factors, times = [], 1
    while len(b) > 1:
        d = strip([x - y for x, y in zip(c, derivative(b))])
        a = gcd(b, d) if d else b
        if len(a) > 1:
            factors.append((a, times))
        b, c = _remainder(b, a)[0], (_remainder(d, a)[0] if d else [])
        times += 1
    return factors


class Number:
    """A complex number of decimals."""

    __slots__ = ("re", "im")

    def __init__(self, re, im=Decimal(0)):
        self.re, self.im = Decimal(re), Decimal(im)

    def __add__(self, other):
        return Number(self.re + other.re, self.im + other.im)

    def __sub__(self, other):
        return Number(self.re - other.re, self.im - other.im)

    def __mul__(self, other):
        return Number(self.re * other.re - self.im * other.im, self.re * other.im + self.im * other.re)

    def __truediv__(self, other):
        size = other.re * other.re + other.im * other.im
        return Number((self.re * other.re + self.im * other.im) / size, (self.im * other.re - self.re * other.im) / size)

    def __abs__(self):
        return (self.re * self.re + self.im * self.im).sqrt()

    def __complex__(self):
        return complex(float(self.re), float(self.im))


def at(p: Polynomial, x: Number) -> Number:
    total = Number(0)
    for c in p:
        total = total * x + Number(decimal(c))
    return total


def _start(p: Polynomial) -> list[Number]:
    """Points on circles of the radii of Newton's polygon."""
    c = [decimal(v) for v in reversed(p)]
    logs = [(k, abs(v).ln()) for k, v in enumerate(c) if v != 0]
    hull: list = []
    for point in logs:
        while len(hull) > 1 and (hull[-1][1] - hull[-2][1]) * (point[0] - hull[-2][0]) <= (point[1] - hull[-2][1]) * (hull[-1][0] - hull[-2][0]):
            hull.pop()
        hull.append(point)
    found = []
    for turn, ((a, la), (b, lb)) in enumerate(zip(hull, hull[1:])):
        radius = ((la - lb) / (b - a)).exp()
        angles = [tau * i / (b - a) + 0.7 + 0.4 * turn for i in range(b - a)]
        found += [Number(radius * Decimal(cos(w)), radius * Decimal(sin(w))) for w in angles]
    return found


def _simple_roots(p: Polynomial) -> list[Number]:
    slope = derivative(p)
    x = _start(p)
    for _ in range(400):
        largest = Decimal(0)
        for i, value in enumerate(x):
            top = at(p, value)
            if abs(top) == 0:
                continue
            step = top / at(slope, value)
            others = Number(0)
            for j, other in enumerate(x):
                if j != i:
                    others = others + Number(1) / (value - other)
            step = step / (Number(1) - step * others)
            x[i] = value - step
            largest = max(largest, abs(step) / max(abs(x[i]), Decimal("1e-9999")))
        if largest < Decimal("1e-60"):
            return x
    raise ArithmeticError(f"no roots after 400 sweeps: {[float(c) for c in p]}")


def roots(p: Polynomial) -> np.ndarray:
    """All roots, rounded once: repeated ones as often as they stand, conjugates exact, ordered by real and imaginary part."""
    p = strip(p)
    if not p:
        return np.array([], dtype=complex)
    origin = next(i for i, value in enumerate(reversed(p)) if value != 0)
    found = [0j] * origin
    for factor, times in square_free(p[: len(p) - origin]):
        for root in _simple_roots(factor):
            value = complex(root)
            if abs(root.im) < Decimal("1e-50") * abs(root):
                value = complex(value.real, 0.0)
            found += [value] * times
    return np.array(sorted(found, key=lambda v: (v.real, v.imag)), dtype=complex)


def value(p: Polynomial, omega: float) -> tuple[Fraction, Fraction]:
    """p(jω), exactly."""
    w, re, im = Fraction(omega), Fraction(0), Fraction(0)
    for c in p:
        re, im = -im * w + c, re * w
    return re, im


def response(numerator: Polynomial, denominator: Polynomial, omega: float) -> complex:
    """N(jω)/D(jω), rounded once."""
    (a, b), (c, d) = value(numerator, omega), value(denominator, omega)
    size = c * c + d * d
    return complex(float((a * c + b * d) / size), float((b * c - a * d) / size))


