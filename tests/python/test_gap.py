"""The gap diagnosis from Python: of models as the command line does it, and of functions that simulate."""

from __future__ import annotations

import _thread
import json
import subprocess
import sys
import threading
import time as clock
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deadtime
from deadtime import errors

Array = np.ndarray

TS = 0.02
NOISE = 0.03
NOMINAL = {"stiffness": 9.0, "gain": 1.0}


def servo(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
    """A servo, angle and rate, exactly sampled: x'' = k (g u - x) - 2.4 x'; commands are held."""
    k, g = parameters["stiffness"], parameters["gain"]
    decay = 1.2
    omega = np.sqrt(k - decay**2)
    y = np.empty((len(time), 2))
    x, v = x0
    for n in range(len(time)):
        y[n] = x, v
        if n + 1 == len(time):
            break
        h = time[n + 1] - time[n]
        target = g * u[n, 0]
        a, b = x - target, (v + decay * (x - target)) / omega
        e, c, s = np.exp(-decay * h), np.cos(omega * h), np.sin(omega * h)
        x = target + e * (a * c + b * s)
        v = e * ((b * omega - decay * a) * c - (a * omega + decay * b) * s)
    return y


FACE: dict[str, Any] = {
    "inputs": {"u": "V"},
    "outputs": {"angle": "rad", "rate": "rad/s"},
    "states": {"x": (0.0, 0.02), "v": (0.0, 0.02)},
    "parameters": {"stiffness": (9.0, "1/s^2"), "gain": 1.0},
}


def commands(samples: int, rng: np.random.Generator) -> Array:
    """Steps of many heights and lengths."""
    lengths = rng.integers(5, 60, samples)
    return np.repeat(rng.uniform(-1.0, 1.0, samples), lengths)[:samples]


def finer(u: Array, time: Array, x0: Array, change: Callable[[Array, Array], Array], parameters: dict[str, float] = NOMINAL) -> Array:
    """The servo under commands that change ten times per sample: `change` makes of the held commands, at the fine times, what the machine gets."""
    fine = np.arange(10 * len(time)) * TS / 10
    return servo(change(np.repeat(u[:, 0], 10), fine)[:, None], fine, x0, parameters)[::10]


def record(name: str, seed: int, real: Callable[[Array, Array, Array], Array], samples: int = 700) -> deadtime.Log:
    rng = np.random.default_rng(seed)
    time = TS * np.arange(samples)
    u = commands(samples, rng)[:, None]
    y = real(u, time, 0.02 * rng.standard_normal(2))
    y = y + NOISE * y.std(axis=0) * rng.standard_normal(y.shape)
    return deadtime.Log(time, {"u": u[:, 0], "angle": y[:, 0], "rate": y[:, 1]}, {"u": "V", "angle": "rad", "rate": "rad/s"}, source=name)


def perfect(u: Array, time: Array, x0: Array) -> Array:
    return servo(u, time, x0, NOMINAL)


def diagnosed(real: Callable[[Array, Array, Array], Array], seed: int = 1, **more: Any) -> deadtime.Diagnosis:
    return deadtime.gap(log=record("a", seed, real), holdout=record("b", seed + 1, real), **{"simulate": servo, **FACE, **more})


def late(u: Array, time: Array, x0: Array, delay: float = 0.054) -> Array:
    steps = round(delay / (TS / 10))
    return finer(u, time, x0, lambda v, t: np.concatenate([np.full(steps, v[0]), v[:-steps]]))


def stronger(u: Array, time: Array, x0: Array) -> Array:
    return servo(1.25 * u, time, x0, NOMINAL)


def dead(u: Array, time: Array, x0: Array) -> Array:
    return servo(np.sign(u) * np.maximum(np.abs(u) - 0.15, 0.0), time, x0, NOMINAL)


def biased(u: Array, time: Array, x0: Array) -> Array:
    return perfect(u, time, x0) + [0.1, 0.0]


def stiff(u: Array, time: Array, x0: Array) -> Array:
    return servo(u, time, x0, {"stiffness": 12.0, "gain": 1.0})


def gusty(u: Array, time: Array, x0: Array) -> Array:
    return finer(u, time, x0, lambda v, t: v + np.where(np.sin(0.7 * t) > 0.6, 0.5 * np.sin(9.0 * t), 0.0))


@pytest.mark.parametrize(
    ("real", "effect", "channel", "value", "tolerance"),
    [
        (late, "input_delay", "u", 0.054, 0.004),
        (dead, "deadband", "u", 0.15, 0.02),
        (biased, "sensor_bias", "angle", 0.1, 0.02),
        (stiff, "parameter_error", "stiffness", 12.0, 0.5),
    ],
    ids=["delay", "deadband", "bias", "parameter"],
)
def test_an_effect_of_the_machine_is_named_through_a_function(
    real: Callable[[Array, Array, Array], Array], effect: str, channel: str, value: float, tolerance: float
) -> None:
    found = diagnosed(real)
    assert (found.verdict, found.channel) == (effect, channel), found.ranking[:4]
    parameter = found.effects[0]["parameters"][0]
    assert parameter["value"] == pytest.approx(value, abs=tolerance)
    low, high = parameter["ci95"]
    assert low < parameter["value"] < high
    assert found.shrink["of_explainable"] > 0.9
    assert found.calls is not None and 0 < found.calls < 1500


def test_a_gain_that_is_a_parameter_too_is_named_as_either() -> None:
    found = diagnosed(stronger)
    assert any({"input_gain:u", "parameter_error:gain"} <= set(names) for names in found.indistinguishable), found.indistinguishable
    alone = diagnosed(stronger, parameters={"stiffness": 9.0}, simulate=lambda u, t, x0, p: servo(u, t, x0, {**p, "gain": 1.0}))
    assert (alone.verdict, alone.channel) == ("input_gain", "u")
    assert alone.effects[0]["parameters"][0]["value"] == pytest.approx(1.25, abs=0.03)


def test_nothing_is_named_where_the_simulator_is_right_and_unknown_where_no_effect_explains() -> None:
    assert diagnosed(perfect).verdict == "none"
    assert diagnosed(gusty).verdict == "unknown"


def test_what_cannot_be_tried_is_listed_with_the_reason() -> None:
    found = diagnosed(biased)
    why = {left["effect"]: left["why"] for left in found.not_tried}
    needs_equations = {"coulomb_friction", "quadratic_drag", "cubic_stiffness", "cross_coupling", "unmodelled_mode", "constant_disturbance"}
    assert needs_equations <= set(why)
    assert all("black box" in why[effect] for effect in needs_equations)
    assert not {"input_delay", "parameter_error", "sensor_bias", "clock_skew"} & set(why)
    bare = diagnosed(biased, parameters=None, simulate=lambda u, t, x0, p: servo(u, t, x0, NOMINAL))
    assert "no parameter" in {left["effect"]: left["why"] for left in bare.not_tried}["parameter_error"]
    assert found.model is None
    assert found.prediction["mode"] == "simulation" and "only called" in found.prediction["why"]


def test_a_recorded_run_is_a_simulator_whose_inputs_and_parameters_move_nothing() -> None:
    log = record("a", 3, perfect)
    recorded = np.column_stack([log["angle"], log["rate"]])
    real = deadtime.Log(log.time, {"u": log["u"], "angle": log["angle"], "rate": log["rate"] + 0.7}, source="a")
    found = deadtime.gap(log=real, simulate=lambda u, time, x0, parameters: recorded[: len(time)], **FACE)
    assert (found.verdict, found.channel) == ("sensor_bias", "rate")
    why = {left["effect"]: left["why"] for left in found.not_tried}
    assert "input `u`" in why["input_delay"] and "parameter" in why["parameter_error"]
    assert any("`gain`" in caveat and "does not apply it" in caveat for caveat in found.caveats)
    assert found.calls is not None and found.calls < 40


def test_a_diagnosis_can_be_read_written_and_drawn(tmp_path: Path) -> None:
    found = diagnosed(stiff)
    lines = found.summary.splitlines()
    assert [line.split(":")[0] for line in lines] == ["Cause", "Shrink", "Left", "Gap", "Place"]
    assert repr(found).startswith(found.summary) and f"Calls of the simulator: {found.calls}" in repr(found)
    assert "<table>" in found._repr_html_() and "parameter error" in found._repr_html_()
    assert found.save(tmp_path / "out") == ["diagnosis.json", "report.html"]
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text()) == found.to_dict() == json.loads(found.to_json())
    assert found.gap["before"] > found.gap["floor"] and found.where["outputs"][0]["share"] > 0
    assert {check["check"] for check in found.checks} >= {"sign", "unit", "excitation"}
    trace = found.traces[0]
    assert trace["time"].shape == trace["measured"].shape == trace["before"].shape == (700,)
    assert trace["after"] is not None and trace["after"].shape == (700,)
    pytest.importorskip("matplotlib")
    figure = found.plot()
    curves = [line.get_label() for line in figure.axes[0].get_lines()]
    assert len(figure.axes) == 4 and {"measured", "simulated", "with what was found"} <= set(curves)
    with pytest.raises(ValueError, match="there is no log"):
        found.plot(log="nowhere")


