"""Three runs of one machine: which plant, loop, sample times, commands, noise and start; and the logs that a given truth leaves."""

import copy

import numpy as np

from .catalogue import Scales
from .loop import Regulator, linearised, predictor_gain
from .plants import PLANTS, Plant
from .signals import excitation, noise
from .simulate import Simulator
from .system import Names


class Inadequate(Exception):
    """This draw is no case; the text says why."""


def with_states(model: dict) -> dict:
    """The model with its states as further outputs."""
    names, model = Names(model), copy.deepcopy(model)
    model["outputs"] += [{"name": f"state_{s}", "unit": "1"} for s in names.states]
    if names.lti:
        model["C"] += np.eye(len(names.states)).tolist()
        model["D"] += [[0.0] * len(names.inputs) for _ in names.states]
    else:
        model["output_equations"] |= {f"state_{s}": s for s in names.states}
    return model


class Run:
    """The fixed circumstances of one log: times, excitation, noise of unit size, relative start, missing samples."""

    def __init__(self, rng, plant: Plant, step: float, duration: float, ny: int, n: int, nu: int, colour: str):
        self.step = step
        self.time = np.round(np.arange(int(duration / step)) * step, 9)
        self.excitation = excitation(rng, self.time, plant.levels, plant.settling)
        self.noise = noise(rng, len(self.time), np.ones(ny), colour)
        self.start = rng.standard_normal(n)
        self.drops = rng.random((len(self.time), nu))
        self.missing = np.zeros((len(self.time), ny), dtype=bool)
        self.seed = int(rng.integers(2**31))

    def lose_samples(self, rng) -> None:
        j = rng.integers(self.missing.shape[1])
        self.missing[:, j] = rng.random(len(self.time)) < 0.02
        if rng.random() < 0.5:
            first = int(rng.uniform(0.1, 0.8) * len(self.time))
            self.missing[first:first + int(0.03 * len(self.time)), j] = True
        self.missing[0] = False


class Experiment:
    def __init__(self, rng, plant_name: str):
        self.plant = plant = PLANTS[plant_name]
        self.model = copy.deepcopy(plant.model)
        names = self.names = Names(self.model)
        ny, n, nu = len(names.outputs), len(names.states), len(names.inputs)
        self.closed = plant.closed or (plant.may_close and rng.random() < 0.4)
        self.effort, colour = rng.uniform(0.5, 1.5), str(rng.choice(["white", "ar1", "ar2"]))
        base, several = plant.sample_time * rng.choice([0.8, 1.0, 1.25]), rng.random() < 0.3
        self.runs = []
        for _ in range(3):
            step = base * (rng.choice([1.0, 1.5]) if several else 1.0)
            self.runs.append(Run(rng, plant, round(step, 6), plant.duration * rng.uniform(0.6, 1.1), ny, n, nu, colour))
        if rng.random() < 0.3:
            for run in self.runs:
                run.lose_samples(rng)
        self.trim = np.array(plant.trim if plant.trim else [0.0] * nu)
        self.output_scale = None
        u, y, _ = self._log(with_states(self.model), [], self.runs[0], np.array(names.initial), np.zeros(ny + n), None)
        self.scales = Scales(self.model, plant, u, y[:, :ny], y[:, ny:], self.runs[0].time)
        if np.any(self.scales.y <= 0) or not np.all(np.isfinite(y)):
            raise Inadequate("an output does not move")
        self.start_std = rng.uniform(0.01, 0.04) * np.maximum(self.scales.x, 1e-9)
        self.gives_std = rng.random() < 0.7
        poles = np.abs(np.linalg.eigvals(linearised(self.model, plant.trim, self.runs[0].step)[0]))
        self.predictor = bool(np.any(poles >= 1 - 1 / len(self.runs[0].time)))
        self.sigma = self.scales.y * 10 ** (-rng.uniform(22 if self.predictor else 15, 40) / 20)  # a loop leaves less of an effect to see

    def gain(self, run: Run):
        return predictor_gain(self.model, self.plant.trim, run.step, self.plant.levels, self.sigma) if self.predictor else None

    def log(self, model: dict, effects: list[dict], index: int, outside=None):
        """Commands, measured and noise-free outputs of one run."""
        run = self.runs[index]
        x0 = np.array(self.names.initial) + run.start * self.start_std
        u, y, clean = self._log(model, effects, run, x0, self.sigma * run.noise, outside)
        if not np.all(np.isfinite(y)) or self._is_lost(clean, effects):
            raise Inadequate("the loop is lost")
        return u, y, clean

    def _is_lost(self, y: np.ndarray, effects: list[dict]) -> bool:
        if not hasattr(self, "scales"):
            return False
        far = 10 * self.scales.peak_y * max(1.0, _largest_gain(effects))
        return bool(np.any(np.abs(y[..., : len(far)] - self.scales.middle_y) > far))

    def drops(self, index: int, effects: list[dict]):
        chance = {e["channel"]: e["parameters"]["probability"] for e in effects if e["effect"] == "dropped_commands"}
        return self.runs[index].drops < np.array([chance.get(name, 0.0) for name in self.names.inputs]) if chance else None

    def _log(self, model, effects, run, x0, noise_values, outside):
        more = len(model["states"]) - len(self.names.states)
        drops = None
        if any(e["effect"] == "dropped_commands" for e in effects):
            drops = self.drops(self.runs.index(run), effects)
        if outside is not None:
            outside.start(run.time, run.seed)
            drops = None
        simulator = Simulator(model, run.time, effects, [*x0, *[0.0] * more], drops)
        if not self.closed:
            commands = self.trim + run.excitation
            if outside is not None:
                commands = np.column_stack([commands, [outside.value(k, c) for k, c in enumerate(commands)]])
            clean = simulator.open_loop(commands)
            return commands[:, : len(self.trim)], self._measured(simulator, clean, commands, effects, model, run, x0, more, drops, noise_values), clean
        scale = self.scales.y if self.output_scale is None and hasattr(self, "scales") else self._first_scale(run)
        regulator = Regulator(self.model, self.plant.trim, run.step, self.plant.levels, run.excitation, scale, self.effort)

        def controller(k, measured):
            if k and self._is_lost(measured[-1], effects):
                raise Inadequate("the loop is lost")
            command = regulator(k, measured)
            return command if outside is None else np.append(command, outside.value(k, command))

        shape = (len(run.time), len(model["outputs"]))
        u, y, clean = simulator.closed_loop(controller, np.broadcast_to(noise_values, shape))
        return u[:, : len(self.trim)], y, clean

    def _measured(self, simulator, clean, commands, effects, model, run, x0, more, drops, noise_values):
        if any(e["effect"] in ("sensor_saturation", "sensor_quantisation") for e in effects):
            return Simulator(model, run.time, effects, [*x0, *[0.0] * more], drops).open_loop(commands, noise_values)
        return clean + noise_values

    def _first_scale(self, run) -> np.ndarray:
        """Output sizes before a run exists: what commands of the usual size do within one settling time."""
        a, b, c, d = linearised(self.model, self.plant.trim, run.step)
        x, outputs = np.zeros(len(a)), []
        for _ in range(max(3, int(2 * self.plant.settling / run.step))):
            outputs.append(c @ x + d @ np.array(self.plant.levels))
            x = a @ x + b @ np.array(self.plant.levels)
        return np.maximum(np.abs(outputs).max(axis=0), 1e-9)


def _largest_gain(effects: list[dict]) -> float:
    return max([abs(e["parameters"].get("gain", 1.0)) for e in effects if e["effect"] == "sensor_gain"], default=1.0)
