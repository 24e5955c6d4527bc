"""Responses: against formulas, on every kind of time, and a model on a log."""

from __future__ import annotations

import os
import signal
import threading
import time as clock
from pathlib import Path

import numpy
import pytest

import deadtime
from deadtime import Log, Model, StateSpace, TransferFunction
from deadtime.errors import EffectError, LogError, SignalError, SimulateError, TimeError

LAG = TransferFunction([3.0], [1.0, 2.0])
RNG = numpy.random.default_rng(7)


def lag_step(t: numpy.ndarray, delay: float = 0.0) -> numpy.ndarray:
    """The step response of LAG by its formula."""
    since = t - delay
    return numpy.where(since > 0, 1.5 * (1 - numpy.exp(-2 * numpy.maximum(since, 0))), 0.0)


def test_the_step_response_is_that_of_the_formula() -> None:
    time, y = deadtime.step_response(LAG, 3.0, 0.1)
    assert len(time) == 31 and time[-1] == pytest.approx(3.0)
    assert y == pytest.approx(lag_step(time), abs=1e-14)
    delayed = TransferFunction([3.0], [1.0, 2.0], delay=0.234)
    assert deadtime.step_response(delayed, 3.0, 0.1).y == pytest.approx(lag_step(time, 0.234), abs=1e-14)
    # Without a duration it is long enough to settle.
    assert deadtime.step_response(LAG).y[-1] == pytest.approx(1.5, rel=2e-3)
    assert LAG.to_state_space().step_response(3.0, 0.1).y.tolist() == y.tolist()


def test_the_impulse_response_is_that_of_the_formula_and_has_unit_area_when_sampled() -> None:
    time, y = deadtime.impulse_response(LAG, 3.0, 0.1)
    assert y == pytest.approx(3 * numpy.exp(-2 * time), rel=1e-13)
    sampled = StateSpace(0.5, 1, 1, 2, sample_time=0.25)
    # Markov parameters 2, 1, 0.5, … over Ts.
    assert deadtime.impulse_response(sampled, 1.0).y == pytest.approx([8.0, 4.0, 2.0, 1.0, 0.5])
    assert sampled.impulse_response(1.0).time == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])