@pytest.mark.parametrize("real", [late, stiff, biased], ids=["delay", "parameter", "bias"])
def test_the_function_with_what_was_found_is_where_the_next_diagnosis_starts(real: Callable[[Array, Array, Array], Array]) -> None:
    first = diagnosed(real)
    better = first.simulator
    assert better is not None and better.effects[0]["effect"] == first.verdict
    again = diagnosed(real, seed=5, simulate=better)
    assert again.verdict == "none", again.ranking[:3]
    log = record("c", 9, real)
    y = better(log["u"][:, None], log.time, np.zeros(2), NOMINAL)
    left = np.column_stack([log["angle"], log["rate"]]) - y
    before = np.column_stack([log["angle"], log["rate"]]) - servo(log["u"][:, None], log.time, np.zeros(2), NOMINAL)
    assert y.shape == (700, 2) and (left[100:].std(axis=0) <= before[100:].std(axis=0) + 1e-9).all()
    assert np.abs(left[100:].mean(axis=0)).max() < 0.03


# Models


def test_a_horizon_tells_the_error_by_the_samples_ahead(examples: Path) -> None:
    found = deadtime.gap(examples / "uav_lateral_stabilised.toml", examples / "uav_flight.csv", horizon=20)
    assert (found.verdict, found.prediction["mode"], found.prediction["horizon"]) == ("input_delay", "horizon", 20)
    horizons = found.shrink["horizons"]
    assert [h["samples"] for h in horizons] == [1, 2, 5, 10, 20]
    assert all(h["after"] < 0.5 * h["before"] for h in horizons)
    with pytest.raises(errors.GapError, match="1 to 375 samples"):
        deadtime.gap(examples / "uav_lateral_stabilised.toml", examples / "uav_flight.csv", horizon=376)
    with pytest.raises(errors.GapError, match="no other prediction mode"):
        deadtime.gap(examples / "uav_lateral_stabilised.toml", examples / "uav_flight.csv", prediction="predictor", horizon=20)


