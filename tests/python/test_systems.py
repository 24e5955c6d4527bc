"""Equations, norms and connections of linear systems, beside scipy and python-control."""

from __future__ import annotations

from typing import Literal

import control
import numpy
import pytest
import scipy.linalg
import scipy.signal

import deadtime
from deadtime.errors import ModelError

OMEGA = numpy.array([0.03, 0.4, 1.0, 7.0])


def drawn(seed: int, n: int, m: int, p: int, stable: bool = True, sampled: bool = False) -> tuple[numpy.ndarray, ...]:
    """A system whose poles decay, or not."""
    random = numpy.random.default_rng(seed)
    a = random.standard_normal((n, n))
    if sampled:
        a *= (0.8 if stable else 1.3) / numpy.abs(numpy.linalg.eigvals(a)).max()
    elif stable:
        a -= (numpy.linalg.eigvals(a).real.max() + 0.3) * numpy.eye(n)
    return a, random.standard_normal((n, m)), random.standard_normal((p, n)), random.standard_normal((p, m))


@pytest.mark.parametrize("seed", range(6))
def test_riccati_equations_and_regulators_are_scipys_and_python_controls(seed: int) -> None:
    n, m = 2 + seed, 1 + seed % 3
    a, b, c, _ = drawn(seed, n, m, 2, stable=False)
    random = numpy.random.default_rng(100 + seed)
    s = 0.1 * random.standard_normal((n, m))
    q, r = numpy.eye(n) * 2, numpy.eye(m) + 0.2
    x = deadtime.care(a, b, q, r, s)
    assert x == pytest.approx(scipy.linalg.solve_continuous_are(a, b, q, r, s=s), rel=1e-8, abs=1e-9)
    k, solution, poles = control.lqr(a, b, q, r, s)
    ours = deadtime.lqr(a, b, q, r, N=s)
    assert ours.K == pytest.approx(k, rel=1e-7, abs=1e-9) and numpy.sort_complex(ours.E) == pytest.approx(numpy.sort_complex(poles), rel=1e-6)
    e = numpy.eye(n) * 2 + 0.3 * random.standard_normal((n, n))
    expected = scipy.linalg.solve_discrete_are(a, b, q, r, e=e, s=s)
    assert deadtime.dare(a, b, q, r, s, e) == pytest.approx(expected, rel=1e-8, abs=1e-9)
    l_gain, p, _ = control.lqe(a, numpy.eye(n), c, q, numpy.eye(2))
    filter = deadtime.lqe(a, c, q, numpy.eye(2))
    assert filter.L == pytest.approx(l_gain, rel=1e-7, abs=1e-9) and filter.P == pytest.approx(p, rel=1e-7, abs=1e-9)
    a, _, c, _ = drawn(seed, n, m, 2, stable=False, sampled=True)
    l_gain, p, _ = control.dlqe(a, numpy.eye(n), c, q, numpy.eye(2))
    filter = deadtime.kalman(deadtime.StateSpace(a, numpy.eye(n), c, sample_time=0.1), q, numpy.eye(2))
    assert filter.L == pytest.approx(l_gain, rel=1e-7, abs=1e-9) and filter.P == pytest.approx(p, rel=1e-7, abs=1e-9)


def test_a_singular_weight_of_the_inputs_is_solved_where_the_inputs_cost_what_they_move() -> None:
    """As scipy, whose pencil needs no inverse of R."""
    a, b, _, _ = drawn(3, 4, 2, 1, stable=False, sampled=True)
    q, r = numpy.eye(4), numpy.diag([0.0, 1.0])
    expected = scipy.linalg.solve_discrete_are(a, b, q, r)
    assert deadtime.dare(a, b, q, r) == pytest.approx(expected, rel=1e-9)
    with pytest.raises(ModelError, match="R must be"):
        deadtime.dare(a, numpy.zeros((4, 2)), q, r)


@pytest.mark.parametrize("seed", range(6))
def test_lyapunovs_equations_and_norms_are_scipys_and_python_controls(seed: int) -> None:
    n = 1 + seed
    a, b, c, _ = drawn(seed, n, 2, 2)
    q = b @ b.T
    assert deadtime.lyap(a, q) == pytest.approx(scipy.linalg.solve_continuous_lyapunov(a, -q), rel=1e-9, abs=1e-11)
    system = deadtime.StateSpace(a, b, c)
    assert deadtime.norm(system) == pytest.approx(control.norm(control.ss(a, b, c, 0), 2), rel=1e-8)
    peak = control.norm(control.ss(a, b, c, 0), "inf")
    assert deadtime.norm(system, "inf") == pytest.approx(peak, rel=1e-5)
    assert deadtime.norm(system, "linf") == pytest.approx(peak, rel=1e-5)
    a, b, c, d = drawn(seed, n, 2, 2, sampled=True)
    assert deadtime.dlyap(a, b @ b.T) == pytest.approx(scipy.linalg.solve_discrete_lyapunov(a, b @ b.T), rel=1e-9, abs=1e-11)
    sampled = deadtime.StateSpace(a, b, c, d, 0.1)
    assert deadtime.norm(sampled, 2) == pytest.approx(control.norm(control.ss(a, b, c, d, 0.1), 2), rel=1e-8)


