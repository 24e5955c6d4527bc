"""Effects that do the same thing by construction, whatever the data: an entry of B that is alone in its column is a gain of that input.

Only effects without memory are compared, by what they change in the derivatives and outputs at random states and commands. Delays, lags and limits
before or behind them only rescale: an input's gain in front of a limit is the same gain behind a larger limit.
"""

import copy
import math

import numpy as np

from .catalogue import channels
from .expressions import FUNCTIONS, to_source
from .system import Names

AFFINE = {"input_gain", "input_offset", "constant_disturbance", "quadratic_drag", "cubic_stiffness", "cross_coupling", "sensor_gain", "sensor_bias", "misalignment"}
POINTS, SIZE, SAME = 40, 0.1, 1e-9  # random points, size of the change, relative difference that is rounding


def _operating(described: list[dict]) -> np.ndarray:
    """Operating points of the channels; "mean" is some level that is not 0."""
    return np.array([1.0 if c.get("operating") == "mean" else float(c.get("operating") or 0.0) for c in described])


def _functions(model: dict):
    """(derivatives and outputs as one function of states and commands, per parameter the model with another value)."""
    names = Names(model)
    if names.lti:
        operating = [_operating(model[k]) for k in ("inputs", "outputs")]
        a, b, c, d = (np.array(model[m], dtype=float) for m in "ABCD")
        return lambda x, u: (a @ x + b @ (u - operating[0]), c @ x + d @ (u - operating[0]) + operating[1])
    places = {n: f"x[{i}]" for i, n in enumerate(names.states)} | {n: f"u[{i}]" for i, n in enumerate(names.inputs)}
    places |= {n: repr(float(p["value"])) for n, p in model["parameters"].items()}
    rows = [[compile(to_source(str(table[n]), places), n, "eval") for n in order]
            for table, order in ((model["derivatives"], names.states), (model["output_equations"], names.outputs))]
    space = dict(FUNCTIONS, __builtins__={})
    return lambda x, u: tuple(np.array([eval(row, space, {"x": x, "u": u}) for row in part], dtype=float) for part in rows)  # noqa: S307 - checked expressions


def _with_parameter(model: dict, channel: str, factor: float) -> dict:
    model = copy.deepcopy(model)
    if Names(model).lti:
        names = Names(model)
        row, column = channel[2:-1].split(",")
        columns = names.states if channel[0] == "A" else names.inputs
        model[channel[0]][names.states.index(row)][columns.index(column)] *= factor
    else:
        model["parameters"][channel]["value"] *= factor
    return model


def _change(model: dict, effect: str, channel: str, x, u) -> np.ndarray:
    """What the effect of size `SIZE` adds to derivatives and outputs."""
    names, plain = Names(model), _functions(model)
    f, g = plain(x, u)
    df, dg = np.zeros_like(f), np.zeros_like(g)
    if effect == "parameter_error":
        changed = _functions(_with_parameter(model, channel, 1 + SIZE))(x, u)
        return np.concatenate([changed[0] - f, changed[1] - g])
    if effect in ("input_gain", "input_offset"):
        i, moved = names.inputs.index(channel), u.copy()
        moved[i] = moved[i] * (1 + SIZE) if effect == "input_gain" else moved[i] + SIZE
        changed = plain(x, moved)
        return np.concatenate([changed[0] - f, changed[1] - g])
    values = dict(zip(names.states, x)) | dict(zip(names.inputs, u)) | dict(zip(names.outputs, g))
    source, _, target = channel.rpartition("->")
    if effect == "cross_coupling" and names.lti and source in names.inputs:
        values[source] -= _operating(model["inputs"])[names.inputs.index(source)]
    if effect in ("sensor_gain", "sensor_bias", "misalignment"):
        rows = range(len(g)) if channel == "*" else [names.outputs.index(target)]
        for j in rows:
            dg[j] = {"sensor_gain": g[j], "sensor_bias": 1.0}.get(effect, values.get(source, 0.0))
    else:
        value = values[source or target]
        df[names.states.index(target)] = {"constant_disturbance": 1.0, "quadratic_drag": value * abs(value), "cubic_stiffness": value**3}.get(effect, value)
    return SIZE * np.concatenate([df, dg])


def same_by_construction(model: dict) -> dict[str, set[str]]:
    """Of each `effect:channel` the others that do the same with another number; those alone that have such others."""
    if Names(model).sample_time:
        return {}
    rng, names = np.random.default_rng(1), Names(model)
    points = [(np.array(names.initial) + rng.normal(size=len(names.states)), rng.normal(size=len(names.inputs))) for _ in range(POINTS)]
    found: dict[str, np.ndarray] = {}
    for effect in sorted(AFFINE | {"parameter_error"}):
        for channel in channels(model, effect):
            moved = np.concatenate([_change(model, effect, channel, x, u) for x, u in points])
            if np.all(np.isfinite(moved)) and np.any(moved):
                found[f"{effect}:{channel}"] = moved / np.linalg.norm(moved)
    same: dict[str, set[str]] = {}
    for a, one in found.items():
        for b, other in found.items():
            if a < b and abs(abs(float(one @ other)) - 1.0) < SAME and min(np.abs(one - other).max(), np.abs(one + other).max()) < math.sqrt(SAME):
                same.setdefault(a, set()).add(b)
                same.setdefault(b, set()).add(a)
    return same
