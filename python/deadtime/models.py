"""Models: linear systems, simulators with named channels, and what is computed from them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy

from ._native import Model

#: What passes for a model: a `Model`, the path of a model file, or a dict with its keys.
ModelLike: TypeAlias = "Model | str | os.PathLike[str] | Mapping[str, Any]"


def as_model(model: ModelLike) -> Model:
    """A model from whatever passes for one."""
    if isinstance(model, Model):
        return model
    if isinstance(model, str | os.PathLike):
        return Model.read(model)
    if isinstance(model, Mapping):
        return Model.from_dict(model)
    raise TypeError(f"a model is a deadtime.Model, the path of a model file, or a dict with its keys, not {type(model).__name__}")


def _plain(value: object) -> object:
    """What JSON takes in place of NumPy's arrays and numbers, and of mappings."""
    if isinstance(value, numpy.ndarray | numpy.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"a model file holds numbers, strings, lists and tables, not {type(value).__name__}")
