"""Other ways to write the same machine down: an output in another unit, a working point away from 0, a nominal model with a sample time."""

import copy
import dataclasses
import math

import numpy as np
from scipy import linalg

from .plants import Plant

OTHER_UNITS = {
    "rad": [("deg", 180 / math.pi)], "rad/s": [("deg/s", 180 / math.pi), ("rpm", 30 / math.pi)], "m": [("mm", 1e3)], "m/s": [("km/h", 3.6)],
    "m/s^2": [("g", 1 / 9.80665)], "A": [("mA", 1e3)],
}


def in_other_unit(rng, model: dict) -> None:
    """Writes one output in another unit, where it has one."""
    choices = [j for j, output in enumerate(model["outputs"]) if output["unit"] in OTHER_UNITS]
    if not choices:
        return
    j = int(rng.choice(choices))
    options = OTHER_UNITS[model["outputs"][j]["unit"]]
    unit, factor = options[rng.integers(len(options))]
    model["outputs"][j]["unit"] = unit
    if model["kind"] == "lti":
        for matrix in ("C", "D"):
            model[matrix][j] = [factor * v for v in model[matrix][j]]
        if "operating" in model["outputs"][j]:
            model["outputs"][j]["operating"] *= factor
    else:
        name = model["outputs"][j]["name"]
        model["output_equations"][name] = f"{factor!r}*({model['output_equations'][name]})"


def can_shift(plant: Plant) -> bool:
    """Whether the machine may run about any command: linear, in no loop of need, not yet about one."""
    return plant.model["kind"] == "lti" and not plant.closed and not plant.trim


def shifted(rng, plant: Plant, model: dict) -> Plant:
    """The plant about another working point: commands some levels off 0, outputs about values of their own."""
    static = -np.array(model["C"]) @ np.linalg.solve(np.array(model["A"]), np.array(model["B"])) + np.array(model["D"])
    trim = tuple(float(f"{level * rng.uniform(-3, 3):.3g}") for level in plant.levels)
    reach = np.abs(static) @ np.array(plant.levels)
    reach = np.maximum(reach, 0.3 * np.abs(np.array(model["D"])) @ np.array(plant.levels))
    for channel, value in zip(model["inputs"], trim):
        channel["operating"] = value
    for channel, size in zip(model["outputs"], reach):
        channel["operating"] = float(f"{size * rng.uniform(-3, 3):.3g}")
    return dataclasses.replace(plant, trim=trim)


def can_sample(plant: Plant) -> bool:
    """Linear, stable and without a direct path, whose edges between samples no sampled model knows."""
    model = plant.model
    return model["kind"] == "lti" and not np.any(model["D"]) and bool(np.all(np.linalg.eigvals(np.array(model["A"])).real < 0))


def sampled(model: dict, step: float) -> dict:
    """The model that gives the same samples every `step` s for commands that are held in between; delays must be whole samples."""
    a, b = np.array(model["A"]), np.array(model["B"])
    n, nu = b.shape
    held = linalg.expm(step * np.block([[a, b], [np.zeros((nu, n + nu))]]))
    result = copy.deepcopy(model)
    result |= {"sample_time_s": step, "A": held[:n, :n].tolist(), "B": held[:n, n:].tolist()}
    return result


def whole_delays(model: dict, step: float) -> None:
    if "input_delay_s" in model:
        model["input_delay_s"] = [round(round(d / step) * step, 9) for d in model["input_delay_s"]]
