"""What is computed from linear systems: regulators, filters, matrix equations, norms, connections, and delays as filters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy
from numpy.typing import ArrayLike

from . import _native, errors
from ._native import StateSpace
from .models import Lqr, _is_system, as_system

if TYPE_CHECKING:
    from .arrays import Array, ComplexArray
    from .models import SystemLike


class Filter(NamedTuple):
    """Kalman's filter in steady state."""

    #: The predictor's gain, shape (n, p): x̂[k+1] = A x̂[k] + L (y − C x̂), or the same of the derivative.
    L: Array
    #: The covariance of the prediction's error, shape (n, n).
    P: Array
    #: The poles of A − L C, shape (n,).
    E: ComplexArray


def _plant(function: str, given: tuple[Any, ...], N: ArrayLike | None, sampled: bool, output: bool) -> list[Any]:
    """A, B (or C), Q, R, N of matrices or of a system in their place."""
    rest = list(given)
    if N is not None:
        rest.append(N)
    of_system = bool(rest) and (isinstance(rest[0], tuple) or _is_system(rest[0]))
    needed = 3 if of_system else 4
    if not needed <= len(rest) <= needed + 1:
        raise TypeError(f"{function} takes {'(A, C, Q, R)' if output else '(A, B, Q, R)'} or (system, Q, R), and perhaps N")
    if of_system:
        system = as_system(rest.pop(0))
        if (system.sample_time is not None) != sampled:
            raise errors.ModelError(f"{function} needs a {'sampled' if sampled else 'continuous'} system; convert it with {'c2d' if sampled else 'd2c'} first")
        if system.input_delay.any() and not output:
            raise errors.ModelError(f"{function} needs a system without delays: pade or with_delays_as_states makes states of them, which Q then weighs too")
        rest = [system.A, system.C if output else system.B, *rest]
    return rest if len(rest) == 5 else [*rest, None]


def lqr(*arguments: Any, N: ArrayLike | None = None) -> Lqr:
    """The gain K that minimises ∫ xᵀQx + uᵀRu + 2xᵀNu dt over dx/dt = A x + B u by u = −K x: `lqr(A, B, Q, R, N)` or `lqr(system, Q, R, N)`.

    The `arguments`, results and errors are those of `dlqr`, of a continuous system.

    Notes
    -----
    Structure-preserving doubling: Chu, Fan and Lin (2005), Linear Algebra Appl. 396, 55-80, doi:10.1016/j.laa.2004.10.010.

    Examples
    --------
    A double integrator:

    >>> import deadtime
    >>> deadtime.lqr([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0], [0.0, 0.0]], 1.0).K.round(6)
    array([[1.      , 1.414214]])
    """
    a, b, q, r, n = _plant("lqr", arguments, N, sampled=False, output=False)
    return Lqr(*_native._lqr(a, b, q, r, n))


def care(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None = None) -> Array:
    """The stabilising solution X of AᵀX + XA − (XB + N)R⁻¹(BᵀX + Nᵀ) + Q = 0; arguments as of `lqr`.

    Examples
    --------
    >>> import deadtime
    >>> round(float(deadtime.care(1.0, 1.0, 1.0, 1.0)[0, 0]), 6)
    2.414214
    """
    return _native._care(A, B, Q, R, N)


def lqe(*arguments: Any, N: ArrayLike | None = None) -> Filter:
    """Kalman's filter of dx/dt = A x + w, y = C x + v: `lqe(A, C, Q, R, N)` or `lqe(system, Q, R, N)`.

    Of the `arguments`, Q (n, n), R (p, p) and N (n, p; 0 without it) are the intensities of w, of v, and between the two.

    Examples
    --------
    >>> import deadtime
    >>> round(float(deadtime.lqe(1.0, 1.0, 1.0, 1.0).L[0, 0]), 6)
    2.414214
    """
    a, c, q, r, n = _plant("lqe", arguments, N, sampled=False, output=True)
    return Filter(*_native._filter(a, c, q, r, n, False))