def test_a_model_gets_the_verdict_of_the_command_line(tmp_path: Path, examples: Path) -> None:
    found = deadtime.gap(examples / "uav_lateral_stabilised.toml", log=examples / "uav_flight.csv")
    words = ["gap", "--model", "examples/uav_lateral_stabilised.toml", "--log", "examples/uav_flight.csv", "--out", str(tmp_path / "cli")]
    subprocess.run([sys.executable, "-m", "deadtime", *words], cwd=examples.parent, check=True, capture_output=True)
    expected = json.loads((tmp_path / "cli" / "diagnosis.json").read_text())
    got = found.to_dict()
    for data in (expected, got):
        data["logs"] = [Path(name).name for name in data["logs"]]
        data["holdout"] = [{**part, "log": Path(part["log"]).name} for part in data["holdout"]]
        for span in data["where"]["times"]:
            span["log"] = Path(span["log"]).name
    # Findings name the log's path.
    assert {k: v for k, v in got.items() if k != "checks"} == {k: v for k, v in expected.items() if k != "checks"}
    assert found.save(tmp_path / "py") == ["diagnosis.json", "report.html", "model_with_effects.toml"]
    written = (tmp_path / "py" / "model_with_effects.toml").read_text()
    assert written == (tmp_path / "cli" / "model_with_effects.toml").read_text()
    assert found.model is not None and found.simulator is None and found.calls is None


