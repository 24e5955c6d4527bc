"""Three ways through the same equations: matrix exponentials (linear), scipy's solve_ivp (reference), Dormand-Prince (fast).

All take a grid of times at which inputs may jump or bend, `values` and `slopes` per interval, and give the state at each grid time.
Friction sticks and slips at located events; while it sticks the state is exactly 0.
"""

import numpy as np
from scipy import integrate, linalg

from .system import System, compiled

_DP = (
    (1 / 5,), (3 / 40, 9 / 40), (44 / 45, -56 / 15, 32 / 9), (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656), (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
_TIMES = (1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
_ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
MOST_STEPS = 400  # of Dormand-Prince per interval, in fits a fifth, and as many events; a response that needs more runs away, is too stiff or sticks and slips without end
TOO_SHORT = 1e-13  # s: an interval this short is passed without a step


def _step_source(n: int) -> str:
    """One Dormand-Prince 5(4) step of n states, unrolled: the new state, its derivative, the largest error relative to S, the largest states so far."""
    lines = ["def step(f, t, h, X, seg, P, fr, k0, S):", f"{', '.join(f'x{i}' for i in range(n))}, = X"]
    lines.append(f"{', '.join(f'k0_{i}' for i in range(n))}, = k0")
    for stage, weights in enumerate(_DP, start=1):
        terms = [
            f"x{i} + h*(" + " + ".join(f"{w!r}*k{s}_{i}" for s, w in enumerate(weights) if w) + ")" for i in range(n)
        ]
        lines.append(f"Y = ({', '.join(terms)},)")
        lines.append(f"K = f(t + {_TIMES[stage - 1]!r}*h, Y, seg, P, fr)")
        lines.append(f"{', '.join(f'k{stage}_{i}' for i in range(n))}, = K")
    lines.append("worst = 0.0")
    for i in range(n):
        error = " + ".join(f"{w!r}*k{s}_{i}" for s, w in enumerate(_ERROR) if w)
        lines += [f"size = abs(Y[{i}])", f"if size > S[{i}]: S[{i}] = size", f"ratio = abs(h*({error}))/S[{i}]", "if worst == worst and not ratio <= worst: worst = ratio"]
    lines.append("return Y, K, worst")
    return "\n ".join(lines)


class Linear:
    """Exact for systems that are linear in state and input, input piecewise linear."""

    def __init__(self, system: System, nu: int):
        n, p = len(system.x) + len(system.extra), system.parameters
        zero_x, zero_v = [0.0] * n, [0.0] * (2 * nu)
        unit = np.eye(max(n, nu))

        def probe(function):
            base = np.array(function(0.0, zero_x, (0.0, *zero_v), p))
            by_state = [np.array(function(0.0, list(unit[i, :n]), (0.0, *zero_v), p)) - base for i in range(n)]
            by_input = [np.array(function(0.0, zero_x, (0.0, *unit[i, :nu], *[0.0] * nu), p)) - base for i in range(nu)]
            return np.array(by_state).T.reshape(-1, n), np.array(by_input).T, base

        a, b, constant = probe(lambda *args: system.f(*args, ()))
        self.c, self.d, self.c0 = probe(system.g)
        self.n, self.nu = n, nu
        self.generator = np.zeros((n + 2 * nu + 1,) * 2)
        self.generator[:n, :n], self.generator[:n, n:n + nu], self.generator[:n, -1] = a, b, constant
        self.generator[n:n + nu, n + nu:-1] = np.eye(nu)
        self.cache: dict[float, np.ndarray] = {}

    def transitions(self, steps: np.ndarray) -> list[np.ndarray]:
        rounded = np.round(steps, 13)
        new = [h for h in np.unique(rounded) if h not in self.cache]
        if new:
            exponentials = linalg.expm(np.array(new)[:, None, None] * self.generator)
            self.cache.update(zip(new, exponentials[:, : self.n]))
        return [self.cache[h] for h in rounded]

    def run(self, grid, values, slopes, x, correct=None) -> np.ndarray:
        n, nu = self.n, self.nu
        known = np.ones((len(grid), n + 2 * nu + 1))
        known[0, :n] = x
        known[:, n:n + nu], known[:, n + nu:-1] = values, slopes
        result = known[:, :n]
        for i, matrix in enumerate(self.transitions(np.diff(grid))):
            if correct is not None:
                correct(i, result)
            matrix.dot(known[i], out=known[i + 1, :n])
        if correct is not None:
            correct(len(grid) - 1, result)
        return result

    def outputs(self, grid, values, slopes, states) -> np.ndarray:
        return states @ self.c.T + values @ self.d.T + self.c0

    def output_at(self, grid, values, slopes):
        """A function (i, state) of the outputs at one grid time."""
        c, offsets = self.c, values @ self.d.T + self.c0
        return lambda i, x: c.dot(x) + offsets[i]


class Stepped:
    """Nonlinear systems, interval by interval. `reference`: solve_ivp; else the Dormand-Prince pair of this file."""

    def __init__(self, system: System, reference: bool, tolerance: float, method: str = "DOP853"):
        self.system, self.reference, self.tolerance, self.method = system, reference, tolerance, method
        self.fr: list[float] | None = None
        n = len(system.x) + len(system.extra)
        self.step = compiled(_step_source(n))["step"]
        self.scale = [1e-9] * n
        self.size = np.inf
        self.most_steps = MOST_STEPS if tolerance < 1e-8 else MOST_STEPS // 5

    def run(self, grid, values, slopes, x, correct=None) -> np.ndarray:
        result = np.empty((len(grid), len(x)))
        result[0] = x
        x = tuple(float(v) for v in x)
        times, values, slopes = grid.tolist(), values.tolist(), slopes.tolist()
        smooth = not self.reference and not self.system.frictions
        for i in range(len(times)):
            if correct is not None:
                result[i] = x
                correct(i, result)
                x = tuple(result[i].tolist())
            if i + 1 < len(times) and smooth:
                x = self._dormand_prince(times[i], times[i + 1], x, (times[i], *values[i], *slopes[i]))[1]
                result[i + 1] = x
            elif i + 1 < len(times):
                x = self._interval(times[i], times[i + 1], x, (times[i], *values[i], *slopes[i]))
                result[i + 1] = x
        return result

    def outputs(self, grid, values, slopes, states) -> np.ndarray:
        g, p = self.system.g, self.system.parameters
        return np.array([g(t, x, (t, *v, *s), p) for t, v, s, x in zip(grid.tolist(), values.tolist(), slopes.tolist(), states.tolist())])

    def output_at(self, grid, values, slopes):
        g, p, times = self.system.g, self.system.parameters, grid.tolist()
        segments = [(t, *v, *s) for t, v, s in zip(times, values.tolist(), slopes.tolist())]
        return lambda i, x: g(times[i], x.tolist(), segments[i], p)

    def _interval(self, t, end, x, seg):
        advance = self._solve_ivp if self.reference else self._dormand_prince
        if self.system.frictions:
            x = self._friction_modes(t, x, seg)
        short = events = 0
        while end - t > TOO_SHORT:
            new, x, event = advance(t, end, x, seg)
            if event is not None:
                events += 1
                if events > self.most_steps:
                    raise ArithmeticError("friction sticks and slips without end")
                short = short + 1 if new - t < 1e-11 else 0
                x = self._after_event(event, new, x, seg, hold=short > 2)
            t = new
        return x

    def _friction_modes(self, t, x, seg):
        """At the start of an interval: what rests stays at rest unless the rest of the derivative is stronger than friction."""
        p, rests = self.system.parameters, self.system.rest(t, x, seg, self.system.parameters)
        fr = self.fr = self.fr or [None] * len(rests)
        for j, (state, level) in enumerate(self.system.frictions):
            value = x[state]
            if value != 0.0:
                fr[j] = 1.0 if value > 0 else -1.0
            else:
                fr[j] = 0.0 if abs(rests[j]) <= p[level] else (1.0 if rests[j] > 0 else -1.0)
        return x

    def _after_event(self, j, t, x, seg, hold):
        """Friction j reached x = 0 or breaks away at t. `hold`: it chatters within rounding, so it rests."""
        state, level = self.system.frictions[j]
        x = list(x)
        x[state] = 0.0
        rest = self.system.rest(t, x, seg, self.system.parameters)[j]
        limit = self.system.parameters[level]
        broke_away = self.fr[j] == 0.0
        if hold or (abs(rest) <= limit and not broke_away):
            self.fr[j] = 0.0
        else:
            self.fr[j] = 1.0 if rest > 0 else -1.0
        return tuple(x)

    def _event_values(self, t, x, seg):
        """Per friction: positive as long as its mode (slips, sticks) lasts."""
        p = self.system.parameters
        rests = self.system.rest(t, x, seg, p) if 0.0 in self.fr else None
        return [
            self.fr[j] * x[state] if self.fr[j] else p[level] - abs(rests[j])
            for j, (state, level) in enumerate(self.system.frictions)
        ]

    def _solve_ivp(self, t, end, x, seg):
        f, p, fr = self.system.f, self.system.parameters, self.fr
        self.scale = [max(s, abs(v)) for s, v in zip(self.scale, x)]
        events = []
        for j in range(len(self.system.frictions)):
            def event(time, state, j=j):
                return self._event_values(time, state, seg)[j]
            event.terminal, event.direction = True, -1
            events.append(event)
        solved = integrate.solve_ivp(
            lambda time, state: f(time, state, seg, p, fr), (t, end), x, method=self.method, rtol=self.tolerance,
            atol=np.maximum(np.array(self.scale) * self.tolerance * 1e-2, 1e-300), events=events or None,
            max_step=(end - t) / 4 if events else np.inf,  # so that no event hides inside a step
        )
        if not solved.success:
            raise ArithmeticError(solved.message)
        happened = next((j for j, times in enumerate(solved.t_events or []) if len(times)), None)
        return solved.t[-1], tuple(solved.y[:, -1].tolist()), happened

    def _dormand_prince(self, t, end, x, seg):
        f, p, fr, step, scale = self.system.f, self.system.parameters, self.fr, self.step, self.scale
        k0 = f(t, x, seg, p, fr)
        h = min(self.size, end - t)
        for _ in range(self.most_steps):
            new, k1, worst = step(f, t, h, x, seg, p, fr, k0, scale)
            worst /= self.tolerance
            if not worst < 1e30:
                raise ArithmeticError("the response runs away")
            if worst > 1.0:
                h *= max(0.2, 0.9 * worst**-0.2)
                continue
            if fr:
                event = self._locate(t, h, x, seg, k0, new)
                if event is not None:
                    return event
            self.size = h * min(5.0, 0.9 * max(worst, 1e-8) ** -0.2) if h >= min(self.size, end - t) or worst > 0.1 else self.size
            t += h
            x, k0 = new, k1
            if end - t <= TOO_SHORT:
                return end, x, None
            h = min(self.size, end - t)
        raise ArithmeticError("the response runs away or is too stiff")

    def _locate(self, t, h, x, seg, k0, new):
        """The first event inside the step, by bisection with the secant's help, or None."""
        def lowest(size, state):
            values = self._event_values(t + size, state, seg)
            j = min(range(len(values)), key=values.__getitem__)
            return values[j], j

        high, (high_value, _) = h, lowest(h, new)
        if high_value >= 0.0:
            return None
        low, low_value = 0.0, max(lowest(0.0, x)[0], 0.0)
        for turn in range(60):
            guess = low + (high - low) * low_value / (low_value - high_value) if turn % 3 else 0.5 * (low + high)
            guess = min(max(guess, low + 0.02 * (high - low)), high - 0.02 * (high - low))
            state = self.step(self.system.f, t, guess, x, seg, self.system.parameters, self.fr, k0, self.scale)[0]
            value, _ = lowest(guess, state)
            if value >= 0.0:
                low, low_value = guess, value
            else:
                high, high_value, new = guess, value, state
            if high - low < 1e-14 + 1e-12 * h:
                break
        return t + high, new, lowest(high, new)[1]
