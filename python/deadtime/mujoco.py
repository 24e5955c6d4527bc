"""MuJoCo models as simulators for `deadtime.gap`, and what was found put back into them.

Needs `pip install mujoco`; nothing of it is imported with `deadtime` itself. Channels and parameters have the names of the MJCF or URDF file.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy
from numpy.typing import NDArray

if TYPE_CHECKING:
    import mujoco

__all__ = ["randomise", "simulator"]

_Array: TypeAlias = "NDArray[numpy.float64]"

#: Attribute of an element of the file to the field of MjModel, and its column. Joints' are those of their first degree of freedom.
_FIELDS: dict[str, dict[str, tuple[str, int | None]]] = {
    "joint": {
        "damping": ("dof_damping", None),
        "armature": ("dof_armature", None),
        "frictionloss": ("dof_frictionloss", None),
        "stiffness": ("jnt_stiffness", None),
    },
    "actuator": {
        "gain": ("actuator_gainprm", 0),
        "time_constant": ("actuator_dynprm", 0),
        "gear": ("actuator_gear", 0),
        "delay": ("actuator_delay", None),
    },
    "body": {"mass": ("body_mass", None)},
    "geom": {"friction": ("geom_friction", 0)},
}


def _load(model: mujoco.MjModel | str | os.PathLike[str]) -> mujoco.MjModel:
    """A model of its own: whatever is changed in it, the caller's stays as it is."""
    import mujoco

    if isinstance(model, mujoco.MjModel):
        return copy.copy(model)
    return mujoco.MjModel.from_xml_path(os.fspath(model))


def _row(model: mujoco.MjModel, kind: str, name: str, field: str) -> int:
    """The row of a field that belongs to an element."""
    try:
        element = getattr(model, kind)(name)
    except KeyError as missing:
        raise ValueError(f"{kind} {name!r}: {missing.args[0]}") from None
    return int(element.dofadr[0]) if field.startswith("dof_") else int(element.id)


class _Parameter:
    """A number of the model that is called by its path, `joint/elbow/damping`."""

    def __init__(self, model: mujoco.MjModel, path: str) -> None:
        parts = path.split("/")
        known = _FIELDS.get(parts[0], {})
        if len(parts) != 3 or parts[2] not in known:
            paths = [f"{kind}/NAME/{attribute}" for kind, attributes in _FIELDS.items() for attribute in attributes]
            raise ValueError(f"there is no parameter {path!r}; there are {', '.join(paths)}")
        self.field, self.column = known[parts[2]]
        self.row = _row(model, parts[0], parts[1], self.field)

    def _place(self) -> Any:
        return self.row if self.column is None else (self.row, self.column)

    def get(self, model: mujoco.MjModel) -> float:
        return float(getattr(model, self.field)[self._place()])

    def set(self, model: mujoco.MjModel, value: float) -> None:
        getattr(model, self.field)[self._place()] = value


def _output(model: mujoco.MjModel, name: str) -> tuple[str, int]:
    """Where an output stands: the array of MjData and the place in it."""
    element, _, rest = name.rpartition(".")
    if element and rest in ("qpos", "qvel"):
        try:
            joint = model.joint(element)
        except KeyError as missing:
            raise ValueError(f"output {name!r}: {missing.args[0]}") from None
        return rest, int((joint.qposadr if rest == "qpos" else joint.dofadr)[0])
    base, _, index = name.partition("[")
    try:
        sensor = model.sensor(base)
    except KeyError as missing:
        raise ValueError(f"output {name!r} is no sensor, and no joint's JOINT.qpos or JOINT.qvel: {missing.args[0]}") from None
    at, size = int(index.rstrip("]") or 0) if index else 0, int(sensor.dim[0])
    if at >= size or (not index and size > 1):
        raise ValueError(f"output {name!r}: the sensor has {size} values, {base}[0] to {base}[{size - 1}]")
    return "sensordata", int(sensor.adr[0]) + at


def _input(model: mujoco.MjModel, name: str) -> tuple[str, int]:
    """Where an input stands: an actuator's control, or the force on a joint that has none."""
    joint, _, rest = name.rpartition(".")
    if joint and rest == "qfrc":
        try:
            return "qfrc_applied", int(model.joint(joint).dofadr[0])
        except KeyError as missing:
            raise ValueError(f"input {name!r}: {missing.args[0]}") from None
    try:
        actuator = _row(model, "actuator", name, "ctrl")
    except ValueError as missing:
        raise ValueError(f"{missing}; the force or torque on a joint is JOINT.qfrc, as in a URDF file, which has no actuators") from None
    # From MuJoCo 4 on an actuator may have several controls; the first one is meant.
    return "ctrl", int(model.actuator_ctrladr[actuator]) if hasattr(model, "actuator_ctrladr") else actuator


