# %% [markdown]
# # From flights of a quadrotor to a model
#
# A model is made of logs alone: four motor speeds in, three body rates out, no equations. In place of the vehicle stands the shipped simulator
# (`examples/quadrotor.toml`, a nano-drone of 45 g), so that what is found can be held against what is true. Claims are checked with `assert`.

# %%
from __future__ import annotations

import tempfile
from pathlib import Path

import numpy

import deadtime

HERE = Path(__file__).resolve().parent
QUADROTOR = deadtime.Model.read(HERE / "quadrotor.toml")
MOTORS = [f"m{k}_rads" for k in (1, 2, 3, 4)]
RATES = ["wx", "wy", "wz"]
SAMPLE_TIME = 0.01  # s
LATE = 0.03  # s, dead time of all motors

# %% [markdown]
# ## Flights
#
# Each flight begins in hover. Every motor's speed jumps about its hover value by half a per cent, at random. Nothing holds the vehicle upright, so flights are short; a vehicle
# under control would do as well, as PBSIDopt withstands feedback. The rates are measured with noise.

# %%
known = QUADROTOR.parameters
hover = float(numpy.sqrt(known["mass"] * known["gravity"] / 4 / known["thrust_coefficient"]))


def flight(seed: int, samples: int = 200) -> dict[str, numpy.ndarray]:
    """Motor speeds and noisy rates of one flight."""
    log = {"time": SAMPLE_TIME * numpy.arange(samples)}
    for k, motor in enumerate(MOTORS):
        jumps = deadtime.excite("rbs", samples, seed=10 * seed + k, band=[0, 0.5])
        jumps[:5] = 0.0
        log[motor] = hover * (1 + 0.005 * jumps)
        log[motor.replace("_rads", "_slope")] = numpy.zeros(samples)  # the motors' acceleration, which acts on nothing while the rotors have no inertia
    flown = deadtime.simulate(QUADROTOR, log, delay=dict.fromkeys(MOTORS, LATE)).log
    noise = numpy.random.default_rng(seed)
    return log | {rate: flown[rate] + 0.01 * noise.standard_normal(samples) for rate in RATES}


flights = [flight(seed) for seed in range(1, 9)]

# %% [markdown]
# ## A model
#
# The dead time is known here and removed first; `delay="auto"` would estimate it. The order is three: each rate is the integral of its moment.

# %%
found = deadtime.identify(flights, MOTORS, RATES, order=3, delay=dict.fromkeys(MOTORS, LATE), name="quadrotor_rates")
print(found)
assert found.A.shape == (3, 3) and found.B.shape == (3, 4) and found.K.shape == (3, 3)
assert found.input_delay_s == dict.fromkeys(MOTORS, LATE)

# %% [markdown]
# Integrators are poles at 1. Their standard deviations say how surely.

# %%
for pole in found.poles:
    print(f"pole at {pole['re']:.4f} ± {pole['std_re']:.1e}")
    assert abs(pole["re"] - 1.0) < 0.02

# %% [markdown]
# ## Against the truth
#
# What a motor does to the rates within a sample is C·B, whatever the states are. By the simulator's equations the rolling moment is
# thrust coefficient × arm × (n₃² + n₄² − n₁² − n₂²); its slope at hover, over the inertia, times the sample time, is the roll rate's row.

# %%
per_sample = SAMPLE_TIME * known["arm"] * 2 * known["thrust_coefficient"] * hover / known["inertia_x"]
roll, pitch, _ = found.C @ found.B
print("roll rate, identified:", roll, "by the equations:", per_sample * numpy.array([-1, -1, 1, 1]))
assert numpy.allclose(roll, per_sample * numpy.array([-1, -1, 1, 1]), rtol=0.1)
assert numpy.allclose(pitch, per_sample * numpy.array([-1, 1, 1, -1]), rtol=0.1)

# %% [markdown]
# ## Onwards
#
# The model is a file for `estimate`, `simulate` and `gap`, a system of deadtime, and one of scipy or python-control.

# %%
with tempfile.TemporaryDirectory() as folder:
    found.save(Path(folder) / "rates.toml")
    again = deadtime.Model.read(Path(folder) / "rates.toml")
assert again.inputs == MOTORS and again.outputs == RATES
assert found.to_scipy().A.shape == (3 + 4 * 3, 3 + 4 * 3)  # three samples of delay for each motor are states
