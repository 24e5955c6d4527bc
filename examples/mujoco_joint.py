"""A joint in MuJoCo that lacks the machine's dry friction, diagnosed by `deadtime.gap(simulate=...)`.

The machine is a joint with a spring, driven by a torque, with a potentiometer and a tachometer. Its dry friction (MuJoCo's
`frictionloss`) is what the simulator lacks. Three questions are asked of the same logs:

1. the simulator is MuJoCo, and dry friction is among the parameters that may be wrong: it is named, with its size;
2. the simulator is MuJoCo, and dry friction is not among them: nothing that may be tried explains the gap, and the diagnosis says so;
3. the simulator is the textbook equation of the joint: there the program knows what dry friction does, and names it.

Needs `pip install mujoco`. In place of the machine stands MuJoCo with a time step four times finer than the simulator's.
"""

# %% The machine, which nobody may look into: MuJoCo with dry friction, a fine time step and noisy sensors
from __future__ import annotations

import time as clock

import mujoco
import numpy as np
from numpy.typing import NDArray

import deadtime

Array = NDArray[np.float64]

JOINT = """
<mujoco model="joint">
  <option timestep="{step}" gravity="0 0 0"/>
  <worldbody>
    <body name="arm">
      <joint name="elbow" type="hinge" axis="0 0 1" stiffness="1.5" damping="0.06" armature="0.005"
             frictionloss="{friction}" solreffriction="0.004 1"/>
      <inertial pos="0.15 0 0" mass="0.4" diaginertia="0.001 0.004 0.004"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="elbow"/></actuator>
</mujoco>
"""
FRICTION = 0.08  # N m
INERTIA = 0.004 + 0.4 * 0.15**2 + 0.005  # kg m^2: the body about the joint, and the armature
NOISE = np.array([0.005, 0.05])  # rad, rad/s


def run(model: mujoco.MjModel, torque: Array, time: Array, start: Array) -> Array:
    """Angle and speed at every sample; torque[k] acts from time[k] to time[k + 1]."""
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = start
    steps = np.rint(np.diff(time, append=2 * time[-1] - time[-2]) / model.opt.timestep).astype(int)
    angle, speed, control = data.qpos, data.qvel, data.ctrl
    y = np.empty((len(time), 2))
    for k, (u, n) in enumerate(zip(torque.tolist(), steps.tolist(), strict=True)):
        y[k, 0], y[k, 1] = angle[0], speed[0]  # first the sample, then the step: u[k] acts after y[k]
        control[0] = u
        mujoco.mj_step(model, data, n)
    return y


machine = mujoco.MjModel.from_xml_string(JOINT.format(step=0.0005, friction=FRICTION))


def experiment(seed: int) -> deadtime.Log:
    """Ten seconds on the machine: torques held for 0.25 s, first small ones, at which friction shows, then large ones."""
    rng = np.random.default_rng(seed)
    time = np.arange(500, dtype=np.float64) * 0.02
    torque = np.repeat(rng.uniform(-1.0, 1.0, 42), 12)[:500] * np.where(time < 5.0, 0.4, 1.0)
    y = run(machine, torque, time, np.zeros(2)) + NOISE * rng.standard_normal((500, 2))
    units = {"torque": "N m", "angle": "rad", "speed": "rad/s"}
    return deadtime.Log(time, {"torque": torque, "angle": y[:, 0], "speed": y[:, 1]}, units, source=f"run {seed}")


train, check = experiment(1), experiment(2)

# %% The simulator: the same joint without dry friction, as a function
simulator = mujoco.MjModel.from_xml_string(JOINT.format(step=0.002, friction=0.0))
calls, seconds = 0, 0.0


def simulate(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
    """What MuJoCo says: outputs, shape (N, 2), of the commands `u`, shape (N, 1), from the start `x0` (angle, speed)."""
    global calls, seconds
    began = clock.perf_counter()
    simulator.dof_damping[0] = parameters["damping"]
    simulator.dof_armature[0] = parameters["armature"]
    simulator.jnt_stiffness[0] = parameters["stiffness"]
    simulator.dof_frictionloss[0] = parameters.get("frictionloss", 0.0)
    y = run(simulator, u[:, 0], time, x0)
    calls, seconds = calls + 1, seconds + clock.perf_counter() - began
    return y


known = {"damping": (0.06, "N m s/rad"), "armature": (0.005, "kg m^2"), "stiffness": (1.5, "N m/rad")}
black_box = {
    "name": "MuJoCo",
    "simulate": simulate,
    "inputs": {"torque": "N m"},
    "outputs": {"angle": "rad", "speed": "rad/s"},
    "states": {"angle": (0.0, 0.01), "speed": (0.0, 0.05)},
}

# %% 1. Dry friction is one of the parameters: its nominal value is 0
named = deadtime.gap(log=[train], holdout=[check], parameters={**known, "frictionloss": (0.0, "N m")}, **black_box)
print("1. dry friction is a parameter of the simulator\n")
print(named)
print(f"{seconds:.1f} s in {calls} calls of MuJoCo\n")
value = named.effects[0]["parameters"][0]
assert (named.verdict, named.channel) == ("parameter_error", "frictionloss")
low, high = value["ci95"]
assert low <= FRICTION <= high and high - low < 0.1 * FRICTION
assert named.shrink["after"] < 1.2 * named.shrink["floor"] < 0.2 * named.shrink["before"]

# %% 2. Dry friction is not among the parameters, and a black box has no equations to which it could be added
calls, seconds = 0, 0.0
unnamed = deadtime.gap(log=[train], holdout=[check], parameters=known, **black_box)
print("2. dry friction is not a parameter of the simulator\n")
print(unnamed)
print(f"{seconds:.1f} s in {calls} calls of MuJoCo\n")
assert "coulomb_friction" in {left_out["effect"] for left_out in unnamed.not_tried}
assert unnamed.verdict == "unknown"

# %% 3. The textbook equation of the joint: dry friction is an effect that the program knows
equation = {
    "format": "deadtime/model@1",
    "name": "joint",
    "kind": "equations",
    "inputs": [{"name": "torque", "unit": "N m"}],
    "outputs": [{"name": "angle", "unit": "rad"}, {"name": "speed", "unit": "rad/s"}],
    "states": {
        "angle": {"unit": "rad", "initial": 0.0, "initial_std": 0.01},
        "speed": {"unit": "rad/s", "initial": 0.0, "initial_std": 0.05},
    },
    "parameters": {
        "inertia": {"unit": "kg m^2", "value": INERTIA},
        "damping": {"unit": "N m s/rad", "value": 0.06},
        "stiffness": {"unit": "N m/rad", "value": 1.5},
    },
    "derivatives": {"angle": "speed", "speed": "(torque - damping*speed - stiffness*angle)/inertia"},
    "output_equations": {"angle": "angle", "speed": "speed"},
}
textbook = deadtime.gap(model=equation, log=[train], holdout=[check])
print("3. the simulator is an equation\n")
print(textbook)
level = textbook.effects[0]["parameters"][0]
assert (textbook.verdict, textbook.channel) == ("coulomb_friction", "speed")
assert level["ci95"][0] <= FRICTION / INERTIA <= level["ci95"][1]
print(f"level {level['value']:.3f} rad/s^2; friction over inertia is {FRICTION / INERTIA:.3f} rad/s^2")

# %%
try:
    figure = named.plot()
except ImportError as missing:  # pip install deadtime[plot]
    print(missing)
