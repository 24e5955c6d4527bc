# %% [markdown]
# # Which method should I trust?
#
# There are more than thirty ways to estimate a delay. They see different things, need different things, and fail in different ways. This page shows how to choose:
# by what a method withstands, by what precision can be expected at all, and by a small study on delays that you injected yourself. Claims are checked with `assert`.

# %%
from __future__ import annotations

import math
from importlib.util import find_spec

import numpy

import deadtime

# %% [markdown]
# ## What there is
#
# `methods()` is a dict: names, and behind each what it is, what it needs, what it cannot see, and its options. Within a class the most trusted comes first.

# %%
methods = deadtime.methods()
for name in ("oestruc", "arxstruc", "p1d", "crosscorr", "threshold"):
    print(f"{name}: {methods[name].summary}; needs {methods[name].needs}")
help_text = methods["oestruc"].__doc__
assert help_text is not None and "nf" in help_text

# %% [markdown]
# A record shows complications: feedback, an unstable plant, coloured noise, a lag of the plant's own (`dynamics`), missing outputs, inputs that move together. A method
# says which it withstands. Two sensors that see the same signal have no dynamics between them: correlation is made for that, and for nothing else.

# %%
assert "dynamics" in methods["oestruc"].withstands
assert "dynamics" not in methods["crosscorr"].withstands
assert "feedback" in methods["arxstruc"].withstands
for condition in ("dynamics", "feedback", "unstable_plant", "coloured_noise"):
    print(f"{condition}: {', '.join(name for name, m in methods.items() if condition in m.withstands and m.scope == 'pair')}")

# %% [markdown]
# ## What can be expected at all
#
# The plant for the rest of this page: one lag of 1 s, a dead time of 0.73 s, samples every 0.1 s, at rest at zero when the record begins. Whatever method comes, the data
# bound its precision: before any estimation `predict_precision` says which standard deviation is to be expected, from the Cramér-Rao bound at a rough model of the record.

# %%
TS, SAMPLES, DELAY = 0.1, 300, 0.73
PLANT = deadtime.TransferFunction([1.0], [1.0, 1.0], delay=DELAY)


def record(seed: int, snr: float = 20.0, step: bool = False) -> dict[str, numpy.ndarray]:
    """A record of the plant: a random binary input or a single step, the response, noise at a ratio of variances."""
    u = deadtime.excite("step", SAMPLES, at=50) if step else deadtime.excite("rbs", SAMPLES, seed=seed, band=[0, 0.3])
    y = deadtime.lsim(PLANT, u, sample_time=TS, prehistory="rest").y
    return {"time": TS * numpy.arange(SAMPLES), "u": u, "y": deadtime.add_noise(y, snr, seed=1000 + seed)}


def expected(log: dict[str, numpy.ndarray]) -> float:
    """The standard deviation to be expected of `p1d`, samples."""
    precision = deadtime.predict_precision(log, "u", "y", method="p1d", detrend="none")["p1d"]
    assert precision is not None
    return precision["std_s"] / TS


rich, poor, noisy = expected(record(1)), expected(record(1, step=True)), expected(record(1, snr=1.0))
print(f"random input {rich:.3f} samples, one step {poor:.3f}, random input in noise as strong as the signal {noisy:.3f}")
# A single step says far less of the delay than an input that keeps moving, and noise costs by its standard deviation.
assert poor > 3 * rich
assert noisy > 3 * rich

# %% [markdown]
# ## A small study by hand
#
# The surest way to trust a method: inject a delay that you know, estimate it many times, and look. Root mean square error in samples; how often the 95 % interval holds the
# truth; how often there was no answer.

# %%
TRIALS = 25
NAMES = ["p1d", "oestruc", "arxstruc", "crosscorr", "threshold"]