def test_the_largest_gain_of_an_unstable_system_is_that_of_its_mirror() -> None:
    """|1/(jω − 1)| is |1/(jω + 1)|."""
    assert deadtime.norm(([1.0], [1.0, -1.0]), "linf") == pytest.approx(1.0, rel=1e-9)
    assert deadtime.norm(([1.0], [1.0, -1.0]), "inf") == float("inf") and deadtime.norm(([1.0], [1.0, -1.0])) == float("inf")
    assert deadtime.norm(([1.0], [1.0, 0.0]), "linf") == float("inf")
    assert deadtime.nu_gap(([1.0], [1.0, 1.0]), ([1.0], [1.0, 1.1])) < 0.1


@pytest.mark.parametrize("dt", [None, 0.2])
@pytest.mark.parametrize("seed", range(4))
def test_connections_have_python_controls_responses(seed: int, dt: float | None) -> None:
    both = [drawn(seed + i, 3, 2, 2, sampled=dt is not None) for i in (0, 50)]
    theirs = [control.ss(a, b, c, d, dt or 0) for a, b, c, d in both]
    ours = [deadtime.StateSpace(a, b, c, d, dt) for a, b, c, d in both]
    points = 1j * OMEGA if dt is None else numpy.exp(1j * OMEGA * dt)
    for name, expected in [
        ("series", control.series(*theirs)),
        ("parallel", control.parallel(*theirs)),
        ("feedback", control.feedback(*theirs)),
    ]:
        got = getattr(deadtime, name)(*ours).frequency_response(OMEGA)
        assert got == pytest.approx(expected(points, squeeze=False), rel=1e-9, abs=1e-9), name
    positive = deadtime.feedback(ours[0], ours[1], 1.0).frequency_response(OMEGA)
    assert positive == pytest.approx(control.feedback(*theirs, sign=1)(points, squeeze=False), rel=1e-9, abs=1e-9)


def test_delays_stay_in_a_sampled_loop_and_are_refused_in_a_continuous_one() -> None:
    plant = deadtime.StateSpace(0.9, 0.1, 1.0, 0.0, 0.1, 0.5)
    closed = deadtime.feedback(plant, 0.7)
    g, z = plant.frequency_response(2.0)[0, 0], closed.frequency_response(2.0)[0, 0]
    assert z == pytest.approx(g / (1 + 0.7 * g), rel=1e-12)
    with pytest.raises(ModelError, match="pade"):
        deadtime.feedback(deadtime.TransferFunction([1.0], [1.0, 1.0], delay=0.1))
    loop = deadtime.series(deadtime.TransferFunction([1.0], [1.0, 1.0]), deadtime.pade(0.1, 4))
    assert deadtime.feedback(loop).is_stable


@pytest.mark.parametrize("order", [1, 2, 3, 5, 9])
def test_pade_is_python_controls(order: int) -> None:
    num, den = control.pade(0.7, order)
    expected = control.tf(num, den)(1j * OMEGA)
    assert deadtime.pade(0.7, order).frequency_response(OMEGA)[0, 0] == pytest.approx(expected, rel=1e-10)


def test_thirans_filter_is_all_pass_and_late() -> None:
    for delay, order, states in [(0.24, None, 3), (0.24, 2, 2), (0.3, None, 0), (1.27, 5, 5)]:
        filter = deadtime.thiran(delay, 0.1, order)
        assert filter.order == states
        response = filter.frequency_response(OMEGA)[0, 0]
        assert numpy.abs(response) == pytest.approx(numpy.ones(4), rel=1e-12)
        assert response[:3] == pytest.approx(numpy.exp(-1j * OMEGA[:3] * delay), abs=1e-5)


@pytest.mark.parametrize("method", ["zoh", "tustin", "matched"])
def test_ways_back_undo_their_ways_there(method: Literal["zoh", "tustin", "matched"]) -> None:
    system = deadtime.as_system(([1.0, 3.0], [1.0, 2.0, 26.0]))
    back = deadtime.d2c(deadtime.c2d(system, 0.1, method), method)
    assert back.frequency_response(OMEGA) == pytest.approx(system.frequency_response(OMEGA), rel=1e-10)


