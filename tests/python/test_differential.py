"""Live differential tests: hypothesis draws systems and signals, python-control, scipy and slycot answer beside us.

Every tolerance is first-order perturbation theory: what an error of a few units in the last place in the matrices can become in the result, by the
condition number of that very case. Where a peer is further off than that, a third witness (80-bit arithmetic, or the residual of the equation) must
say that the peer is the wrong one; `--hypothesis-show-statistics` counts such cases.

A failure prints the few numbers that the case was made of. `pytest --hypothesis-profile=thorough` draws ten times as many cases.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import control
import numpy
import pytest
import scipy.linalg
import scipy.optimize
import scipy.signal
import slycot
from hypothesis import assume, event, given
from hypothesis import strategies as st

import deadtime
from deadtime import StateSpace, TransferFunction

EPS = float(numpy.finfo(float).eps)
#: Units in the last place that a well-conditioned product, solution or exponential of a few rows may lose; ours and the peers' together.
ULPS = 200.0


@dataclass(frozen=True)
class Case:
    """A system by the few numbers that make it; the same numbers, the same system."""

    states: int
    inputs: int
    outputs: int
    unstable: bool
    feedthrough: bool
    #: Decades over which the states' units are spread.
    spread: float
    sample_time: float
    seed: int

    def matrices(self) -> tuple[numpy.ndarray, numpy.ndarray, numpy.ndarray, numpy.ndarray]:
        """Modes of 0.05 to 8 rad/s in random coordinates."""
        rng = numpy.random.default_rng(self.seed)
        n = self.states
        modes = numpy.zeros((n, n))
        i = 0
        while i < n:
            size, damping = 10 ** rng.uniform(-1.3, 0.9), rng.uniform(0.02, 1.0)
            if i + 1 < n and rng.random() < 0.6:
                real, imaginary = -damping * size, size * numpy.sqrt(1 - damping**2)
                modes[i : i + 2, i : i + 2] = [[real, imaginary], [-imaginary, real]]
                i += 2
            else:
                modes[i, i] = -size
                i += 1
        if self.unstable:
            # Slow enough to grow by a few decades at most in any simulation here.
            k = rng.integers(n)
            modes[k, k] = abs(modes[k, k]) if abs(modes[k, k]) < 1 else 0.3
        coordinates = scipy.linalg.qr(rng.standard_normal((n, n)))[0] * 10 ** rng.uniform(-0.5, 0.5, n)
        units = 10 ** rng.uniform(-self.spread / 2, self.spread / 2, n)
        t = units[:, None] * coordinates
        a = t @ modes @ numpy.linalg.inv(t)
        b, c = units[:, None] * rng.standard_normal((n, self.inputs)), rng.standard_normal((self.outputs, n)) / units
        d = rng.standard_normal((self.outputs, self.inputs)) if self.feedthrough else numpy.zeros((self.outputs, self.inputs))
        return a, b, c, d

    def signal(self, samples: int) -> numpy.ndarray:
        """Steps of random height and length with a little noise, shape (samples, inputs)."""
        rng = numpy.random.default_rng(self.seed + 1)
        steps = numpy.repeat(rng.standard_normal((samples // 5 + 1, self.inputs)), 5, axis=0)[:samples]
        return steps + 0.1 * rng.standard_normal((samples, self.inputs))


def cases(**fixed: st.SearchStrategy[object]) -> st.SearchStrategy[Case]:
    """Systems of every kind, but for what is fixed."""
    fields: dict[str, st.SearchStrategy[object]] = {
        "states": st.integers(1, 6),
        "inputs": st.integers(1, 3),
        "outputs": st.integers(1, 3),
        "unstable": st.booleans(),
        "feedthrough": st.booleans(),
        "spread": st.sampled_from([0.0, 0.0, 2.0, 4.0]),
        "sample_time": st.sampled_from([0.01, 0.1, 0.37]),
        "seed": st.integers(0, 2**32 - 1),
    }
    return st.builds(Case, **(fields | fixed))


ONE = {"inputs": st.just(1), "outputs": st.just(1)}


def norm(matrix: numpy.ndarray) -> float:
    """The spectral norm, 0 of nothing."""
    return float(numpy.linalg.norm(matrix, 2)) if matrix.size else 0.0


def agree(
    ours: numpy.ndarray,
    peers: dict[str, numpy.ndarray],
    tolerance: numpy.ndarray | float,
    witness: Callable[[], numpy.ndarray] | None = None,
) -> None:
    """Ours lies as near to every peer as `tolerance` says; where it does not, ours must be the one that the witness confirms."""
    for name, theirs in peers.items():
        assert numpy.shape(ours) == numpy.shape(theirs), f"{name}: {numpy.shape(ours)} and {numpy.shape(theirs)}"
        off = numpy.abs(ours - theirs)
        if numpy.all(off <= tolerance):
            continue
        worst = numpy.max(off / numpy.broadcast_to(tolerance, off.shape))
        assert witness is not None, f"{name} is {worst} tolerances away"
        true = witness()
        ours_off, theirs_off = numpy.max(numpy.abs(ours - true) / tolerance), numpy.max(numpy.abs(theirs - true) / tolerance)
        assert ours_off <= 1, f"{name} is {worst} tolerances away from ours; from the witness: ours {ours_off}, {name} {theirs_off}"
        event(f"{name} is off by more than its conditioning, ours is not")


# Third witnesses and condition numbers


def exponential(matrix: numpy.ndarray) -> numpy.ndarray:
    """exp of a matrix in 80-bit arithmetic: Taylor's series of M/2^k, squared k times. Slow and obviously right."""
    m = matrix.astype(numpy.longdouble)
    squarings = max(0, int(numpy.ceil(numpy.log2(max(float(numpy.abs(m).sum(axis=0).max(initial=0.0)), 1e-300)))) + 3)
    m = m / numpy.longdouble(2) ** squarings
    term = total = numpy.eye(len(m), dtype=numpy.longdouble)
    for k in range(1, 25):
        term = term @ m / k
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total.astype(float)


