"""`simulate`: the outputs that a model with effects would log, in open loop, in a closed loop, or one step ahead."""

import zlib
from collections.abc import Callable

import numpy as np

from .integrate import Linear, Stepped
from .pieces import InputChain
from .sampled import SampledPlant
from .sensors import Sensors
from .system import DECLARED, DYNAMICS, STEPPING, Names, System, sort_effects

MANY = 16  # edges from which a signal is worked out as a whole
GRID_SLACK = 1e-9  # times closer than this share of a sample time are one


def _columns(pieces: list) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    columns = np.array(pieces).T
    return columns[0], columns[2], columns[3]


def losses(parameters: dict, draws: np.ndarray) -> np.ndarray:
    """Which commands are lost: each for itself, or in runs of `burst` on average, `probability` of all being lost in the long run; draws in 0..1."""
    probability, burst = parameters.get("probability", 0.0), parameters.get("burst")
    if burst is None:
        return draws < probability
    begins, goes_on = min(probability / (burst * (1.0 - probability)), 1.0), 1.0 - 1.0 / burst
    lost, found = False, []
    for draw in draws:
        lost = draw < (goes_on if lost else begins)
        found.append(lost)
    return np.array(found)


class Simulator:
    """One model with effects on one log's time stamps.

    integrator: "auto" (matrix exponentials where the system is linear, else Dormand-Prince at `tolerance`), "fast" (always
    Dormand-Prince) or "reference" (scipy's solve_ivp at `tolerance`, with `method`).
    """

    def __init__(self, model, time, effects=(), x0=None, drops=None, rng=None, integrator="auto", tolerance=1e-10, method="DOP853"):
        self.names = names = Names(model)
        found = sort_effects(names, list(effects))
        self.stamps = np.asarray(time, dtype=float) - float(time[0])
        self.nu, count = len(names.inputs), len(self.stamps)
        steps = np.diff(self.stamps)
        self.slack = GRID_SLACK * (float(np.median(steps)) if len(steps) else 1.0)
        self.sensors = Sensors(names, found)
        self.sampled_at = self.sensors.sampled_at(self.stamps)
        self.end = max(self.sampled_at.max(), self.stamps[-1]) + 4 * self.slack  # an edge at the last sample is seen there
        self.x = list(names.initial if x0 is None else x0)
        self.drops = self._drops(found.get("dropped_commands", {}), drops, rng, count)
        self.chains = []
        for name, delay in zip(names.inputs, names.input_delay):
            own = {effect: channels[name] for effect, channels in found.items() if name in channels}
            # Random delays are a log's own, and the same whenever it is simulated.
            seed = zlib.crc32(np.round(self.stamps, 9).tobytes())
            self.chains.append(InputChain(own, delay + own.get("input_delay", {}).get("delay", 0.0), seed))
        if names.sample_time:
            if refused := set(found) & (DYNAMICS | DECLARED | STEPPING - {"gain_jump"}):
                raise ValueError(f"a sampled model takes no {', '.join(sorted(refused))}")
            self.sampled, self.engine, self.system = SampledPlant(model, names, found), None, None
            self.linear = not self.sensors.limits
            return
        self.sampled, self.system = None, System(model, names, found)
        if integrator == "auto" and self.system.linear:
            self.engine = Linear(self.system, self.nu)
        else:
            self.engine = Stepped(self.system, integrator == "reference", tolerance, method)
        self.linear = isinstance(self.engine, Linear) and not self.sensors.limits

    def _drops(self, probabilities: dict, drops, rng, count: int):
        if not probabilities:
            return None
        if drops is None:
            draws = rng.random((count, self.nu))
            drops = np.column_stack([losses(probabilities.get(name, {}), draws[:, i]) for i, name in enumerate(self.names.inputs)])
        acting = np.array([name in probabilities for name in self.names.inputs])
        drops = np.asarray(drops, dtype=bool) & acting
        drops[0] = False
        return drops

    def _passed(self, commands: np.ndarray) -> np.ndarray:
        """The commands [N, nu] after drops."""
        if self.drops is None:
            return commands
        kept = np.maximum.accumulate(np.where(self.drops, 0, np.arange(len(commands))[:, None]), axis=0)
        return np.take_along_axis(commands, kept, axis=0)

    def signals(self, start: float, end: float, marks: np.ndarray):
        """Grid of all edges and marks in [start, end], with each input's value (from the right) and slope there."""
        pieces = [chain.at_once(start, end, self.slack) if len(chain.edges) > MANY else _columns(chain.pieces(start, end, self.slack)) for chain in self.chains]
        edges = [channel[0] for channel in pieces]
        switches = [t for t in (self.system.switches if self.system else []) if start < t < end]
        times = np.sort(np.concatenate([marks, [start, end], switches, *edges]))
        grid = times[np.concatenate([[True], np.diff(times) > self.slack])]
        values, slopes = np.empty((len(grid), self.nu)), np.empty((len(grid), self.nu))
        for i, (begins, height, slope) in enumerate(pieces):
            index = np.searchsorted(begins, grid + self.slack, side="right") - 1
            slopes[:, i] = slope[index]
            values[:, i] = height[index] + slopes[:, i] * (grid - begins[index])
        return grid, values, slopes

    def index(self, grid: np.ndarray, times: np.ndarray) -> np.ndarray:
        return np.searchsorted(grid, times + self.slack, side="right") - 1

    def _settle(self, grid, values, slopes) -> None:
        self.x = np.array(self.system.start(self.x, (grid[0], *values[0], *slopes[0])))

    def open_loop(self, commands, noise=0.0) -> np.ndarray:
        commands = self._passed(np.asarray(commands, dtype=float))
        for i, chain in enumerate(self.chains):
            chain.push_all(self.stamps, commands[:, i])
        if self.sampled:
            return self.sensors.measure(self.sampled.run(self, self.x), self.stamps, noise)
        grid, values, slopes = self.signals(0.0, self.end, self.sampled_at.ravel())
        self._settle(grid, values, slopes)
        states = self.engine.run(grid, values, slopes, self.x)
        return self.sensors.measure(self._at(grid, values, slopes, states, self.sampled_at), self.stamps, noise)

    def _at(self, grid, values, slopes, states, times) -> np.ndarray:
        """Outputs before gain and bias at times [N, ny], all on the grid."""
        outputs = self.engine.outputs(grid, values, slopes, states)
        return np.take_along_axis(outputs, self.index(grid, times.ravel()).reshape(times.shape), axis=0)

    def predictor(self, commands, measured, gain) -> np.ndarray:
        """One-step predictions: after each sample the plant's states move by gain [n, ny] times the innovation."""
        commands, measured = self._passed(np.asarray(commands, dtype=float)), np.asarray(measured, dtype=float)
        for i, chain in enumerate(self.chains):
            chain.push_all(self.stamps, commands[:, i])
        grid, values, slopes = self.signals(0.0, self.end, np.concatenate([self.stamps, self.sampled_at.ravel()]))
        self._settle(grid, values, slopes)
        taken = self.index(grid, self.sampled_at.ravel()).reshape(self.sampled_at.shape)
        known_at = np.maximum(self.index(grid, self.stamps), taken.max(axis=1))
        due: dict[int, list[int]] = {}
        for k, i in enumerate(known_at.tolist()):
            due.setdefault(i, []).append(k)
        outputs, predicted = np.empty((len(grid), measured.shape[1])), np.empty_like(measured)
        n, columns = len(self.names.states), np.arange(measured.shape[1])
        output_at, missing = self.engine.output_at(grid, values, slopes), ~np.isfinite(measured)
        known, any_missing = np.where(missing, 0.0, measured), missing.any(axis=1).tolist()
        simultaneous = (taken == known_at[:, None]).all(axis=1).tolist()
        factor, added, limited = self.sensors.gain, self.sensors.bias + self.stamps[:, None] * self.sensors.drift, self.sensors.limits

        def correct(i: int, states: np.ndarray) -> None:
            outputs[i] = output_at(i, states[i])
            for k in due.get(i, ()):
                raw = outputs[i] if simultaneous[k] else outputs[taken[k], columns]
                value = raw * factor + added[k]
                predicted[k] = self.sensors.limit(value[None])[0] if limited else value
                innovation = known[k] - predicted[k]
                if any_missing[k]:
                    innovation[missing[k]] = 0.0
                states[i, :n] += gain.dot(innovation)

        self.engine.run(grid, values, slopes, self.x, correct)
        return predicted

    def closed_loop(self, controller: Callable[[int, np.ndarray], np.ndarray], noise) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`controller(k, measured[:k])` commands u[k]; returns commands [N, nu], measured and noise-free outputs [N, ny]."""
        count, ny = self.sampled_at.shape
        if np.any(self.sampled_at > self.stamps[:, None] + self.slack):
            raise ValueError("sensors that look ahead cannot be in a loop")
        commands, measured, values_at = np.empty((count, self.nu)), np.empty((count, ny)), np.empty((count, ny))
        passed = np.zeros(self.nu)
        blocks = np.searchsorted(self.stamps, self.sampled_at + self.slack, side="right") - 1
        members = [[] for _ in range(count)]
        for k, j in np.ndindex(count, ny):
            members[blocks[k, j]].append((k, j))
        for k in range(count):
            commands[k] = controller(k, measured[:k])
            passed = commands[k].copy() if self.drops is None else np.where(self.drops[k], passed, commands[k])
            for chain, command in zip(self.chains, passed.tolist()):
                chain.push(self.stamps[k], command)
            start, end = self.stamps[k], self.stamps[k + 1] if k + 1 < count else self.stamps[-1] + 2 * self.slack
            marks = np.array([self.sampled_at[member] for member in members[k]])
            grid, values, slopes = self.signals(start, end, marks)
            if k == 0:
                self._settle(grid, values, slopes)
            states = self.engine.run(grid, values, slopes, self.x)
            outputs = self.engine.outputs(grid, values, slopes, states)
            for member, index in zip(members[k], self.index(grid, marks).tolist()):
                values_at[member] = outputs[index, member[1]]
            self.x = states[-1].copy()
            measured[k] = self.sensors.measure(values_at[k:k + 1].copy(), self.stamps[k:k + 1], noise[k])[0]
        return commands, measured, self.sensors.measure(values_at, self.stamps)


def simulate(model, time, u, effects=(), x0=None, drops=None, rng=None, noise=0.0, **options) -> np.ndarray:
    """Logged outputs [N, ny] of a model@1 dict for commands u [N, nu] at `time` [N] (s).

    effects: [{effect, channel, parameters: {name: value}}]; x0: state at the first sample (the model's `initial` if None);
    drops [N, nu]: which commands are lost (drawn with `rng` if None); noise [N, ny]; options: see Simulator.
    """
    return Simulator(model, time, effects, x0, drops, rng, **options).open_loop(u, noise)
