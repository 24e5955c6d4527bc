"""Results side by side: diagnoses before and after a repair or of the machines of a fleet, studies of two versions."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import TypeAlias

from . import _native
from .diagnosis import Diagnosis
from .results import FileResult
from .studies import Study

#: A result, the folder that it was saved to, or its file.
ResultLike: TypeAlias = "Diagnosis | Study | str | os.PathLike[str]"

_FILES = {"diagnosis": "diagnosis.json", "study": "study.json"}


class Comparison(FileResult):
    """Results side by side: `deadtime/compare@1`. `str(comparison)` is all that the command line prints.

    `to_dict` has the tables: of diagnoses the errors, the shares of the causes, and their numbers with the test whether they agree.
    """

    def __init__(self, json_text: str, text: str, page: str) -> None:
        self._json, self._text, self._page = json_text, text, page

    def to_json(self) -> str:
        """The text as JSON."""
        return self._json

    def page(self) -> str:
        """The comparison as a page of HTML that needs no network."""
        return self._page

    def __str__(self) -> str:
        return self._text.rstrip()

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


def compare(results: Mapping[str, ResultLike]) -> Comparison:
    """Compares two or more results of one kind, as `deadtime compare` does.

    Parameters
    ----------
    results : dict of name to Diagnosis, Study, or path
        What `gap` or `study` returned; the folder that it was saved to; or its diagnosis.json or study.json.

    Raises
    ------
    ValueError
        Fewer than two results, results of two kinds, or a file that is neither.
    FileError
        A file cannot be read.

    Examples
    --------
    >>> import deadtime
    >>> found = deadtime.compare({"first": "examples/diagnosis.json", "again": "examples/diagnosis.json"})
    >>> found.to_dict()["names"]
    ['first', 'again']
    """
    read = {name: _text(result) for name, result in results.items()}
    if len(read) < 2:
        raise ValueError(f"{len(read)} results: give two or more to compare")
    kinds = {name: _kind(name, text) for name, text in read.items()}
    first = next(iter(kinds.values()))
    if other := next((name for name, kind in kinds.items() if kind != first), None):
        raise ValueError(f"{other}: a {kinds[other]} and a {first}: compare results of one kind")
    return Comparison(*_native._compare(first, list(read.items())))


def _text(result: ResultLike) -> str:
    if isinstance(result, Diagnosis | Study):
        return result.to_json()
    path = Path(result)
    if path.is_dir():
        held = [path / file for file in _FILES.values() if (path / file).is_file()]
        if len(held) != 1:
            raise ValueError(f"{path}: {'both' if held else 'neither'} diagnosis.json {'and' if held else 'nor'} study.json in this folder")
        path = held[0]
    return _native._read_text(path)


def _kind(name: str, text: str) -> str:
    try:
        format_line = str(json.loads(text).get("format"))
    except (ValueError, AttributeError):
        format_line = ""
    kind = next((kind for kind in _FILES if format_line.startswith(f"deadtime/{kind}@")), None)
    if kind is None:
        raise ValueError(f"{name}: neither a diagnosis nor a study of deadtime")
    return kind