def dlqe(*arguments: Any, N: ArrayLike | None = None) -> Filter:
    """Kalman's filter of x[k+1] = A x[k] + w, y = C x + v: `dlqe(A, C, Q, R, N)` or `dlqe(system, Q, R, N)`.

    Of the `arguments`, Q (n, n), R (p, p) and N (n, p; 0 without it) are the covariances of w, of v, and between the two. The gain is the predictor's, as python-control's; MATLAB's
    `dlqe` gives that of the update, M with A M = L.

    Examples
    --------
    A random walk in noise of its own size has the golden ratio for its covariance:

    >>> import deadtime
    >>> round(float(deadtime.dlqe(1.0, 1.0, 1.0, 1.0).P[0, 0]), 6)
    1.618034
    """
    a, c, q, r, n = _plant("dlqe", arguments, N, sampled=True, output=True)
    return Filter(*_native._filter(a, c, q, r, n, True))


def kalman(system: SystemLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None = None) -> Filter:
    """Kalman's filter of a system, continuous or sampled: `lqe` or `dlqe`, whichever its time asks for, with their Q, R and N.

    Examples
    --------
    >>> import deadtime
    >>> round(float(deadtime.kalman(deadtime.StateSpace(1.0, 1.0, 1.0, sample_time=0.1), 1.0, 1.0).P[0, 0]), 6)
    1.618034
    """
    ours = as_system(system)
    return (lqe if ours.sample_time is None else dlqe)(ours, Q, R, N=N)


def lyap(A: ArrayLike, Q: ArrayLike) -> Array:
    """The X of A X + X Aᵀ + Q = 0, all n×n, as MATLAB's `lyap`.

    Raises
    ------
    ModelError
        Two poles of A add up to 0.

    Examples
    --------
    >>> import deadtime
    >>> float(deadtime.lyap(-2.0, 4.0)[0, 0])
    1.0
    """
    return _native._lyap(A, Q, False)


def dlyap(A: ArrayLike, Q: ArrayLike) -> Array:
    """The X of A X Aᵀ − X + Q = 0, all n×n, as MATLAB's `dlyap`.

    Raises
    ------
    ModelError
        The product of two poles of A is 1.

    Examples
    --------
    >>> import deadtime
    >>> float(deadtime.dlyap(0.5, 3.0)[0, 0])
    4.0
    """
    return _native._lyap(A, Q, True)


def norm(system: SystemLike, kind: Literal[2, "2", "inf", "linf"] | float = 2) -> float:
    """A norm of a linear system; delays change none of them.

    Parameters
    ----------
    system : SystemLike
        Continuous or sampled, whatever `as_system` takes.
    kind : 2, inf or "linf"
        2: the H2 norm, the output's standard deviation under white noise. inf: the H-infinity norm, the largest gain of a stable system. "linf": the largest gain
        over all frequencies whatever the poles, as MATLAB's `norm(sys, inf)`.

    Returns
    -------
    float
        Infinite for 2 and inf where a pole does not decay, for 2 of a continuous system with a direct path, and for "linf" with a pole on the boundary.

    Examples
    --------
    1/(s + 1): 1/√2 and 1.

    >>> import deadtime
    >>> round(deadtime.norm(([1.0], [1.0, 1.0])), 6), round(deadtime.norm(([1.0], [1.0, 1.0]), "inf"), 6)
    (0.707107, 1.0)
    """
    ours = as_system(system)
    if kind in (2, "2"):
        return _native._norm_h2(ours)
    if kind in ("inf", float("inf")):
        return ours.norm_hinf()[0]
    if kind != "linf":
        raise ValueError(f"no norm is called {kind!r}: write 2, inf or 'linf'")
    return _largest_gain(ours)


