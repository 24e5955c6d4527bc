"""Co-simulation units (FMI 2.0 and 3.0) as simulators for `deadtime.gap`.

Needs `pip install fmpy`; nothing of it is imported with `deadtime` itself. Channels and parameters have the names of the unit's modelDescription.xml.
"""

from __future__ import annotations

import os
import shutil
import weakref
from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

import numpy
from numpy.typing import NDArray

__all__ = ["simulator"]

_Array: TypeAlias = "NDArray[numpy.float64]"

#: Names of the list that an error shows.
_LISTED = 20


class _Unit:
    """f(u, time, x0, parameters) of a co-simulation unit."""

    def __init__(self, path: str, inputs: list[str], outputs: list[str], parameters: list[str], states: list[str], step: float | None) -> None:
        import fmpy

        if step is not None and not (numpy.isfinite(step) and step > 0):
            raise ValueError(f"step {step!r}: give seconds above 0")
        description = fmpy.read_model_description(path)
        if description.coSimulation is None:
            raise ValueError(f"{path} is no co-simulation unit: it would need an integrator of its own; export it for co-simulation")
        if description.fmiVersion.split(".")[0] not in ("2", "3"):
            raise ValueError(f"{path} is of FMI {description.fmiVersion}; co-simulation units of FMI 2.0 and 3.0 are run")
        self.path, self.step = path, step
        self.__name__ = str(description.modelName)
        self._three = description.fmiVersion.startswith("3")
        self._identifier, self._guid = str(description.coSimulation.modelIdentifier), str(description.guid)
        self._variables = {str(v.name): v for v in description.modelVariables if v.type in ("Real", "Float64") and not getattr(v, "dimensions", None)}
        self._inputs = [self._reference("input", name, ("input",)) for name in inputs]
        self._outputs = [self._reference("output", name, ()) for name in outputs]
        self._parameters = {name: self._reference("parameter", name, ("parameter",)) for name in parameters}
        self._states = [self._reference("state", name, ("local", "output", "parameter")) for name in states]
        self._folder = str(fmpy.extract(path))
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)

    def _reference(self, role: str, name: str, causalities: tuple[str, ...]) -> int:
        """The number of a variable; those that may stand here have one of these causalities, and any where there are none."""
        there = [n for n, v in self._variables.items() if not causalities or v.causality in causalities]
        if name not in there:
            more = f" and {len(there) - _LISTED} more" if len(there) > _LISTED else ""
            raise ValueError(f"{self.path} has no {role} {name!r} that is a real number; it has {', '.join(there[:_LISTED]) or 'none'}{more}")
        return int(self._variables[name].valueReference)

    def nominal(self) -> dict[str, float]:
        started = {name: self._variables[name].start for name in self._parameters}
        for name, start in started.items():
            if start is None:
                raise ValueError(f"{self.path}: parameter {name!r} has no start value, which would be its nominal one")
        return {name: float(start) for name, start in started.items()}

    def units(self, names: Iterable[str]) -> dict[str, str | None]:
        def unit(name: str) -> str | None:
            variable = self._variables[name]
            found = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
            return None if found is None else str(found)

        return {name: unit(name) for name in names}

    def _begin(self, x0: _Array, parameters: Mapping[str, float], u: _Array) -> tuple[Any, Any, Any]:
        """An instance behind its initialisation, and its functions that set and get."""
        import fmpy.fmi2
        import fmpy.fmi3

        common = {"guid": self._guid, "unzipDirectory": self._folder, "modelIdentifier": self._identifier, "instanceName": "deadtime"}
        unit = fmpy.fmi3.FMU3Slave(**common) if self._three else fmpy.fmi2.FMU2Slave(**common)
        unit.instantiate()
        put, get = (unit.setFloat64, unit.getFloat64) if self._three else (unit.setReal, unit.getReal)
        references = [*self._parameters.values(), *self._states]
        values = [parameters[name] for name in self._parameters] + [float(x) for x in x0]
        if references:
            put(references, values)
        if not self._three:
            unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        if self._inputs:
            put(self._inputs, [float(x) for x in u])
        unit.exitInitializationMode()
        return unit, put, get

    def __call__(self, u: _Array, time: _Array, x0: _Array, parameters: Mapping[str, float]) -> _Array:
        unit, put, get = self._begin(x0, parameters, u[0])
        y, now = numpy.empty((len(time), len(self._outputs))), 0.0
        try:
            for k, stamp in enumerate(time):
                # Up to this sample with the command of the one before.
                if k > 0:
                    whole = float(stamp - time[0])
                    parts = 1 if self.step is None else max(1, int(numpy.ceil((whole - now) / self.step - 1e-9)))
                    for part in range(1, parts + 1):
                        until = now + (whole - now) / (parts - part + 1)
                        unit.doStep(currentCommunicationPoint=now, communicationStepSize=until - now)
                        now = until
                if self._inputs:
                    put(self._inputs, [float(x) for x in u[k]])
                y[k] = get(self._outputs)
            unit.terminate()
        finally:
            unit.freeInstance()
        return y


def simulator(
    fmu: str | os.PathLike[str],
    inputs: Mapping[str, str | None] | Iterable[str],
    outputs: Mapping[str, str | None] | Iterable[str],
    parameters: Mapping[str, str | None] | Iterable[str] = (),
    states: Mapping[str, tuple[float, float | None]] | None = None,
    *,
    step: float | None = None,
) -> dict[str, Any]:
    """A co-simulation unit (FMI 2.0 or 3.0) as the arguments of `gap`, `check` and `isolability`: `deadtime.gap(log=..., **deadtime.fmi.simulator(...))`.

    Commands are held from one sample to the next; each run is one of a fresh instance. FMI 2.0 lets a unit answer at once to a command only where it calculates outputs anew
    when they are asked for.

    Parameters
    ----------
    fmu : path
        The unit, a file `.fmu`. It is unpacked into a temporary folder. It is a program: run only what you trust.
    inputs : names, or name to unit
        Inputs, real numbers. Units are those of the description where names alone are given.
    outputs : names, or name to unit
        Outputs and any other real variables.
    parameters : names, or name to unit
        Parameters that may be wrong. Their nominal values are the unit's start values.
    states : dict of name to initial value and standard deviation, optional
        Variables whose start may be set, where logs start.
    step : float, optional
        Longest communication step, s; default: a log's sample time.

    Returns
    -------
    dict
        `simulate`, `inputs`, `outputs`, `states`, `parameters`, `name`.

    Raises
    ------
    ValueError
        A name that the unit does not have, and those that it has; a unit that is no co-simulation unit.
    """

    def names(given: Mapping[str, str | None] | Iterable[str]) -> list[str]:
        return [given] if isinstance(given, str) else list(given)

    unit = _Unit(os.fspath(fmu), names(inputs), names(outputs), names(parameters), list(states or {}), step)
    units = {**unit.units([*names(inputs), *names(outputs), *names(parameters)])}
    for given in (inputs, outputs, parameters):
        if isinstance(given, Mapping):
            units.update(given)
    nominal = unit.nominal()
    return {
        "simulate": unit,
        "inputs": {name: units[name] for name in names(inputs)},
        "outputs": {name: units[name] for name in names(outputs)},
        "states": dict(states) if states else None,
        "parameters": {name: (nominal[name], units[name]) for name in nominal} or None,
        "name": unit.__name__,
    }
