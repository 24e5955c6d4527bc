"""Answers a file of random problems with scipy and python-control, for the differential test.

Usage: python differential_reference.py PROBLEMS.json ANSWERS.json

PROBLEMS.json is a list (or {"problems": list}) of
  {"kind": "c2d", "method": "zoh|foh|tustin|impulse", "A", "B", "C", "D", "sample_time_s"}          -> A, B, C, D
  {"kind": "dlqr", "A", "B", "Q", "R", "N" (may be null)}                                           -> K, X
  {"kind": "lsim", "A", "B", "C", "D", "sample_time_s", "hold": "zoh|linear", "x0", "u": [N][nu]}   -> y [N][ny]
  {"kind": "zeros_poles", "A", "B", "C", "D"}                                                       -> zeros, poles ([re, im])
ANSWERS.json is {"answers": [...]} in the same order. Each answer holds those keys, "condition" (largest relative change of any
part of the answer per relative change of the data, from 3 random perturbations of relative size 1e-8; at least 1) and
"error" (null, or why the reference failed; then nothing else is there).
"""

import json
import os
import sys
import tempfile
import warnings
from pathlib import Path

import control
import numpy as np
from scipy import linalg, optimize, signal

PERTURBATION = 1e-8
PERTURBATIONS = 3
DISAGREEMENT = 1e-8  # of the two Riccati solvers, times the condition number
MATRICES = ("A", "B", "C", "D", "Q", "R", "N", "x0", "u")


class Failed(Exception):
    """The reference has no trustworthy answer."""


def c2d(data: dict) -> dict:
    method = {"tustin": "bilinear"}.get(data["method"], data["method"])
    a, b, c, d, _ = signal.cont2discrete(tuple(data[key] for key in "ABCD"), data["sample_time_s"], method)
    return {"A": a, "B": b, "C": c, "D": d}


def dlqr(data: dict) -> dict:
    a, b, q, r, n = (data[key] for key in "ABQRN")
    x = linalg.solve_discrete_are(a, b, q, r, s=n)
    x = (x + x.T) / 2
    k = np.linalg.solve(r + b.T @ x @ b, b.T @ x @ a + n.T)
    if np.max(np.abs(np.linalg.eigvals(a - b @ k))) >= 1:
        raise Failed("the closed loop is not stable")
    return {"K": k, "X": x}


def lsim(data: dict) -> dict:
    u = data["u"]
    t = np.arange(len(u)) * data["sample_time_s"]
    if data["hold"] == "linear":
        system = control.ss(*(data[key] for key in "ABCD"))
        y = control.forced_response(system, t, u.T, data["x0"], squeeze=False).outputs
        return {"y": np.reshape(y, (len(data["C"]), len(u))).T}
    _, y, _ = signal.lsim(tuple(data[key] for key in "ABCD"), u, t, X0=data["x0"], interp=False)
    return {"y": np.reshape(y, (len(u), len(data["C"])))}


def zeros_poles(data: dict) -> dict:
    system = control.ss(*(data[key] for key in "ABCD"))
    return {"zeros": control.zeros(system), "poles": control.poles(system)}


SOLVERS = {"c2d": c2d, "dlqr": dlqr, "lsim": lsim, "zeros_poles": zeros_poles}


def arrays(problem: dict) -> dict:
    """The problem with its matrices as float arrays; a missing N is zero."""
    data = {key: np.array(value, dtype=float) if key in MATRICES and value is not None else value for key, value in problem.items()}
    if problem["kind"] == "dlqr" and data.get("N") is None:
        data["N"] = np.zeros_like(data["B"])
    return data


def perturbed(data: dict, generator: np.random.Generator) -> dict:
    """Every entry changed by up to the relative size; Q and R stay symmetric."""
    changed = {}
    for key, value in data.items():
        if key in MATRICES and value is not None:
            value = value * (1 + PERTURBATION * generator.choice([-1.0, 1.0], value.shape))
            if key in ("Q", "R"):
                value = (value + value.T) / 2
        changed[key] = value
    return changed


def change(new, old) -> float:
    """Largest relative change; sets of complex numbers are paired first, others go by rows' running largest magnitude."""
    new, old = np.asarray(new), np.asarray(old)
    if new.shape != old.shape:
        raise Failed("a small perturbation changes the number of zeros")
    if old.size == 0:
        return 0.0
    if np.iscomplexobj(old) or np.iscomplexobj(new):
        distance = np.abs(new[:, None] - old[None, :])
        rows, columns = optimize.linear_sum_assignment(distance)
        return float(np.max(distance[rows, columns] / np.maximum(np.abs(old[columns]), 1e-300)))
    return float(np.max(np.abs(new - old)) / (np.max(np.abs(old)) or 1.0))


def check_dlqr(data: dict, answer: dict, condition: float) -> None:
    k, x, _ = (np.asarray(value) for value in control.dlqr(data["A"], data["B"], data["Q"], data["R"], data["N"]))
    apart = max(change(k, answer["K"]), change(x, answer["X"]))
    if apart > min(DISAGREEMENT, 1e-12 * max(condition, 1.0)):
        raise Failed(f"scipy and python-control differ by {apart:.2g}")


def answer(problem: dict, generator: np.random.Generator) -> dict:
    try:
        data = arrays(problem)
        solver = SOLVERS[problem["kind"]]
        found = solver(data)
        changed = (solver(perturbed(data, generator)) for _ in range(PERTURBATIONS))
        sizes = [max(change(new[key], found[key]) for key in found) for new in changed]
        condition = max(1.0, max(sizes) / PERTURBATION)
        if problem["kind"] == "dlqr":
            check_dlqr(data, found, condition)
        if not all(np.all(np.isfinite(value)) for value in found.values()):
            raise Failed("the answer is not finite")
    except Exception as problem_found:  # any failure of a reference tool is an answer, too
        return {"error": f"{type(problem_found).__name__}: {problem_found}"}
    return {**{key: as_lists(value) for key, value in found.items()}, "condition": condition, "error": None}


def as_lists(value: np.ndarray) -> list:
    if np.iscomplexobj(value):
        return [[float(v.real), float(v.imag)] for v in value]
    return value.tolist()


def write(path: Path, document: dict) -> None:
    """Writes to a temporary name beside `path`, then renames."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        json.dump(document, file, allow_nan=False)
    os.replace(name, path)


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    warnings.filterwarnings("ignore")
    problems = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    problems = problems["problems"] if isinstance(problems, dict) else problems
    generator = np.random.default_rng(1)
    write(Path(sys.argv[2]).absolute(), {"answers": [answer(problem, generator) for problem in problems]})
    return 0


if __name__ == "__main__":
    sys.exit(main())