def block(a: numpy.ndarray, b: numpy.ndarray, sample_time: float) -> numpy.ndarray:
    """[A B; 0 0]·Ts, whose exponential is [Ad Bd; 0 I]."""
    n, m = b.shape
    whole = numpy.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = a * sample_time, b * sample_time
    return whole


def exponential_tolerance(matrix: numpy.ndarray) -> float:
    """What an error of some units in the last place in M becomes in exp(M), absolutely: by the condition number of the exponential at M."""
    return ULPS * EPS * len(matrix) * max(1.0, scipy.linalg.expm_cond(matrix)) * float(numpy.linalg.norm(scipy.linalg.expm(matrix)))


def response_of(a: numpy.ndarray, b: numpy.ndarray, c: numpy.ndarray, d: numpy.ndarray, z: complex) -> numpy.ndarray:
    return c @ numpy.linalg.solve(z * numpy.eye(len(a)) - a, b) + d


def response_tolerance(
    matrices: tuple[numpy.ndarray, ...], z: complex, errors: tuple[float, float, float, float]
) -> float:
    """|δH| ≤ |C R δA R B| + |C R δB| + |δC R B| + |δD|, R = (zI − A)⁻¹, and what solving with zI − A loses itself."""
    a, b, c, _ = matrices
    shifted = z * numpy.eye(len(a)) - a
    resolvent = numpy.linalg.inv(shifted)
    seen, moved, spread = norm(c @ resolvent), norm(resolvent @ b), norm(resolvent)
    solving = ULPS * EPS * norm(shifted)
    return seen * (errors[0] + solving) * moved + norm(c) * spread * errors[1] + errors[2] * moved + errors[3] + ULPS * EPS * norm(matrices[3])


def recursion_tolerance(phi: numpy.ndarray, gamma: numpy.ndarray, c: numpy.ndarray, d: numpy.ndarray, x: numpy.ndarray, u: numpy.ndarray, error: float) -> float:
    """What matrices that are off by `error` make of y over all samples: Σ‖CΦʲ‖·(‖δΦ‖ max‖x‖ + ‖δΓ‖ max‖u‖), and rounding of each step."""
    power, total = c, 0.0
    for _ in range(len(x)):
        total += norm(power)
        power = power @ phi
    largest_x, largest_u = float(numpy.max(numpy.linalg.norm(x, axis=1))), float(numpy.max(numpy.linalg.norm(u, axis=1)))
    each = error * (largest_x + 2 * largest_u) + ULPS * EPS * (norm(phi) * largest_x + 2 * norm(gamma) * largest_u)
    return total * each + ULPS * EPS * (norm(c) * largest_x + norm(d) * largest_u) + 1e-300


