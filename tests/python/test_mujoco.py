"""A URDF file through MuJoCo as a simulator, against the equation of a pendulum, which scipy solves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import deadtime

pytest.importorskip("mujoco", reason="mujoco is not installed")
import deadtime.mujoco  # noqa: E402

MASS, LENGTH, INERTIA, DAMPING = 0.8, 0.5, 0.01, 0.1
URDF = f"""
<robot name="arm">
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0 0 {-LENGTH}"/><mass value="{MASS}"/>
    <inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="elbow" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><dynamics damping="{DAMPING}"/></joint>
</robot>
"""
STEP = 0.002


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(URDF)
    return path


def pendulum(time: np.ndarray, torque: np.ndarray, start: list[float], damping: float) -> np.ndarray:
    """(I + m l²) q'' = torque − damping q' − m g l sin q, the torque held from one sample to the next; shape (N, 2): q, q'."""
    y = np.empty((len(time), 2))
    y[0] = start
    for k in range(1, len(time)):
        def rates(_: float, s: np.ndarray, u: float = torque[k - 1]) -> list[float]:
            return [s[1], (u - damping * s[1] - MASS * 9.81 * LENGTH * np.sin(s[0])) / (INERTIA + MASS * LENGTH**2)]

        y[k] = solve_ivp(rates, (time[k - 1], time[k]), y[k - 1], rtol=1e-9, atol=1e-10).y[:, -1]
    return y


def test_a_urdf_file_swings_as_the_pendulum_that_it_describes(urdf: Path) -> None:
    made = deadtime.mujoco.simulator(
        urdf, {"elbow.qfrc": "N m"}, {"elbow.qpos": "rad", "elbow.qvel": "rad/s"}, ["joint/elbow/damping"], {"elbow.qpos": (0.0, 0.1), "elbow.qvel": (0.0, 0.1)}
    )
    assert made["parameters"] == {"joint/elbow/damping": (DAMPING, None)}
    time = 0.02 * np.arange(150)
    torque = np.repeat(np.random.default_rng(3).choice([-1.5, 1.5], 15), 10)
    for damping, start in ((DAMPING, [0.0, 0.0]), (0.5, [0.4, -1.0])):
        y = made["simulate"](torque[:, None], time, np.array(start), {"joint/elbow/damping": damping})
        # MuJoCo's semi-implicit Euler is of first order: with its step of 2 ms the error is some thousandths of the swing.
        expected = pendulum(time, torque, start, damping)
        assert np.abs(y - expected).max(axis=0) == pytest.approx([0, 0], abs=0.01 * np.abs(expected).max())
        assert np.abs(expected[:, 0]).max() > 0.2


def test_what_a_urdf_file_does_not_have_is_named(urdf: Path) -> None:
    for inputs, says in (("elbow", "JOINT.qfrc"), ("shoulder.qfrc", "elbow")):
        with pytest.raises(ValueError, match=says):
            deadtime.mujoco.simulator(urdf, inputs, "elbow.qpos")
