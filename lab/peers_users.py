"""What a user waits for beside what a user would run instead: whole runs of the program against SIPPY, scipy, MuJoCo's and nfoursid's identification.

Called by lab/peers with the path of the program; prints a Markdown page. Ours is timed as a process, from its start to its end, with the reading of its
logs. Peers are timed within a process that has imported them and has the numbers in memory.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import logging
import os
import subprocess
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import scipy.integrate
import scipy.optimize
import scipy.signal
from mujoco import sysid
from nfoursid.nfoursid import NFourSID

warnings.filterwarnings("ignore")
logging.disable(logging.WARNING)

SEED = 1
DELAYS = 36
ROOT = Path(__file__).resolve().parent.parent
JOINT = """
<mujoco model="joint">
  <option timestep="{step}" gravity="0 0 0"/>
  <worldbody>
    <body name="arm">
      <joint name="elbow" type="hinge" axis="0 0 1" stiffness="{stiffness}" damping="{damping}" armature="{armature}"
             frictionloss="{friction}" solreffriction="0.004 1"/>
      <inertial pos="0.15 0 0" mass="0.4" diaginertia="0.001 0.004 0.004"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="elbow"/></actuator>
  <sensor><jointpos name="angle" joint="elbow"/><jointvel name="speed" joint="elbow"/></sensor>