# Conversions


@given(cases())
def test_zero_order_hold_is_that_of_scipy_and_control(case: Case) -> None:
    a, b, c, d = case.matrices()
    ours = deadtime.c2d((a, b, c, d), case.sample_time)
    by_scipy = scipy.signal.cont2discrete((a, b, c, d), case.sample_time, "zoh")
    by_control = control.sample_system(control.ss(a, b, c, d), case.sample_time, "zoh")
    m = block(a, b, case.sample_time)
    agree(
        numpy.hstack([ours.A, ours.B]),
        {"scipy": numpy.hstack(by_scipy[:2]), "control": numpy.hstack([by_control.A, by_control.B])},
        exponential_tolerance(m),
        lambda: exponential(m)[: case.states],
    )
    assert numpy.array_equal(ours.C, c) and numpy.array_equal(ours.D, d)


@given(cases())
def test_tustin_is_that_of_scipy_and_control_state_by_state(case: Case) -> None:
    a, b, c, d = case.matrices()
    half = case.sample_time / 2
    assume(numpy.linalg.cond(numpy.eye(case.states) - a * half) < 1e8)
    ours = deadtime.c2d((a, b, c, d), case.sample_time, "tustin")
    by_scipy = scipy.signal.cont2discrete((a, b, c, d), case.sample_time, "bilinear")
    by_control = control.sample_system(control.ss(a, b, c, d), case.sample_time, "tustin")
    # One linear solution with I − A·Ts/2: relative error by its condition number, of the size of what it is applied to.
    inverse = numpy.linalg.inv(numpy.eye(case.states) - a * half)
    relative = ULPS * EPS * numpy.linalg.cond(numpy.eye(case.states) - a * half)
    sizes = {
        "A": norm(inverse) * (1 + norm(a * half)),
        "B": norm(inverse) * norm(b) * case.sample_time,
        "C": norm(c) * norm(inverse),
        "D": norm(d) + norm(c) * norm(inverse) * norm(b) * half,
    }
    for name, scipys, controls in zip("ABCD", by_scipy[:4], (by_control.A, by_control.B, by_control.C, by_control.D), strict=True):
        agree(getattr(ours, name), {"scipy": scipys, "control": controls}, relative * sizes[name])


@given(cases(), st.floats(0.05, 0.95))
def test_prewarped_tustin_is_that_of_control_and_exact_at_its_frequency(case: Case, share: float) -> None:
    a, b, c, d = case.matrices()
    omega = share * numpy.pi / case.sample_time
    effective = 2 * numpy.tan(omega * case.sample_time / 2) / omega
    shifted = numpy.eye(case.states) - a * effective / 2
    assume(numpy.linalg.cond(shifted) < 1e6)
    ours = deadtime.c2d((a, b, c, d), case.sample_time, "tustin", prewarp_rad_s=omega)
    theirs = control.sample_system(control.ss(a, b, c, d), case.sample_time, "tustin", prewarp_frequency=omega)
    relative = ULPS * EPS * numpy.linalg.cond(shifted)
    z = numpy.exp(1j * omega * case.sample_time)
    matrices = (ours.A, ours.B, ours.C, ours.D)
    tolerance = response_tolerance(matrices, z, tuple(relative * max(norm(x), 1.0) for x in matrices))  # type: ignore[arg-type]
    there = ours.frequency_response(omega)
    agree(there, {"control": response_of(theirs.A, theirs.B, theirs.C, theirs.D, z)}, tolerance)
    agree(there, {"the continuous system": response_of(a, b, c, d, 1j * omega)}, tolerance + response_tolerance((a, b, c, d), 1j * omega, (0, 0, 0, 0)))


