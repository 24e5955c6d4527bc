"""Each operation of a peer by deadtime's. What deadtime does not offer (complex matrices, Sylvester's equations, …) stays the peer's own.

An input that deadtime refuses is given to the peer too: a refusal of both is the peer's error, a refusal of ours alone fails the test.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import control
import control.bdalg
import control.delay
import control.mateqn
import control.statefbk
import control.stochsys
import control.sysnorm
import numpy
import scipy.linalg
import scipy.signal
from scipy._lib._array_api import xp_capabilities_table

import deadtime
from deadtime.errors import DeadtimeError

Operation: TypeAlias = Callable[..., Any]

#: The operations that the running test has reached.
reached: set[str] = set()


class NotOffered(Exception):
    """deadtime does not offer this; the peer does it."""


def _real(*matrices: Any) -> list[numpy.ndarray]:
    arrays = [numpy.asarray(m) for m in matrices]
    if any(a.dtype.kind not in "fiub" or a.dtype.itemsize > 8 or not a.size or a.ndim > 2 for a in arrays):
        raise NotOffered
    return [numpy.atleast_2d(a).astype(float) for a in arrays]


def _square(*matrices: numpy.ndarray) -> None:
    if any(not numpy.allclose(m, m.T, rtol=1e-10, atol=0) for m in matrices):
        raise NotOffered


def _ours(system: Any) -> deadtime.StateSpace:
    if isinstance(system, control.StateSpace):
        if system.dt is True or system.nstates == 0:
            raise NotOffered
        return deadtime.as_system(system)
    raise NotOffered


def _theirs(system: deadtime.StateSpace, like: Any) -> Any:
    return control.StateSpace(system.A, system.B, system.C, system.D, like.dt)


# scipy


def _cont2discrete(system: Any, dt: float, method: str = "zoh", alpha: float | None = None) -> Any:
    if not isinstance(system, tuple) or len(system) != 4 or method not in ("zoh", "foh", "impulse", "gbt", "bilinear", "tustin", "euler", "backward_diff"):
        raise NotOffered
    matrices = _real(*system)
    options = {"alpha": alpha} if method == "gbt" else {}
    sampled = deadtime.c2d(tuple(matrices), float(dt), "tustin" if method == "bilinear" else method, **options)
    # What does not change stays the caller's, with its type.
    c, d = (given if numpy.array_equal(found, given) else found for found, given in zip((sampled.C, sampled.D), system[2:], strict=True))
    return sampled.A, sampled.B, c, d, dt


def _lsim(system: Any, U: Any, T: Any, X0: Any = None, interp: bool = True) -> Any:
    time = numpy.asarray(T)
    if U is None or time.ndim != 1 or time.size < 2 or not numpy.allclose(numpy.diff(time), time[1] - time[0]):
        raise NotOffered
    space = system if isinstance(system, scipy.signal.lti) else scipy.signal.lti(*system)
    space = space.to_ss()
    matrices = _real(space.A, space.B, space.C, space.D)
    if numpy.size(U) == 1:
        U = numpy.full((time.size, matrices[1].shape[1]), U)
    if len(U) != time.size or (X0 is not None and numpy.size(X0) != len(matrices[0])):
        raise NotOffered
    (signal,) = _real(numpy.reshape(U, (time.size, -1)))
    found = deadtime.lsim(tuple(matrices), signal, sample_time=float(time[1] - time[0]), x0=X0, hold="linear" if interp else "zero", prehistory="rest")
    return time, found.y, found.x[:, 0] if found.x.shape[1] == 1 else found.x


def _dlsim(system: Any, u: Any, t: Any = None, x0: Any = None) -> Any:
    if t is not None or isinstance(system, scipy.signal.lti) or numpy.ndim(u) == 0:
        raise NotOffered
    space = system if isinstance(system, scipy.signal.dlti) else scipy.signal.dlti(*system[:-1], dt=system[-1])
    was_space = isinstance(space, scipy.signal.StateSpace)
    space = space.to_ss()
    a, b, c, d = _real(space.A, space.B, space.C, space.D)
    if x0 is not None and numpy.size(x0) != len(a):
        raise NotOffered
    x0 = None if x0 is None else numpy.reshape(x0, -1)
    (signal,) = _real(numpy.asarray(u).reshape(len(u), -1))
    found = deadtime.lsim(deadtime.StateSpace(a, b, c, d, float(space.dt)), signal, x0=x0, prehistory="rest")
    y = found.y.reshape(len(signal), -1)
    return (found.time, y, found.x) if was_space else (found.time, y)


def _solve_continuous_are(a: Any, b: Any, q: Any, r: Any, e: Any = None, s: Any = None, balanced: bool = True) -> Any:
    if e is not None:
        raise NotOffered
    a, b, q, r = _real(a, b, q, r)
    _square(q, r)
    return deadtime.care(a, b, q, r, s)


def _solve_discrete_are(a: Any, b: Any, q: Any, r: Any, e: Any = None, s: Any = None, balanced: bool = True) -> Any:
    a, b, q, r = _real(a, b, q, r)
    _square(q, r)
    return deadtime.dare(a, b, q, r, s, e)


def _solve_continuous_lyapunov(a: Any, q: Any) -> Any:
    a, q = _real(a, q)
    return deadtime.lyap(a, -q)


def _solve_discrete_lyapunov(a: Any, q: Any, method: str | None = None) -> Any:
    a, q = _real(a, q)
    return deadtime.dlyap(a, q)


# python-control


def _lyap(A: Any, Q: Any, C: Any = None, E: Any = None, method: Any = None) -> Any:
    if C is not None or E is not None:
        raise NotOffered
    a, q = _real(A, Q)
    _square(q)
    return deadtime.lyap(a, q)


def _dlyap(A: Any, Q: Any, C: Any = None, E: Any = None, method: Any = None) -> Any:
    if C is not None or E is not None:
        raise NotOffered
    a, q = _real(A, Q)
    _square(q)
    return deadtime.dlyap(a, q)


def _riccati(sampled: bool) -> Callable[..., Any]:
    def solve(A: Any, B: Any, Q: Any, R: Any = None, S: Any = None, E: Any = None, stabilizing: bool = True, **names: Any) -> Any:
        if not stabilizing or (E is not None and not sampled) or names.get("method") not in (None, "scipy", "slycot"):
            raise NotOffered
        a, b, q = _real(A, B, Q)
        (r,) = _real(numpy.eye(b.shape[1]) if R is None else R)
        _square(q, r)
        s = None if S is None else _real(S)[0]
        e = numpy.eye(len(a)) if E is None else _real(E)[0]
        if sampled:
            x = deadtime.dare(a, b, q, r, s, None if E is None else e)
            k = numpy.linalg.solve(r + b.T @ x @ b, b.T @ x @ a + (0 if s is None else s.T))
        else:
            x = deadtime.care(a, b, q, r, s)
            k = numpy.linalg.solve(r, b.T @ x + (0 if s is None else s.T))
        return x, numpy.linalg.eigvals(numpy.linalg.solve(e, a - b @ k)), k

    return solve


def _regulator(name: str) -> Callable[..., Any]:
    def solve(*arguments: Any, **options: Any) -> Any:
        if options.pop("method", None) not in (None, "scipy", "slycot") or options.keys() - {"integral_action"} or any(v is not None for v in options.values()):
            raise NotOffered
        if isinstance(arguments[0], control.StateSpace):
            system = arguments[0]
            if (system.dt in (0, None)) != (name == "lqr") or system.dt is True:
                raise NotOffered
            arguments = (system.A, system.B, *arguments[1:])
        if len(arguments) not in (4, 5):
            raise NotOffered
        matrices = _real(*arguments)
        return tuple(getattr(deadtime, name)(*matrices))

    return solve


def _in_order(poles: Any, others: Any) -> Any:
    """The poles, each in the place of the nearest of the others."""
    left = list(poles)
    return numpy.array([left.pop(int(numpy.argmin([abs(p - other) for p in left]))) for other in others])


def _estimator(name: str) -> Callable[..., Any]:
    def solve(*arguments: Any, **options: Any) -> Any:
        if options.pop("method", None) not in (None, "scipy", "slycot") or options or not arguments or isinstance(arguments[0], control.StateSpace) or len(arguments) not in (5, 6):
            raise NotOffered
        a, g, c, q, r, *n = _real(*arguments)
        gain, covariance, poles = getattr(deadtime, name)(a, c, g @ q @ g.T, r, *[g @ n[0]] if n else [])
        return gain, covariance, _in_order(poles, numpy.linalg.eigvals(a.T - c.T @ gain.T))

    return solve


def _pade(T: float, n: int = 1, numdeg: int | None = None) -> Any:
    if numdeg not in (None, n) or not (isinstance(n, int) and n > 0 and T > 0):
        raise NotOffered
    filter = deadtime.pade(T, n).transfer_function()
    return list(filter.num), list(filter.den)


def _binary(name: str) -> Callable[..., Any]:
    def join(*systems: Any, **options: Any) -> Any:
        if len(systems) != 2 or options or any(not isinstance(s, control.StateSpace) for s in systems) or systems[0].dt != systems[1].dt:
            raise NotOffered
        return _theirs(getattr(deadtime, name)(*map(_ours, systems)), systems[0])

    return join


def _feedback(sys1: Any, sys2: Any = 1, sign: int = -1, **options: Any) -> Any:
    if options or not isinstance(sys1, control.StateSpace) or (isinstance(sys2, control.StateSpace) and sys1.dt != sys2.dt):
        raise NotOffered
    back = float(sys2) if isinstance(sys2, int | float) and sys1.ninputs == sys1.noutputs else _ours(sys2)
    return _theirs(deadtime.feedback(_ours(sys1), back, float(sign)), sys1)


def _norm(system: Any, p: Any = 2, tol: float = 1e-6, print_warning: bool = True, method: Any = None) -> Any:
    if not isinstance(system, control.StateSpace | control.TransferFunction) or system.dt is True:
        raise NotOffered
    if p not in (2, "inf"):
        raise NotOffered
    return deadtime.norm(system, 2 if p == 2 else "linf")


def _sample(self: Any, Ts: float, method: str = "zoh", alpha: Any = None, prewarp_frequency: Any = None, **names: Any) -> Any:
    if names or self.dt not in (0, None) or self.nstates == 0 or method not in ("zoh", "foh", "gbt", "bilinear", "tustin", "euler", "backward_diff"):
        raise NotOffered
    bilinear = method in ("bilinear", "tustin")
    options = {"alpha": alpha} if method == "gbt" else {"prewarp_rad_s": prewarp_frequency} if bilinear and prewarp_frequency else {}
    if prewarp_frequency and not bilinear:
        raise NotOffered
    sampled = deadtime.c2d(_ours(self), float(Ts), "tustin" if bilinear else method, **options)
    found = control.StateSpace(sampled.A, sampled.B, sampled.C, sampled.D, Ts)
    if self.input_labels or self.output_labels:
        found._copy_names(self, prefix_suffix_name="sampled")
        found.dt = Ts
    return found


def _poles(self: Any) -> Any:
    return _ours(self).poles()


def _zeros(self: Any) -> Any:
    return _ours(self).zeros()


# In place


def _adapter(name: str, ours: Callable[..., Any], theirs: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(theirs)
    def call(*arguments: Any, **options: Any) -> Any:
        try:
            found = ours(*arguments, **options)
        except NotOffered:
            return theirs(*arguments, **options)
        except (DeadtimeError, ValueError, TypeError):
            theirs(*arguments, **options)  # an error of both is the peer's
            reached.add(name)
            raise
        reached.add(name)
        return found

    return call


def _replace(package: str, module: Any, name: str, ours: Callable[..., Any]) -> None:
    """The function wherever the package has it."""
    theirs = getattr(module, name)
    adapter = _adapter(f"{package}.{name}", ours, theirs)
    if theirs in xp_capabilities_table:
        # scipy's tests ask for what a function can do by the function.
        xp_capabilities_table[adapter] = xp_capabilities_table[theirs]
    for loaded in [m for key, m in sys.modules.items() if key.split(".")[0] == package and m is not None]:
        for attribute, value in list(vars(loaded).items()):
            if value is theirs:
                setattr(loaded, attribute, adapter)


def install() -> None:
    """Every operation that deadtime offers, in the place of the peers'."""
    signal: Sequence[tuple[str, Operation]] = [("cont2discrete", _cont2discrete), ("lsim", _lsim), ("dlsim", _dlsim)]
    for name, ours in signal:
        _replace("scipy", scipy.signal, name, ours)
    equations: Sequence[tuple[str, Operation]] = [
        ("solve_continuous_are", _solve_continuous_are),
        ("solve_discrete_are", _solve_discrete_are),
        ("solve_continuous_lyapunov", _solve_continuous_lyapunov),
        ("solve_discrete_lyapunov", _solve_discrete_lyapunov),
    ]
    for name, ours in equations:
        _replace("scipy", scipy.linalg, name, ours)
    functions: Sequence[tuple[Any, str, Operation]] = [
        (control.mateqn, "lyap", _lyap),
        (control.mateqn, "dlyap", _dlyap),
        (control.mateqn, "care", _riccati(sampled=False)),
        (control.mateqn, "dare", _riccati(sampled=True)),
        (control.statefbk, "lqr", _regulator("lqr")),
        (control.statefbk, "dlqr", _regulator("dlqr")),
        (control.stochsys, "lqe", _estimator("lqe")),
        (control.stochsys, "dlqe", _estimator("dlqe")),
        (control.delay, "pade", _pade),
        (control.bdalg, "series", lambda *s, **o: _binary("series")(*s, **o)),
        (control.bdalg, "parallel", lambda *s, **o: _binary("parallel")(*s, **o)),
        (control.bdalg, "feedback", _feedback),
        (control.sysnorm, "norm", _norm),
    ]
    for module, name, ours in functions:
        _replace("control", module, name, ours)
    methods: Sequence[tuple[str, Operation]] = [("poles", _poles), ("zeros", _zeros), ("sample", _sample)]
    for name, method in methods:
        setattr(control.StateSpace, name, _adapter(f"control.StateSpace.{name}", method, getattr(control.StateSpace, name)))