</mujoco>
"""
#: The body about its joint; the armature comes on top.
BODY = 0.004 + 0.4 * 0.15**2
TRUTH = {"damping": 0.06, "armature": 0.005, "stiffness": 1.5, "friction": 0.08}
#: Where every search begins.
START = {"damping": 0.1, "armature": 0.01, "stiffness": 1.0, "friction": 0.02}
EQUATION = """
format = "deadtime/model@1"
name = "joint"
kind = "equations"
inputs = [{{ name = "torque", unit = "N m" }}]
outputs = [{{ name = "angle", unit = "rad" }}, {{ name = "speed", unit = "rad/s" }}]
[states]
angle = {{ unit = "rad", initial = 0.0, initial_std = 0.01 }}
speed = {{ unit = "rad/s", initial = 0.0, initial_std = 0.05 }}
[parameters]
inertia = {{ unit = "kg m^2", value = {inertia} }}
damping = {{ unit = "N m s/rad", value = {damping} }}
stiffness = {{ unit = "N m/rad", value = {stiffness} }}
{more}
[derivatives]
angle = "speed"
speed = "(torque - damping*speed - stiffness*angle{friction})/inertia"
[output_equations]
angle = "angle"
speed = "speed"
"""


class Page:
    def __init__(self, program: str, folder: str, runs: int):
        self.program, self.folder, self.runs, self.missed = program, Path(folder), runs, []
        self.long: dict[str, tuple[list[float], str]] = {}

    def log(self, name: str, columns: dict[str, np.ndarray]) -> str:
        path = self.folder / name
        np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
        return str(path)

    def ours(self, *arguments: str) -> tuple[float, dict]:
        """Seconds of one run by the clock, and what it wrote as JSON."""
        out = self.folder / "answer.json"
        if arguments[0] in ("gap", "identify"):
            arguments = (*arguments, "--out", str(self.folder / ("diagnosis" if arguments[0] == "gap" else "identified.toml")))
        start = time.perf_counter()
        done = subprocess.run([self.program, *arguments, "--quiet", "--json", str(out)], stdout=subprocess.DEVNULL)
        seconds = time.perf_counter() - start
        if done.returncode == 2:
            raise SystemExit(f"deadtime {' '.join(arguments)} could not run")
        return seconds, json.loads(out.read_text())

    def head(self) -> None:
        print("\n| what is asked | ours, min (median) | aim | | ours answers | instead | its time, min (median) | ratio of minima (medians) | it answers |")
        print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |", flush=True)

    def row(
        self,
        what: str,
        arguments: list[str],
        read: Callable[[dict], str],
        peers: dict[str, tuple[Callable[[], object], Callable[[object], str], float]],
        aim: float | None = None,
    ) -> None:
        """peers: name, (function, what its result says, by what its time is multiplied to be the whole)."""
        mine, answer = [], {}
        theirs: dict[str, list[float]] = {name: [] for name in peers}
        said = {}
        for _ in range(self.runs):
            seconds, answer = self.ours(*arguments)
            mine.append(seconds)
            for name, (function, say, scale) in peers.items():
                # A long one is run once: what it would vary by is small beside it.
                if name in self.long:
                    theirs[name], said[name] = self.long[name]
                    continue
                start = time.perf_counter()
                with contextlib.redirect_stdout(io.StringIO()):
                    result = function()
                theirs[name].append((time.perf_counter() - start) * scale)
                said[name] = say(result)
                if theirs[name][0] > 20 * scale:
                    self.long[name] = (theirs[name], said[name])
        verdict = "" if aim is None else "met" if min(mine) <= aim else "**missed**"
        if verdict == "**missed**":
            self.missed.append(f"{what} ({human(min(mine))}, aim {human(aim)})")
        first = [what, spread(mine), "" if aim is None else f"≤ {human(aim)}", verdict, read(answer)]
        for name, times in theirs.items():
            ratio = f"{min(times) / min(mine):.3g}× ({np.median(times) / np.median(mine):.3g}×)"
            print("| " + " | ".join([*first, name, spread(times), ratio, said[name]]) + " |", flush=True)
            first = [""] * 5


def human(value: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value * 1e6:.3g} µs"


def spread(seconds: list[float]) -> str:
    return f"{human(min(seconds))} ({human(float(np.median(seconds)))})"


def record(rng: np.random.Generator, samples: int, ts: float, pole_s: float, delay_s: float, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """A plant of one pole behind a dead time, exact for its input, which is binary and held for five samples."""
    u = np.repeat(np.sign(rng.standard_normal(samples // 5 + 1)), 5)[:samples]
    y = first_order([1.0, pole_s, delay_s], u, ts)
    return u, y + noise * np.std(y) * rng.standard_normal(samples)


def first_order(p: np.ndarray | list[float], u: np.ndarray, ts: float) -> np.ndarray:
    """Gain, time constant and dead time, from rest, for an input that is held between samples."""
    gain, lag, delay = p
    whole = int(np.floor(delay / ts))
    rest = delay - whole * ts
    # What came before the dead time's last part acts until that has passed.
    early = np.exp(-(ts - rest) / lag) - np.exp(-ts / lag)
    late = 1 - np.exp(-(ts - rest) / lag)
    return scipy.signal.lfilter(gain * np.concatenate([np.zeros(whole + 1), [late, early]]), [1, -np.exp(-ts / lag)], u)


def per_delay(u: np.ndarray, y: np.ndarray, ts: float, delays: list[int], refine: bool) -> np.ndarray:
    """scipy's least squares of gain and time constant for each whole delay; then all three from the best."""

    def residual(p: np.ndarray, delay: float) -> np.ndarray:
        return first_order([p[0], p[1], delay], u, ts) - y

    bounds = ([-np.inf, 0.1 * ts], [np.inf, 1e3 * ts])
    fits = [scipy.optimize.least_squares(residual, [0.5, 10 * ts], args=(k * ts,), bounds=bounds, x_scale=[1, ts]) for k in delays]
    best = min(range(len(delays)), key=lambda k: fits[k].cost)
    start = [*fits[best].x, delays[best] * ts]
    if not refine:
        return np.array(start)
    bounds = ([-np.inf, 0.1 * ts, 0], [np.inf, 1e3 * ts, DELAYS * ts])
    # The loss has a kink at every whole sample: from there, and from half a sample to either side.
    starts = [np.clip(start[2] + half * ts, 1e-6, None) for half in (-0.5, 0.0, 0.5)]
    fits = [
        scipy.optimize.least_squares(lambda p: first_order(p, u, ts) - y, [*start[:2], delay], bounds=bounds, x_scale=[1, ts, ts]) for delay in starts
    ]
    return min(fits, key=lambda fit: fit.cost).x


