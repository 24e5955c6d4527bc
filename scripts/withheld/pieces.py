"""What happens to one command before any lag: piecewise linear signals, every kink at its exact time.

A piece is (start, end, value, slope): value + slope*(t - start) for start <= t < end, times in s of log time.
"""

import bisect
import math

import numpy as np

from .system import MOVING

Piece = tuple[float, float, float, float]
INFINITE = math.inf


def _split(piece: Piece, levels: tuple[float, ...]) -> list[Piece]:
    """The piece cut where it crosses one of the levels."""
    start, end, value, slope = piece
    if slope == 0.0:
        return [piece]
    cuts = sorted(start + (level - value) / slope for level in levels if math.isfinite(level))
    edges = [start, *(cut for cut in cuts if start < cut < end), end]
    return [(a, b, value + slope * (a - start), slope) for a, b in zip(edges, edges[1:]) if b > a]


class Deadband:
    def __init__(self, width: float):
        self.width = width

    def held(self, values: np.ndarray) -> np.ndarray:
        """Of successive values that hold still."""
        return np.sign(values) * np.maximum(np.abs(values) - self.width, 0.0)

    def __call__(self, piece: Piece) -> list[Piece]:
        result = []
        for start, end, value, slope in _split(piece, (-self.width, self.width)):
            middle = value + slope * (end - start) / 2 if math.isfinite(end) else value
            if abs(middle) <= self.width:
                result.append((start, end, 0.0, 0.0))
            else:
                result.append((start, end, value - math.copysign(self.width, middle), slope))
        return result


class Saturation:
    def __init__(self, lower: float | None, upper: float | None):
        self.lower = -INFINITE if lower is None else lower
        self.upper = INFINITE if upper is None else upper

    def held(self, values: np.ndarray) -> np.ndarray:
        return np.minimum(np.maximum(values, self.lower), self.upper)

    def __call__(self, piece: Piece) -> list[Piece]:
        result = []
        for start, end, value, slope in _split(piece, (self.lower, self.upper)):
            middle = value + slope * (end - start) / 2 if math.isfinite(end) else value
            limited = min(max(middle, self.lower), self.upper)
            result.append((start, end, value, slope) if limited == middle else (start, end, limited, 0.0))
        return result


class Backlash:
    """The play operator: p = min(max(p, v - width), v + width), centred on the first value."""

    def __init__(self, width: float):
        self.width, self.position = width, None

    def held(self, values: np.ndarray) -> np.ndarray:
        result, position = [], float(values[0]) if self.position is None else self.position
        for value in values.tolist():
            position = min(max(position, value - self.width), value + self.width)
            result.append(position)
        self.position = position
        return np.array(result)

    def __call__(self, piece: Piece) -> list[Piece]:
        start, end, value, slope = piece
        width = self.width
        if self.position is None:
            self.position = value
        held = min(max(self.position, value - width), value + width)
        if slope == 0.0:
            self.position = held
            return [(start, end, held, 0.0)]
        carried = -width if slope > 0 else width
        contact = start + (held - (value + carried)) / slope
        self.position = value + slope * (end - start) + carried if contact < end else held
        if contact >= end:
            return [(start, end, held, 0.0)]
        if contact <= start:
            return [(start, end, held, slope)]
        return [(start, contact, held, 0.0), (contact, end, held, slope)]


class RateLimit:
    def __init__(self, rate: float):
        self.rate, self.value = rate, None

    def __call__(self, piece: Piece) -> list[Piece]:
        start, end, target, slope = piece
        if self.value is None:
            self.value = target
        result = []
        behind = target - self.value
        if behind != 0.0:
            speed = math.copysign(self.rate, behind)
            closing = (speed - slope) * math.copysign(1.0, behind)
            meeting = start + abs(behind) / closing if closing > 0 else INFINITE
            if meeting >= end:
                result.append((start, end, self.value, speed))
                self.value += speed * (end - start)
                return result
            if meeting > start:
                result.append((start, meeting, self.value, speed))
            target += slope * (meeting - start)
            start = meeting
        followed = min(max(slope, -self.rate), self.rate)
        result.append((start, end, target, followed))
        self.value = target + followed * (end - start)
        return result


class Arrivals:
    """When commands arrive. In this order: late by a random delay of their own, held by a slower loop, late by a fixed delay, by one that jumps, by one that drifts."""

    def __init__(self, parameters: dict[str, dict[str, float]], delay: float, seed: int):
        self.fixed, self.rng, self.sent, self.latest = delay, np.random.default_rng(seed), 0, -INFINITE
        self.jump, self.drift = parameters.get("delay_jump"), parameters.get("delay_drift")
        self.jitter, self.slower = parameters.get("delay_jitter"), parameters.get("multi_rate")

    def _drawn(self) -> float:
        """A draw of a gamma distribution; the first command is there from the start."""
        mean, spread = self.jitter["delay"], self.jitter["spread"]
        draw = self.rng.gamma((mean / spread) ** 2, spread**2 / mean) if mean > 0 and spread > 0 else mean
        return draw if self.sent else 0.0

    def of(self, time: float) -> list[float]:
        """The times at which a command sent at `time` takes effect: one, or two where it is heard again after a delay jumped."""
        if self.jitter:
            time += self._drawn()
            if self.jitter["ordered"] >= 0.5:
                self.latest = time = max(time, self.latest)
        if self.slower and self.sent:
            period, phase = self.slower["period"], self.slower["phase"]
            time = max(time, phase + math.ceil((time - phase) / period - 1e-9) * period)
        self.sent += 1
        time += self.fixed
        times = [time]
        if self.jump:
            before, after = time + self.jump["delay"], time + self.jump["later"]
            times = [*([before] if before < self.jump["time"] else []), max(after, self.jump["time"])]
        if self.drift:
            times = [max(t, (t + self.drift["delay"]) / (1.0 - self.drift["rate"])) for t in times]
        return times


