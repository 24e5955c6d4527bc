"""What the results have in common: each is a file of the program's formats, and says itself in words."""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

from . import _native


class Result(ABC):
    """A result that is a file of one of the program's formats."""

    @abstractmethod
    def to_json(self) -> str:
        """The file's text."""

    def to_dict(self) -> dict[str, Any]:
        """The file's content as dicts and lists, a copy."""
        data: dict[str, Any] = json.loads(self.to_json())
        return data

    @cached_property
    def _data(self) -> dict[str, Any]:
        return self.to_dict()


class FileResult(Result):
    """One that is written as one file."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file, under a temporary name until it is whole.

        Parameters
        ----------
        path : path
            The file.

        Raises
        ------
        FileError
            The operating system refused it.
        """
        _native._write_whole(path, (self.to_json() + "\n").encode())


class PrintedResult(FileResult):
    """One that prints as on the command line; two are equal where their files are."""

    _file: str
    _text: str

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and isinstance(other, PrintedResult) and self._file == other._file

    def __hash__(self) -> int:
        return hash(self._file)

    def to_json(self) -> str:
        """The text of the file."""
        return self._file

    def to_text(self) -> str:
        """What the command line prints."""
        return self._text

    def __repr__(self) -> str:
        return self._text