def estimates(page: Page, rng: np.random.Generator) -> None:
    from sippy_unipi import system_identification

    ts = 0.02
    print("\n## A dead time, by all methods and by one")
    print(f"\nA plant of one pole at 0.2 s behind 0.19 s, sampled every {ts} s, with noise; {DELAYS} delays are searched. By all methods means every one of")
    print("`deadtime list methods` that can take the log, and what to believe of them. Each peer does less: one model for each whole delay, and the delay of the least loss.")
    print("SIPPY has no refined instrumental variables. Where few delays are run, that stands there, and the time is scaled to all.")
    page.head()

    def believed(answer: dict) -> str:
        found = {e["method"]: e["delay_s"] for pair in answer["pairs"] for e in pair["estimates"] if e["delay_s"] is not None}
        shown = [name for name in ("oestruc", "armaxstruc", "ivstruc", "p1d") if name in found]
        return f"{len(found)} methods; " + ", ".join(f"{name} {found[name]:.4g} s" for name in shown)

    def armax(u: np.ndarray, y: np.ndarray, delays: list[int]) -> Callable[[], float]:
        def scan() -> float:
            losses = []
            for k in delays:
                model = system_identification(y, u, "ARMAX", ARMAX_orders=[3, 3, 2, max(k - 1, 0)], ARMAX_mod="ILLS", max_iterations=100, tsample=ts)
                losses.append(float(np.ravel(model.Vn)[0]))
            return delays[int(np.argmin(losses))] * ts

        return scan

    def seconds(result: object) -> str:
        return f"{float(np.ravel(np.asarray(result))[-1]):.4g} s"

    for samples, few, aim in ((1_500, list(range(DELAYS)), 0.25), (100_000, [9], 5.0)):
        u, y = record(rng, samples, ts, 0.2, 0.19, 0.1)
        path = page.log(f"record{samples}.csv", {"time": np.arange(samples) * ts, "u": u, "y": y})
        some = "" if len(few) == DELAYS else f", {len(few)} delay, time scaled to {DELAYS}"
        some_fits = list(range(DELAYS)) if samples < 10_000 else [8, 9, 10]
        fitted = "" if len(some_fits) == DELAYS else f", {len(some_fits)} delays, time scaled to {DELAYS}"
        page.row(
            f"`estimate`, all methods, {samples} samples",
            ["estimate", path, "--input", "u", "--output", "y"],
            believed,
            {
                f"SIPPY `ARMAX` by `ILLS`, orders 3, 3, 2, per delay{some}": (armax(u, y, few), seconds if not some else lambda _: "", DELAYS / len(few)),
                f"scipy `least_squares`, one pole, per delay{fitted}": (
                    lambda u=u, y=y, some=some_fits: per_delay(u, y, ts, some, False),
                    seconds,
                    DELAYS / len(some_fits),
                ),
            },
            aim,
        )
        if samples < 10_000:
            page.row(
                f"`estimate --method p1d`, {samples} samples",
                ["estimate", path, "--input", "u", "--output", "y", "--method", "p1d"],
                lambda answer: f"{answer['pairs'][0]['estimates'][0]['delay_s']:.6g} s",
                {
                    "scipy `least_squares`, one pole, per delay, then with the dead time free": (
                        lambda u=u, y=y: per_delay(u, y, ts, list(range(DELAYS)), True),
                        lambda p: f"{p[2]:.6g} s",
                        1,
                    )
                },
            )