def study(snr: float, detrend: deadtime.delays.Detrend = "none") -> dict[str, tuple[float, float, int]]:
    """Error (samples), share of intervals that hold the truth, and records without an answer, by method."""
    answers: dict[str, list[deadtime.Estimate]] = {name: [] for name in NAMES}
    for seed in range(1, TRIALS + 1):
        for estimate in deadtime.estimate(record(seed, snr), "u", "y", method=NAMES, detrend=detrend).pair.estimates:
            answers[estimate.method].append(estimate)
    table = {}
    for name, estimates in answers.items():
        found = [e for e in estimates if e.outcome == "found" and e.delay_s is not None and e.ci95_s is not None]
        errors = [(e.delay_s - DELAY) / TS for e in found if e.delay_s is not None]
        held = [e.ci95_s[0] <= DELAY <= e.ci95_s[1] for e in found if e.ci95_s is not None]
        rms = math.sqrt(sum(e * e for e in errors) / len(errors)) if errors else math.nan
        table[name] = (rms, sum(held) / len(held) if held else math.nan, TRIALS - len(found))
    return table


table = study(snr=20.0)
print(f"{'method':<10} {'error (samples)':>16} {'truth held':>11} {'no answer':>10}")
for name, (rms, held, without) in table.items():
    print(f"{name:<10} {rms:>16.3f} {held:>11.0%} {without:>10}")

# %% [markdown]
# - `p1d` has the plant's own form, one lag and a fraction of a sample: it is by far the most precise, near what was predicted, and its interval holds the truth.
# - `oestruc` and `arxstruc` count whole samples, so that 7.3 samples are 7 to them: they are off by a third of a sample, and their intervals say so.
# - `crosscorr` takes the lag of the plant for delay: off by two samples.

# %%
assert table["p1d"][0] < 2.0 * rich
assert table["p1d"][1] > 0.9
for name in ("oestruc", "arxstruc"):
    assert abs(table[name][0] - 0.3) < 0.05 and table[name][1] > 0.9
assert table["crosscorr"][0] > 1.5

# %% [markdown]
# The verdict of `estimate` knows this much: where the record shows a lag of the plant's own, neither `crosscorr` nor `p1d` is counted. For `p1d` that is caution: whether a
# plant has one lag or three no record says by itself, and with the wrong number `p1d` takes the rest for delay. Knowing your plant, you may trust it.

# %%
pair = deadtime.estimate(record(1), "u", "y", detrend="none").pair
print(pair.verdict)
for name in ("crosscorr", "p1d"):
    assert "dynamics" in pair[name].distrust and not pair[name].counts
assert pair["oestruc"].counts
assert pair.verdict.ci95_s is not None and pair.verdict.ci95_s[0] <= DELAY <= pair.verdict.ci95_s[1]

# %% [markdown]
# ## Where a record begins
#
# The record begins at rest at zero. Its mean is taken off by default, which is right for most logs, but here it would make a start at rest one that is not.
# So `estimate` looks which of the two explains the record better, and measures it from its rest: `p1d` stays as precise.

# %%
by_default = study(snr=20.0, detrend="mean")
print(f"p1d by default: {by_default['p1d'][0]:.3f} samples, as logged: {table['p1d'][0]:.3f}")
assert by_default["p1d"][0] < 1.1 * table["p1d"][0]

# %% [markdown]
# ## Against the bound
#
# The same study at three levels of noise: the error of `p1d` falls as the bound falls, by the root of the ratio.

# %%
levels = [5.0, 20.0, 80.0]
errors = [study(snr)["p1d"][0] for snr in levels]
bounds = [expected(record(1, snr)) for snr in levels]
for snr, error, bound in zip(levels, errors, bounds, strict=True):
    print(f"ratio {snr:>4.0f}: error {error:.3f} samples, predicted {bound:.3f}")
    assert 0.6 < error / bound < 1.6
assert errors[0] > 1.5 * errors[1] > 2.25 * errors[2]

if find_spec("matplotlib"):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 3.5), layout="constrained")
    axes = figure.subplots()
    axes.loglog(levels, errors, "o-", label="p1d")
    axes.loglog(levels, bounds, "--", label="predicted")
    axes.set(xlabel="signal to noise, ratio of variances", ylabel="error, samples")
    axes.legend()

# %% [markdown]
# Bigger questions (more plants, inputs, loops, thousands of records, all methods) go to `deadtime.study`, which does the same from a plan, on all cores.