@given(cases())
def test_first_order_hold_has_scipy_s_response_whatever_its_states(case: Case) -> None:
    a, b, c, d = case.matrices()
    ours = deadtime.c2d((a, b, c, d), case.sample_time, "foh")
    theirs = scipy.signal.cont2discrete((a, b, c, d), case.sample_time, "foh")[:4]
    # scipy's ramps come of the exponential of a block with an identity beside B, so its condition number is that of the larger block.
    n, m = b.shape
    ramp = numpy.zeros((n + 2 * m, n + 2 * m))
    ramp[: n + m, : n + m] = block(a, b, case.sample_time)
    ramp[n : n + m, n + m :] = numpy.eye(m)
    error = exponential_tolerance(ramp)
    for omega in numpy.array([0.02, 0.2, 0.6, 0.97]) * numpy.pi / case.sample_time:
        z = numpy.exp(1j * omega * case.sample_time)
        tolerance = max(response_tolerance(x, z, (error, 2 * error, 0.0, norm(c) * error)) for x in ((ours.A, ours.B, ours.C, ours.D), theirs))
        agree(ours.frequency_response(omega), {"scipy": response_of(*theirs, z)}, tolerance)


@given(cases(feedthrough=st.just(False)))
def test_impulse_invariance_has_scipy_s_markov_parameters(case: Case) -> None:
    a, b, c, d = case.matrices()
    ours = deadtime.c2d((a, b, c, d), case.sample_time, "impulse")
    theirs = scipy.signal.cont2discrete((a, b, c, d), case.sample_time, "impulse")[:4]
    error = exponential_tolerance(a * case.sample_time)
    left, right, power = (ours.B, theirs[1], numpy.eye(case.states))
    agree(ours.D, {"scipy": theirs[3]}, ULPS * EPS * norm(c) * norm(b) * case.sample_time)
    # C·Φᵏ·B: k + 1 factors that are off by `error` each, and rounding.
    for k in range(12):
        growth = sum(norm(c @ numpy.linalg.matrix_power(ours.A, j)) for j in range(k + 1)) * max(norm(power @ ours.B), norm(ours.B))
        tolerance = (error * (1 + 1 / max(norm(ours.A), 1e-3)) + ULPS * EPS * norm(ours.A)) * growth + ULPS * EPS * norm(c) * norm(left) + 1e-300
        agree(c @ left, {"scipy": theirs[2] @ right}, tolerance * max(1.0, norm(b) * case.sample_time / max(norm(ours.B), 1e-300)))
        left, right, power = ours.A @ left, theirs[0] @ right, ours.A @ power


@given(st.integers(1, 4), st.sampled_from([0.01, 0.1, 0.37]), st.integers(0, 2**32 - 1))
def test_zero_pole_matching_is_that_of_control_where_its_rule_is_the_same(order: int, sample_time: float, seed: int) -> None:
    # One zero fewer than poles and none at 0: there control adds no zero at −1 that MATLAB's rule asks for, and matches the gain at s = 0 too.
    rng = numpy.random.default_rng(seed)
    poles, zeros = -rng.uniform(0.2, 3.0, order) * numpy.arange(1, order + 1), -rng.uniform(0.2, 3.0, order - 1)
    assume(order == 1 or numpy.min(numpy.abs(zeros[:, None] - poles[None, :])) > 1e-3)
    gain = rng.uniform(0.5, 2.0)
    ours = deadtime.c2d(TransferFunction.from_zeros_poles_gain(zeros, poles, gain), sample_time, "matched")
    theirs = control.sample_system(control.zpk(zeros, poles, gain), sample_time, "matched")

    def exact(z: complex) -> complex:
        """The rule itself, from the zeros and poles that were drawn."""
        at = numpy.prod(z - numpy.exp(zeros * sample_time)) / numpy.prod(z - numpy.exp(poles * sample_time))
        dc = numpy.prod(1 - numpy.exp(zeros * sample_time)) / numpy.prod(1 - numpy.exp(poles * sample_time))
        return at / dc * gain * numpy.prod(-zeros) / numpy.prod(-poles)

    for omega in numpy.array([0.02, 0.3, 0.9]) * numpy.pi / sample_time:
        z = numpy.exp(1j * omega * sample_time)
        # Roots cluster at z = 1 as the sample time falls: each of the factors 1 − exp(pTs) has lost |1/(pTs)| units in the last place.
        lost = sum(1 / abs(numpy.expm1(root * sample_time)) for root in [*zeros, *poles])
        ours_at = ours.frequency_response(omega)[0, 0]
        agree(ours_at, {"control": theirs(z)}, ULPS * EPS * (1 + lost) * abs(exact(z)), lambda z=z: exact(z))  # type: ignore[misc]