class InputChain:
    """One input's effects up to the rate limit. `parameters`: {effect: {name: value}}; `delay`: the total, s; `seed`: of random delays."""

    def __init__(self, parameters: dict[str, dict[str, float]], delay: float, seed: int = 0):
        self.arrivals = Arrivals(parameters, delay, seed)
        self.delay = delay if not MOVING & set(parameters) else None
        self.gain = parameters.get("input_gain", {}).get("gain", 1.0)
        self.quadratic = parameters.get("input_curve", {}).get("quadratic", 0.0)
        self.fade = parameters.get("gain_fade", {}).get("rate", 0.0)
        self.step = parameters.get("gain_jump")
        self.offset = parameters.get("input_offset", {}).get("offset", 0.0)
        self.stages = []
        if "deadband" in parameters:
            self.stages.append(Deadband(parameters["deadband"]["width"]))
        if "backlash" in parameters:
            self.stages.append(Backlash(parameters["backlash"]["width"]))
        if "saturation" in parameters:
            limits = parameters["saturation"]
            self.stages.append(Saturation(limits.get("lower"), limits.get("upper")))
        if "rate_limit" in parameters:
            self.stages.append(RateLimit(parameters["rate_limit"]["rate"]))
        self.current, self.edges = None, []

    def push(self, time: float, command: float) -> None:
        """A command that was sent at `time`, s of log time."""
        if self.current is None:
            self.current = command
        for arrives in self.arrivals.of(time):
            self._insert(arrives, command)

    def _insert(self, time: float, command: float) -> None:
        """Edges are in order; of several at one time the last one sent acts."""
        at = bisect.bisect_right(self.edges, time, key=lambda edge: edge[0])
        if at and self.edges[at - 1][0] == time:
            self.edges[at - 1] = (time, command)
        else:
            self.edges.insert(at, (time, command))

    def push_all(self, times: np.ndarray, commands: np.ndarray) -> None:
        self.current = float(commands[0])
        if self.delay is not None:
            self.edges = list(zip((times + self.delay).tolist(), commands.tolist()))
            return
        for time, command in zip(times.tolist(), commands.tolist()):
            self.push(time, command)

    def _stepped(self, times):
        """The gain that steps, at these times."""
        return np.where(times < self.step["time"], self.step["gain"], self.step["later"]) if self.step else 1.0

    def at_once(self, start: float, end: float, closeness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same as `pieces` for many edges: starts, values and slopes of the pieces. What holds still goes through static stages as a whole."""
        times, values = np.array(self.edges).T
        count = int(np.searchsorted(times, end - closeness))
        self.edges, times, values = self.edges[count:], times[:count], values[:count]
        first = int(np.searchsorted(times, start + closeness, side="right"))
        current = values[first - 1] if first else self.current
        times, values = np.concatenate([[start], times[first:]]), np.concatenate([[current], values[first:]])
        self.current = values[-1]
        if self.step and start < self.step["time"] < end:
            place = int(np.searchsorted(times, self.step["time"]))
            if place == len(times) or times[place] > self.step["time"]:
                times, values = np.insert(times, place, self.step["time"]), np.insert(values, place, values[place - 1])
        values = (self.gain * values + self.quadratic * values * np.abs(values)) * self._stepped(times)
        slopes = -values * self.fade
        values = values * (1.0 - self.fade * times) + self.offset
        stages = list(self.stages)
        while stages and not self.fade and isinstance(stages[0], (Deadband, Saturation, Backlash)):
            values = stages.pop(0).held(values)
        if not stages:
            return times, values, slopes
        moving = list(zip(times.tolist(), [*times[1:].tolist(), end], values.tolist(), slopes.tolist()))
        for stage in stages:
            moving = [out for piece in moving for out in stage(piece)]
        columns = np.array(moving).T
        return columns[0], columns[2], columns[3]

    def pieces(self, start: float, end: float, closeness: float) -> list[Piece]:
        """The signal over [start, end); an edge within `closeness` of the start counts as at the start."""
        held = []
        while self.edges and self.edges[0][0] < end - closeness:
            time, command = self.edges.pop(0)
            time = start if time - start <= closeness else time
            if time > start:
                held.append((start, time, self.current, 0.0))
            start, self.current = time, command
        held.append((start, end, self.current, 0.0))
        if self.step:
            at = self.step["time"]
            held = [part for s, e, v, _ in held for part in ([(s, at, v, 0.0), (at, e, v, 0.0)] if s < at < e else [(s, e, v, 0.0)])]
        result = []
        for start, end, value, _ in held:
            value = (self.gain * value + self.quadratic * value * abs(value)) * float(self._stepped(start))
            moving = [(start, end, value * (1.0 - self.fade * start) + self.offset, -value * self.fade)]
            for stage in self.stages:
                moving = [out for piece in moving for out in stage(piece)]
            result += moving
        return result
