"""The check on withheld effects.

Cases whose cause is known to somebody else are diagnosed, then scored against labels that were committed to beforehand.

docs/blind.md defines the protocol, the files and every score.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from . import _native
from .arguments import perhaps, whole
from .results import FileResult

PathLike: TypeAlias = "str | os.PathLike[str]"

__all__ = ["BlindRun", "BlindScore", "CaseOutcome", "run", "score"]


@dataclass(frozen=True)
class CaseOutcome:
    """How one case went."""

    id: str
    """The case."""
    outcome: str
    """`done`: diagnosed now; `kept`: diagnosed before; `failed`."""
    time_s: float | None
    """Wall-clock time of the diagnosis, s, where it was made now."""
    error: str | None
    """Why it failed."""


@dataclass(frozen=True)
class BlindRun:
    """How all cases went, in order of their names."""

    verdicts: str
    """The folder that the verdicts were written to."""
    cases: tuple[CaseOutcome, ...]
    """Every case."""

    @property
    def failed(self) -> dict[str, str]:
        """The cases that were not diagnosed, and why."""
        return {case.id: case.error or "" for case in self.cases if case.outcome == "failed"}

    @property
    def passed(self) -> bool:
        """Every case has a verdict."""
        return not self.failed

    def __iter__(self) -> Iterator[CaseOutcome]:
        return iter(self.cases)

    def __len__(self) -> int:
        return len(self.cases)

    def to_dict(self) -> dict[str, Any]:
        """As `deadtime blind run --json` writes it: cases, done, failed."""
        failed = [f"{name}: {error}" for name, error in self.failed.items()]
        return {"cases": len(self.cases), "done": len(self.cases) - len(failed), "failed": failed}

    def __repr__(self) -> str:
        done = len(self.cases) - len(self.failed)
        if self.passed:
            return f"{done} cases diagnosed; verdicts in {self.verdicts}"
        lines = [f"{name}: {error}" for name, error in self.failed.items()]
        return "\n".join([f"{done} of {len(self.cases)} cases were diagnosed; these were not:", *lines])


def run(
    cases: PathLike,
    verdicts: PathLike,
    *,
    jobs: int = 1,
    fresh: bool = False,
    seed: int = 1,
    threads: int | None = None,
    progress: Callable[[CaseOutcome], object] | None = None,
) -> BlindRun:
    """Diagnoses every case of a folder; only the case folders are read. `deadtime blind run`.

    Parameters
    ----------
    cases : path
        Folder of cases: ID/model.toml, ID/train_*.csv, ID/holdout_*.csv, ID/commitment.txt.
    verdicts : path
        Folder to write ID/diagnosis.json, ID/run.json and ID/commitment.txt to; cases that stand there are not done again.
    jobs : int
        Cases at a time; a diagnosis uses all threads itself.
    fresh : bool
        Diagnose all cases again.
    seed : int
        Seed of the bootstrap.
    threads : int, optional
        Default: all cores.
    progress : function of a `CaseOutcome`, optional
        Called for every case as it is done.

    Returns
    -------
    BlindRun
        How each case went. A case that fails stops no other: look at `failed`.

    Raises
    ------
    BlindError, FileError
        There are no cases to begin with.
    KeyboardInterrupt
        Within 0.2 s; the verdicts that are done stay, and are kept by the next run.

    Examples
    --------
    `cases` is a folder of two cases: one whose command arrives late, one that its simulator describes.

    >>> from deadtime import blind
    >>> done = blind.run(cases, verdicts)
    >>> done.passed, len(done.cases)
    (True, 2)
    """
    if jobs < 1:
        raise ValueError(f"jobs is {jobs}: give at least 1")
    tell = None if progress is None else lambda *one: progress(CaseOutcome(*one))
    told = _native._blind_run(cases, verdicts, whole("jobs", jobs, 1), fresh, whole("seed", seed, 0), perhaps("threads", threads, 1), tell)
    return BlindRun(os.fspath(verdicts), tuple(CaseOutcome(*one) for one in told))


def score(verdicts: PathLike, labels: PathLike, cases: PathLike | None = None, *, require: Sequence[str] = ()) -> BlindScore:
    """Checks every label against the commitment that came with its case, then scores the verdicts. `deadtime blind score`.

    Parameters
    ----------
    verdicts : path
        Folder of ID/diagnosis.json, ID/run.json and ID/commitment.txt.
    labels : path
        Folder of ID.json, `deadtime/blind@1`.
    cases : path, optional
        Folder of cases; needed only where a verdict has no commitment.
    require : list of str
        Limits `NAME>=VALUE` or `NAME<=VALUE`, missed when a score's 95 % interval lies beyond one as a whole: see `passed` and `unmet`.

    Raises
    ------
    BlindError
        Labels that do not match their commitment, verdicts without label and labels without verdict, a limit on a score that there is not;
        nothing is scored then.

    Examples
    --------
    >>> from deadtime import blind
    >>> done = blind.run(cases, verdicts)
    >>> score = blind.score(verdicts, labels)
    >>> score.cases, score["false_alarm"]
    (2, 0.0)
    """
    limits = list(require)
    _native.BlindScore.check(limits)
    return BlindScore(_native.BlindScore.of(verdicts, labels, cases), limits)


class BlindScore(FileResult):
    """How a diagnoser did on withheld effects. `score` returns one.

    Parameters
    ----------
    native : BlindScore
        The scores, as the native module holds them.
    require : list of str
        Limits to be kept.
    """

    def __init__(self, native: _native.BlindScore, require: list[str]) -> None:
        self._native = native
        self._require = require

    @property
    def cases(self) -> int:
        """How many cases."""
        return int(self._data["cases"])

    @property
    def groups(self) -> dict[str, int]:
        """Cases of each kind: `single`, `none`, `unknown`, `pair`."""
        return dict(self._data["groups"])

    @property
    def scores(self) -> dict[str, dict[str, Any]]:
        """Every score by its name: `value`, `ci95`, `count`."""
        return {one["name"]: one for one in self._data["scores"]}

    def __getitem__(self, name: str) -> float | None:
        """The value of the score `name`; None where no case has one."""
        value: float | None = self.scores[name]["value"]
        return value

    @property
    def by(self) -> list[dict[str, Any]]:
        """The same scores by true effect, plant, strength and loop: `key`, `value`, `cases`, `scores`."""
        return list(self._data["by"])

    @property
    def confusion(self) -> list[dict[str, Any]]:
        """Truth and verdict: `truth`, `verdict`, `cases`."""
        return list(self._data["confusion"])

    @property
    def answers(self) -> list[dict[str, Any]]:
        """Every case with what was judged of it."""
        return list(self._data["answers"])

    @property
    def unmet(self) -> list[str]:
        """The required limits that are not kept, in a sentence each."""
        return self._native.unmet(self._require)

    @property
    def passed(self) -> bool:
        """Every required limit is kept."""
        return not self.unmet

    def to_json(self) -> str:
        """`deadtime/blind-score@1`."""
        return self._native.json()

    def markdown(self) -> str:
        """The report as Markdown."""
        return self._native.markdown()

    def __repr__(self) -> str:
        return self._native.text().rstrip()
