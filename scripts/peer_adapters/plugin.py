"""A plugin of pytest: puts the adapters in place before tests are imported, and writes how each test ended and what of ours it reached."""

from __future__ import annotations

import json
import os
import pathlib
from typing import Any

import pytest

from . import operations

outcomes: list[dict[str, Any]] = []

operations.install()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Any:
    operations.reached.clear()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Any:
    report = yield
    if report.when == "call" or (report.when == "setup" and report.outcome != "passed"):
        why = str(report.longrepr).strip().splitlines()[-1][:300] if report.failed else ""
        outcomes.append({"name": item.nodeid, "outcome": report.outcome, "reached": sorted(operations.reached), "why": why})
    return report


def pytest_sessionfinish() -> None:
    pathlib.Path(os.environ["PEER_OUTCOMES"]).write_text(json.dumps(outcomes))
