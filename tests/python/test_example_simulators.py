"""The examples on simulators and the tutorials on gaps run as written: each asserts what it claims."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest


def run(script: Path) -> str:
    """What a script prints, run as a newcomer would."""
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    page = (script.parents[1] / "docs" / "examples.md").read_text(encoding="utf-8")
    shown = page.split(f"$ python examples/{script.name}\n")[1].split("```")[0]
    assert causes(shown) == causes(done.stdout), "docs/examples.md shows something else: python scripts/examples_page.py"
    return done.stdout


def causes(printed: str) -> list[str]:
    """What is named, without the numbers."""
    return [line.split(" with ")[0].split(";")[0] for line in printed.splitlines() if line.startswith("Cause: ")]


def test_dry_friction_in_mujoco_is_named_where_it_can_be_and_unknown_where_not(examples: Path) -> None:
    parts = run(examples / "mujoco_joint.py").split("\n\n")
    named, unnamed, textbook = (next(p for p in parts if p.startswith(f"Gap: the model {name} ") and what in p) for name, what in (
        ("MuJoCo", "Cause: parameter_error on `frictionloss`"),
        ("MuJoCo", "Cause: unknown"),
        ("joint", "Cause: coulomb_friction on `speed`"),
    ))
    assert "Not tried: " in named and "Not tried: " in unnamed and "coulomb_friction" in unnamed.split("Not tried: ")[1]
    assert "Not tried: " not in textbook


def test_a_lower_thrust_in_rotorpy_is_told_from_a_larger_mass(examples: Path) -> None:
    printed = run(examples / "rotorpy_hover.py")
    assert "Cause: parameter_error on `k_eta`" in printed
    assert "0.0000" not in printed.split("Cause: ")[1].splitlines()[0], "a coefficient of 2e-8 is no 0"


def test_the_way_from_two_logs_to_a_simulator_without_a_gap(examples: Path) -> None:
    printed = run(examples / "find_my_gap.py")
    assert "looks like rpm" in printed and "Cause: input_delay on `voltage`" in printed and "Cause: none" in printed


def test_the_experiment_that_was_proposed_leaves_one_cause(examples: Path) -> None:
    printed = run(examples / "plan_the_next_experiment.py")
    assert "Cause: deadband on `voltage`" in printed


@pytest.mark.parametrize("number", [1, 2])
def test_the_logs_of_the_tutorial_are_those_that_the_pretended_machine_writes(
    number: int, examples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(examples))
    import drive_machine

    drive_machine.write(tmp_path)
    name = f"drive_run_{number}.csv"
    shipped, written = (np.loadtxt(folder / name, delimiter=",", skiprows=1) for folder in (examples, tmp_path))
    # The last digit may turn over where processors round differently.
    np.testing.assert_allclose(written, shipped, rtol=0.0, atol=0.011)