def held(rng: np.random.Generator, samples: int, every: int, size: float) -> np.ndarray:
    return np.repeat(size * rng.standard_normal(samples // every + 1), every)[:samples]


def noisy(rng: np.random.Generator, y: np.ndarray, share: float = 0.03) -> np.ndarray:
    return y + share * y.std(axis=0) * rng.standard_normal(y.shape)


def causes(answer: dict) -> str:
    named = [f"{e['effect']}, " + ", ".join(f"{p['name']} {p['value']:.4g} {p['unit']}" for p in e["parameters"][:2]) for e in effects(answer)]
    return f"`{answer['cause']['verdict']}`" + (f" ({'; '.join(named)})" if named else "")


def effects(answer: dict) -> list[dict]:
    return answer["cause"].get("effects", [])


def diagnoses(page: Page, rng: np.random.Generator) -> None:
    ts, samples = 0.01, 6_000
    time_s = np.arange(samples) * ts
    print("\n## A diagnosis")
    print("\nThree logs of 60 s at 100 Hz of a machine whose actuator lags by 0.08 s, with noise; the model has no lag. `gap` tries every cause of its catalogue wherever it")
    print("can act, and judges on data it has not seen. No peer does that. What stands instead does less: a user who suspects this one cause already fits it,")
    print("by scipy's `least_squares` over a simulation with the lag as one state more.")
    page.head()

    def linear(lag: float, u: np.ndarray) -> np.ndarray:
        a = np.array([[-0.26408514, -0.14106016, 9.29265436], [-8.43128442, -12.80335648, -46.95699092], [0, 1, 0]])
        b = np.array([[9.379], [851.287], [0.0]])
        c = np.array([[0, 1, 0], [-0.26408514, -0.14106016, -0.51734564]])
        d = np.array([[0.0], [9.379]])
        whole = np.block([[a, b], [np.zeros((1, 3)), np.array([[-1 / lag]])]])
        return scipy.signal.lsim((whole, np.array([[0], [0], [0], [1 / lag]]), np.hstack([c, d]), np.zeros((2, 1))), u, time_s, interp=False)[1]

    def masses(lag: float, u: np.ndarray) -> np.ndarray:
        """Each held piece of the input by solve_ivp."""

        def rate(_: float, x: np.ndarray, command: float) -> list[float]:
            x1, v1, x2, v2, drive = x
            force = 60 * (x1 - x2)
            return [v1, 9 * drive - force - 1.5 * v1 - 0.3 * v1 * abs(v1) - 9 * np.sin(x1), v2, force - 1.5 * v2, (command - drive) / lag]

        x, y = np.zeros(5), np.empty((samples, 2))
        ends = np.append(np.flatnonzero(np.diff(u)) + 1, samples)
        start = 0
        for end in ends:
            at = np.arange(start, end + 1) * ts
            piece = scipy.integrate.solve_ivp(rate, (at[0], at[-1]), x, t_eval=at, args=(u[start],), rtol=1e-6, atol=1e-9)
            y[start:end] = piece.y[[0, 3], :-1].T
            x, start = piece.y[:, -1], end
        return y

    cases = (
        ("linear, 3 states", ROOT / "examples/uav_lateral_stabilised.toml", "r", ("p", "ay"), linear, 0.6, "scipy `lsim`"),
        ("equations, 4 states", ROOT / "benches/support/two_masses.toml", "u", ("angle", "rate"), masses, 2.5, "scipy `solve_ivp`"),
    )
    for name, model, channel, outputs, simulate, aim, by in cases:
        logs = []
        for k in range(3):
            u = held(rng, samples, 20, 0.5)
            y = noisy(rng, simulate(0.08, u))
            columns = {"time": time_s, channel: u, outputs[0]: y[:, 0], outputs[1]: y[:, 1]}
            logs.append((page.log(f"{channel}{k}.csv", columns), u, y))
        spreads = np.mean([y.std(axis=0) for _, _, y in logs], axis=0)

        def fit(simulate: Callable = simulate, logs: list = logs, spreads: np.ndarray = spreads) -> float:
            def residual(p: np.ndarray) -> np.ndarray:
                return np.concatenate([((simulate(p[0], u) - y) / spreads).ravel() for _, u, y in logs])

            return float(scipy.optimize.least_squares(residual, [0.03], bounds=([1e-3], [1.0]), x_scale=[0.1]).x[0])

        page.row(
            f"`gap`, {name}",
            ["gap", "--model", str(model), *(part for path, _, _ in logs for part in ("--log", path))],
            causes,
            {f"`least_squares` of the lag alone over {by}": (fit, lambda lag: f"lag {lag:.4g} s", 1)},
            aim,
        )


def joints(page: Page, rng: np.random.Generator) -> None:
    ts, samples = 0.01, 6_000
    time_s = np.arange(samples) * ts
    print("\n## A joint in MuJoCo")
    print("\nThe joint of examples/mujoco_joint.py: three logs of 60 s at 100 Hz, a time step of 0.5 ms in the machine and of 2 ms in the simulator of MuJoCo's own `mujoco.sysid`,")
    print("which fits armature, damping, stiffness and dry friction. Ours fits the joint's equation, whose inertia is the body's and the armature's; the armature is")
    print("what is left. `gap` is given the equation without friction, the other three right, and has to find out that it is friction.")
    print(f"\nTrue: {told(TRUTH)}. Both fits begin at {told(START)}.")
    page.head()
    machine = mujoco.MjModel.from_xml_string(JOINT.format(step=0.0005, **TRUTH))
    spec = mujoco.MjSpec.from_string(JOINT.format(step=0.002, **START))
    data = mujoco.MjData(machine)
    logs, controls, sensors, paths = [], [], [], []
    for k in range(3):
        torque = np.repeat(rng.uniform(-1.0, 1.0, samples // 25 + 1), 25)[:samples] * np.where(time_s < 30.0, 0.4, 1.0)
        mujoco.mj_resetData(machine, data)
        y = np.empty((samples, 2))
        for j in range(samples):
            y[j] = data.qpos[0], data.qvel[0]
            data.ctrl[0] = torque[j]
            mujoco.mj_step(machine, data, 20)
        y += np.array([0.005, 0.05]) * rng.standard_normal(y.shape)
        logs.append((torque, y))
        paths.append(page.log(f"joint{k}.csv", {"time": time_s, "torque": torque, "angle": y[:, 0], "speed": y[:, 1]}))
        # Its controls are interpolated to the simulator's steps: given at those they are held, as the machine held them.
        steps = np.arange((samples - 1) * 5 + 1) * 0.002
        controls.append(sysid.TimeSeries(steps, np.repeat(torque, 5)[: len(steps), None]))
        sensors.append(sysid.TimeSeries.from_names(time_s, y, spec.compile()))

    def by_mujoco() -> dict[str, float]:
        attribute = {"friction": "frictionloss"}
        parameters = sysid.ParameterDict()
        for name, value in START.items():

            def write(spec: mujoco.MjSpec, parameter: sysid.Parameter, name: str = attribute.get(name, name)) -> None:
                slot = getattr(spec.joint("elbow"), name)
                if np.ndim(slot):
                    slot[0] = parameter.value[0]
                else:
                    setattr(spec.joint("elbow"), name, parameter.value[0])

            parameters.add(sysid.Parameter(name, nominal=value, min_value=0.0, max_value=20 * value, modifier=write))
        initial = sysid.create_initial_state(spec.compile(), np.zeros(1), np.zeros(1), np.zeros(0))
        sequences = sysid.ModelSequences("joint", spec, [f"log{k}" for k in range(3)], [initial] * 3, controls, sensors)
        residual = sysid.build_residual_fn(models_sequences=[sequences])
        fitted, _ = sysid.optimize(initial_params=parameters, residual_fn=residual, optimizer="mujoco", verbose=False)
        return {name: float(fitted[name].value[0]) for name in START}

    peers = {"`mujoco.sysid.optimize`, four parameters": (by_mujoco, told, 1)}
    structure = page.folder / "joint.toml"
    friction = {"more": 'friction = {{ unit = "N m", value = {} }}'.format(START["friction"]), "friction": " - friction*tanh(speed/0.01)"}
    numbers = {"damping": START["damping"], "stiffness": START["stiffness"]}
    structure.write_text(EQUATION.format(inertia=BODY + START["armature"], **numbers, **friction))

    def fitted(answer: dict) -> str:
        values = {p["name"]: p["value"] for p in answer["parameters"]}
        return told({"damping": values["damping"], "armature": values["inertia"] - BODY, "stiffness": values["stiffness"], "friction": values["friction"]})

    page.row("`identify --structure`, four parameters", ["identify", "--structure", str(structure), "--free", "all", *paths], fitted, peers)
    plain = page.folder / "plain.toml"
    right = {"damping": TRUTH["damping"], "stiffness": TRUTH["stiffness"]}
    plain.write_text(EQUATION.format(inertia=BODY + TRUTH["armature"], **right, more="", friction=""))

    def cause(answer: dict) -> str:
        levels = [p["value"] for e in effects(answer) for p in e["parameters"] if e["effect"] == "coulomb_friction" and p["name"] == "level"]
        return causes(answer) + "".join(f": {level * (BODY + TRUTH['armature']):.4g} N m" for level in levels)

    page.row("`gap`, the whole catalogue", ["gap", "--model", str(plain), *(part for path in paths for part in ("--log", path))], cause, peers)


def told(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items())


def subspaces(page: Page, rng: np.random.Generator) -> None:
    from nfoursid.utils import Decomposition, Utils

    print("\n## A linear model of a log")
    print("\nFour inputs, four outputs, eight states, white inputs and noise. The order is given, and the past is 10 samples for both; ours also gives standard deviations, of 200")
    print("draws. nfoursid's `NFourSID` takes the full singular value decomposition of a matrix with a column for each sample. At 100000 samples that is 80 GB. So it runs")
    print("as it is at 4000 samples; at 100000 its decomposition is made thin, which is not what it ships. slycot, as pinned, wraps no identification routine of SLICOT. The answer")
    print("is how far the eigenvalues are from the true ones, at most.")
    page.head()
    angles, radii = np.array([0.3, 0.8, 1.4, 2.1]), np.array([0.95, 0.9, 0.85, 0.8])
    blocks = [r * np.array([[np.cos(w), np.sin(w)], [-np.sin(w), np.cos(w)]]) for r, w in zip(radii, angles, strict=True)]
    a = scipy.linalg.block_diag(*blocks)
    true = np.linalg.eigvals(a)
    b, c = rng.standard_normal((8, 4)), rng.standard_normal((4, 8))

    def off(eigenvalues: np.ndarray) -> str:
        """Each with the nearest."""
        return f"{max(np.min(np.abs(np.asarray(eigenvalues) - p)) for p in true):.1e}"

    thin = Utils.eigenvalue_decomposition

    def decomposed(matrix: np.ndarray) -> Decomposition:
        u, s, v = np.linalg.svd(matrix, full_matrices=False)
        return Decomposition(u, np.diag(s), v)

    for samples, patched in ((4_000, False), (100_000, True)):
        u = rng.standard_normal((samples, 4))
        y = scipy.signal.dlsim((a, b, c, np.zeros((4, 4)), 1.0), u)[1]
        y = noisy(rng, y, 0.1)
        names = [f"u{k}" for k in range(4)], [f"y{k}" for k in range(4)]
        columns = {"time": np.arange(samples) * 0.01, **dict(zip(names[0], u.T, strict=True)), **dict(zip(names[1], y.T, strict=True))}
        path = page.log(f"mimo{samples}.csv", columns)
        frame = pd.DataFrame({name: columns[name] for part in names for name in part})

        def by_nfoursid(frame: pd.DataFrame = frame, names: tuple = names, patched: bool = patched) -> np.ndarray:
            Utils.eigenvalue_decomposition = staticmethod(decomposed if patched else thin)
            method = NFourSID(frame, output_columns=names[1], input_columns=names[0], num_block_rows=10)
            method.subspace_identification()
            model, _ = method.system_identification(rank=8)
            return np.linalg.eigvals(model.a)

        sides = [part for name in names[0] for part in ("--input", name)] + [part for name in names[1] for part in ("--output", name)]
        for method in ("n4sid", "pbsidopt"):
            page.row(
                f"`identify --method {method}`, {samples} samples",
                ["identify", path, *sides, "--method", method, "--order", "8", "--past", "10", "--delay", "none"],
                lambda answer: off(eigenvalues(answer)),
                {"`NFourSID`" + (", decomposition made thin" if patched else ""): (by_nfoursid, off, 1)},
            )
        Utils.eigenvalue_decomposition = staticmethod(thin)


def eigenvalues(answer: dict) -> np.ndarray:
    return np.linalg.eigvals(np.array(answer["model"]["A"]))


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("program")
    arguments.add_argument("--runs", type=int, default=5)
    arguments.add_argument("--only", default="", help="estimates, diagnoses, joints or subspaces")
    options = arguments.parse_args()
    print("# What a user waits for\n")
    print("`lab/peers --users` prints this page: whole runs of the program, from start to end with the reading of the logs, beside what a user would run instead. The others")
    print("are favoured: their imports are not counted, and their numbers are in memory already. Runs in turns; the ratio is their time over ours.")
    print(f"Every program takes the threads it takes by default; {os.cpu_count()} processors, {options.runs} runs, one of what takes over 20 s. Seed {SEED}.")
    with tempfile.TemporaryDirectory() as folder:
        page = Page(options.program, folder, options.runs)
        for case in (estimates, diagnoses, joints, subspaces):
            if options.only in ("", case.__name__):
                case(page, np.random.default_rng(SEED))
    print("\nAll aims met." if not page.missed else "\nMissed: " + "; ".join(page.missed) + ".")


if __name__ == "__main__":
    main()