# Responses


@given(cases(), st.booleans())
def test_lsim_is_that_of_scipy_and_control(case: Case, straight: bool) -> None:
    a, b, c, d = case.matrices()
    u, samples = case.signal(80), 80
    x0 = numpy.linalg.norm(b) * numpy.random.default_rng(case.seed + 2).standard_normal(case.states)
    time = numpy.arange(samples) * case.sample_time
    ours = deadtime.lsim((a, b, c, d), u, sample_time=case.sample_time, x0=x0, hold="linear" if straight else "zero")
    _, y, _ = scipy.signal.lsim((a, b, c, d), u, time, X0=x0, interp=straight)
    peers = {"scipy": y.reshape(samples, -1)}
    if straight:
        # python-control joins the samples of a continuous system by straight lines.
        peers["control"] = control.forced_response(control.ss(a, b, c, d), time, u.T, x0, squeeze=False).y.T
    n, m = b.shape
    ramp = numpy.zeros((n + 2 * m, n + 2 * m))
    ramp[: n + m, : n + m] = block(a, b, case.sample_time)
    ramp[n : n + m, n + m :] = numpy.eye(m)
    whole = scipy.linalg.expm(ramp)
    tolerance = recursion_tolerance(whole[:n, :n], whole[:n, n : n + m], c, d, ours.x, u, exponential_tolerance(ramp))

    def witness() -> numpy.ndarray:
        """The recursion in 80-bit arithmetic with matrices from 80-bit exponentials."""
        e = exponential(ramp).astype(numpy.longdouble)
        phi, held, slope = e[:n, :n], e[:n, n : n + m], e[:n, n + m :]
        x, rows = x0.astype(numpy.longdouble), []
        for k in range(samples):
            rows.append(c @ x + d @ u[k])
            change = u[min(k + 1, samples - 1)] - u[k] if straight else numpy.zeros(m)
            x = phi @ x + held @ u[k] + slope @ change
        return numpy.array(rows, dtype=float)

    agree(ours.y.reshape(samples, -1), peers, tolerance, witness)


@given(cases())
def test_lsim_of_sampled_systems_is_that_of_scipy_and_control(case: Case) -> None:
    sampled = deadtime.c2d(case.matrices(), case.sample_time)
    matrices = (sampled.A, sampled.B, sampled.C, sampled.D)
    u, samples = case.signal(80), 80
    x0 = numpy.linalg.norm(sampled.B) * numpy.random.default_rng(case.seed + 2).standard_normal(case.states)
    ours = deadtime.lsim(sampled, u, x0=x0)
    _, y, _ = scipy.signal.dlsim((*matrices, case.sample_time), u, x0=x0)
    time = numpy.arange(samples) * case.sample_time
    by_control = control.forced_response(control.ss(*matrices, case.sample_time), time, u.T, x0, squeeze=False).y.T
    # The matrices are the same to the bit; only the steps round.
    tolerance = recursion_tolerance(*matrices, ours.x, u, 0.0)
    agree(ours.y.reshape(samples, -1), {"scipy": y, "control": by_control}, tolerance)


@given(cases(sample_time=st.sampled_from([0.01, 0.1])))
def test_step_and_impulse_responses_are_those_of_control(case: Case) -> None:
    a, b, c, d = case.matrices()
    samples, ts = 60, case.sample_time
    time = numpy.arange(samples) * ts
    peer = control.ss(a, b, c, d)
    m = block(a, b, ts)
    whole = scipy.linalg.expm(m)
    error = exponential_tolerance(m)
    for j in range(case.inputs):
        for response, theirs, start, direct in [
            (deadtime.step_response, control.step_response, numpy.zeros(case.states), d),
            (deadtime.impulse_response, control.impulse_response, b[:, j], numpy.zeros_like(d)),
        ]:
            ours = response((a, b, c, d), (samples - 1) * ts, ts)
            assert ours.time == pytest.approx(time, abs=1e-12)
            y = ours.y.reshape(samples, case.outputs, case.inputs)[:, :, j]
            by_control = theirs(peer, time, input=j, squeeze=False).y[:, 0, :].T
            held = numpy.zeros((samples, case.inputs))
            held[:, j] = float(response is deadtime.step_response)
            states = deadtime.lsim((a, b, c, d), held, sample_time=ts, x0=start).x
            # control's impulse response runs the same straight-line simulation as its forced response, from the state B·e_j.
            tolerance = recursion_tolerance(whole[: case.states, : case.states], whole[: case.states, case.states :], c, direct, states, held, error)

            def witness(response: object = response, j: int = j, start: numpy.ndarray = start) -> numpy.ndarray:
                e = exponential(m).astype(numpy.longdouble)
                x, rows = start.astype(numpy.longdouble), []
                step = response is deadtime.step_response
                for _ in range(samples):
                    rows.append(c @ x + (d[:, j] if step else 0.0))
                    x = e[: case.states, : case.states] @ x + (e[: case.states, case.states + j] if step else 0.0)
                return numpy.array(rows, dtype=float)

            agree(y, {"control": by_control}, tolerance, witness)


