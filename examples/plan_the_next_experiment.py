# %% [markdown]
# Plan the next experiment: what to record when the data cannot tell two causes apart.
#
# A drive turns a flywheel, and turns it more slowly than its model says. The first log was made in a hurry: steps between +3 V and -3 V.

# %%
from __future__ import annotations

from pathlib import Path

import numpy as np
from drive_machine import drive
from numpy.typing import NDArray

import deadtime

model = Path(__file__).parent / "drive.toml"


def experiment(voltage: NDArray[np.float64], seed: int) -> deadtime.Log:
    """The commands (V) on the machine. It is pretended here: its driver does nothing below 0.8 V, and nobody who diagnoses knows that."""
    time, speed = drive(voltage, seed, dead_zone=0.8)
    return deadtime.Log(time, {"voltage": voltage, "speed": speed}, {"voltage": "V", "speed": "rad/s"}, source=f"log {seed}")


steps = np.repeat(np.where(np.arange(25) % 2 == 0, 3.0, -3.0), 40)
first = experiment(steps, seed=1)

# %% [markdown]
# Before anything is diagnosed: what can such steps show? At one amplitude, a driver with a smaller gain, one with a dead zone, one that
# saturates and a sensor that reads too little are one and the same. `isolability` knows that without looking at a single residual.

# %%
seen = deadtime.isolability(model, log=[first])
alike = next(group for group in seen.classes if "deadband:voltage" in group["members"])
print("alike here:", ", ".join(alike["members"]))
print(alike["next_experiment"])
assert {"input_gain:voltage", "deadband:voltage", "saturation:voltage"} <= set(alike["members"])

# %% [markdown]
# The diagnosis explains the gap down to the noise. But look at the probabilities, and at the aliases: the name on top is one of five, and
# it is the wrong one. The sentence after them says what to record next. Of eight experiments that were simulated under each alternative it is
# the one that separates them best.

# %%
before = deadtime.gap(model=model, log=[first])
print(before)
rivals = next(group for group in before.indistinguishable if f"{before.verdict}:{before.channel}" in group)
print("aliases:", ", ".join(rivals))
print("next:", before.next_experiment)
assert "deadband:voltage" in rivals and len(rivals) > 2
assert before.ranking[0]["probability"] < 0.5
assert before.next_experiment.startswith("to separate")

# %% [markdown]
# Most of these effects act by amplitude, and another operating point separates those. So repeat the same steps about one. How far away is for
# you to choose: the program does not know what your machine withstands. Two standard deviations are 6 V here.

# %%
second = experiment(steps + 6.0, seed=2)
after = deadtime.gap(model=model, log=[first, second])
print(after)

# %% [markdown]
# One cause is left, with its size. The alternatives are excluded, not only less likely.

# %%
assert (after.verdict, after.channel) == ("deadband", "voltage")
assert after.ranking[0]["probability"] > 0.95
assert not any("deadband:voltage" in group and len(group) > 1 for group in after.indistinguishable)
width = after.effects[0]["parameters"][0]
low, high = width["ci95"]
assert low <= 0.8 <= high
print(f"dead zone: {width['value']:.3f} V ({low:.3f} to {high:.3f} V); the machine has 0.8 V")
print(f"probability of the leader: {before.ranking[0]['probability']:.0%} before, {after.ranking[0]['probability']:.0%} after")

# %% [markdown]
# The table of what can be seen says the same from the other side: with both logs, a dead zone is alike to nothing else.

# %%
both = deadtime.isolability(model, log=[first, second])
assert not any("deadband:voltage" in group["members"] for group in both.classes)

# %%
try:
    figure = after.plot()
except ImportError as missing:  # pip install deadtime[plot]
    print(missing)
