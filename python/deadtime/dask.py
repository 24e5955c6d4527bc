"""Studies and blind runs on many machines, by Dask (`pip install deadtime[dask]`).

The work is split by seed. The seed of a record is a hash of what the record is of, so that a task, some blocks of 25 records with all their
estimates, gives the same bits whoever
makes it, whenever, and however often. A task writes one Parquet part under a name of its own, under a temporary name first: what is done
stays done when a worker, the scheduler or the
client dies. docs/dask.md tells how large tasks are, what they cost, and how to run on SLURM.
"""

from __future__ import annotations

import os
import socket
import threading
import time
import uuid
from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from . import _native
from .blind import BlindRun, CaseOutcome
from .errors import FileError, StudyError
from .studies import PathLike, Plan, PlanLike, Study, as_plan

if TYPE_CHECKING:
    import distributed

__all__ = ["run_blind", "run_study"]

#: Seconds of work in a task, where the plan is long enough.
TASK_SECONDS = 10.0
#: Seconds of a task at least, unless the whole plan is shorter: a task costs the scheduler about a millisecond.
LEAST_SECONDS = 1.0
#: Tasks of a worker's thread at least, where they do not get shorter than that: the last ones are waited for.
ROUNDS = 8
#: Tasks in the scheduler's hands, by thread of a worker: the rest stays with the client.
AHEAD = 3
#: Seconds in which a file of a shared folder must be seen by the client.
PATIENCE = 60.0
#: How often a task is given to a worker whose file system or network failed.
TRIES = 4


class _Part(NamedTuple):
    """What a task sends back."""

    part: bytes | None
    size: int
    seconds: float


_runners: dict[str, _native.Runner] = {}
_lock = threading.Lock()


def _runner(text: str, folder: str, stamp: str) -> _native.Runner:
    """The plan made ready on this worker, once for all its tasks."""
    with _lock:
        runner = _runners.get(stamp)
        if runner is None:
            runner = _native.Runner(_native.Plan(text, folder), tried=False, max_memory_gb=inf, max_disk_gb=inf)
            if runner.stamp != stamp:
                raise StudyError(
                    f"worker on {socket.gethostname()}: the plan means something else there: install the client's version of deadtime "
                    f"(there: {_native.__version__}), and let workers read the same model files"
                )
            _runners.clear()
            _runners[stamp] = runner
    return runner


def _cost(text: str, folder: str, stamp: str, setting: int) -> float:
    """On a worker: seconds of a record of this setting, with all its estimates."""
    return _runner(text, folder, stamp).cost(setting)


def _make(text: str, folder: str, stamp: str, first: int, end: int, path: str | None) -> _Part:
    """On a worker: the estimates of some blocks, written to `path`, or sent back."""
    clock = time.perf_counter()
    runner = _runner(text, folder, stamp)
    if path is None:
        part = runner.part(first, end)
        return _Part(part, len(part), time.perf_counter() - clock)
    return _Part(None, runner.write_part(first, end, path), time.perf_counter() - clock)


def _diagnose(case: str, name: str, verdicts: str, fresh: bool, seed: int, threads: int) -> tuple[str, str, float | None, str | None]:
    """On a worker: the diagnosis of one case."""
    return _native._blind_case(case, name, verdicts, fresh, seed, threads)


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as missing:
        raise ImportError("many machines need Dask: pip install deadtime[dask]") from missing
    return distributed