def _largest_gain(system: StateSpace) -> float:
    """Over the axis or the circle: the band of the poles and zeros by level sets, its ends by their limits."""
    poles = system.poles()
    if system.sample_time is None:
        sizes = numpy.abs(poles)
        on_edge = numpy.abs(poles.real) <= 1e-13 * (sizes.max(initial=0.0) + 1e-300)
    else:
        sizes = numpy.abs(numpy.log(poles[poles != 0])) / system.sample_time
        on_edge = numpy.abs(numpy.abs(poles) - 1.0) <= 1e-13
    if on_edge.any():
        return float("inf")
    moving = sizes[sizes > 0]
    low, high = (1e-4 * moving.min(), 1e4 * moving.max()) if moving.size else (0.1, 10.0)
    if system.sample_time is not None:
        high = numpy.pi / system.sample_time
    peak = _native._norm_linf(system, (min(low, 0.5 * high), high))
    ends = [numpy.linalg.norm(system.dc_gain(), 2), numpy.linalg.norm(system.D, 2) if system.sample_time is None else 0.0]
    return max(float(peak[0]) if peak else 0.0, *map(float, ends))


def nu_gap(first: SystemLike, second: SystemLike) -> float:
    """Vinnicombe's nu-gap of two systems (`first`, `second`) of one time, without delays: 0 for systems that no controller distinguishes, 1 for what none stabilises both of.

    Notes
    -----
    Vinnicombe (1993), IEEE Trans. Automat. Contr. 38(9), 1371-1383.

    Examples
    --------
    >>> import deadtime
    >>> round(deadtime.nu_gap(([1.0], [1.0, 1.0]), ([1.0], [1.0, 1.0])), 6)
    0.0
    """
    return _native._nu_gap(as_system(first), as_system(second))


def series(first: SystemLike, second: SystemLike) -> StateSpace:
    """`second` driven by the outputs of `first`, as MATLAB's `series(first, second)`; the product second·first.

    A delay between the two moves to the inputs where all of them are alike; else it becomes states of a sampled system.

    Raises
    ------
    ModelError
        Outputs and inputs that differ in number, unlike times, unlike continuous delays between the two.

    Examples
    --------
    >>> import deadtime
    >>> float(deadtime.series(([2.0], [1.0, 1.0]), ([3.0], [1.0, 2.0])).dc_gain()[0, 0])
    3.0
    """
    return _native._connect("series", as_system(first), as_system(second), 0.0)


def parallel(first: SystemLike, second: SystemLike) -> StateSpace:
    """The sum of the outputs of two systems (`first`, `second`) with the same inputs, as MATLAB's `parallel`; delays and errors as of `series`.

    Examples
    --------
    >>> import deadtime
    >>> float(deadtime.parallel(([2.0], [1.0, 1.0]), ([3.0], [1.0, 2.0])).dc_gain()[0, 0])
    3.5
    """
    return _native._connect("parallel", as_system(first), as_system(second), 0.0)


def feedback(forward: SystemLike, back: SystemLike | float = 1.0, sign: float = -1.0) -> StateSpace:
    """The loop y = forward·(u + sign·back·y), as MATLAB's `feedback(forward, back, sign)`; a number for `back` is that gain of every output.

    Delays of sampled systems stay in the loop, as states.

    Raises
    ------
    ModelError
        Channels that do not fit, unlike times, a continuous delay in the loop (convert with `c2d`, or approximate it by `pade`), a loop without a solution.

    Examples
    --------
    >>> import deadtime
    >>> float(deadtime.feedback(([1.0], [1.0, 0.0])).poles()[0].real)
    -1.0
    """
    ours = as_system(forward)
    if isinstance(back, int | float):
        empty = numpy.zeros((0, 0))
        p = ours.outputs
        back = StateSpace(empty, numpy.zeros((0, p)), numpy.zeros((p, 0)), float(back) * numpy.eye(p), ours.sample_time)
    return _native._connect("feedback", ours, as_system(back), float(sign))


