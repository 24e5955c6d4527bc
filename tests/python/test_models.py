"""Systems and models: what they hold, what they refuse, and numbers that can be derived by hand."""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
from pathlib import Path

import numpy
import pytest

import deadtime
from deadtime import Model, StateSpace, TransferFunction
from deadtime.errors import EffectError, FileError, ModelError, RegistryError, TimeError

LAG = TransferFunction([3.0], [1.0, 2.0])


def oscillator(**more: object) -> StateSpace:
    """y'' + 4 y = u with y and y' as outputs."""
    return StateSpace([[0.0, 1.0], [-4.0, 0.0]], [[0.0], [1.0]], numpy.eye(2), **more)  # type: ignore[arg-type]


def test_a_system_gives_back_what_it_was_made_of() -> None:
    a, b, c, d = numpy.array([[-1.0, 2.0], [0.0, -3.0]]), [[1.0, 0.0], [0.5, 4.0]], [[1.0, 1.0]], [[0.0, 7.0]]
    system = StateSpace(a, b, c, d, 0.1, [0.3, 0.0])
    assert (system.order, system.inputs, system.outputs, system.sample_time) == (2, 2, 1, 0.1)
    for ours, given in zip((system.A, system.B, system.C, system.D), (a, b, c, d), strict=True):
        assert numpy.array_equal(ours, given)
    assert system.input_delay == pytest.approx([0.3, 0.0])
    # What is handed out is the user's to change.
    system.A[0, 0] = 99.0
    assert system.A[0, 0] == -1.0


