"""Diagnoses on their way out: ranges for domain randomisation, MuJoCo's fields, Isaac Lab's arguments, transfer functions with delay."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy

from . import _native
from .diagnosis import Diagnosis
from .logs import LogLike, as_logs
from .models import ModelLike, as_model
from .results import FileResult

#: What a diagnosis can be handed over to.
Target: TypeAlias = Literal["domain-randomisation", "mujoco", "isaaclab", "transfer-function"]


class Export(FileResult):
    """What was handed over; `to_dict` has it as dicts and lists."""

    def __init__(self, texts: tuple[str, str]) -> None:
        self._json, self._yaml = texts

    def to_json(self) -> str:
        """The text as JSON."""
        return self._json.rstrip("\n")

    def to_yaml(self) -> str:
        """The text as YAML."""
        return self._yaml

    def __repr__(self) -> str:
        return self._yaml.rstrip("\n")


def export(
    diagnosis: Diagnosis | str | os.PathLike[str],
    to: Target,
    *,
    model: ModelLike | None = None,
    log: LogLike | Iterable[LogLike] | None = None,
    widen: float = 1.0,
    **options: Any,
) -> Export:
    """Hands a diagnosis over to another program, as `deadtime export` does.

    Parameters
    ----------
    diagnosis : Diagnosis or path
        What `gap` returned, a diagnosis.json, or the folder that `save` wrote.
    to : str
        "domain-randomisation", "mujoco", "isaaclab" or "transfer-function".
    model : Model, path or dict, optional
        The model with its effects; default: that of the diagnosis.
    log : Log, path, frame, or several of them, optional
        The training logs, for noise in the outputs' units; a Diagnosis knows them.
    widen : float
        The width of every interval is multiplied by this: machines of one kind differ more than one machine is uncertain.
    **options
        Of the target: `timestep` and `names` of "mujoco", `physics_dt` and `inertia` of "isaaclab".

    Raises
    ------
    RegistryError
        An unknown target or option.
    DiagnosisError
        The file is no diagnosis, or the target needs what is not there.
    FileError, LogError, ModelError
        A file cannot be read.

    Examples
    --------
    >>> import deadtime
    >>> made = deadtime.export("examples/diagnosis.json", "isaaclab", physics_dt=0.005)
    >>> made.to_dict()["actuators"]
    {'delta_lat': {'class_type': 'DelayedPDActuatorCfg', 'min_delay': 5, 'max_delay': 7}}
    """
    source = "diagnosis"
    if isinstance(diagnosis, Diagnosis):
        text, deviations = diagnosis.to_json(), _deviations(diagnosis)
        known = diagnosis.model
    else:
        path = Path(diagnosis)
        path = path / "diagnosis.json" if path.is_dir() else path
        text, source, deviations = _native._read_text(path), str(path), []
        beside = path.with_name("model_with_effects.toml")
        known = as_model(beside) if model is None and beside.is_file() else None
    if log is not None:
        deviations = _of_logs(text, as_logs(log))
    given = known if model is None else as_model(model)
    return Export(_native._export(text, source, given, deviations, float(widen), to, json.dumps(options)))


def _deviations(diagnosis: Diagnosis) -> list[tuple[str, float]]:
    """Standard deviations of the outputs over the training logs."""
    values: dict[str, list[Any]] = {}
    for trace in diagnosis.traces:
        if trace["train"] is not None:
            values.setdefault(trace["output"], []).append(trace["measured"])
    return [(name, float(numpy.nanstd(numpy.concatenate(parts)))) for name, parts in values.items()]


def _of_logs(text: str, logs: list[_native.Log]) -> list[tuple[str, float]]:
    try:
        names = [output["name"] for output in json.loads(text)["gap"]["outputs"]]
    except (ValueError, KeyError, TypeError):
        return []  # What is wrong with it is said where it is read.
    return [(name, float(numpy.nanstd(numpy.concatenate([log[name] for log in logs])))) for name in names]