def pade(delay: float, order: int) -> StateSpace:
    """A delay, s, in continuous time as an all-pass filter whose numerator and denominator are of this order: `pade(T, N)` of MATLAB and python-control.

    Examples
    --------
    >>> import deadtime
    >>> float(deadtime.pade(0.5, 1).poles()[0].real)
    -4.0
    """
    return _native._pade(float(delay), order)


def thiran(delay: float, sample_time: float, order: int | None = None) -> StateSpace:
    """A delay, s, in sampled time as an all-pass filter, maximally flat at low frequencies.

    Without `order` it has ⌈delay/sample_time⌉ states, as MATLAB's `thiran(tau, Ts)`; with it at most so many, behind whole samples of input delay.

    Notes
    -----
    Thiran (1971), IEEE Trans. Circuit Theory 18(6), 659-664, doi:10.1109/TCT.1971.1083363.

    Examples
    --------
    >>> import deadtime
    >>> deadtime.thiran(0.25, 0.1).order
    3
    """
    return _native._thiran(float(delay), float(sample_time), order)


def _samples(values: ArrayLike) -> Array:
    """Samples, then channels."""
    array = numpy.asarray(values, dtype=float)
    return array[:, None] if array.ndim == 1 else array


def markov(u: ArrayLike, y: ArrayLike, count: int) -> Array:
    """The first `count` Markov parameters D, CB, CAB, … by least squares, from rest at the first sample.

    Parameters
    ----------
    u, y : array_like, shapes (N,) or (N, m), and (N,) or (N, p)
        Input and output, samples first.
    count : int
        As many as the response lasts; truncation is an error of the model.

    Returns
    -------
    array, shape (count, p, m)

    Raises
    ------
    IdentifyError
        Fewer samples than unknowns, or an input that is not rich enough.

    Examples
    --------
    >>> import deadtime
    >>> deadtime.markov([1.0, 0.0, 2.0, 0.0, 0.0], [0.5, 0.25, 1.0, 0.5, 0.0], 2).ravel().round(6)
    array([0.5 , 0.25])
    """
    return _native._markov(_samples(u), _samples(y), count, None)


def okid(u: ArrayLike, y: ArrayLike, past: int, count: int) -> Array:
    """The first `count` Markov parameters by an observer whose memory is `past` samples: from any start, and of responses that last longer.

    Arguments, result and errors are those of `markov`.

    Notes
    -----
    Juang, Phan, Horta and Longman (1993), J. Guidance, Control, and Dynamics 16(2), 320-329, doi:10.2514/3.21006.

    Examples
    --------
    >>> import deadtime
    >>> u = [1.0, 0.0, -1.0, 2.0, 0.0, 1.0, 3.0, -2.0]
    >>> y = deadtime.lsim(deadtime.StateSpace(0.5, 1.0, 1.0, sample_time=1.0), u, x0=[4.0]).y
    >>> deadtime.okid(u, y, 1, 4).ravel().round(6)
    array([0.  , 1.  , 0.5 , 0.25])
    """
    return _native._markov(_samples(u), _samples(y), count, past)


def era(markov: ArrayLike, order: int, sample_time: float) -> StateSpace:
    """The sampled model of `order` states whose Markov parameters D, CB, CAB, … these are: the eigensystem realisation algorithm.

    Parameters
    ----------
    markov : array_like, shape (K,) or (K, p, m)
        As `markov` and `okid` give them; of an impulse response, its samples times the sample time.
    order : int
        States.
    sample_time : float
        s.

    Raises
    ------
    IdentifyError
        An order that so many parameters do not show.

    Notes
    -----
    Juang and Pappa (1985), J. Guidance, Control, and Dynamics 8(5), 620-627, doi:10.2514/3.20031.

    Examples
    --------
    >>> import deadtime
    >>> round(float(deadtime.era([0.0, 1.0, 0.5, 0.25, 0.125], 1, 0.1).A[0, 0]), 6)
    0.5
    """
    array = numpy.asarray(markov, dtype=float)
    return _native._era(numpy.ascontiguousarray(array[:, None, None] if array.ndim == 1 else array), order, float(sample_time))
