"""Case zeros: poles, transmission zeros and transfer functions."""

import control
import numpy as np

from . import plants
from .c2d_cases import TOOL
from .plants import DYNAMICS

RANDOM_SYSTEMS = 20


def ordered(values: np.ndarray) -> np.ndarray:
    """By real part, then imaginary part; rounding around the origin is written as 0."""
    values = np.asarray(values, dtype=complex).ravel()
    values = np.where(np.abs(values) < 1e-13, 0.0, values)
    return values[np.lexsort((np.round(values.imag, 9), np.round(values.real, 9)))]


def exact_transfer(a, b, c, d) -> tuple[list, np.ndarray, np.ndarray]:
    """Numerators [ny][nu] (n + 1 coefficients, highest power first), characteristic polynomial, relative degrees."""
    numerators, denominator = plants.transfer_function(a, b, c, d)
    degrees = [[len(denominator) - len(plants.strip(p)) if plants.strip(p) else None for p in row] for row in numerators]
    return [[[float(v) for v in p] for p in row] for row in numerators], np.array([float(v) for v in denominator]), degrees


def check_control(a, b, c, d, numerators, denominator) -> float:
    """Largest relative difference of python-control's transfer functions, cross-multiplied, from the exact ones."""
    system = control.tf(control.ss(a, b, c, d))
    worst = 0.0
    for i in range(len(c)):
        for j in range(b.shape[1]):
            ours = np.polymul(np.array(numerators[i][j]), system.den[i][j])
            theirs = np.polymul(system.num[i][j], denominator)
            worst = max(worst, float(np.max(np.abs(np.polysub(ours, theirs))) / np.max(np.abs(ours))))
    return worst


def case(label: str, time: str, a, b, c, d) -> dict:
    numerators, denominator, degrees = exact_transfer(a, b, c, d)
    difference = check_control(a, b, c, d, numerators, denominator)
    assert difference < 1e-8, f"{label}: {difference}"
    system = control.ss(a, b, c, d)
    zeros = ordered(control.zeros(system))
    for zero in zeros:  # the system matrix loses rank at each of them
        pencil = np.block([[zero * np.eye(len(a)) - a, -b], [c, d]])
        sizes = np.linalg.svd(pencil, compute_uv=False)
        assert sizes[-1] < 1e-8 * sizes[0], f"{label}: {zero} is no zero"
    return {
        "id": label, "time": time, "A": a, "B": b, "C": c, "D": d, "poles": ordered(control.poles(system)), "zeros": zeros,
        "numerators": numerators, "denominator": denominator, "relative_degree": degrees, "control_difference": difference,
    }


def _draw(generator: np.random.Generator, index: int) -> tuple[np.ndarray, ...]:
    """Order 2..8, 1-3 inputs and outputs, every second square, D zero in half of the draws."""
    order = 2 + index % 7
    inputs = int(generator.integers(1, 4))
    outputs = inputs if index % 2 == 0 else int(generator.integers(1, 4))
    a, b = generator.standard_normal((order, order)), generator.standard_normal((order, inputs))
    c, d = generator.standard_normal((outputs, order)), generator.standard_normal((outputs, inputs))
    if index % 4 < 2:
        d = np.zeros((outputs, inputs))
    return tuple(np.round(m, 4) for m in (a, b, c, d))


def zeros(stored: dict | None) -> dict:
    cases = [case(p.name, "continuous", p.a, p.b, p.c, p.d) for p in DYNAMICS]
    cases += [case(f"{p.name}_{p.outputs[i]}", "continuous", *_siso(p, i)) for p in DYNAMICS for i in range(len(p.outputs))]
    known = {c["id"]: c for c in stored["cases"]} if stored else {}
    generator = np.random.default_rng(20240505)
    for index in range(RANDOM_SYSTEMS):
        label, drawn = f"random{index:02}", _draw(generator, index)
        if label in known:
            drawn = tuple(np.array(known[label][key], dtype=float) for key in "ABCD")
        cases.append(case(label, "continuous", *drawn))
    return {"tool": TOOL, "tolerance": {"default": 1e-9, "control_difference": None}, "cases": cases}


def _siso(plant: plants.Plant, index: int) -> tuple:
    single = plant.output(index)
    return single.a, single.b, single.c, single.d
