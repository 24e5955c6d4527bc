"""Models from logs: what `identify` gives is the command line's, as arrays and as other packages' systems."""

from __future__ import annotations

from pathlib import Path

import numpy
import pytest

import deadtime


@pytest.fixture(scope="module")
def found() -> deadtime.Identified:
    generator = numpy.random.default_rng(1)
    u = generator.standard_normal((2, 3000))
    A, B = numpy.array([[0.8, 0.2], [-0.3, 0.7]]), numpy.array([[1.0, 0.2], [0.4, -0.6]])
    x, y = numpy.zeros(2), numpy.zeros((2, 3000))
    for t in range(3, 3000):
        y[:, t] = x + 0.05 * generator.standard_normal(2)
        x = A @ x + B @ u[:, t - 3]
    log = {"time": 0.02 * numpy.arange(3000), "a": u[0], "b": u[1], "p": y[0], "q": y[1]}
    return deadtime.identify(log, ["a", "b"], ["p", "q"], order=2, delay={"a": 0.06, "b": 0.06})


def test_the_model_that_made_the_data_is_found_whatever_its_states(found: deadtime.Identified) -> None:
    A, B = numpy.array([[0.8, 0.2], [-0.3, 0.7]]), numpy.array([[1.0, 0.2], [0.4, -0.6]])
    assert found.order == 2 and found.input_delay_s == {"a": 0.06, "b": 0.06} and found.sample_time_s == pytest.approx(0.02)
    for power in range(4):
        markov = found.C @ numpy.linalg.matrix_power(found.A, power) @ found.B
        assert numpy.allclose(markov, numpy.linalg.matrix_power(A, power) @ B, atol=0.02)
    poles = numpy.array([complex(p["re"], p["im"]) for p in found.poles])
    for pole, truth in zip(sorted(poles, key=lambda p: p.imag), sorted(numpy.linalg.eigvals(A), key=lambda p: p.imag), strict=True):
        assert abs(pole - truth) < 0.02
    assert all(0 < p["std_re"] < 0.01 for p in found.poles)
    assert found.K.shape == (2, 2) and found.innovations_covariance == pytest.approx(numpy.diag([0.0025, 0.0025]), abs=5e-4)
    assert [fit["output"] for fit in found.fits] == ["p", "q"]


def test_it_is_a_file_and_a_system_of_other_packages(found: deadtime.Identified, tmp_path: Path) -> None:
    found.save(tmp_path / "model.toml")
    assert deadtime.Model.read(tmp_path / "model.toml") == found.model
    control = pytest.importorskip("control")
    theirs, ours = found.to_control(), found.to_scipy()
    # three samples of delay of two inputs are states
    assert theirs.nstates == 2 + 6 and theirs.dt == pytest.approx(0.02) and ours.A.shape == (8, 8)
    for omega in (1.0, 20.0):
        z = numpy.exp(1j * omega * 0.02)
        mine = found.C @ numpy.linalg.solve(z * numpy.eye(2) - found.A, found.B) * z**-3
        assert numpy.allclose(numpy.asarray(control.evalfr(theirs, z)), mine, atol=1e-9)


def test_process_models_and_transfer_functions_have_their_numbers(tmp_path: Path) -> None:
    signal = pytest.importorskip("scipy.signal")
    generator = numpy.random.default_rng(5)
    u = numpy.repeat(generator.choice([-1.0, 1.0], 200), 6)
    # 2/(1 + 3 s) behind a hold of 0.1 s and 7 samples, by scipy.
    numerator, denominator, _ = signal.cont2discrete(([2.0], [3.0, 1.0]), 0.1, method="zoh")
    y = signal.lfilter(numerator.ravel(), denominator, numpy.concatenate([numpy.zeros(7), u[:-7]]))
    log = {"time": 0.1 * numpy.arange(1200), "u": u, "y": y + 0.02 * generator.standard_normal(1200)}
    process = deadtime.identify(log, "u", "y", method="p1d")
    truth = {"K": 2.0, "T1": 3.0, "dead_time": 0.7}
    assert process.structure is not None and {p["name"] for p in process.parameters} == set(truth)
    for number in process.parameters:
        assert abs(number["value"] - truth[number["name"]]) < 4 * number["std"] + 1e-9, number
        assert number["ci95"][0] < number["value"] < number["ci95"][1]
    assert [g["by"] for g in process.first_guesses] == ["area", "tangent"]
    transfer = deadtime.identify(log, "u", "y", method="riv", options={"nf": 1, "nb": 1})
    numbers = {p["name"]: p for p in transfer.parameters}
    assert numbers["nk"]["value"] == 8 and transfer.input_delay_s == {"u": pytest.approx(0.7)}
    for name, value in (("f1", denominator[1]), ("b0", numerator.ravel()[1])):
        assert abs(numbers[name]["value"] - value) < 4 * numbers[name]["std"], (name, numbers[name], value)
    process.save(tmp_path / "process.toml")
    assert deadtime.Model.read(tmp_path / "process.toml") == process.model


def test_what_cannot_be_is_said(examples: Path) -> None:
    log = examples / "two_inputs.csv"
    with pytest.raises(ValueError, match="learn is 1.5"):
        deadtime.identify(log, "heater", "temperature", learn=1.5)
    with pytest.raises(ValueError, match="'auto', 'none'"):
        deadtime.identify(log, "heater", "temperature", delay="some")  # type: ignore[arg-type]
    with pytest.raises(deadtime.errors.DelayError, match="`motor`, which is no input"):
        deadtime.identify(log, "heater", "temperature", delay={"motor": 0.1})
    with pytest.raises(deadtime.errors.RegistryError, match="pbsidopt"):
        deadtime.identify(log, "heater", "temperature", method="magic")  # type: ignore[arg-type]


def test_a_frequency_response_is_an_array_a_file_or_data_of_python_control(tmp_path: Path) -> None:
    omega = numpy.geomspace(0.2, 60, 70)
    response = numpy.exp(-0.043j * omega) * 2 / (1 + 0.3j * omega)
    answers = [
        deadtime.estimate_frf(omega, response),
        deadtime.estimate_frf(omega / (2 * numpy.pi), response, unit="Hz", coherence=numpy.full(70, 0.9)),
    ]
    path = tmp_path / "frf.csv"
    numpy.savetxt(path, numpy.column_stack([omega, response.real, response.imag]), delimiter=",", header="omega [rad/s],real,imag", comments="")
    answers.append(deadtime.estimate_frf(path))
    control = pytest.importorskip("control")
    answers.append(deadtime.estimate_frf(control.frd(response, omega)))
    for answer in answers:
        assert answer.delay_s == pytest.approx(0.043, abs=1e-6)
        assert [e.method for e in answer.pair.estimates] == ["rational", "bode_phase"]
    with pytest.raises(ValueError, match="not both"):
        deadtime.estimate_frf(omega, response, coherence=omega, std=omega)
    with pytest.raises(deadtime.errors.LogError, match="a squared coherence is between 0 and 1"):
        deadtime.estimate_frf(omega, response, coherence=omega)


def test_a_step_table_is_a_log_with_the_step_beside_it() -> None:
    time = numpy.arange(160.0)
    log = deadtime.step_log({"time": time, "level": 3 * (1 - numpy.exp(-numpy.maximum(time - 4.37, 0) / 12))}, size=2.0)
    assert len(log) == 180 and list(log["step"][18:22]) == [0, 0, 2, 2]
    with pytest.raises(deadtime.errors.LogError, match="the step at 3.5 s is not at a row"):
        deadtime.step_log({"time": time, "level": time}, time=3.5)