class _Simulator:
    """f(u, time, x0, parameters) of a MuJoCo model."""

    def __init__(self, model: mujoco.MjModel, inputs: list[str], outputs: list[str], states: list[str], parameters: list[str]) -> None:
        self.model = model
        self.__name__ = "MuJoCo"
        self._inputs = [_input(model, name) for name in inputs]
        self._outputs = [_output(model, name) for name in outputs]
        self._states = [_output(model, name) for name in states]
        for name, (array, _) in zip(states, self._states, strict=True):
            if array == "sensordata":
                raise ValueError(f"state {name!r}: a start is a joint's JOINT.qpos or JOINT.qvel")
        self._parameters = {path: _Parameter(model, path) for path in parameters}

    def nominal(self) -> dict[str, float]:
        return {path: parameter.get(self.model) for path, parameter in self._parameters.items()}

    def __call__(self, u: _Array, time: _Array, x0: _Array, parameters: Mapping[str, float]) -> _Array:
        import mujoco

        model, data = self.model, mujoco.MjData(self.model)
        for path, value in parameters.items():
            self._parameters[path].set(model, value)
        mujoco.mj_setConst(model, data)
        mujoco.mj_resetData(model, data)
        for (array, at), start in zip(self._states, x0, strict=True):
            getattr(data, array)[at] = start
        # Stamps in steps of the simulator; whatever is left of a step goes on to the next sample.
        steps = numpy.diff(numpy.rint(time / model.opt.timestep).astype(int), append=0)
        sensors = any(array == "sensordata" for array, _ in self._outputs)
        y = numpy.empty((len(time), len(self._outputs)))
        commands = [(getattr(data, array), at) for array, at in self._inputs]
        places = [(getattr(data, array), at) for array, at in self._outputs]
        for k in range(len(time)):
            for (array, at), value in zip(commands, u[k], strict=True):
                array[at] = value
            if sensors:
                mujoco.mj_forward(model, data)
            y[k] = [array[at] for array, at in places]
            if k + 1 < len(time):
                mujoco.mj_step(model, data, steps[k])
        return y


def simulator(
    model: mujoco.MjModel | str | os.PathLike[str],
    inputs: Mapping[str, str | None] | Iterable[str],
    outputs: Mapping[str, str | None] | Iterable[str],
    parameters: Mapping[str, str | None] | Iterable[str] = (),
    states: Mapping[str, tuple[float, float | None]] | None = None,
) -> dict[str, Any]:
    """A MuJoCo model as the arguments of `gap`, `check` and `isolability`: `deadtime.gap(log=..., **deadtime.mujoco.simulator(...))`.

    Parameters
    ----------
    model : MjModel or path
        The model, or its MJCF or URDF file. It is copied.
    inputs : names, or name to unit
        Actuators; and the force or torque on a joint as `elbow.qfrc`, for models without actuators, as those of URDF files.
    outputs : names, or name to unit
        Sensors (`gyro[0]` where one has several values), and joints as `elbow.qpos`, `elbow.qvel`. Where a log calls them otherwise, `log.rename`.
    parameters : paths, or path to unit
        What may be wrong: `joint/NAME/damping`, `armature`, `frictionloss`, `stiffness`; `actuator/NAME/gain`, `time_constant`, `gear`, `delay`; `body/NAME/mass`;
        `geom/NAME/friction`. Their nominal values are the model's.
    states : dict of name to initial value and standard deviation, optional
        Where logs start, as `elbow.qpos` and `elbow.qvel`.

    Returns
    -------
    dict
        `simulate`, `inputs`, `outputs`, `states`, `parameters`, `name`.

    Raises
    ------
    ValueError
        A name that the model does not have, and those that it has.
    """

    def units(given: Mapping[str, str | None] | Iterable[str]) -> dict[str, str | None]:
        return dict(given) if isinstance(given, Mapping) else dict.fromkeys([given] if isinstance(given, str) else given)

    i, o, p = units(inputs), units(outputs), units(parameters)
    simulate = _Simulator(_load(model), list(i), list(o), list(states or {}), list(p))
    nominal = simulate.nominal()
    return {
        "simulate": simulate,
        "inputs": i,
        "outputs": o,
        "states": dict(states) if states else None,
        "parameters": {path: (nominal[path], unit) for path, unit in p.items()} or None,
        "name": "MuJoCo",
    }


def randomise(
    model: mujoco.MjModel | str | os.PathLike[str],
    ranges: Mapping[str, Any],
    rng: numpy.random.Generator,
) -> tuple[mujoco.MjModel, dict[str, float]]:
    """A model with every field drawn evenly from its range, and what was drawn.

    Parameters
    ----------
    model : MjModel or path
        The nominal model; it is copied.
    ranges : dict
        `deadtime.export(diagnosis, "mujoco").to_dict()`, or the file of `deadtime export --to mujoco`.
    rng : numpy.random.Generator
        Where the draws come from.

    Raises
    ------
    ValueError
        A name that the model does not have; a delay longer than the model's history buffer, with the `nsample` that it needs.
    """
    drawn_model, drawn = _load(model), {}
    for field in ranges["fields"]:
        value = float(rng.uniform(field["low"], field["high"]))
        if "path" in field:
            _Parameter(drawn_model, field["path"]).set(drawn_model, value)
            drawn[field["path"]] = value
            continue
        name, array = field["field"], getattr(drawn_model, field["field"])
        row = _row(drawn_model, field["element"], field["name"], name)
        place: Any = row if field["index"] is None else (row, field["index"])
        if name in ("actuator_delay", "sensor_delay"):
            _has_history(drawn_model, name, row, value, field)
        if field["times"] is not None:
            value *= float(getattr(drawn_model, field["times"])[row])
        array[place] = array[place] * value if field["operation"] == "scale" else value
        column = "" if field["index"] is None else f"[{field['index']}]"
        drawn[f"{field['element']}/{field['name']}/{name}{column}"] = float(array[place])
    return drawn_model, drawn


def _has_history(model: mujoco.MjModel, name: str, row: int, delay: float, field: Mapping[str, Any]) -> None:
    """A delay is silently cut where the history buffer is too short."""
    samples = int(getattr(model, name.replace("delay", "history"))[row][0])
    needed = int(numpy.ceil(delay / model.opt.timestep - 1e-9))
    if samples < needed:
        raise ValueError(f"{field['element']} {field['name']!r} keeps {samples} samples, and a delay of {delay:.4g} s needs {needed}: {field['needs']}")
