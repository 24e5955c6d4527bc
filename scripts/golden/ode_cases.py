"""Case ode: the steppers on three classical problems, and the Jacobians of the equations' documents by extrapolated differences."""

import copy

import numpy as np
from scipy import integrate

from . import equations_cases
from .discretise import assert_close

TOOL = "numpy 2.3.5, scipy 1.17.1"


def arenstorf(t, x):
    """Hairer, Norsett and Wanner (1993), section II.0: a satellite of earth and moon."""
    mu = 0.012277471
    nu = 1 - mu
    d1, d2 = ((x[0] + mu) ** 2 + x[1] ** 2) ** 1.5, ((x[0] - nu) ** 2 + x[1] ** 2) ** 1.5
    return [x[2], x[3], x[0] + 2 * x[3] - nu * (x[0] + mu) / d1 - mu * (x[0] - nu) / d2, x[1] - 2 * x[2] - nu * x[1] / d1 - mu * x[1] / d2]


def robertson(t, x):
    """Hairer and Wanner (1996), section IV.1: stiff chemical kinetics."""
    return [-0.04 * x[0] + 1e4 * x[1] * x[2], 0.04 * x[0] - 1e4 * x[1] * x[2] - 3e7 * x[1] ** 2, 3e7 * x[1] ** 2]


def brusselator(t, x):
    """Hairer, Norsett and Wanner (1993), section I.16, with a drive that depends on time."""
    return [1 + x[0] ** 2 * x[1] - 4 * x[0] + 0.2 * np.sin(3 * t), 3 * x[0] - x[0] ** 2 * x[1]]


PROBLEMS = {
    "arenstorf": (arenstorf, [0.994, 0.0, 0.0, -2.00158510637908], [0.5, 2.0, 5.0, 8.0], ("DOP853", "LSODA"), 1e-6),
    "robertson": (robertson, [1.0, 0.0, 0.0], [0.4, 4.0, 400.0, 4e4], ("Radau", "BDF"), 1e-6),
    "brusselator": (brusselator, [1.5, 3.0], [1.0, 4.0, 10.0, 20.0], ("DOP853", "Radau"), 1e-8),
}


def paths() -> list[dict]:
    cases = []
    for name, (f, x0, times, methods, agree) in PROBLEMS.items():
        runs = [integrate.solve_ivp(f, (0, times[-1]), x0, m, t_eval=times, rtol=1e-12 if m != "BDF" else 1e-10, atol=1e-15).y.T for m in methods]
        assert_close(runs[1], runs[0], agree, f"{name}: second solver")
        cases.append({"id": name, "method": methods[0], "x0": x0, "times": times, "x": runs[0]})
    return cases


def slope(f, at: float) -> np.ndarray:
    """df/dv: central differences of three steps, extrapolated to step 0 (Richardson): an error of the step's sixth power."""
    step = 2e-3 * max(abs(at), 1e-2)
    d = [(np.asarray(f(at + h)) - np.asarray(f(at - h))) / (2 * h) for h in (step, step / 2, step / 4)]
    once = [(4 * d[1] - d[0]) / 3, (4 * d[2] - d[1]) / 3]
    return (16 * once[1] - once[0]) / 15


def jacobians() -> list[dict]:
    """Of the derivatives and the outputs by states, inputs and parameters, at two points of each plant's stored path."""
    from . import store

    stored = store.read(store.FOLDER / "equations" / "reference.json")
    found = []
    for case in stored["cases"]:
        if not case["id"].endswith("_even"):
            continue
        for sample in (7, 20):
            model, t, x, u = case["model"], case["time_s"][sample], np.array(case["x"][sample]), np.array(case["u"][sample])
            names = list(model["parameters"])

            def by(kind, j):
                def at(v):
                    xs, us, changed = x.copy(), u.copy(), model
                    if kind == "states":
                        xs[j] = v
                    elif kind == "inputs":
                        us[j] = v
                    else:
                        changed = copy.deepcopy(model)
                        changed["parameters"][names[j]]["value"] = v
                    derivatives, outputs = equations_cases._by_text(changed, t, xs, us)
                    return np.concatenate([derivatives, outputs])

                value = {"states": x, "inputs": u}.get(kind)
                return slope(at, value[j] if value is not None else model["parameters"][names[j]]["value"])

            entry = {"id": f"{case['id']} {sample}", "case": case["id"], "sample": sample}
            for kind, count in (("states", len(x)), ("inputs", len(u)), ("parameters", len(names))):
                entry[kind] = np.column_stack([by(kind, j) for j in range(count)])
            found.append(entry)
    return found


def ode(stored: dict | None) -> dict:
    return {"tool": TOOL, "tolerance": {"default": 1e-7}, "cases": paths(), "jacobians": jacobians()}
