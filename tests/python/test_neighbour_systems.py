"""Systems of python-control and scipy, read as ours and given back."""

from __future__ import annotations

import subprocess
import sys

import control
import numpy
import pytest
import scipy.signal

import deadtime
from deadtime import Model, StateSpace, TransferFunction
from deadtime.errors import ModelError, TimeError

OMEGA = numpy.array([0.03, 0.4, 1.0, 7.0])
A, B = [[-1.0, 2.0], [-3.0, -4.0]], [[1.0, 0.0], [0.5, 2.0]]
C, D = [[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]], [[0.0, 0.1], [0.0, 0.0], [2.0, 0.0]]


def same_response(ours: StateSpace, theirs: object) -> None:
    """The frequency response of a neighbour's system, by the neighbour."""
    points = 1j * OMEGA if ours.sample_time is None else numpy.exp(1j * OMEGA * ours.sample_time)
    expected = theirs(points, squeeze=False)  # type: ignore[operator]
    assert ours.frequency_response(OMEGA) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("dt", [0, 0.2])
def test_a_state_space_model_of_python_control_is_read_as_it_stands(dt: float) -> None:
    theirs = control.ss(A, B, C, D, dt)
    ours = deadtime.as_system(theirs)
    assert ours == StateSpace(A, B, C, D, dt or None)
    same_response(ours, theirs)
    back = ours.to_control()
    assert isinstance(back, control.StateSpace) and back.dt == dt
    assert numpy.array_equal(back.A, A) and numpy.array_equal(back.D, D)


@pytest.mark.parametrize("dt", [0, 0.2])
def test_a_transfer_matrix_of_python_control_keeps_every_pair(dt: float) -> None:
    num = [[[1.0], [2.0, 0.3]], [[0.0], [1.0, 0.1, 0.2]], [[0.5, 0.0], [-3.0]]]
    den = [[[1.0, 0.5], [1.0, 0.2, 0.4]], [[1.0], [2.0, 0.6, 0.3]], [[1.0, 0.4], [1.0, -0.5, 0.3]]]
    theirs = control.tf(num, den, dt)
    ours = deadtime.as_system(theirs)
    assert (ours.outputs, ours.inputs, ours.sample_time) == (3, 2, dt or None)
    same_response(ours, theirs)


def test_an_unspecified_time_is_continuous_and_a_nameless_sample_time_must_be_named() -> None:
    assert deadtime.as_system(control.ss(-1, 1, 1, 0, None)).sample_time is None
    for nameless in (control.tf([1.0], [1.0, 0.5], True), control.ss(-0.5, 1, 1, 0, True), scipy.signal.dlti([1.0], [1.0, 0.5])):
        with pytest.raises(ModelError, match="give sample_time"):
            deadtime.as_system(nameless)
        assert deadtime.as_system(nameless, sample_time=0.1).sample_time == 0.1
    with pytest.raises(TimeError, match="differ"):
        deadtime.as_system(control.ss(-0.5, 1, 1, 0, 0.2), sample_time=0.1)
    with pytest.raises(ModelError, match="sampled"):
        deadtime.as_system(control.ss(-1, 1, 1, 0), sample_time=0.1)


def test_scipy_systems_of_all_three_kinds_are_read() -> None:
    num, den = [2.0, 1.0], [1.0, 0.5, 0.06]
    zeros, poles, gain = scipy.signal.tf2zpk(num, den)
    matrices = scipy.signal.tf2ss(num, den)
    expected = TransferFunction(num, den).frequency_response(OMEGA)
    for theirs in (scipy.signal.lti(num, den), scipy.signal.lti(zeros, poles, gain), scipy.signal.lti(*matrices)):
        assert deadtime.as_system(theirs).frequency_response(OMEGA)[0, 0] == pytest.approx(expected, rel=1e-12)
    sampled = TransferFunction(num, den, 0.1).frequency_response(OMEGA)
    for theirs in (scipy.signal.dlti(num, den, dt=0.1), scipy.signal.dlti(zeros, poles, gain, dt=0.1), scipy.signal.dlti(*matrices, dt=0.1)):
        ours = deadtime.as_system(theirs)
        assert ours.sample_time == 0.1
        assert ours.frequency_response(OMEGA)[0, 0] == pytest.approx(sampled, rel=1e-12)


