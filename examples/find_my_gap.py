# %% [markdown]
# Find my gap: from two logs and a model file to a simulator that agrees with the machine.
#
# You have a simulator that does not do what the machine does. What is it that the simulator lacks? The way there has five steps, in this
# order: check the logs, ask what they can show at all, diagnose, look how far the gap shrinks on data that nothing was fitted to, save
# and go on from there.
#
# The machine is a drive: a voltage turns a flywheel. `drive.toml` is its model, the two CSV files are runs of ten seconds.

# %%
from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

import deadtime

Array = NDArray[np.float64]
HERE = Path(__file__).parent
model = HERE / "drive.toml"
first, second = (deadtime.read(HERE / f"drive_run_{number}.csv") for number in (1, 2))

# %% [markdown]
# Step 1: the commonest causes need no diagnosis. A unit, a sign, a swapped channel, a clock: `check` looks for them.

# %%
report = deadtime.check(model, log=[first])
print(report)

# %% [markdown]
# The speed was logged in revolutions per minute, the model wants rad/s. `check` changes nothing: that is for you to do.


# %%
def in_rad_s(log: deadtime.Log) -> deadtime.Log:
    """The same log with the speed in rad/s."""
    speed = log["speed"] * (2.0 * np.pi / 60.0)
    units = {"voltage": "V", "speed": "rad/s"}
    return deadtime.Log(log.time, {"voltage": log["voltage"], "speed": speed}, units, source=Path(log.source).name)


first, second = in_rad_s(first), in_rad_s(second)

# %% [markdown]
# Step 2: what can these logs show at all? `isolability` simulates every effect of the catalogue at plausible sizes. Nothing is fitted.
#
# It says that a command that comes late, outputs that are measured late and clocks that are set differently look the same here. So if the
# gap is one of them, no diagnosis of these logs can say which: better known now than after a week with the wrong cable.

# %%
seen = deadtime.isolability(model, log=[first])
for group in seen.classes:
    print("alike here:", ", ".join(group["members"]))
late = next(group["members"] for group in seen.classes if "input_delay:voltage" in group["members"])
assert {"output_delay:*", "clock_offset:*"} <= set(late)

# %% [markdown]
# Step 3: the diagnosis. The first log is for training, the second is held out.

# %%
found = deadtime.gap(model=model, log=[first], holdout=[second])
print(found)

# %% [markdown]
# Commands arrive 12 ms late, or it is one of the two aliases that it names itself. The interval is narrow: a delay is known to a small
# part of a sample.

# %%
assert (found.verdict, found.channel) == ("input_delay", "voltage")
delay = found.effects[0]["parameters"][0]
low, high = delay["ci95"]
assert low <= 0.012 <= high and high - low < 0.001
assert any({"input_delay:voltage", "output_delay:*", "clock_offset:*"} <= set(alike) for alike in found.indistinguishable)

# %% [markdown]
# Step 4: how far does the gap shrink on the log that nothing was fitted to? Down to the noise floor; there is nothing left to be found in
# these logs.

# %%
shrink = found.shrink
print(f"held out: {shrink['before']:.1%} of the spread before, {shrink['after']:.1%} after, {shrink['floor']:.1%} is noise")
assert shrink["after"] < 1.2 * shrink["floor"] < 0.2 * shrink["before"]

# %% [markdown]
# Step 5: save it. The folder holds the diagnosis, a page with a picture per output, and the model with what it lacked. Against that model
# there is no gap.

# %%
with TemporaryDirectory() as folder:
    found.save(folder)
    print(sorted(file.name for file in Path(folder).iterdir()))
    again = deadtime.gap(model=Path(folder) / "model_with_effects.toml", log=[first], holdout=[second])
assert again.verdict == "none"
print(again)

# %% [markdown]
# The same without a model file. Any function will do that makes outputs of commands: here a loop in Python, for you perhaps Simulink,
# MuJoCo (mujoco_joint.py) or RotorPy (rotorpy_hover.py). Parameters that may be wrong are named; what changes equations cannot be tried,
# and is listed.


# %%
def simulate(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
    """The speed (rad/s), shape (N, 1), of held voltages `u`, shape (N, 1)."""
    constant, resistance = 0.05, 1.2
    rate = (constant**2 / resistance + parameters["viscous"]) / parameters["inertia"]
    gain = constant / resistance / parameters["inertia"] / rate
    decays = np.exp(-rate * np.diff(time)).tolist()
    speed = [float(x0[0])]
    for voltage, decay in zip(u[:, 0].tolist(), decays, strict=False):
        speed.append(decay * speed[-1] + (1.0 - decay) * gain * voltage)
    return np.array(speed)[:, None]


called = deadtime.gap(
    name="my own loop",
    simulate=simulate,
    log=[first],
    holdout=[second],
    inputs={"voltage": "V"},
    outputs={"speed": "rad/s"},
    states={"speed": (0.0, 1.0)},
    parameters={"inertia": (0.0004, "kg m^2"), "viscous": (0.0003, "N m s/rad")},
)
print(called)
assert called.verdict == "input_delay" and abs(called.effects[0]["parameters"][0]["value"] - 0.012) < 0.0005
assert "coulomb_friction" in {one["effect"] for one in called.not_tried}

# %% [markdown]
# Which of the three is it? plan_the_next_experiment.py shows how such a question is answered.

# %%
try:
    figure = found.plot()
except ImportError as missing:  # pip install deadtime[plot]
    print(missing)