def run_study(
    plan: PlanLike,
    client: distributed.Client,
    out: PathLike,
    *,
    trials: int | None = None,
    seed: int | None = None,
    block: int | None = None,
    task_seconds: float = TASK_SECONDS,
    resume: bool = False,
    shared: bool = True,
    in_flight: int | None = None,
    progress: Callable[[int, int], object] | None = None,
    max_memory_gb: float | None = None,
    max_disk_gb: float | None = None,
) -> Study:
    """Runs a study on the workers of a Dask cluster.

    It finds the cells and estimates of `deadtime.study`, bit by bit on workers of one kind, run times apart.

    Parameters
    ----------
    plan : str, path, dict or Plan
        As `deadtime.study` takes it. Model files that it names are read by the workers, under the same path.
    client : distributed.Client
        A synchronous client. Workers need the client's version of deadtime; a task uses one thread.
    out : path
        Folder for study.json, tables.md, report.html, tasks.json and estimates/part-*.parquet, one data set to DuckDB, Polars and pandas.
    trials, seed : int, optional
        In place of the plan's.
    block : int, optional
        Blocks of 25 records in a task; default: as many as take `task_seconds`, after a record of every kind has been timed on the workers.
    task_seconds : float
        Work in a task, s. A plan that would give a worker's thread fewer than 8 tasks has shorter ones, of 1 s at least. A task holds a
        block at least, 400 000 estimates at most, and
        never ends within a setting that it shares with another setting.
    resume : bool
        Go on where an earlier run in `out` ended, in whatever way, with the tasks of that run: parts that are there are not made again,
        unless a single byte of one is not as it was written (a warning names them).
    shared : bool
        Workers write to `out` themselves: it is the same folder for all of them. False: they send their parts to the client, which writes
        them.
    in_flight : int, optional
        Tasks that the scheduler holds at a time; default: 3 by thread of a worker, 16 at least.
    progress : function of (done, all), optional
        Called with the number of estimates made, and of all, after every task.
    max_memory_gb, max_disk_gb : float, optional
        As `deadtime.study` takes them.

    Raises
    ------
    FileError
        Another client writes to `out`.
    StudyError
        A plan that cannot be run; a folder that holds another study; a record that cannot be made, naming setting, trial and seed; a task
        on which workers died again and again;
        workers of another version.
    KeyboardInterrupt
        At once; what is done stays, and `resume=True` goes on.

    Examples
    --------
    `client` is a `distributed.Client`, `folder` a path that the workers see.

    >>> import deadtime, deadtime.dask
    >>> study = deadtime.dask.run_study("examples/gate_plan.toml", client, folder, trials=25)
    >>> alone = deadtime.study("examples/gate_plan.toml", trials=25)
    >>> [cell["rms_samples"] for cell in study.cells] == [cell["rms_samples"] for cell in alone.cells]
    True
    """
    _distributed()
    _check(client)
    chosen = as_plan(plan, trials=trials, seed=seed)
    folder = Path(out).absolute()
    runner = _native.Runner(chosen, max_memory_gb=max_memory_gb, max_disk_gb=max_disk_gb)
    with closing(_native.Lock(folder)):
        return _run_study(client, chosen, folder, runner, block, task_seconds, resume, shared, in_flight, progress)


def _run_study(
    client: Any,
    chosen: Plan,
    folder: Path,
    runner: _native.Runner,
    block: int | None,
    task_seconds: float,
    resume: bool,
    shared: bool,
    in_flight: int | None,
    progress: Callable[[int, int], object] | None,
) -> Study:
    """The study in a folder that no other client writes to."""
    distributed = _distributed()
    sent = (chosen._bare(), os.fspath(chosen.folder), runner.stamp)
    tasks = _native.Tasks.open(runner, folder, resume)
    if tasks is None:
        ends = _sized(client, runner, sent, task_seconds) if block is None else runner.tasks_of(_at_least_one(block))
        tasks = _native.Tasks(runner, folder, ends)
    missing = tasks.missing()
    left = sum(runner.estimates_of(*tasks.blocks(task)) for task in missing)
    count = runner.estimates - left
    if progress is not None:
        progress(count, runner.estimates)

    def arguments(task: int) -> tuple[Any, ...]:
        return (*sent, *tasks.blocks(task), os.fspath(tasks.path(task)) if shared else None)

    seen = False
    with closing(_results(distributed, client, "deadtime-study", _make, missing, arguments, in_flight)) as results:
        for task, made in results:
            if not shared:
                tasks.keep(task, made.part)
            elif not seen:
                _wait_for(tasks.path(task))
                seen = True
            count += runner.estimates_of(*tasks.blocks(task))
            if progress is not None:
                progress(count, runner.estimates)
    return Study(tasks.gather(runner, None), chosen, folder)


def run_blind(
    cases: PathLike,
    verdicts: PathLike,
    client: distributed.Client,
    *,
    fresh: bool = False,
    seed: int = 1,
    threads: int = 1,
    in_flight: int | None = None,
    progress: Callable[[CaseOutcome], object] | None = None,
) -> BlindRun:
    """Diagnoses every case of a folder on the workers of a Dask cluster, a task per case: the verdicts of `deadtime.blind.run`.

    Parameters
    ----------
    cases, verdicts : path
        As `deadtime.blind.run` takes them; folders that all workers see under the same path.
    client : distributed.Client
        A synchronous client.
    fresh : bool
        Diagnose all cases again; without it, cases that are done are kept, and so a run that was stopped goes on.
    seed : int
        Seed of the bootstrap.
    threads : int
        Threads of a diagnosis.
    in_flight : int, optional
        Tasks that the scheduler holds at a time; default: 3 by thread of a worker, 16 at least.
    progress : function of a `CaseOutcome`, optional
        Called for every case as it is done.

    Returns
    -------
    BlindRun
        How each case went. A case that fails stops no other: look at `failed`.

    Examples
    --------
    `client` is a `distributed.Client`, `cases` a folder of two cases.

    >>> import deadtime.dask
    >>> len(deadtime.dask.run_blind(cases, verdicts, client).cases)
    2
    """
    distributed = _distributed()
    _check(client)
    source, target = Path(cases).absolute(), Path(verdicts).absolute()
    names = _native._blind_cases(source)

    def arguments(number: int) -> tuple[Any, ...]:
        return (os.fspath(source / names[number]), names[number], os.fspath(target), fresh, seed, threads)

    outcomes: dict[int, CaseOutcome] = {}
    with (
        closing(_native.Lock(target)),
        closing(_results(distributed, client, "deadtime-blind", _diagnose, range(len(names)), arguments, in_flight)) as results,
    ):
        for number, told in results:
            outcomes[number] = CaseOutcome(*told)
            if progress is not None:
                progress(outcomes[number])
    return BlindRun(os.fspath(target), tuple(outcomes[number] for number in range(len(names))))


