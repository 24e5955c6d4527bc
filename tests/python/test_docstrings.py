"""Every public function has an example in its docstring, and each example does what it shows."""

from __future__ import annotations

import doctest
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Any

import blind_cases
import distributed
import pytest

import deadtime

MODULES = ("blind", "bounds", "comparing", "dask", "delays", "diagnosis", "exports", "identification", "logs", "models", "signals", "studies", "systems", "tracking")


def examples_of(module: str) -> list[doctest.DocTest]:
    """The examples of a module, of its public functions and classes."""
    found = doctest.DocTestFinder(exclude_empty=True).find(importlib.import_module(f"deadtime.{module}"))
    return [test for test in found if test.examples]


@pytest.fixture(scope="module")
def client() -> Iterator[distributed.Client]:
    """A cluster of one worker in this process."""
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, memory_limit=None) as cluster:
        with distributed.Client(cluster) as client:
            yield client


@pytest.mark.parametrize("module", MODULES)
def test_examples_do_what_they_show(module: str, root: Path, tmp_path: Path, client: distributed.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(root)
    tests = examples_of(module)
    assert tests
    for number, test in enumerate(tests):
        work = tmp_path / str(number)
        cases, labels = blind_cases.make(work, {"late": 4, "true": 0}) if module in ("blind", "dask") else (None, None)
        names: dict[str, Any] = {"cases": cases, "labels": labels, "verdicts": work / "verdicts", "folder": work / "study", "client": client}
        test.globs = {**test.globs, **names} if module in ("blind", "dask") else test.globs
        told: list[str] = []
        result = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test, out=told.append)
        assert result.failed == 0, "".join(told)


def test_every_public_function_has_an_example() -> None:
    public = {name: getattr(deadtime, name) for name in deadtime.__all__}
    for module in ("blind", "bounds", "dask"):
        loaded = importlib.import_module(f"deadtime.{module}")
        public |= {f"{module}.{name}": value for name, value in vars(loaded).items() if not name.startswith("_") and getattr(value, "__module__", "") == loaded.__name__}
    functions = {name: value for name, value in public.items() if isinstance(value, FunctionType)}
    assert len(functions) > 40
    lacking = [name for name, function in functions.items() if ">>>" not in (inspect.getdoc(function) or "")]
    assert lacking == []
