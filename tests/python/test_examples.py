"""The tutorials of examples/ are scripts, and what they claim they assert."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = ["estimate_a_delay.py", "which_method.py", "identify_quadrotor.py"]


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.nightly] if name == "which_method.py" else []) for name in SCRIPTS])
def test_a_tutorial_runs_and_what_it_claims_holds(name: str, examples: Path, tmp_path: Path) -> None:
    ran = subprocess.run([sys.executable, "-W", "error", str(examples / name)], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert ran.returncode == 0, ran.stdout[-3000:] + ran.stderr
    assert not list(tmp_path.iterdir()), "it leaves nothing behind"


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_tutorial_is_cells_with_prose_and_claims(name: str, examples: Path) -> None:
    text = (examples / name).read_text(encoding="utf-8")
    cells = re.split(r"^# %%", text, flags=re.MULTILINE)[1:]
    assert sum(cell.startswith(" [markdown]") for cell in cells) >= 4
    assert text.count("\nassert ") + text.count("    assert ") >= 5
    assert max(map(len, text.splitlines())) <= 180