def _check(client: Any) -> None:
    if getattr(client, "asynchronous", False):
        raise TypeError("the client is asynchronous: give a synchronous one, Client(…) outside of an event loop")


def _at_least_one(block: int) -> int:
    if block < 1:
        raise ValueError(f"block is {block}: give at least 1")
    return block


def _sized(client: Any, runner: _native.Runner, sent: tuple[str, str, str], task_seconds: float) -> list[int]:
    """Ends of tasks that take about as long as they should: a record of every kind is timed first."""
    if not task_seconds > 0:
        raise ValueError(f"task_seconds is {task_seconds}: give more than 0")
    kinds = runner.kinds()
    costs: list[float] = [0.0] * len(kinds)
    distributed = _distributed()

    def arguments(kind: int) -> tuple[Any, ...]:
        return (*sent, kinds[kind][0])

    with closing(_results(distributed, client, "deadtime-cost", _cost, range(len(kinds)), arguments, None)) as results:
        for kind, cost in results:
            costs[kind] = cost
    total = sum(cost * records for cost, (_, records) in zip(costs, kinds, strict=True))
    threads = max(1, sum(client.nthreads().values()))
    return runner.tasks(costs, min(task_seconds, max(LEAST_SECONDS, total / (ROUNDS * threads))))


def _wait_for(path: Path) -> None:
    """Returns when the client sees a file that a worker has written; network file systems take their time."""
    until = time.monotonic() + PATIENCE
    while not path.exists():
        if time.monotonic() > until:
            raise StudyError(
                f"{path}: a worker has written it, and it is not here: `out` must be the same folder for all of them, or give shared=False"
            )
        time.sleep(0.2)
        # Asks the server again, where a network file system caches that there was no such file.
        os.listdir(path.parent)


def _results(
    distributed: Any,
    client: Any,
    prefix: str,
    function: Callable[..., Any],
    tasks: Iterable[int],
    arguments: Callable[[int], tuple[Any, ...]],
    in_flight: int | None,
) -> Generator[tuple[int, Any], None, None]:
    """What `function` answers to each task, as it comes; few tasks at a time are with the scheduler, however many there are.

    The scheduler itself gives the tasks of a worker that died to another one.
    """
    from distributed.comm.core import CommClosedError

    token = uuid.uuid4().hex[:12]
    waiting = iter(tasks)
    done = distributed.as_completed(loop=client.loop, raise_errors=False)
    pending: dict[Any, int] = {}
    tries: dict[int, int] = {}

    def submit(task: int) -> None:
        tries[task] = tries.get(task, 0) + 1
        # A key of this run alone: results of another run under the same name would be taken for this one's.
        future = client.submit(function, *arguments(task), key=f"{prefix}-{token}-{task}-{tries[task]}", pure=False)
        pending[future] = task
        done.add(future)

    limit, asked = 0, 0.0
    try:
        while True:
            # Workers come and go.
            if time.monotonic() - asked > 1.0:
                limit = in_flight or max(16, AHEAD * sum(client.nthreads().values()))
                asked = time.monotonic()
            while len(pending) < max(1, limit) and (task := next(waiting, None)) is not None:
                submit(task)
            if not pending:
                return
            future = next(done)
            task = pending.pop(future)
            status = future.status
            if status == "finished":
                result = future.result()
                future.release()
                del tries[task]
                yield task, result
            elif status == "error":
                error = future.exception()
                if isinstance(error, distributed.KilledWorker):
                    last = error.last_worker
                    raise StudyError(f"{prefix}, task {task}: workers died on it again and again, the last one {last}") from error
                if not isinstance(error, FileError | CommClosedError) or tries[task] >= TRIES:
                    raise error
                submit(task)
            elif tries[task] < TRIES:
                # Cancelled or lost: the scheduler began anew.
                submit(task)
            else:
                raise StudyError(f"{prefix}, task {task}: the scheduler lost it {TRIES} times")
    finally:
        # Those that have not begun are not begun; those that run write the parts that they would have written.
        for future in list(pending):
            future.release()
