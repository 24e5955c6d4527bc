# %% [markdown]
# # Estimate a delay
#
# How late does a machine answer to its command? `deadtime` reads that from a log: time stamps, the command that was sent, and what a sensor measured.
# This page is a script with cells (`# %%`): run it whole, or cell by cell in an editor or a notebook. What it claims it checks with `assert`.

# %%
from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy

import deadtime

# Next to this script, or at the repository's top where a notebook runs.
HERE = Path(__file__).parent if "__file__" in globals() else Path("examples")

# %% [markdown]
# ## A log in a file
#
# The log of thirty seconds of simulated flight: `r` is the roll command, `p` the roll rate that a gyroscope measured. The command reached the vehicle 0.13 s
# late, six samples and a half, which the methods do not know.

# %%
log = deadtime.read(HERE / "uav_flight.csv")
print(log)

result = deadtime.estimate(log, "r", "p")
print(result)

# %% [markdown]
# Every method that looks at one input and one output has answered. The sentence at the end is the verdict: which delay most kinds of methods hold inside their
# intervals. Methods that do not withstand what the record shows (here that the plant has a lag of its own) are listed and not counted.
#
# Results are objects: `result.verdict`, `result.best` (the answer that the verdict took), `result.pair["oestruc"]` (one method's answer).

# %%
print(result.verdict.delay_s, result.verdict.ci95_s)
print(result.best)
print(result.pair["oestruc"])

assert result.verdict.delay_s is not None and result.verdict.ci95_s is not None
# Most methods count samples of 0.02 s: the verdict comes to within one, and its interval says so.
assert abs(result.verdict.delay_s - 0.13) <= 0.02
assert result.verdict.ci95_s[0] <= 0.13 <= result.verdict.ci95_s[1]

# %% [markdown]
# ## A figure
#
# Dots are dead times, bars their 95 % intervals, grey what is not counted; below stands the impulse response that was estimated from the log, which begins where
# the dead time ends. Figures need matplotlib: `pip install deadtime[plot]`.

# %%
if find_spec("matplotlib"):
    figure = result.plot()
    with TemporaryDirectory() as folder:
        figure.savefig(Path(folder) / "estimate.png")

# %% [markdown]
# ## Fractions of a sample
#
# A model of the vehicle knows its lag, and the log holds all of its states. Then `state_least_squares` resolves the half sample.

# %%
known = deadtime.estimate(log, "r", "p", method="state_least_squares", model=HERE / "uav_lateral_stabilised.toml")
print(known)
assert known.delay_s is not None and abs(known.delay_s - 0.13) < 0.001

# %% [markdown]
# ## Your own arrays
#
# Arrays, dicts of arrays, pandas and polars frames are logs too. Here a plant of one lag (0.5 s), sampled every 0.1 s, that hears its command 0.7 s late.

# %%
ts, n, delay = 0.1, 500, 0.7
u = deadtime.excite("rbs", n, seed=3, band=[0, 0.3])
plant = deadtime.TransferFunction([2.0], [0.5, 1.0], delay=delay)
y = deadtime.add_noise(deadtime.lsim(plant, u, sample_time=ts).y, snr=50.0, seed=4)

estimate = deadtime.estimate_delay(u, y, ts)
print(estimate)
assert estimate.outcome == "found" and estimate.delay_s is not None
assert abs(estimate.delay_s - delay) < 1e-9

# %% [markdown]
# `estimate_delay` runs one method, `oestruc` unless you name another. *All* methods and a verdict come from `estimate`, which takes the same arrays as a dict:

# %%
everything = deadtime.estimate({"time": ts * numpy.arange(n), "u": u, "y": y}, "u", "y")
print(everything.verdict)
assert everything.delay_s is not None and abs(everything.delay_s - delay) < 0.5 * ts

# %% [markdown]
# ## Logs that are not perfect
#
# NaN marks samples that an output misses. Time stamps may be uneven: then the error says where, and `resample` puts the log onto an even grid.

# %%
gaps = y.copy()
gaps[100:140] = numpy.nan
missing = deadtime.estimate_delay(u, gaps, ts)
assert missing.delay_s is not None and abs(missing.delay_s - delay) < 1e-9

rough = deadtime.read(HERE / "irregular.csv")
try:
    deadtime.estimate(rough, "valve", "pressure")
    raise AssertionError("uneven time stamps are refused")
except deadtime.errors.LogError as refused:
    print(refused)
even = deadtime.estimate(rough, "valve", "pressure", resample=0.05)
print(even.verdict)
assert even.delay_s is not None

# %% [markdown]
# ## No answer is an answer
#
# Where the output does not follow the input, no delay is made up.

# %%
unrelated = numpy.random.default_rng(5).standard_normal(n)
nothing = deadtime.estimate_delay(u, unrelated, ts)
print(nothing, "|", nothing.note)
assert nothing.delay_s is None and nothing.outcome == "not_visible"

# %% [markdown]
# ## Keep the result
#
# `save` writes `deadtime/estimate@1`, the same file as the command line's `--json`; `to_pandas` gives a row per method.

# %%
with TemporaryDirectory() as folder:
    path = Path(folder) / "estimate.json"
    everything.save(path)
    assert '"format": "deadtime/estimate@1"' in path.read_text(encoding="utf-8")
if find_spec("pandas"):
    print(everything.to_pandas()[["method", "outcome", "delay_s", "std_s", "counts"]].head())
