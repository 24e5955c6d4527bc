"""Accuracy on delays that were injected and so are known: plans, studies, and the gate that compares two of them."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, overload

import numpy as np

from . import _native, plotting
from ._native import Plan
from .arguments import perhaps
from .results import FileResult

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas
    import polars
    import pyarrow

PathLike: TypeAlias = "str | os.PathLike[str]"
#: What passes for a plan: a `Plan`, the name of a shipped one, the path or the text of a plan file, its keys as a dict.
PlanLike: TypeAlias = "Plan | str | os.PathLike[str] | Mapping[str, Any]"

__all__ = ["GateResult", "Plan", "Study", "as_plan", "gate", "plans", "plants", "read_study", "study"]


def plans() -> dict[str, str]:
    """The plans that ship with the program: name and what each is for.

    Examples
    --------
    >>> import deadtime
    >>> "bjorklund" in deadtime.plans()
    True
    """
    return _native._plans()


def plants() -> dict[str, str]:
    """The plants that plans can name: name and what each is.

    Examples
    --------
    >>> import deadtime
    >>> plan = {"plants": sorted(deadtime.plants())[:2]}
    >>> len(plan["plants"])
    2
    """
    return _native._plants()


def as_plan(plan: PlanLike, *, trials: int | None = None, seed: int | None = None) -> Plan:
    """A plan from whatever passes for one, with other `trials` or another `seed` where these are given."""
    made = plan if isinstance(plan, Plan) else Plan(_plain(dict(plan)) if isinstance(plan, Mapping) else plan)
    return made.replace(trials=perhaps("trials", trials, 0), seed=perhaps("seed", seed, 0))


def _plain(value: Any) -> Any:
    """Keys of a plan as JSON can hold them: arrays as lists, paths as text, an infinite ratio as a plan file writes it."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items() if one is not None}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple | range):
        return [_plain(one) for one in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and value == float("inf"):
        return "inf"
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def study(
    plan: PlanLike = "thesis",
    out: PathLike | None = None,
    *,
    trials: int | None = None,
    seed: int | None = None,
    resume: bool = False,
    threads: int | None = None,
    progress: Callable[[int, int], object] | None = None,
    max_memory_gb: float | None = None,
    max_disk_gb: float | None = None,
) -> Study:
    """Runs a study on this machine: `deadtime study`.

    The numbers are the same to the bit for any number of threads, run times apart.

    Parameters
    ----------
    plan : str, path, dict or Plan
        A shipped plan by name (`plans()`), a plan file, its text, or its keys.
    out : path, optional
        Folder for study.json, estimates.csv, estimates.parquet, tables.md and report.html. Without it everything is kept in memory.
    trials : int, optional
        Records of each setting; default: as the plan says.
    seed : int, optional
        Default: as the plan says.
    resume : bool
        Go on where an earlier run of this plan in `out` was stopped: blocks of 25 records are kept as they are done. A block that
        is damaged is made again, with a warning.
    threads : int, optional
        Default: all cores.
    progress : function of (done, all), optional
        Called with the number of estimates made, and of all, every now and then.
    max_memory_gb, max_disk_gb : float, optional
        What the study may need, 10^9 bytes of memory and on the disk, estimated before anything is made; default: 4 and 50.

    Raises
    ------
    StudyError
        A plan that cannot be run or needs more than it may, a folder that holds another study, a record that cannot be made.
    FileError
        Another run writes to `out`.
    RegistryError
        A method, excitation or conversion that no list knows.
    KeyboardInterrupt
        Within 0.2 s; finished blocks stay in `out`.

    Examples
    --------
    Three methods on four settings:

    >>> import deadtime
    >>> study = deadtime.study("examples/gate_plan.toml", trials=20)
    >>> len(study.cells), sorted({cell["method"] for cell in study.cells})
    (12, ['arxstruc', 'oestruc', 'threshold'])
    """
    chosen = as_plan(plan, trials=trials, seed=seed)
    limits = (max_memory_gb, max_disk_gb)
    if out is not None:
        folder = Path(out)
        return Study(_native._study(chosen, folder, resume, perhaps("threads", threads, 1), progress, limits), chosen, folder)
    if resume:
        raise ValueError("resume=True goes on in the folder of an earlier run: give it as `out`")
    with tempfile.TemporaryDirectory(prefix="deadtime-", ignore_cleanup_errors=True) as name:
        result = Study(_native._study(chosen, Path(name), False, perhaps("threads", threads, 1), progress, limits), chosen, Path(name))
        result._load()
        result._folder = None
    return result


def read_study(path: PathLike, plan: PlanLike | None = None) -> Study:
    """A study that was written.

    Parameters
    ----------
    path : path
        `study.json`, or the folder that holds it.
    plan : str, path, dict or Plan, optional
        Its plan; with it, published numbers and aims stand with the results.

    Raises
    ------
    StudyError, FileError
        The file is none of a study's; it cannot be read.

    Examples
    --------
    >>> import deadtime, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = deadtime.study("examples/gate_plan.toml", folder, trials=20)
    ...     deadtime.read_study(folder).cells == made.cells
    True
    """
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    return Study(_native.StudyResult.read(path), None if plan is None else as_plan(plan), folder)


class Study(FileResult):
    """What a study found: every cell, the scores of the methods, and every single estimate.

    Errors are in samples, positive where an answer is too late. `str(study)` is all that the command line prints. `deadtime.study` and
    `deadtime.read_study` return one.

    Parameters
    ----------
    native : StudyResult
        The results, as the native module holds them.
    plan : Plan, optional
        What was run.
    folder : path, optional
        Where the estimates are.
    """

    def __init__(self, native: _native.StudyResult, plan: Plan | None, folder: Path | None) -> None:
        self._native = native
        self._plan = plan
        self._folder = folder
        self._columns: dict[str, Any] | None = None

    def to_json(self) -> str:
        """`deadtime/study@1`, as `study.json` holds it."""
        return self._native.json()

    def write_baseline(self, path: PathLike) -> None:
        """Writes what `gate` compares later runs with to the file or folder `path`: without run times, nine digits, one line per cell."""
        self._native.write_baseline(path)

    @property
    def name(self) -> str:
        """The plan's name."""
        return str(self._data["plan"])

    @property
    def about(self) -> str:
        """What the plan is for."""
        return str(self._data["about"])

    @property
    def plan(self) -> Plan | None:
        """The plan; None where only its results were read."""
        return self._plan

    @property
    def folder(self) -> Path | None:
        """Where it is kept; None: in memory only."""
        return self._folder

    @property
    def seed(self) -> int:
        """The seed that it was run with."""
        return int(self._data["seed"])

    @property
    def program(self) -> str:
        """The program that ran it."""
        return str(self._data["program"])

    @property
    def cells(self) -> list[dict[str, Any]]:
        """Every cell, one method on one setting: keys (`plant`, `snr`, `delay_s`, …) and results (`rms_samples`, `coverage95`, …)."""
        return list(self._data["cells"])

    @property
    def scores(self) -> list[dict[str, Any]]:
        """Means over the cells of a grid, by method and by the share of answers that is kept: `mean_rms_samples`, `ci95_samples`."""
        return list(self._data["scores"])

    @property
    def published(self) -> list[dict[str, Any]]:
        """Every published number of the plan and ours.

        `source`, `cells`, `statistic`, `published`, `ours`, `standing` (matching, differing, not_reproducible).
        """
        return [] if self._plan is None else json.loads(self._native.published(self._plan))

    @property
    def aims(self) -> list[dict[str, Any]]:
        """Every aim of the plan and what was reached: `aim`, `method`, `measure`, `at_least`, `at_most`, `reached`, `met`."""
        return [] if self._plan is None else json.loads(self._native.aims(self._plan))

    @overload
    def estimates(self, kind: Literal["numpy"] = ...) -> dict[str, np.ndarray]: ...
    @overload
    def estimates(self, kind: Literal["pandas"]) -> pandas.DataFrame: ...
    @overload
    def estimates(self, kind: Literal["polars"]) -> polars.DataFrame: ...
    @overload
    def estimates(self, kind: Literal["pyarrow"]) -> pyarrow.Table: ...

    def estimates(self, kind: str = "numpy") -> Any:
        """Every single estimate as columns.

        Parameters
        ----------
        kind : {"numpy", "pandas", "polars", "pyarrow"}
            A dict of arrays of shape (estimates,), a frame, or a table. Words are arrays of objects, categories, strings, or a dictionary
            type.

        Returns
        -------
        columns
            `cell` (its place in `cells`), the cell's keys, then `trial`, `seed`, `true_delay_s`, `outcome`, `raw_s`, `delay_s`, `std_s`,
            `lo_s`, `hi_s`,
            `error_samples`, `bound_samples`, `predicted_samples`, `time_s`. What is missing is NaN (null in polars and pyarrow).
        """
        columns = self._load()
        if kind == "numpy":
            return {name: _words(*c) if isinstance(c, tuple) else c for name, c in columns.items()}
        if kind == "pandas":
            import pandas

            frame = {n: pandas.Categorical.from_codes(c[1], c[0]) if isinstance(c, tuple) else c for n, c in columns.items()}
            return pandas.DataFrame(frame)
        if kind == "polars":
            import polars


            def one(name: str, values: Any) -> Any:
                words = isinstance(values, tuple)
                return polars.Series(name, _words(*values).tolist(), polars.String) if words else polars.Series(name, values)

            series = [one(name, values) for name, values in columns.items()]
            return polars.DataFrame([s.fill_nan(None) if s.dtype == polars.Float64 else s for s in series])
        if kind == "pyarrow":
            import pyarrow

            def column(values: Any) -> Any:
                if isinstance(values, tuple):
                    return pyarrow.DictionaryArray.from_arrays(values[1], pyarrow.array(values[0], pyarrow.string()))
                return pyarrow.array(values, mask=np.isnan(values) if values.dtype.kind == "f" else None)

            return pyarrow.table({n: column(c) for n, c in columns.items()})
        raise ValueError(f"estimates as {kind!r}: there are numpy, pandas, polars, pyarrow")

    def _load(self) -> dict[str, Any]:
        if self._columns is None:
            self._columns = _native._estimates(self.parts())
        return self._columns

    def parts(self) -> list[Path]:
        """The Parquet files that hold the estimates, in order: one data set to DuckDB, Polars and pandas.

        Raises
        ------
        FileNotFoundError
            There are none: the study is in memory only, or another program wrote it without them.
        """
        if self._folder is None:
            raise FileNotFoundError("this study is kept in memory: run it with `out` to have its estimates as files")
        whole = self._folder / "estimates.parquet"
        found = [whole] if whole.exists() else sorted((self._folder / "estimates").glob("part-*.parquet"))
        if not found:
            raise FileNotFoundError(f"{self._folder}: there is neither estimates.parquet nor a folder `estimates` with parts")
        return found

    def plot(self) -> matplotlib.figure.Figure:
        """RMS error by method and the Cramér-Rao bound, and how often the 95 % intervals hold the truth.

        Raises
        ------
        ImportError
            matplotlib is not installed: `pip install deadtime[plot]`.
        """
        return plotting.study(self.name, self.seed, self.cells)

    def __str__(self) -> str:
        return self._native.text(self._plan).rstrip()

    def __repr__(self) -> str:
        return self._native.headline().rstrip()

    def _repr_html_(self) -> str:
        picture = plotting.image(self.plot, f"RMS error by method and coverage of the intervals in {self.name}")
        return f"<p>{_escaped(self.name)}: {_escaped(self.about)}</p>{plotting.folded(picture, self._native.html())}"

    def __reduce__(self) -> tuple[Any, ...]:
        return (_revived, (self.to_json(), self._plan, self._folder, self._columns))


def _revived(text: str, plan: Plan | None, folder: Path | None, columns: dict[str, Any] | None) -> Study:
    study = Study(_native.StudyResult(text), plan, folder)
    study._columns = columns
    return study


def _words(words: Sequence[str], codes: np.ndarray) -> np.ndarray:
    taken: np.ndarray = np.array(words, dtype=object)[codes]
    return taken


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")


def gate(
    results: Study | PathLike,
    baseline: Study | PathLike,
    *,
    alpha: float | None = None,
    margin: float | None = None,
    margin_samples: float | None = None,
    margin_share: float | None = None,
) -> GateResult:
    """Compares a study with an earlier run of its plan: correctness exactly, accuracy by tests. `deadtime gate`.

    Parameters
    ----------
    results, baseline : Study or path
        Two runs of one plan; a path is `study.json` or its folder.
    alpha : float, optional
        Chance that equally accurate programs fail, all comparisons together; default 0.01.
    margin : float, optional
        Share of itself by which an RMS error may grow; default 0.1.
    margin_samples : float, optional
        Samples by which it may grow; default 0.01.
    margin_share : float, optional
        By how much a share of records, answers or intervals may get worse; default 0.02.

    Raises
    ------
    StudyError
        The two are no runs of one plan.

    Examples
    --------
    A study is no worse than itself:

    >>> import deadtime
    >>> study = deadtime.study("examples/gate_plan.toml", trials=20)
    >>> deadtime.gate(study, study).passed
    True
    """
    both = [one if isinstance(one, Study) else read_study(one) for one in (results, baseline)]
    return GateResult(_native.GateReport.of(both[0]._native, both[1]._native, alpha, margin, margin_samples, margin_share))


class GateResult(FileResult):
    """What a gate found; true where nothing is worse. `deadtime.gate` returns one.

    Parameters
    ----------
    native : GateReport
        The comparison, as the native module holds it.
    """

    def __init__(self, native: _native.GateReport) -> None:
        self._native = native

    @property
    def passed(self) -> bool:
        """Nothing is worse."""
        return not self.findings

    def __bool__(self) -> bool:
        return self.passed

    @property
    def findings(self) -> list[dict[str, Any]]:
        """What got worse: `grid`, `place`, `method`, `cell`, `measured`, `before`, `after`, `p_value`, …"""
        return list(self._data["worse"])

    @property
    def better(self) -> list[dict[str, Any]]:
        """What got better by the same tests."""
        return list(self._data["better"])

    def to_json(self) -> str:
        """`deadtime/gate@1`."""
        return self._native.json()

    def junit(self) -> str:
        """JUnit XML: a suite per grid, a case per method."""
        return self._native.junit()

    def markdown(self) -> str:
        """A summary in Markdown."""
        return self._native.markdown()

    def __repr__(self) -> str:
        return self._native.text().rstrip()

    def _repr_html_(self) -> str:
        lines = "".join(f"<li>{_escaped(line)}</li>" for line in self._native.lines())
        return f"<p>{_escaped(repr(self).splitlines()[0])}</p>" + (f"<ul>{lines}</ul>" if lines else "")
