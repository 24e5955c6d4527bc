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
    return [line.split(",")[0].split(";")[0] for line in printed.splitlines() if line.startswith("Cause: ")]


@pytest.mark.nightly
def test_dry_friction_in_mujoco_is_named_where_it_can_be_and_unknown_where_not(examples: Path) -> None:
    parts = run(examples / "mujoco_joint.py").split("\n\n")
    named, unnamed, textbook = (next(p for p in parts if f"Gap: {name}, " in p and what in p) for name, what in (
        ("MuJoCo", "Cause: parameter error of `frictionloss`"),
        ("MuJoCo", "Cause: unknown"),
        ("joint", "Cause: coulomb friction of `speed`"),
    ))
    assert "Not tried: " in named and "Not tried: " in unnamed and "coulomb_friction" in unnamed.partition("Not tried: ")[2]
    assert "Not tried: " not in textbook


@pytest.mark.nightly
def test_a_lower_thrust_in_rotorpy_is_told_from_a_larger_mass(examples: Path) -> None:
    printed = run(examples / "rotorpy_hover.py")
    assert "Cause: parameter error of `k_eta`" in printed
    assert "0.0000" not in printed.split("Cause: ")[1].splitlines()[0], "a coefficient of 2e-8 is no 0"


def test_the_way_from_two_logs_to_a_simulator_without_a_gap(examples: Path) -> None:
    printed = run(examples / "find_my_gap.py")
    assert "looks like rpm" in printed and "Cause: input delay of `voltage`" in printed and "Cause: none" in printed


def test_the_experiment_that_was_proposed_leaves_one_cause(examples: Path) -> None:
    printed = run(examples / "plan_the_next_experiment.py")
    assert "Cause: deadband of `voltage`" in printed


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


def test_the_shipped_quadrotor_flies_as_in_rotorpy_for_ten_seconds(examples: Path) -> None:
    """RotorPy's rigid body without air, integrated to rounding, with the rotors at the speeds that the model is given."""
    from rotorpy.vehicles.multirotor import Multirotor

    import deadtime

    arm, hover, step = 0.0353, np.sqrt(0.045 * 9.81 / (4 * 3.72e-8)), 0.01
    corners = {"r1": (arm, -arm), "r2": (-arm, -arm), "r3": (-arm, arm), "r4": (arm, arm)}
    vehicle = Multirotor(
        {
            "mass": 0.045, "Ixx": 2.3951e-5, "Iyy": 2.3951e-5, "Izz": 3.2347e-6, "Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0, "num_rotors": 4,
            "rotor_pos": {name: np.array([x, y, 0.0]) for name, (x, y) in corners.items()}, "rotor_directions": np.array([-1, 1, -1, 1]),
            "rotor_speed_min": 0.0, "rotor_speed_max": 5000.0, "k_eta": 3.72e-8, "k_m": 7.74e-12, "tau_m": 0.01,
        },
        aero=False,
        integrator_kwargs={"method": "DOP853", "rtol": 1e-12, "atol": 1e-13},
    )  # fmt: skip
    time = step * np.arange(1001)
    frequency, phase = np.array([0.7, 1.1, 0.9, 1.3]), np.array([0.0, 1.0, 2.0, 3.0])
    speeds = hover + 1.5 * np.sin(2 * np.pi * frequency * time[:, None] + phase)
    state = {"x": np.zeros(3), "v": np.zeros(3), "q": np.array([0.0, 0, 0, 1]), "w": np.zeros(3), "wind": np.zeros(3)}
    rows = []
    for command in speeds:
        rows.append(np.concatenate([state["x"], state["v"], state["q"], state["w"]]))
        state = vehicle.step(state | {"rotor_speeds": command}, {"cmd_motor_speeds": command}, step)
    theirs = np.array(rows)

    log = {"time": time} | {f"m{i + 1}_rads": speeds[:, i] for i in range(4)} | {f"m{i + 1}_slope": np.zeros(len(time)) for i in range(4)}
    ours = deadtime.simulate(examples / "quadrotor.toml", log)
    names = ["x", "y", "z", "vx", "vy", "vz", "qx", "qy", "qz", "qw", "wx", "wy", "wz"]
    apart = {name: float(np.abs(ours.log[name] - theirs[:, i]).max()) for i, name in enumerate(names)}
    # It flew: metres away, tilted and turned.
    assert np.abs(theirs[-1, :3]).max() > 1.0 and np.abs(theirs[:, 6:9]).max() > 0.1
    assert max(apart.values()) < 1e-6, apart