def test_a_model_and_a_frame_may_be_given_as_they_are(examples: Path) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_csv(examples / "uav_flight.csv")
    of_frame = deadtime.gap(model=str(examples / "uav_lateral_stabilised.toml"), log=[frame])
    of_file = deadtime.gap(deadtime.Model.read(examples / "uav_lateral_stabilised.toml"), log=deadtime.read(examples / "uav_flight.csv"))
    assert (of_frame.verdict, of_frame.channel, of_frame.effects) == (of_file.verdict, of_file.channel, of_file.effects)


def test_frames_are_logs_for_a_function_too() -> None:
    pandas = pytest.importorskip("pandas")
    log = record("a", 1, biased)
    frame = pandas.DataFrame({"time": log.time, "u [V]": log["u"], "angle [rad]": log["angle"], "rate [rad/s]": log["rate"]})
    assert deadtime.gap(log=frame, simulate=servo, **FACE).verdict == "sensor_bias"
    wrong = frame.rename(columns={"angle [rad]": "angle [deg]"})
    with pytest.raises(errors.LogError, match="angle"):
        deadtime.gap(log=wrong, simulate=servo, **FACE)


def test_check_and_isolability_take_models_and_functions(examples: Path, tmp_path: Path) -> None:
    model, flight = examples / "uav_lateral_stabilised.toml", examples / "uav_flight.csv"
    looked = deadtime.check(model, log=flight)
    assert looked.not_run is None and looked.to_dict()["format"] == "deadtime/check@1" and looked.logs[0]["samples"] == len(deadtime.read(flight))
    apart = deadtime.isolability(model, log=flight)
    assert apart.to_dict()["format"] == "deadtime/isolability@1" and apart.cosines.shape == (len(apart.effects),) * 2
    upside_down = record("a", 1, lambda u, time, x0: -perfect(u, time, x0))
    wrong = deadtime.check(simulate=servo, log=upside_down, **FACE)
    assert any(check["check"] == "sign" for check in wrong.failed), wrong
    assert "LOOK" in repr(wrong)
    seen = deadtime.isolability(simulate=servo, log=record("a", 1, perfect), **FACE)
    assert any({"input_gain:u", "parameter_error:gain"} <= set(c["members"]) for c in seen.classes)
    assert "coulomb_friction" not in {effect["effect"] for effect in seen.effects}
    seen.save(tmp_path / "seen.json")
    assert json.loads((tmp_path / "seen.json").read_text()) == seen.to_dict()
    with pytest.raises(errors.FileError):
        seen.save(tmp_path)


# What a function does wrong


def refused(simulate: Any, kind: type[Exception] = errors.GapError, **more: Any) -> str:
    with pytest.raises(kind) as told:
        deadtime.gap(log=record("run 7", 1, perfect, 300), simulate=simulate, **{**FACE, **more})
    return str(told.value)


def test_answers_of_another_shape_or_kind_are_refused_with_what_came() -> None:
    assert "(300, 2) is needed" in refused(lambda u, t, x0, p: np.zeros(300))
    assert "return y.T" in refused(lambda u, t, x0, p: np.zeros((2, 300)))
    assert "returned None" in refused(lambda u, t, x0, p: None)
    assert "complex128" in refused(lambda u, t, x0, p: np.zeros((300, 2), dtype=complex))
    assert "run 7" in refused(lambda u, t, x0, p: "no numbers")

    def hole(u: Array, time: Array, x0: Array, p: dict[str, float]) -> Array:
        y = servo(u, time, x0, p)
        y[17, 1] = np.nan
        return y

    told = refused(hole)
    assert "run 7" in told and "`rate`" in told and "sample 17" in told and "NaN" in told