def test_a_numerator_of_several_rows_has_as_many_outputs() -> None:
    # scipy's own way back from a model of two outputs.
    num, den = scipy.signal.ss2tf([[-1.0, 0.0], [1.0, -2.0]], [[1.0], [0.0]], numpy.eye(2), numpy.zeros((2, 1)))
    ours = deadtime.as_system(scipy.signal.lti(num, den))
    assert ours.outputs == 2
    direct = StateSpace([[-1.0, 0.0], [1.0, -2.0]], [[1.0], [0.0]], numpy.eye(2))
    assert ours.frequency_response(OMEGA) == pytest.approx(direct.frequency_response(OMEGA), rel=1e-10)


def test_tuples_are_read_as_scipy_reads_them() -> None:
    expected = TransferFunction([1.0, 3.0], [1.0, 0.9, 0.2])
    for given in (([1.0, 3.0], [1.0, 0.9, 0.2]), ([-3.0], [-0.4, -0.5], 1.0), scipy.signal.tf2ss([1.0, 3.0], [1.0, 0.9, 0.2])):
        ours = deadtime.as_system(given)
        assert ours.sample_time is None
        assert ours.frequency_response(OMEGA)[0, 0] == pytest.approx(expected.frequency_response(OMEGA), rel=1e-12)
        assert deadtime.as_system(given, sample_time=0.1).sample_time == 0.1
    assert deadtime.as_system((A, B, C, D, 0.3)) == StateSpace(A, B, C, D, 0.3)
    for wrong in ((1.0,), (A, B, C, D, 0.1, 7)):
        with pytest.raises(TypeError, match="no system"):
            deadtime.as_system(wrong)


def test_improper_systems_of_neighbours_are_refused() -> None:
    with pytest.raises(ModelError, match="1 zeros and 0 poles"):
        deadtime.as_system(control.tf([1.0, 0.0], [1.0]))


def test_delays_go_to_neighbours_as_states_or_not_at_all() -> None:
    delayed = TransferFunction([1.0], [1.0, 2.0], delay=0.35)
    with pytest.raises(ValueError, match="pade"):
        delayed.to_state_space().to_control()
    sampled = deadtime.c2d(delayed, 0.1)
    # Three whole samples, and the half of one that the conversion made a state of.
    theirs = sampled.to_control()
    assert theirs.nstates == sampled.order + 3
    same_response(sampled, theirs)
    by_scipy = sampled.to_scipy()
    assert isinstance(by_scipy, scipy.signal.StateSpace) and by_scipy.dt == 0.1
    _, response = scipy.signal.dfreqresp(by_scipy, OMEGA * 0.1)
    assert response == pytest.approx(sampled.frequency_response(OMEGA)[0, 0], rel=1e-9)


def test_labels_of_python_control_name_the_channels_of_a_simulator() -> None:
    named = control.ss(A, B, C, D, inputs=["left", "right"], outputs=["x", "y", "z"], states=["v", "w"], name="rover")
    model = deadtime.as_model(named)
    assert (model.name, model.inputs, model.outputs, model.states) == ("rover", ["left", "right"], ["x", "y", "z"], ["v", "w"])
    assert model.system() == StateSpace(A, B, C, D)
    nameless = Model.from_system(control.ss(A, B, C, D), name="plain")
    assert (nameless.inputs, nameless.outputs, nameless.states) == (["u1", "u2"], ["y1", "y2", "y3"], ["x1", "x2"])


def test_functions_take_neighbours_systems_directly() -> None:
    theirs = control.tf([3.0], [1.0, 2.0])
    assert deadtime.c2d(theirs, 0.1).A[0, 0] == pytest.approx(numpy.exp(-0.2))
    assert deadtime.lsim(theirs, numpy.ones(4), sample_time=0.1).y == pytest.approx(1.5 * (1 - numpy.exp(-0.2 * numpy.arange(4))))
    assert deadtime.dlqr(control.ss(1.0, 1.0, 1.0, 0.0, 0.1), 1, 1).K[0, 0] == pytest.approx((numpy.sqrt(5) - 1) / 2)
    log = deadtime.Log(numpy.arange(50) * 0.1, {"u": numpy.ones(50)})
    simulated = deadtime.simulate(control.ss(-2.0, 3.0, 1.0, 0.0), log)
    assert simulated.log["y"][-1] == pytest.approx(1.5, rel=1e-3)


def test_a_tuple_needs_no_neighbour_at_all() -> None:
    code = "import sys, deadtime; deadtime.lsim(([1], [1, 1]), [1, 2, 3], sample_time=0.1); assert not {'scipy', 'control'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