def test_a_negative_pole_has_a_continuous_model_of_higher_order() -> None:
    sampled = deadtime.StateSpace(-0.5, 1.0, 1.0, sample_time=0.1)
    back = deadtime.d2c(sampled)
    assert back.order == 2
    assert deadtime.c2d(back, 0.1).frequency_response(OMEGA) == pytest.approx(sampled.frequency_response(OMEGA), rel=1e-10)


@pytest.mark.parametrize("dt", [None, 0.1])
def test_responses_from_a_state_are_python_controls(dt: float | None) -> None:
    a, b, c, d = drawn(4, 3, 2, 2, sampled=dt is not None)
    x0 = [1.0, -2.0, 0.5]
    time = numpy.arange(21) * 0.1
    ours, theirs = deadtime.StateSpace(a, b, c, d, dt), control.ss(a, b, c, d, dt or 0)
    got = deadtime.step_response(ours, 2.0, 0.1, x0)
    free = control.initial_response(theirs, time, x0).y
    expected = control.step_response(theirs, time).y + free.reshape(2, 1, -1)
    assert got.y.transpose(1, 2, 0) == pytest.approx(expected, rel=1e-8, abs=1e-9)
    rest = deadtime.impulse_response(ours, 2.0, 0.1)
    moved = deadtime.impulse_response(ours, 2.0, 0.1, x0)
    assert (moved.y - rest.y)[:, :, 0].T == pytest.approx(free.reshape(2, -1), rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("kind", ["gbt", "euler", "backward_diff"])
def test_differences_are_scipys(kind: str) -> None:
    a, b, c, d = drawn(7, 3, 1, 1)
    options = {"alpha": 0.3} if kind == "gbt" else {}
    theirs = scipy.signal.cont2discrete((a, b, c, d), 0.1, kind, **options)
    ours = deadtime.c2d((a, b, c, d), 0.1, kind, **options)
    expected = control.ss(*theirs[:4], 0.1)(numpy.exp(1j * OMEGA * 0.1))
    assert ours.frequency_response(OMEGA)[0, 0] == pytest.approx(expected, rel=1e-11)


def test_every_shape_of_scipys_systems_is_read() -> None:
    for theirs in [
        scipy.signal.lti([], [-1] * 4, [1]),
        scipy.signal.lti([-2.0], [-1.0, -3.0], 2.0),
        scipy.signal.lti([1.0 + 0j, 2.0], [1.0, 3.0 + 0j, 2.0]),
        scipy.signal.lti([[1.0, 0.0], [0.0, 2.0]], [1.0, 3.0, 2.0]),
        scipy.signal.dlti([0.3], [0.1, 0.2], numpy.array([1.5]), dt=0.1),
    ]:
        ours = deadtime.as_system(theirs)
        # SciPy's own conversion takes no array for a gain.
        if isinstance(gain := getattr(theirs, "gain", 1.0), list | numpy.ndarray):
            theirs.gain = float(numpy.squeeze(gain))
        space = theirs.to_ss()
        expected = control.ss(space.A, space.B, space.C, space.D, ours.sample_time or 0)
        points = 1j * OMEGA if ours.sample_time is None else numpy.exp(1j * OMEGA * 0.1)
        assert ours.frequency_response(OMEGA) == pytest.approx(expected(points, squeeze=False), rel=1e-9)
    with pytest.raises(ModelError, match="imaginary"):
        deadtime.as_system(([1.0 + 1j], [1.0, 1.0]))


def test_markov_parameters_and_their_model_are_those_of_the_system() -> None:
    a, b, c, d = drawn(11, 3, 2, 2, sampled=True)
    system = deadtime.StateSpace(a, b, c, d, 0.1)
    expected = numpy.array([d, *(c @ numpy.linalg.matrix_power(a, k) @ b for k in range(40))])
    u = numpy.random.default_rng(1).standard_normal((600, 2))
    rest, moving = deadtime.lsim(system, u, prehistory="rest").y, deadtime.lsim(system, u, x0=[1.0, -2.0, 3.0], prehistory="rest").y
    assert deadtime.okid(u, moving, 5, 41) == pytest.approx(expected, abs=1e-8)
    assert deadtime.markov(u, rest, 150)[:41] == pytest.approx(expected, abs=1e-6)
    model = deadtime.era(expected, 3, 0.1)
    assert model.frequency_response(OMEGA) == pytest.approx(system.frequency_response(OMEGA), rel=1e-9)