def test_one_output_may_be_a_plain_vector() -> None:
    log = record("a", 1, biased)
    found = deadtime.gap(
        log=log, simulate=lambda u, t, x0, p: servo(u, t, x0, NOMINAL)[:, 0], inputs=["u"], outputs=["angle"], states={"x": (0.0, 0.02), "v": (0.0, 0.02)}
    )
    assert (found.verdict, found.channel) in {("sensor_bias", "*"), ("sensor_bias", "angle")}


def test_an_exception_of_the_function_is_the_cause_of_ours() -> None:
    def broken(u: Array, time: Array, x0: Array, p: dict[str, float]) -> Array:
        return servo(u, time, x0, {"stiffness": p["stifness"], "gain": 1.0})

    with pytest.raises(errors.GapError, match="KeyError: 'stifness'") as told:
        deadtime.gap(log=record("run 7", 1, perfect, 300), simulate=broken, **FACE)
    assert isinstance(told.value.__cause__, KeyError)
    assert "broken" in "".join(traceback.format_exception(told.value.__cause__))
    assert "run 7" in str(told.value)


def test_a_rival_that_fails_is_given_up_and_told() -> None:
    def fussy(u: Array, time: Array, x0: Array, p: dict[str, float]) -> Array:
        if np.abs(u).max() > 1.1:
            raise OverflowError("command out of range")
        return servo(u, time, x0, p)

    found = diagnosed(late, simulate=fussy)
    assert found.verdict == "input_delay"
    assert any("OverflowError: command out of range" in caveat for caveat in found.caveats), found.caveats


def test_a_function_that_does_not_repeat_itself_is_refused() -> None:
    rng = np.random.default_rng(1)
    told = refused(lambda u, t, x0, p: servo(u, t, x0, p) + 0.01 * rng.standard_normal((len(t), 2)))
    assert "seed" in told and "run 7" in told
    state = {"x": np.zeros(2)}

    def goes_on(u: Array, time: Array, x0: Array, p: dict[str, float]) -> Array:
        y = servo(u, time, state["x"], p)
        state["x"] = y[-1]
        return y

    assert "begin afresh" in refused(goes_on)


def test_an_unstable_function_is_refused_and_one_that_never_forgets_is_told() -> None:
    def unstable(u: Array, time: Array, x0: Array, p: dict[str, float]) -> Array:
        y = np.empty((len(time), 2))
        x = x0[0]
        for n in range(len(time)):
            y[n] = x, 3.0 * x
            x += TS * (3.0 * x + u[n, 0])
        return y

    assert "close the loop" in refused(unstable)

    def cart(u: Array, time: Array, x0: Array, p: dict[str, float]) -> Array:
        v = x0[1] + np.concatenate([[0.0], np.cumsum(u[:-1, 0] * np.diff(time))])
        return np.column_stack([x0[0] + np.concatenate([[0.0], np.cumsum(v[:-1] * np.diff(time))]), v])

    found = deadtime.gap(log=record("a", 1, lambda u, t, x0: cart(u, t, x0, {})), simulate=cart, **{**FACE, "parameters": None})
    assert found.verdict == "none"
    assert any("integrates" in caveat for caveat in found.caveats)
    assert "is left at the end" in found.prediction["why"]


def test_a_function_of_single_precision_will_do() -> None:
    found = diagnosed(late, simulate=lambda u, t, x0, p: servo(u, t, x0, p).astype(np.float32))
    assert (found.verdict, found.channel) == ("input_delay", "u")