def test_responses_of_several_channels_are_one_array_of_time_output_input() -> None:
    system = StateSpace([[-1.0, 0.0], [0.0, -2.0]], numpy.eye(2), [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    y = deadtime.step_response(system, 1.0, 0.1).y
    assert y.shape == (11, 3, 2)
    assert y[:, 0, 1].tolist() == [0.0] * 11 and y[:, 2, 1] == pytest.approx(y[:, 1, 1])
    for wrong in (-1.0, numpy.nan):
        with pytest.raises(ValueError, match="duration"):
            deadtime.step_response(system, wrong)
    with pytest.raises(TimeError, match="differ"):
        deadtime.step_response(deadtime.c2d(LAG, 0.1), 1.0, 0.2)


def test_a_held_input_gives_the_same_on_even_uneven_and_sampled_time() -> None:
    system = TransferFunction([1.0, 2.0], [1.0, 0.6, 4.0], delay=0.35)
    u = RNG.standard_normal(60)
    time = numpy.arange(60) * 0.1
    by_step, by_time = deadtime.lsim(system, u, sample_time=0.1), deadtime.lsim(system, u, time)
    assert by_step.y == pytest.approx(by_time.y, abs=1e-12)
    # Stamps off the grid by a millionth of a second are uneven for the machine and the same for the eye.
    jittered = time + 1e-6 * RNG.uniform(-1, 1, 60)
    assert deadtime.lsim(system, u, jittered).y == pytest.approx(by_step.y, abs=1e-4)
    # Prehistory at rest, as a transfer function of z has it.
    sampled = deadtime.lsim(deadtime.c2d(system, 0.1), u, prehistory="rest")
    assert sampled.y == pytest.approx(deadtime.lsim(system, u, time, prehistory="rest").y, abs=1e-12)


def test_a_ramp_in_straight_lines_is_followed_exactly() -> None:
    # y' = −2y + 3t from rest: 1.5 t − 0.75 (1 − exp(−2t)).
    time = numpy.array([0.0, 0.2, 0.3, 0.9, 1.0, 2.5])
    exact = 1.5 * time - 0.75 * (1 - numpy.exp(-2 * time))
    assert deadtime.lsim(LAG, time, time, hold="linear").y == pytest.approx(exact, abs=1e-13)
    assert deadtime.lsim(LAG, time, time).y != pytest.approx(exact, abs=1e-3)


def test_a_free_motion_starts_from_its_state() -> None:
    response = deadtime.lsim(StateSpace(-2, 1, 1), numpy.zeros(20), sample_time=0.1, x0=[5.0])
    assert response.y == pytest.approx(5 * numpy.exp(-2 * response.time), rel=1e-13)


def test_shapes_are_samples_first_and_results_unpack() -> None:
    system = StateSpace(-numpy.eye(3), numpy.ones((3, 2)), numpy.ones((4, 3)))
    response = deadtime.lsim(system, numpy.ones((7, 2)), sample_time=0.5)
    time, y, x = response
    assert (time.shape, y.shape, x.shape, response.u.shape) == ((7,), (7, 4), (7, 3), (7, 2))
    assert deadtime.lsim(LAG, numpy.ones(7), sample_time=0.5).y.shape == (7,)
    assert deadtime.lsim(LAG, numpy.ones((7, 1)), sample_time=0.5).y.shape == (7,)
    assert "7 samples" in repr(response)
    assert deadtime.lsim(LAG, [], sample_time=0.5).y.shape == (0,)
    assert deadtime.lsim(LAG, [1], sample_time=0.5).y.tolist() == [0.0]
    # Columns of a larger array, in the other memory order.
    wide = numpy.asfortranarray(RNG.standard_normal((40, 6)))
    assert numpy.array_equal(
        deadtime.lsim(system, wide[::2, 1:5:3], sample_time=0.5).y,
        deadtime.lsim(system, numpy.ascontiguousarray(wide[::2, 1:5:3]), sample_time=0.5).y,
    )


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"u": numpy.ones((5, 2)), "sample_time": 0.1}, SimulateError, "1 inputs, the signal has 2"),
        ({"u": [1.0, numpy.nan], "sample_time": 0.1}, SimulateError, "sample 1"),
        ({"u": numpy.ones(5)}, ValueError, "time or sample_time"),
        ({"u": numpy.ones(5), "time": [0, 1, 2, 3, 4], "sample_time": 1.0}, ValueError, "not both"),
        ({"u": numpy.ones(5), "time": [0.0, 1.0]}, SimulateError, "2 time stamps and 5"),
        ({"u": numpy.ones(3), "time": [0.0, 2.0, 1.0]}, SimulateError, "must increase"),
        ({"u": numpy.ones(3), "time": [0.0, numpy.nan, 1.0]}, SimulateError, "must increase"),
        ({"u": numpy.ones(3), "sample_time": -1.0}, TimeError, "above 0"),
        ({"u": numpy.ones(3), "sample_time": 0.1, "x0": [1.0, 2.0]}, SimulateError, "1 states"),
        ({"u": numpy.ones(3), "sample_time": 0.1, "hold": "cubic"}, ValueError, "cubic"),
        ({"u": numpy.ones(3), "sample_time": 0.1, "prehistory": "wild"}, ValueError, "wild"),
        ({"u": numpy.ones((2, 2, 2)), "sample_time": 0.1}, ValueError, "3 dimensions"),
        ({"u": ["a", "b"], "sample_time": 0.1}, ValueError, "could not convert"),
    ],
)
def test_what_cannot_be_simulated_is_refused_with_its_reason(arguments: dict[str, object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        deadtime.lsim(LAG, **arguments)  # type: ignore[arg-type]


def test_a_sampled_system_keeps_to_its_own_grid() -> None:
    sampled = deadtime.c2d(LAG, 0.1)
    u = numpy.ones(5)
    assert numpy.array_equal(deadtime.lsim(sampled, u).time, numpy.arange(5) * 0.1)
    assert deadtime.lsim(sampled, u, 3.0 + numpy.arange(5) * 0.1).y.tolist() == deadtime.lsim(sampled, u).y.tolist()
    with pytest.raises(SimulateError, match="asks for 0.1"):
        deadtime.lsim(sampled, u, numpy.arange(5) * 0.2)
    with pytest.raises(TimeError, match="differ"):
        deadtime.lsim(sampled, u, sample_time=0.2)


def test_an_unstable_system_that_leaves_the_numbers_says_when() -> None:
    with pytest.raises(SimulateError, match="explodes"):
        deadtime.lsim(TransferFunction([1], [1, -100]), numpy.ones(1000), sample_time=0.1)


def test_a_model_on_a_log_is_what_lsim_says(examples: Path) -> None:
    log = deadtime.read(examples / "uav_flight.csv")
    model = deadtime.as_model(examples / "uav_lateral_stabilised.toml")
    simulated = deadtime.simulate(model, log, states=True)
    by_lsim = deadtime.lsim(model, log["r"], sample_time=log.sample_time, x0=model.to_dict().get("initial"))
    # p is an output and a state: it stands in the log once.
    assert simulated.log.channels == ["r", "p", "ay", "v", "phi"]
    for i, output in enumerate(model.outputs):
        assert simulated.log[output] == pytest.approx(by_lsim.y[:, i], rel=1e-10, abs=1e-9), output
        measured = log[output]
        nrmse = numpy.sqrt(numpy.mean((measured - by_lsim.y[:, i]) ** 2)) / numpy.std(measured)
        assert simulated.nrmse[output] == pytest.approx(nrmse, rel=1e-9)
    assert "nrmse p" in repr(simulated)


def test_the_delay_that_a_log_holds_makes_the_model_fit_it(examples: Path) -> None:
    delayed = deadtime.as_model(examples / "uav_lateral_delayed.toml")
    seconds = delayed.effects[0]["parameters"]["delay"]
    log = examples / "uav_flight.csv"
    with_effect = deadtime.simulate(delayed, log)
    without = deadtime.simulate(delayed.with_effects([]), log)
    by_argument = deadtime.simulate(delayed.with_effects([]), log, delay={"r": seconds})
    for output in ("p", "ay"):
        assert with_effect.nrmse[output] < 0.2 < without.nrmse[output]
        assert by_argument.nrmse[output] == pytest.approx(with_effect.nrmse[output], rel=1e-6)


def test_noise_has_the_ratio_that_was_asked_for_and_depends_on_the_seed_alone(examples: Path) -> None:
    model, log = deadtime.as_model(examples / "uav_lateral_stabilised.toml"), examples / "uav_flight.csv"
    clean = deadtime.simulate(model, log).log["p"]
    noisy = [deadtime.simulate(model, log, snr=25.0, seed=seed).log["p"] for seed in (1, 1, 2)]
    assert numpy.array_equal(noisy[0], noisy[1]) and not numpy.array_equal(noisy[0], noisy[2])
    # 1500 samples: the variance of white noise is known to 4 % (one standard deviation).
    assert numpy.var(clean) / numpy.var(noisy[0] - clean) == pytest.approx(25.0, rel=0.2)


def test_a_log_that_does_not_fit_the_model_says_so(examples: Path) -> None:
    model = deadtime.as_model(examples / "uav_lateral_stabilised.toml")
    time = numpy.arange(50) * 0.02
    for log, message in [
        (Log(time, {"q": time}), "`r`"),
        (Log(time, {"r": numpy.where(time > 0.5, numpy.nan, 1.0)}), "no sample at 0.52 s"),
        (Log(time, {"r": time}, {"r": "deg"}), "deg"),
    ]:
        with pytest.raises(LogError, match=message):
            deadtime.simulate(model, log)
    log = Log(time, {"r": time, "p": numpy.zeros(50)})
    assert deadtime.simulate(model, log).nrmse == {"p": None}
    with pytest.raises(SimulateError, match="no input `q`"):
        deadtime.simulate(model, log, delay={"q": 0.1})
    with pytest.raises(SimulateError, match="sampled"):
        deadtime.simulate(deadtime.c2d(model, 0.02), log, delay={"r": 0.1})
    with pytest.raises(TimeError, match="differ"):
        deadtime.simulate(deadtime.c2d(model, 0.01), log)
    with pytest.raises(SignalError, match="noise on"):
        deadtime.simulate(model, Log(time, {"r": numpy.zeros(50)}), snr=10.0)
    wrong = Model.from_dict(model.to_dict() | {"effects": [{"effect": "input_delay", "channel": "q", "parameters": {"delay": 0.1}}]})
    with pytest.raises(EffectError, match="`q`"):
        deadtime.simulate(wrong, log)


def test_a_long_simulation_can_be_interrupted_and_lets_others_work() -> None:
    system = StateSpace(-numpy.eye(4) * 0.3, numpy.ones((4, 1)), numpy.ones((1, 4)))
    # A jittered time asks for one matrix exponential per sample: seconds of work.
    time = numpy.cumsum(RNG.uniform(0.9, 1.1, 600_000))
    u = numpy.ones(len(time))
    waits = []
    for _ in range(3):
        sent = []

        def interrupt(sent: list[float] = sent) -> None:
            clock.sleep(0.3)
            sent.append(clock.monotonic())
            os.kill(os.getpid(), signal.SIGINT)

        timer = threading.Thread(target=interrupt)
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            deadtime.lsim(system, u, time)
        waits.append(clock.monotonic() - sent[0])
        timer.join()
    # A busy machine may be late.
    assert min(waits) < 0.2