@given(cases(**ONE))
def test_step_and_impulse_responses_of_one_pair_are_those_of_scipy(case: Case) -> None:
    a, b, c, d = case.matrices()
    samples, ts = 60, case.sample_time
    time = numpy.arange(samples) * ts
    m = block(a, b, ts)
    whole = scipy.linalg.expm(m)
    error = exponential_tolerance(m)
    n = case.states
    for response, theirs, start, held, direct in [
        (deadtime.step_response, scipy.signal.step, numpy.zeros(n), 1.0, d),
        (deadtime.impulse_response, scipy.signal.impulse, b[:, 0], 0.0, numpy.zeros_like(d)),
    ]:
        ours = response((a, b, c, d), (samples - 1) * ts, ts).y
        # scipy's impulse leaves the direct path out as ours does.
        _, y = theirs((a, b, c, d), T=time)
        u = numpy.full((samples, 1), held)
        states = deadtime.lsim((a, b, c, d), u, sample_time=ts, x0=start).x
        tolerance = recursion_tolerance(whole[:n, :n], whole[:n, n:], c, direct, states, u, error)
        agree(ours, {"scipy": numpy.reshape(y, -1)}, tolerance)


# Poles and zeros


def matched(ours: numpy.ndarray, theirs: numpy.ndarray) -> numpy.ndarray:
    """The peer's numbers in the order that brings them nearest to ours."""
    rows, columns = scipy.optimize.linear_sum_assignment(numpy.abs(ours[:, None] - theirs[None, :]))
    return theirs[columns[numpy.argsort(rows)]]


@given(cases())
def test_poles_are_those_of_numpy_and_control(case: Case) -> None:
    a, b, c, d = case.matrices()
    poles = StateSpace(a, b, c, d).poles()
    values, left, right = scipy.linalg.eig(a, left=True)
    # An eigenvalue moves by the perturbation over |yᴴx|, its condition number; eps‖A‖ is what any backward stable iteration makes.
    conditions = 1 / numpy.abs(numpy.sum(left.conj() * right, axis=0))
    assume(numpy.max(conditions) < 1e6)
    order = [int(numpy.argmin(numpy.abs(values - p))) for p in poles]
    tolerance = ULPS * EPS * norm(a) * conditions[order]
    agree(poles, {"scipy": matched(poles, values), "control": matched(poles, control.ss(a, b, c, d).poles())}, tolerance)