def test_numbers_stand_for_matrices_of_one_entry_and_a_missing_d_for_zeros() -> None:
    assert StateSpace(-1, 2, 3) == StateSpace([[-1.0]], [[2.0]], [[3.0]], [[0.0]])
    assert StateSpace(-1, 2, 3, input_delay=0.5).input_delay.tolist() == [0.5]
    gain = StateSpace(numpy.zeros((0, 0)), numpy.zeros((0, 2)), numpy.zeros((1, 0)), [[5.0, 6.0]])
    assert gain.order == 0 and gain.dc_gain().tolist() == [[5.0, 6.0]] and gain.is_stable


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: StateSpace([[1, 2]], 1, 1), ModelError, "matrix A is 1 by 2"),
        (lambda: StateSpace([1.0, 2.0], 1, 1), ValueError, "two, rows and columns"),
        (lambda: StateSpace([[1j]], 1, 1), TypeError, "real numbers"),
        (lambda: StateSpace([["a"]], 1, 1), TypeError, "real numbers"),
        (lambda: StateSpace(math.nan, 1, 1), ModelError, "finite"),
        (lambda: StateSpace(1, 1, 1, sample_time=0.0), TimeError, "above 0"),
        (lambda: StateSpace(1, 1, 1, input_delay=-1.0), TimeError, "delay"),
        (lambda: StateSpace(1, 1, 1, input_delay=[1.0, 2.0]), ModelError, "input delays"),
        (lambda: StateSpace(0.5, 1, 1, sample_time=0.1, input_delay=0.25), ModelError, "multiples of its sample time"),
        (lambda: TransferFunction([1, 0, 0], [1, 1]), ModelError, "2 zeros and 1 poles"),
        (lambda: TransferFunction([1], [0.0, 0.0]), ModelError, "denominator"),
        (lambda: TransferFunction.from_zeros_poles_gain([], [1j], 1.0), ModelError, "conjugate"),
        (lambda: LAG.to_state_space().select(0, 3), ModelError, "no input 3"),
        (lambda: LAG.to_state_space().relative_degree(3), ModelError, "no output 3"),
        (lambda: deadtime.c2d(LAG, 0.1, "zhO"), RegistryError, "there are: zoh, foh"),
        (lambda: deadtime.c2d(LAG, 0.1, "tustin", prewarp=3.0), RegistryError, "prewarp_rad_s"),
        (lambda: deadtime.c2d(LAG, 0.1, "tustin", prewarp_rad_s=300.0), ModelError, "Nyquist"),
        (lambda: deadtime.c2d(deadtime.c2d(LAG, 0.1), 0.1), ModelError, "continuous"),
        (lambda: deadtime.c2d(oscillator(), 0.1, "matched"), ModelError, "one input and one output"),
        (lambda: deadtime.d2c(LAG), ModelError, "sampled"),
        (lambda: deadtime.dlqr(LAG, 1, 1), ModelError, "c2d first"),
        (lambda: deadtime.dlqr([[1.2]], [[0.0]], 1, 1), ModelError, "not stabilisable"),
        (lambda: deadtime.dlqr([[0.5]], [[1.0]], 1, -1), ModelError, "positive definite"),
        (lambda: deadtime.dlqr([[0.5]], [[1.0]]), TypeError, "A, B, Q, R"),
        (lambda: deadtime.uav("sideways"), RegistryError, "lateral, longitudinal"),
        (lambda: Model.read("nowhere.toml"), FileError, "No such file"),
        (lambda: Model.read("nowhere.yaml"), ModelError, "toml or .json"),
        (lambda: Model.from_toml("format = 3"), ModelError, "model: "),
        (lambda: Model.from_dict({"format": "deadtime/model@9"}), ModelError, "deadtime/model@1"),
        (lambda: Model.from_dict({"format": {1, 2}}), TypeError, "not set"),
        (lambda: deadtime.as_model(3), TypeError, "not int"),
        (lambda: deadtime.as_system("lateral"), TypeError, "not str"),
    ],
)
def test_what_cannot_be_is_refused_with_its_reason(make: object, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        make()  # type: ignore[operator]


def test_poles_zeros_and_gains_of_a_known_system() -> None:
    # (s + 1)(s + 5) / ((s + 2)(s^2 + 2s + 10)), dc gain 5/20.
    tf = TransferFunction.from_zeros_poles_gain([-1.0, -5.0], [-2.0, -1 + 3j, -1 - 3j], 1.0)
    system = tf.to_state_space()
    assert numpy.sort(system.zeros().real) == pytest.approx([-5.0, -1.0], abs=1e-12)
    assert numpy.sort_complex(system.poles()) == pytest.approx([-2.0, -1 - 3j, -1 + 3j], abs=1e-12)
    assert tf.num == pytest.approx([1.0, 6.0, 5.0]) and tf.den == pytest.approx([1.0, 4.0, 14.0, 20.0])
    assert system.dc_gain() == pytest.approx(0.25)
    assert system.is_stable and system.relative_degree() == 1 and tf.relative_degree == 1
    at = (1j + 1) * (1j + 5) / ((1j + 2) * (-1 + 2j + 10))
    assert tf.frequency_response(1.0) == pytest.approx(at) and system.frequency_response(1.0)[0, 0] == pytest.approx(at)
    assert system.frequency_response([1.0, 2.0, 3.0]).shape == (1, 1, 3)
    back = system.transfer_function()
    assert back.num == pytest.approx(tf.num, abs=1e-12) and back.den == pytest.approx(tf.den, abs=1e-12)


def test_a_delay_turns_the_phase_and_nothing_else() -> None:
    delayed = TransferFunction([3.0], [1.0, 2.0], delay=0.25)
    omega = numpy.array([0.1, 1.0, 10.0])
    assert delayed.frequency_response(omega) == pytest.approx(LAG.frequency_response(omega) * numpy.exp(-0.25j * omega))
    sampled = deadtime.c2d(delayed, 0.05)
    assert sampled.input_delay == pytest.approx([0.25])
    as_states = sampled.with_delays_as_states()
    assert (as_states.order, as_states.input_delay.tolist()) == (6, [0.0])
    assert as_states.frequency_response(omega) == pytest.approx(sampled.frequency_response(omega))
    with pytest.raises(ValueError, match="c2d"):
        delayed.to_state_space().with_delays_as_states()


def test_a_constant_gain_is_infinite_where_a_pair_integrates_and_there_only() -> None:
    both = StateSpace([[0.0, 0.0], [0.0, -2.0]], numpy.eye(2), numpy.eye(2))
    assert both.dc_gain().tolist() == [[math.inf, 0.0], [0.0, 0.5]]
    assert not both.is_stable


def test_the_lag_behind_a_hold_has_the_pole_and_gain_of_its_formula() -> None:
    sampled = deadtime.c2d(LAG, 0.1)
    assert sampled.A[0, 0] == pytest.approx(math.exp(-0.2), rel=1e-15)
    assert sampled.dc_gain() == pytest.approx(1.5)
    back = deadtime.d2c(sampled)
    assert back.A == pytest.approx(-2.0) and back.dc_gain() == pytest.approx(1.5)


def test_tustin_with_prewarping_is_exact_at_its_frequency() -> None:
    sampled = deadtime.c2d(LAG, 0.3, "tustin", prewarp_rad_s=4.0)
    assert sampled.frequency_response(4.0)[0, 0] == pytest.approx(LAG.frequency_response(4.0), rel=1e-13)
    assert deadtime.c2d(LAG, 0.3, "tustin").frequency_response(4.0)[0, 0] != pytest.approx(LAG.frequency_response(4.0), rel=1e-3)


def test_the_conversions_that_are_listed_all_work() -> None:
    listed = deadtime.conversions()
    assert {line["name"] for line in listed} == {"zoh", "foh", "impulse", "tustin", "gbt", "euler", "backward_diff", "matched", "least_squares"}
    for line in listed:
        sampled = deadtime.c2d(LAG, 0.05, line["name"], **line["options"])
        # All of them are near the continuous response far below the Nyquist frequency, at most half a sample late.
        assert sampled.frequency_response(0.5)[0, 0] == pytest.approx(LAG.frequency_response(0.5), rel=0.06), line["name"]


def test_the_scalar_regulator_has_the_golden_ratio_as_its_solution() -> None:
    # x = 1 + x − x²/(1 + x) has the solution (1 + √5)/2.
    gain, solution, poles = deadtime.dlqr([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    golden = (1 + math.sqrt(5)) / 2
    assert solution[0, 0] == pytest.approx(golden) and gain[0, 0] == pytest.approx(golden / (1 + golden))
    assert poles[0] == pytest.approx(1 - golden / (1 + golden))
    assert deadtime.dare(1, 1, 1, 1)[0, 0] == pytest.approx(golden)
    system = StateSpace(1, 1, 1, sample_time=0.1)
    assert deadtime.dlqr(system, 1, 1).K[0, 0] == gain[0, 0]
    assert deadtime.dlqr(system, 1, 1, 0.2).K[0, 0] == deadtime.dlqr(1, 1, 1, 1, N=0.2).K[0, 0]
    with pytest.raises(ModelError, match="with_delays_as_states"):
        deadtime.dlqr(StateSpace(1, 1, 1, sample_time=0.1, input_delay=0.1), 1, 1)


def test_representations_show_what_a_person_wants_to_see() -> None:
    assert repr(oscillator()).splitlines()[:2] == ["<StateSpace: continuous, 2 states, 1 input, 2 outputs", "  A = [[0, 1], [-4, 0]]"]
    large = StateSpace(-numpy.eye(20), numpy.ones((20, 1)), numpy.ones((1, 20)), sample_time=0.5, input_delay=1.0)
    assert repr(large) == "<StateSpace: sampled every 0.5 s, 20 states, 1 input, 1 output, input delay 1 s>"
    assert large._repr_latex_() is None
    assert r"\dot x" in (oscillator()._repr_latex_() or "")
    assert repr(LAG) == "<TransferFunction: continuous, num [3], den [1, 2]>"
    assert TransferFunction([1, -2], [1, 0, 5.0], 0.1, 0.3)._repr_latex_() == r"$$\frac{z - 2}{z^{2} + 5}\,z^{-3},\quad T_s = 0.1\,\mathrm{s}$$"
    assert repr(deadtime.uav("lateral")) == "<Model lateral: lti, continuous; delta_lat -> p, ay; 3 states>"


@pytest.mark.parametrize(
    "value",
    [
        oscillator(),
        oscillator(sample_time=0.1, input_delay=0.3),
        LAG,
        TransferFunction([1, 0.3], [1, 0.2, 0.7], 0.1, 0.2),
        deadtime.uav("lateral"),
    ],
)
def test_systems_and_models_travel_to_workers(value: object) -> None:
    assert pickle.loads(pickle.dumps(value)) == value
    assert value != 3


def test_equal_systems_have_equal_numbers() -> None:
    assert oscillator() == oscillator()
    assert oscillator() != oscillator(sample_time=0.1)
    assert oscillator() != oscillator(input_delay=0.1)


def test_a_model_keeps_its_file_through_every_form(examples: Path, tmp_path: Path) -> None:
    for path in sorted(examples.rglob("*.toml")):
        if "deadtime/model@1" not in path.read_text(encoding="utf-8"):
            continue
        model = deadtime.as_model(path)
        assert Model.from_dict(model.to_dict()) == model == Model.from_toml(model.to_toml()) == pickle.loads(pickle.dumps(model))
        for name in ("copy.toml", "copy.json"):
            model.write(tmp_path / name)
            assert deadtime.as_model(str(tmp_path / name)) == model, path


def test_a_model_names_its_channels(examples: Path) -> None:
    model = deadtime.as_model(examples / "uav_lateral_delayed.toml")
    assert (model.kind, model.inputs, model.outputs, model.states) == ("lti", ["r"], ["p", "ay"], ["v", "p", "phi"])
    assert model.units["p"] == "rad/s"
    assert [e["effect"] for e in model.effects] == ["input_delay"]
    assert model.with_effects([]).effects == []
    cart = deadtime.as_model(examples / "cart_pendulum.toml")
    assert cart.kind == "equations" and cart.sample_time is None and cart.parameters
    with pytest.raises(ModelError, match="lti"):
        cart.system()


def test_effects_are_checked_when_they_are_put_into_a_model() -> None:
    model = deadtime.uav("lateral")
    entry = {"effect": "input_delay", "channel": "delta_lat", "parameters": {"delay": 0.031}}
    assert model.with_effects([entry]).effects == [entry]
    limit = {"effect": "saturation", "channel": "delta_lat", "parameters": {"upper": 0.5}}
    limited = model.with_effects([limit])
    assert Model.from_dict(limited.to_dict()) == limited
    for wrong, message in [
        ({**entry, "effect": "input_dely"}, "no effect"),
        ({**entry, "channel": "delta_ver"}, "delta_lat"),
        ({**entry, "parameters": {"delay": -1.0}}, "between 0 and"),
        ({**entry, "parameters": {"lag": 1.0}}, "no parameter"),
    ]:
        with pytest.raises(EffectError, match=message):
            model.with_effects([wrong])


def test_the_catalogue_lists_all_effects_and_where_each_can_act() -> None:
    every = deadtime.effects()
    assert len(every) == 49 and {line["site"] for line in every} == {"input", "dynamics", "output", "clock"}
    on_model = deadtime.effects(deadtime.uav("lateral"))
    rows = [(row["effect"], row["channel"]) for row in on_model]
    assert ("input_delay", "delta_lat") in rows and ("parameter_error", "A[v,phi]") in rows
    sampled = deadtime.effects(deadtime.c2d(deadtime.uav("lateral"), 0.01))
    assert "dynamics" not in {row["site"] for row in sampled}


def test_a_system_becomes_a_simulator_with_names() -> None:
    model = Model.from_system(
        deadtime.c2d(LAG, 0.1),
        ["valve"],
        ["level"],
        ["level_state"],
        name="tank",
        units={"valve": "1", "level": "m"},
        operating={"valve": "mean", "level": 2.0},
        initial=[0.5],
        initial_std=[0.1],
    )
    data = model.to_dict()
    assert (model.name, model.inputs, model.outputs, model.states, model.sample_time) == ("tank", ["valve"], ["level"], ["level_state"], 0.1)
    assert (data["inputs"][0]["operating"], data["outputs"][0]["operating"], data["initial"]) == ("mean", 2.0, [0.5])
    assert model.system() == deadtime.c2d(LAG, 0.1)
    several = Model.from_system(oscillator(input_delay=0.2))
    assert (several.inputs, several.outputs, several.states) == (["u"], ["y1", "y2"], ["x1", "x2"])
    assert several.system() == oscillator(input_delay=0.2)
    for arguments, message in [({"outputs": ["one"]}, "1 output_labels named"), ({"units": {"z": "m"}}, "no `z`"), ({"initial": [1.0]}, "initial")]:
        with pytest.raises(ModelError, match=message):
            Model.from_system(oscillator(), **arguments)


def test_equations_become_a_simulator() -> None:
    model = Model.from_equations(
        {"angle": "speed", "speed": "(torque - viscous*speed)/inertia"},
        {"angle": "angle"},
        ["torque"],
        {"inertia": 0.02, "viscous": 0.1},
        name="servo",
        units={"torque": "N m", "angle": "rad", "inertia": "kg m^2"},
        initial_std={"angle": 0.0},
        input_delay={"torque": 0.01},
    )
    assert (model.kind, model.states, model.parameters) == ("equations", ["angle", "speed"], {"inertia": 0.02, "viscous": 0.1})
    assert Model.from_toml(model.to_toml()) == model
    with pytest.raises(ModelError, match="torq"):
        Model.from_equations({"v": "torq"}, {"v": "v"}, ["torque"])


def test_a_converted_model_keeps_its_names_and_start() -> None:
    data = deadtime.uav("lateral").to_dict() | {"initial": [1.0, 0.0, 0.0]}
    sampled = deadtime.c2d(Model.from_dict(data), 0.01)
    assert isinstance(sampled, Model) and sampled.states == ["v", "p", "phi"] and sampled.to_dict()["initial"] == [1.0, 0.0, 0.0]
    # The states of Tustin's model are others.
    assert "initial" not in deadtime.c2d(Model.from_dict(data), 0.01, "tustin").to_dict()
    with pytest.raises(ModelError, match="effects"):
        deadtime.c2d(Model.from_dict(data).with_effects([{"effect": "input_gain", "channel": "delta_lat", "parameters": {"gain": 2.0}}]), 0.01)


def test_the_vehicle_is_the_one_of_the_thesis() -> None:
    whole = deadtime.uav().system()
    assert (whole.order, whole.inputs, whole.outputs) == (9, 4, 6) and not whole.is_stable
    assert deadtime.uav("vertical").system().poles() == pytest.approx([-0.731])


def test_no_neighbour_is_imported_with_the_package() -> None:
    code = (
        "import sys, deadtime; deadtime.step_response(deadtime.uav('vertical')); deadtime.as_system(([1], [1, 1])); "
        "print([n for n in ('scipy', 'control', 'pandas', 'polars', 'matplotlib') if n in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"
