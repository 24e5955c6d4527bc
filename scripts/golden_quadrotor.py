#!/usr/bin/env python3
"""Writes golden/quadrotor/reference.json: ten seconds of a quadrotor by SciPy, with the rotation kept as a matrix and not as a quaternion.

Usage: python scripts/golden_quadrotor.py [--check | --stamp], in an environment with numpy and scipy. --check compares with the file instead; --stamp does that
and renews its part of golden/HASHES, as writing does.
"""

import json
import pathlib
import sys

import numpy as np
import scipy
from golden import hashes
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

GRAVITY, MASS, ARM, THRUST, TORQUE = 9.81, 0.045, 0.0353, 3.72e-8, 7.74e-12
INERTIA = np.diag([2.3951e-5, 2.3951e-5, 3.2347e-6])
# Everything that the model file holds at 0 acts here; the moments' shares keep ten seconds without a controller upright enough.
EFFECTS = {
    "torque_x": 0.6, "torque_y": 0.5, "torque_z": 0.7, "motor_lag": 0.012, "rotor_inertia": 3e-9, "drag_xy": 0.01, "drag_z": 0.005, "rotor_drag": 1.5e-6,
    "damping_x": 6e-5, "damping_y": 5e-5, "damping_z": 7e-6, "moment_x": 1e-6, "moment_y": -2e-6, "trim_x": 1e-7, "trim_y": -2e-7, "trim_z": 1e-8,
    "tilt_x": 0.01, "tilt_y": -0.02, "velocity_scale": 0.05, "velocity_delay": 0.004, "rate_delay": 0.02,
}
STEP, SAMPLES = 0.01, 1001
# Between two regenerations, absolute: 40 times what two solvers differ by.
TOLERANCE = 1e-9


def motors() -> np.ndarray:
    """Speeds about hover, rad/s: a sum of sines for each rotor, held between samples."""
    t = STEP * np.arange(SAMPLES)[:, None]
    hover = np.sqrt(MASS * GRAVITY / (4 * THRUST))
    frequency, phase = np.array([0.7, 1.1, 0.9, 1.3]), np.array([0.0, 1.0, 2.0, 3.0])
    return np.round(hover + 12 * np.sin(2 * np.pi * frequency * t + phase) + 6 * np.sin(2 * np.pi * 2.3 * t - phase), 3)


def derivative(state, speed, slope, e):
    position, velocity, rates, r = state[:3], state[3:6], state[6:9], state[9:].reshape(3, 3)
    n = speed - e["motor_lag"] * slope
    lift = THRUST * n**2
    true = velocity / (1 + e["velocity_scale"])
    body = r.T @ true
    lateral = e["drag_xy"] + e["rotor_drag"] * n.sum()
    force = lift.sum() * np.array([e["tilt_y"], -e["tilt_x"], 1.0]) - np.array([lateral, lateral, e["drag_z"]]) * body
    acceleration = r @ force / MASS - np.array([0, 0, GRAVITY])
    rolled = np.array([
        e["torque_x"] * ARM * (lift[2] + lift[3] - lift[0] - lift[1]),
        e["torque_y"] * ARM * (lift[1] + lift[2] - lift[0] - lift[3]),
        e["torque_z"] * TORQUE * (n[1]**2 + n[3]**2 - n[0]**2 - n[2]**2) + e["rotor_inertia"] * (slope[1] + slope[3] - slope[0] - slope[2]),
    ])
    moment = rolled - np.array([e["damping_x"], e["damping_y"], e["damping_z"]]) * rates
    moment += np.array([e["moment_x"] * body[1], e["moment_y"] * body[0], 0.0]) + np.array([e["trim_x"], e["trim_y"], e["trim_z"]])
    spinning = np.array([0, 0, e["rotor_inertia"] * (n[0] + n[2] - n[1] - n[3])])
    turning = np.linalg.solve(INERTIA, moment - np.cross(rates, INERTIA @ rates + spinning))
    o = rates + e["rate_delay"] * turning
    skew = np.array([[0, -o[2], o[1]], [o[2], 0, -o[0]], [-o[1], o[0], 0]])
    p = true + e["velocity_delay"] * acceleration
    return np.concatenate([p, (1 + e["velocity_scale"]) * acceleration, turning, (r @ skew).ravel()])


def run(u, e, method):
    slopes = np.vstack([np.zeros(4), np.diff(u, axis=0) / STEP])
    state = np.concatenate([np.zeros(3), [0.3, -0.2, 0.1], [0.05, -0.04, 0.1], np.eye(3).ravel()])
    rows = [state]
    for k in range(SAMPLES - 1):
        done = solve_ivp(lambda _, s: derivative(s, u[k], slopes[k], e), (0, STEP), state, method=method, rtol=1e-12, atol=1e-13)
        state = done.y[:, -1]
        rows.append(state)
    return np.array(rows)


def main():
    u = motors()
    cases = []
    for name, e in [("published", {k: 1.0 if k in ("torque_x", "torque_y", "torque_z") else 0.0 for k in EFFECTS}), ("all_effects", EFFECTS)]:
        x, second = run(u, e, "DOP853"), run(u, e, "RK45")
        print(name, "two solvers differ by", np.abs(x - second).max(), "rates up to", np.abs(x[:, 6:9]).max(), "position up to", np.abs(x[:, :3]).max())
        q = Rotation.from_matrix(x[:, 9:].reshape(-1, 3, 3)).as_quat()
        keep = slice(0, SAMPLES, 50)
        cases.append({"id": name, "parameters": e, "position": x[keep, :3].tolist(), "velocity": x[keep, 3:6].tolist(), "rates": x[keep, 6:9].tolist(),
                      "quaternion": q[keep].tolist()})
    path = pathlib.Path(__file__).resolve().parent.parent / "golden" / "quadrotor" / "reference.json"
    if {"--check", "--stamp"} & set(sys.argv):
        stored = json.loads(path.read_text())["cases"]
        worst = max(np.abs(np.subtract(new[key], old[key])).max() for new, old in zip(cases, stored, strict=True) for key in ("position", "velocity", "rates", "quaternion"))
        print(f"quadrotor: largest difference {worst:.2g} of {TOLERANCE:g} allowed")
        if not worst <= TOLERANCE or [c["parameters"] for c in cases] != [c["parameters"] for c in stored]:
            sys.exit("golden/quadrotor/reference.json differs")
        if "--stamp" in sys.argv:
            hashes.stamp("quadrotor")
        return
    path.write_text(json.dumps({"step_s": STEP, "every": 50, "u": u.tolist(), "start": [0, 0, 0, 0.3, -0.2, 0.1, 0, 0, 0, 1, 0.05, -0.04, 0.1],
                                "tool": f"scipy {scipy.__version__}, numpy {np.__version__}", "cases": cases}) + "\n")
    hashes.stamp("quadrotor")


main()