@given(cases(inputs=st.integers(1, 2), outputs=st.integers(1, 2)))
def test_zeros_are_those_of_slycot(case: Case) -> None:
    a, b, c, d = case.matrices()
    ours = StateSpace(a, b, c, d).zeros()
    n, m, p = case.states, case.inputs, case.outputs
    found = slycot.ab08nd(n, m, p, a, b, c, d)
    nu, af, bf = found[0], found[8], found[9]
    theirs = scipy.linalg.eigvals(af[:nu, :nu], bf[:nu, :nu]) if nu else numpy.zeros(0, dtype=complex)
    event(f"{len(ours)} zeros")

    def pencil(s: complex) -> numpy.ndarray:
        return numpy.block([[a - s * numpy.eye(n), b], [c, d]])

    def residual(s: complex) -> float:
        """How far the pencil is from losing rank at s, relative to its size there; states in units of their own make it blind, so these are balanced."""
        balanced = pencil(s)
        for _ in range(6):
            balanced = balanced / numpy.maximum(numpy.abs(balanced).max(axis=1, keepdims=True), 1e-300)
            balanced = balanced / numpy.maximum(numpy.abs(balanced).max(axis=0, keepdims=True), 1e-300)
        return float(numpy.linalg.svd(balanced, compute_uv=False)[-1])

    # Rank decisions differ where a zero lies far outside all poles (one Markov parameter near 0): the number counts within ten thousand times the poles.
    reach = 1e4 * max(norm(a), 1e-3)
    near, near_theirs = ours[numpy.abs(ours) < reach], theirs[numpy.abs(theirs) < reach]
    assert len(near) == len(near_theirs)
    if len(near) == 0:
        return
    # A zero moves by the perturbation over |yᴴ E x|, y and x the null vectors of the pencil there, E its identity block.
    order = matched(near, near_theirs)
    for zero, theirs_at in zip(near, order, strict=True):
        left, _, right = numpy.linalg.svd(pencil(zero))
        condition = 1 / max(abs(left[:n, -1].conj() @ right[-1, :n].conj()), 1e-300)
        tolerance = ULPS * EPS * norm(pencil(zero)) * condition
        if abs(zero - theirs_at) > tolerance:
            # Whose zero makes the pencil lose rank?
            assert residual(zero) <= max(10 * residual(theirs_at), 1e-10), (zero, theirs_at, residual(zero), residual(theirs_at))
            event("slycot's zero is further off than its conditioning, or both are as good")


# Norms and gains


@given(cases(unstable=st.just(False), outputs=st.integers(1, 2)), st.booleans())
def test_the_h_infinity_norm_is_that_of_slycot(case: Case, sampled: bool) -> None:
    system = StateSpace(*case.matrices())
    if sampled:
        system = deadtime.c2d(system, case.sample_time)
    a, b, c, d = system.A, system.B, system.C, system.D
    gain, omega = system.norm_hinf()
    theirs, _ = slycot.ab13dd("D" if sampled else "C", "I", "S", "D", case.states, case.inputs, case.outputs, a, numpy.eye(case.states), b, c, d, 1e-10)
    # Both stop within 1e-10; beside it the gain itself is known as well as the response at the peak.
    known = 0.0
    if numpy.isfinite(omega):
        z = numpy.exp(1j * omega * case.sample_time) if sampled else 1j * omega
        known = response_tolerance((a, b, c, d), z, (0.0, 0.0, 0.0, 0.0))
        # What is returned is attained: python-control's response at that frequency has this gain.
        there = control.ss(a, b, c, d, case.sample_time if sampled else 0)(z, squeeze=False)
        assert norm(there) == pytest.approx(gain, rel=1e-9, abs=known)
    else:
        assert norm(d) == pytest.approx(gain, rel=1e-12)
    if gain > theirs * (1 + 1e-9) + known:
        # What python-control's response attains at one frequency, or D at all high ones, no norm can be below.
        event("slycot's norm is below a gain that is attained")
    else:
        assert gain == pytest.approx(theirs, rel=1e-9, abs=known)
    # No frequency of a fine grid is above it.
    for w in numpy.geomspace(1e-3, numpy.pi / case.sample_time, 60):
        assert norm(system.frequency_response(w)) <= gain * (1 + 1e-9) + known


@given(cases(unstable=st.just(False)), st.booleans())
def test_a_system_that_integrates_has_no_h_infinity_norm_as_control_says(case: Case, sampled: bool) -> None:
    a, b, c, d = case.matrices()
    n, p = case.states, case.outputs
    # The outputs' sum, integrated, and that integral as a further output.
    a = numpy.block([[a, numpy.zeros((n, 1))], [c.sum(axis=0, keepdims=True), numpy.zeros((1, 1))]])
    b, d = numpy.vstack([b, d.sum(axis=0, keepdims=True)]), numpy.vstack([d, numpy.zeros((1, case.inputs))])
    c = numpy.block([[c, numpy.zeros((p, 1))], [numpy.zeros((1, n)), numpy.ones((1, 1))]])
    system = StateSpace(a, b, c, d)
    if sampled:
        system = deadtime.c2d(system, case.sample_time)
    assert system.norm_hinf()[0] == numpy.inf
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert control.norm(system.to_control(), "inf") == numpy.inf