def test_wrong_arguments_say_the_remedy(examples: Path) -> None:
    log = record("a", 1, perfect, 300)
    model = examples / "uav_lateral_stabilised.toml"
    with pytest.raises(TypeError, match="model or a function"):
        deadtime.gap(log=log)
    with pytest.raises(TypeError, match="not both"):
        deadtime.gap(model, log, simulate=servo, **FACE)
    with pytest.raises(TypeError, match="goes with simulate"):
        deadtime.gap(model, log, inputs=["u"])
    with pytest.raises(TypeError, match="not a function"):
        deadtime.gap(log=log, simulate=3, **FACE)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="outputs is missing"):
        deadtime.gap(log=log, simulate=servo, inputs=["u"])
    with pytest.raises(TypeError, match="at least one log"):
        deadtime.gap(simulate=servo, **FACE)
    with pytest.raises(TypeError, match="states: x is \\[\\]"):
        deadtime.gap(log=log, simulate=servo, **{**FACE, "states": {"x": ([], 1.0)}})
    # A word is the channel that the state is started from.
    with pytest.raises(errors.GapError, match="no channel is called `zero`"):
        deadtime.gap(log=log, simulate=servo, **{**FACE, "states": {"x": ("zero", 1.0)}})
    with pytest.raises(ValueError, match="prediction is `both`"):
        deadtime.gap(log=log, simulate=servo, prediction="both", **FACE)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="threads is 0"):
        deadtime.gap(log=log, simulate=servo, threads=0, **FACE)
    with pytest.raises(ValueError, match="seed is -1"):
        deadtime.gap(log=log, simulate=servo, seed=-1, **FACE)
    with pytest.raises(errors.GapError, match="simulated freely"):
        deadtime.gap(log=log, simulate=servo, prediction="predictor", **FACE)
    with pytest.raises(errors.GapError, match="simulated freely"):
        deadtime.gap(log=log, simulate=servo, horizon=10, **FACE)
    with pytest.raises(ValueError, match="horizon is 0"):
        deadtime.gap(log=log, simulate=servo, horizon=0, **FACE)
    with pytest.raises(errors.GapError, match="longest delay"):
        deadtime.gap(log=log, simulate=servo, max_delay=-1.0, **FACE)
    with pytest.raises(errors.GapError, match="torque"):
        deadtime.gap(log=log, simulate=servo, **{**FACE, "inputs": ["torque"]})
    with pytest.raises(errors.SimulateError, match="`angle`"):
        deadtime.gap(log=log, simulate=servo, **{**FACE, "outputs": ["angle", "angle"]})
    with pytest.raises(errors.SimulateError, match="standard deviation"):
        deadtime.gap(log=log, simulate=servo, **{**FACE, "states": {"x": (0.0, -1.0)}})


# Beside the interpreter


