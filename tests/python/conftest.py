"""What the tests of the Python package share."""

from __future__ import annotations

import os
import signal
from pathlib import Path

# Before anything imports them: figures are drawn without a screen, and matrices of six rows multiplied by one thread.
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest  # noqa: E402
from hypothesis import HealthCheck, settings  # noqa: E402

# Whoever starts the tests in the background may have them ignore Ctrl-C, and all that they start too; they are about it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same draws on every run, so that a change alone makes a test fail. `--hypothesis-profile=thorough` draws others, ten times as many (scripts/fuzz); a failure prints what reproduces it.
_DRAWS = {"deadline": None, "database": None, "print_blob": True, "suppress_health_check": [HealthCheck.too_slow, HealthCheck.filter_too_much]}
settings.register_profile("short", max_examples=40, derandomize=True, **_DRAWS)
settings.register_profile("thorough", max_examples=400, **_DRAWS)
settings.load_profile("short")

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def root() -> Path:
    """The top of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def examples(root: Path) -> Path:
    """The folder of examples."""
    return root / "examples"