@given(cases(unstable=st.just(True)))
def test_an_unstable_system_has_no_h_infinity_norm(case: Case) -> None:
    # No peer: python-control and slycot give the L-infinity norm, the largest gain of a response that no signal could measure. MATLAB gives infinity.
    a, b, c, d = case.matrices()
    assume(numpy.max(numpy.linalg.eigvals(a).real) > 1e-6)
    assert StateSpace(a, b, c, d).norm_hinf()[0] == numpy.inf


def riccati_residual(a: numpy.ndarray, b: numpy.ndarray, q: numpy.ndarray, r: numpy.ndarray, n: numpy.ndarray, x: numpy.ndarray) -> float:
    right = b.T @ x @ a + n.T
    return norm(a.T @ x @ a - x - right.T @ numpy.linalg.solve(r + b.T @ x @ b, right) + q)


@given(cases(spread=st.sampled_from([0.0, 2.0])), st.floats(-3.0, 3.0), st.booleans())
def test_the_regulator_is_that_of_scipy_control_and_slycot(case: Case, decades: float, crossed: bool) -> None:
    system = deadtime.c2d(case.matrices(), case.sample_time)
    a, b = system.A, system.B
    order, inputs = case.states, case.inputs
    rng = numpy.random.default_rng(case.seed + 3)
    root = rng.standard_normal((order + inputs, order + inputs))
    weight = root @ root.T + 0.1 * numpy.eye(order + inputs)
    q, r, n = weight[:order, :order], weight[order:, order:] * 10**decades, weight[:order, order:] * 10 ** (decades / 2)
    if not crossed:
        n = numpy.zeros_like(n)
    assume(norm(b) > 1e-6)
    ours = deadtime.dlqr(a, b, q, r, n)
    x, k = ours.S, ours.K

    def of_slycot() -> numpy.ndarray:
        # slycot writes into what it is given; of its symplectic matrix (hinv="D") the unstable half belongs to the stabilising solution.
        g = slycot.sb02mt(order, inputs, b.copy(), r.copy())[-1]
        return slycot.sb02md(order, a.copy(), g, q.copy(), "D", hinv="D", sort="U")[0]

    asked = {"scipy": lambda: scipy.linalg.solve_discrete_are(a, b, q, r, s=n), "control": lambda: control.dlqr(a, b, q, r, n)[1]}
    if not crossed and abs(numpy.linalg.det(a)) > 1e-8:
        asked["slycot"] = of_slycot
    peers = {}
    for name, solve in asked.items():
        # A peer may say that rounding keeps it from an answer; then the others are heard.
        try:
            peers[name] = solve()
        except (numpy.linalg.LinAlgError, slycot.exceptions.SlycotArithmeticError):
            event(f"{name} gives no answer")
    assume(peers)
    loop = a - b @ k
    assert numpy.max(numpy.abs(numpy.linalg.eigvals(loop))) < 1
    # The residual in X moves X by the inverse of the Stein operator of the closed loop; rounding makes a residual of eps times the terms' sizes.
    stein = numpy.eye(order**2) - numpy.kron(loop.T, loop.T)
    condition = 1 / numpy.linalg.svd(stein, compute_uv=False)[-1]
    terms = norm(x) * (1 + norm(a) ** 2 + norm(loop) ** 2) + norm(q) + norm(k) ** 2 * norm(r) + 2 * norm(n) * norm(k)
    # The peers weigh R⁻¹ or the extended pencil, whose conditioning is not that of the solution.
    tolerance = ULPS * EPS * condition * terms * max(1.0, numpy.linalg.cond(r) ** 0.5)
    for name, theirs in peers.items():
        if norm(x - theirs) <= tolerance:
            continue
        # The equation itself is the witness: ours leaves the smaller residual, and one that rounding explains.
        mine, other = riccati_residual(a, b, q, r, n, x), riccati_residual(a, b, q, r, n, theirs)
        assert mine <= ULPS * EPS * terms * max(1.0, numpy.linalg.cond(r + b.T @ x @ b) ** 0.5), (name, mine / (EPS * terms))
        assert mine <= other, (name, mine, other)
        event(f"{name} solves the Riccati equation less exactly")
    assert ours.E == pytest.approx(matched(ours.E, numpy.linalg.eigvals(loop)), abs=1e-5)