def test_a_function_may_itself_use_deadtime() -> None:
    system = deadtime.StateSpace([[0.0, 1.0], [-9.0, -2.4]], [[0.0], [9.0]], [[1.0, 0.0], [0.0, 1.0]], [[0.0], [0.0]])

    def simulate(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
        deadtime._native._busy(0.0)  # what long work of the package does
        return np.asarray(deadtime.lsim(system, u, time, x0=x0).y)

    found = diagnosed(biased, simulate=simulate, parameters=None)
    assert (found.verdict, found.channel) == ("sensor_bias", "angle")


def test_a_function_may_diagnose_within_a_diagnosis() -> None:
    inner: list[str] = []

    def simulate(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
        if not inner:
            inner.append("begun")
            inner.append(diagnosed(biased).verdict)
        return servo(u, time, x0, parameters)

    assert diagnosed(biased, simulate=simulate, threads=2).verdict == "sensor_bias"
    assert inner == ["begun", "sensor_bias"]


def test_nuisances_of_a_model_file_have_a_value_in_every_log(tmp_path: Path) -> None:
    model = tmp_path / "servo.toml"
    model.write_text("""
format = "deadtime/model@1"
name = "servo"
kind = "lti"
inputs = [{ name = "u", unit = "V" }]
outputs = [{ name = "angle", unit = "rad" }, { name = "rate", unit = "rad/s" }]
states = [{ name = "x", unit = "rad" }, { name = "v", unit = "rad/s" }]
initial = [0.0, 0.0]
initial_std = [0.02, 0.02]
A = [[0.0, 1.0], [-9.0, -2.4]]
B = [[0.0], [9.0]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]

[[nuisances]]
effect = "sensor_bias"
channel = "angle"
std = 0.3
""")
    offsets = [0.2, -0.3]

    def off(by: float) -> Callable[[Array, Array, Array], Array]:
        return lambda u, time, x0: servo(u, time, x0, NOMINAL) + [by, 0.0]

    logs = [record(f"log{i}", 900 + i, off(by)) for i, by in enumerate(offsets)]
    found = deadtime.gap(str(model), logs)
    assert found.verdict == "none" and not found.contributions
    assert [(n["effect"], n["channel"], n["log"], n["unit"]) for n in found.nuisances] == [
        ("sensor_bias", "angle", f"log{i}", "rad") for i in range(2)
    ]
    for nuisance, by in zip(found.nuisances, offsets, strict=True):
        assert abs(nuisance["value"] - by) < 3 * nuisance["std"] < 0.05 and nuisance["prior_std"] == 0.3


def test_calls_come_one_at_a_time_from_one_thread() -> None:
    threads: set[int] = set()
    inside = threading.Lock()

    def simulate(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
        assert inside.acquire(blocking=False), "two calls at once"
        threads.add(threading.get_ident())
        clock.sleep(0.0005)  # the interpreter's lock is free meanwhile
        y = servo(u, time, x0, parameters)
        inside.release()
        return y

    found = diagnosed(biased, simulate=simulate)
    assert found.verdict == "sensor_bias" and not found.caveats and len(threads) == 1


def test_equal_calls_are_made_once() -> None:
    seen: list[bytes] = []

    def simulate(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
        seen.append(u.tobytes() + time.tobytes() + x0.tobytes() + repr(parameters).encode())
        return servo(u, time, x0, parameters)

    found = diagnosed(biased, simulate=simulate)
    assert found.calls == len(seen)
    # One call is made twice, to see whether it repeats itself.
    assert len(seen) - len(set(seen)) == 1


def test_progress_is_told_and_its_exceptions_end_the_work() -> None:
    told: list[tuple[float, str]] = []
    diagnosed(biased, progress=lambda share, words: told.append((share, words)))
    assert told[0][1] == "simulating the model as it is" and told[-1] == (0.95, "writing the answer")
    assert all(0.0 <= share <= 1.0 for share, _ in told)

    class Enough(Exception):
        pass

    def stop(share: float, words: str) -> None:
        raise Enough

    with pytest.raises(Enough):
        diagnosed(biased, progress=stop)


def test_what_ends_a_program_ends_the_diagnosis() -> None:
    calls = 0

    def leaves(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
        nonlocal calls
        calls += 1
        if calls == 30:
            raise SystemExit(4)
        return servo(u, time, x0, parameters)

    with pytest.raises(SystemExit):
        diagnosed(late, simulate=leaves)
    assert calls == 30


@pytest.mark.parametrize("waits", [False, True], ids=["computing", "waiting"])
def test_ctrl_c_is_heard_while_the_function_runs(waits: bool) -> None:
    log = record("a", 1, late)
    begun = threading.Event()

    def slow(u: Array, time: Array, x0: Array, parameters: dict[str, float]) -> Array:
        begun.set()
        until = clock.perf_counter() + 0.4
        while clock.perf_counter() < until:
            if waits:
                clock.sleep(0.4)
        return servo(u, time, x0, parameters)

    # Once more where the machine was busy.
    for _ in range(4):
        begun.clear()
        pressed: list[float] = []

        def press() -> None:
            begun.wait()
            clock.sleep(0.1)
            pressed.append(clock.perf_counter())
            _thread.interrupt_main()

        threading.Thread(target=press).start()
        with pytest.raises(KeyboardInterrupt):
            deadtime.gap(log=log, simulate=slow, **FACE)
        took = clock.perf_counter() - pressed[0]
        clock.sleep(0.5)  # the last call ends
        if took < 0.2:
            return
    raise AssertionError(f"Ctrl-C was heard after {took:.3f} s")
