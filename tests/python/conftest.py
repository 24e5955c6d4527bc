"""What the tests of the Python package share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Before anything imports it: figures are drawn without a screen.
os.environ.setdefault("MPLBACKEND", "Agg")

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def root() -> Path:
    """The top of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def examples(root: Path) -> Path:
    """The folder of examples."""
    return root / "examples"
