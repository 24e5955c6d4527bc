"""A quadrotor in RotorPy whose propellers give less thrust than the simulator assumes, diagnosed by `deadtime.gap(simulate=...)`.

The simulator is the whole loop: RotorPy's Crazyflie with its SE(3) position controller. It goes to and fro along x by a program of its
own; its height is commanded. On the machine the thrust coefficient is 8 % lower (worn propellers). Mass, thrust coefficient, motor lag
and rotor drag are the parameters that may be wrong; every effect on command, sensors and clock is tried with them.

Needs `pip install rotorpy`. In place of the machine stands RotorPy, integrated by its adaptive solver to 1e-8; the simulator takes one
step per sample.
"""

# %% The vehicle and its controller, as RotorPy ships them; only the attitude gains are lower, for a controller that runs at 25 Hz
from __future__ import annotations

import time as clock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

import deadtime

Array = NDArray[np.float64]

CRAZYFLIE = {**quad_params, "tau_m": 0.05, "kp_att": 60.0, "kd_att": 11.0}
HOVER = np.sqrt(CRAZYFLIE["mass"] * 9.81 / 4.0 / CRAZYFLIE["k_eta"])  # rad/s of every rotor
AT_REST = {name: np.zeros(3) for name in ("x_dot", "x_ddot", "x_dddot", "x_ddddot")} | {"yaw": 0.0, "yaw_dot": 0.0}
SAMPLE_TIME = 0.04  # s
controller = SE3Control(CRAZYFLIE)  # it assumes the nominal parameters, on the machine too


def fly(vehicle: Multirotor, height: Array, time: Array, start: Array) -> Array:
    """x and z (m) and the pitch rate (rad/s) at every sample; height[k] is commanded from time[k] to time[k + 1]."""
    state: dict[str, Any] = {
        "x": np.array([start[0], 0.0, start[1]]),
        "v": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(4, HOVER),
    }
    y = np.empty((len(time), 3))
    for k, z in enumerate(height):
        y[k] = state["x"][0], state["x"][2], state["w"][1]
        x = 0.3 if time[k] % 2.4 < 1.2 else -0.3
        command = controller.update(time[k], state, {**AT_REST, "x": np.array([x, 0.0, z])})
        state = vehicle.step(state, command, SAMPLE_TIME)
    return y


# %% The machine, which nobody may look into
LOSS = 0.08
NOISE = np.array([0.005, 0.005, 0.05])  # m, m, rad/s: tracking by cameras, and a gyro
machine = Multirotor({**CRAZYFLIE, "k_eta": (1.0 - LOSS) * CRAZYFLIE["k_eta"]}, integrator_kwargs={"rtol": 1e-8, "atol": 1e-10})


def experiment(seed: int) -> deadtime.Log:
    """Six seconds of going to and fro at changing heights."""
    rng = np.random.default_rng(seed)
    time = np.arange(150, dtype=np.float64) * SAMPLE_TIME
    height = np.repeat(rng.uniform(-0.3, 0.3, 15), 10)
    y = fly(machine, height, time, np.zeros(2)) + NOISE * rng.standard_normal((150, 3))
    units = {"height": "m", "x": "m", "z": "m", "pitch_rate": "rad/s"}
    channels = {"height": height, "x": y[:, 0], "z": y[:, 1], "pitch_rate": y[:, 2]}
    return deadtime.Log(time, channels, units, source=f"flight {seed}")


train, check = experiment(1), experiment(2)

# %% The simulator, as a function of commands, time, start and the parameters that may be wrong
calls, seconds = 0, 0.0


def simulate(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
    """What RotorPy says: outputs, shape (N, 3), of the commanded heights `u`, shape (N, 1), from rest at `x0` = (x, z)."""
    global calls, seconds
    began = clock.perf_counter()
    # One step of a solver of third order per sample: fast, and smooth in the parameters as no adaptive step is.
    one_step = {"method": "RK23", "first_step": SAMPLE_TIME, "rtol": 1.0, "atol": 1.0}
    y = fly(Multirotor({**CRAZYFLIE, **parameters}, integrator_kwargs=one_step), u[:, 0], time, x0)
    calls, seconds = calls + 1, seconds + clock.perf_counter() - began
    return y


# %% What differs, and how much of it is left on the flight that nothing was fitted to?
found = deadtime.gap(
    name="RotorPy",
    simulate=simulate,
    log=[train],
    holdout=[check],
    inputs={"height": "m"},
    outputs={"x": "m", "z": "m", "pitch_rate": "rad/s"},
    states={"x": (0.0, 0.005), "z": (0.0, 0.005)},
    parameters={
        "mass": (CRAZYFLIE["mass"], "kg"),
        "k_eta": (CRAZYFLIE["k_eta"], "N s^2/rad^2"),
        "tau_m": (CRAZYFLIE["tau_m"], "s"),
        "k_d": (CRAZYFLIE["k_d"], "kg/rad"),
    },
)
print(found)
print(f"{seconds:.1f} s in {calls} calls of RotorPy")
thrust = found.effects[0]["parameters"][0]
low, high = thrust["ci95"]
print(f"k_eta: {thrust['value'] / CRAZYFLIE['k_eta']:.4f} of the nominal one; the machine has {1.0 - LOSS:.4f}")
assert (found.verdict, found.channel) == ("parameter_error", "k_eta")
assert low <= (1.0 - LOSS) * CRAZYFLIE["k_eta"] <= high
assert not found.indistinguishable  # the gyro tells a lower thrust from a larger mass
assert found.shrink["after"] < 1.2 * found.shrink["floor"] < 0.3 * found.shrink["before"]

# %%
try:
    figure = found.plot()
except ImportError as missing:  # pip install deadtime[plot]
    print(missing)
