"""Three runs of one machine: which plant, loop, sample times, commands, noise and start; and the logs that a given truth leaves."""

import copy
from dataclasses import dataclass

import numpy as np

from .catalogue import Scales, real_channels
from .loop import Regulator, linearised, predictor_gain
from .plants import PLANTS, Plant
from .signals import colour, excitation, noise, stamps
from .simulate import Simulator, losses
from .system import DYNAMICS, Names
from .variants import can_sample, can_shift, in_other_unit, sampled, shifted, whole_delays


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

    def __init__(self, rng, plant: Plant, step: float, duration: float, sizes: tuple[int, int, int], style: "Style"):
        nu, n, ny = sizes
        self.step = step
        self.time = stamps(rng, step, duration, style.timing)
        even = np.arange(int(duration / step) + 1) * step
        self.excitation = excitation(rng, even, plant.levels, plant.settling)[np.rint(self.time / step).astype(int)]
        self.noise = noise(rng, len(self.time), style.colours, style.heavy)
        self.start = rng.standard_normal(n)
        self.drops = rng.random((len(self.time), nu))
        self.missing = np.zeros((len(self.time), ny), dtype=bool)
        self.seed = int(rng.integers(2**31))
        self.begins = float(rng.integers(1, 5000)) if style.late else 0.0  # the first time stamp in the file

    def lose_samples(self, rng) -> None:
        """Some samples of one output, and perhaps a stretch of them."""
        j = rng.integers(self.missing.shape[1])
        self.missing[:, j] |= rng.random(len(self.time)) < 0.02
        if rng.random() < 0.5:
            first = int(rng.uniform(0.1, 0.8) * len(self.time))
            self.missing[first:first + int(0.03 * len(self.time)), j] = True
        self.missing[0] = False

    def slow_output(self, j: int, every: int) -> None:
        """Output j comes with every so-many-th row only."""
        self.missing[:, j] |= np.arange(len(self.time)) % every > 0


@dataclass
class Style:
    """How this machine is commanded and logged."""

    timing: str  # even, jitter, missed
    colours: list[list[float]]
    heavy: bool  # tails of the noise
    late: bool  # time stamps do not begin at 0
    resolution: float | None  # of the commands, as a share of their level


class Experiment:
    """`model` is the machine; `nominal` what the diagnoser gets: the same, unless that has a sample time."""

    def __init__(self, rng, plant_name: str, effect: str | None = None):
        self.plant, self.model = PLANTS[plant_name], copy.deepcopy(PLANTS[plant_name].model)
        self.machine_outputs = self.plant.model["outputs"]
        if rng.random() < 0.3:
            in_other_unit(rng, self.model)
        if rng.random() < 0.4 and can_shift(self.plant):
            plant = shifted(rng, self.plant, model := copy.deepcopy(self.model))
            if effect is None or real_channels(model, effect, plant):
                self.plant, self.model = plant, model
        plant, names = self.plant, Names(self.model)
        self.names = names
        self.discrete = rng.random() < 0.5 and can_sample(plant) and effect not in DYNAMICS
        nu, n, ny = sizes = len(names.inputs), len(names.states), len(names.outputs)
        self.closed = plant.closed or (plant.may_close and rng.random() < 0.4)
        self.effort = rng.uniform(0.5, 1.5)
        style = Style(
            timing=str(rng.choice(["even", "jitter", "missed"], p=[0.6, 0.2, 0.2])), colours=[colour(rng) for _ in names.outputs], heavy=rng.random() < 0.2,
            late=rng.random() < 0.3, resolution=float(rng.choice([0.02, 0.06])) if rng.random() < 0.25 else None,
        )
        self.resolution = None if style.resolution is None else style.resolution * np.array(plant.levels)
        base, several = plant.sample_time * rng.choice([0.8, 1.0, 1.25]), rng.random() < 0.4
        if self.discrete:
            style.timing, several = "even", False
            whole_delays(self.model, round(base, 6))
        self.runs = []
        for _ in range(3):
            step = round(base * (rng.choice([0.75, 1.0, 1.5, 2.0]) if several else 1.0), 6)
            self.runs.append(Run(rng, plant, step, max(plant.duration * rng.uniform(0.5, 1.2), 250 * step), sizes, style))
        if rng.random() < 0.3:
            for run in self.runs:
                run.lose_samples(rng)
        steady = np.all(np.abs(np.linalg.eigvals(linearised(self.model, plant.trim, base)[0])) < 1 - 1 / (plant.duration / base))
        if ny > 1 and steady and rng.random() < 0.2:  # one-step predictions with a gain for every sample would drift between rare ones
            slow, every = int(rng.integers(ny)), int(rng.integers(2, 6))
            for run in self.runs:
                run.slow_output(slow, every)
        self.trim = np.array(plant.trim if plant.trim else [0.0] * nu)
        self.mean_inputs = self._means(rng)
        self.mean_outputs = rng.random() < 0.5  # "mean" where the measured mean is the operating point
        self.nominal = sampled(self.model, self.runs[0].step) if self.discrete else self.model
        self.output_scale = None
        u, y, _ = self._log(with_states(self.model), [], self.runs[0], np.array(names.initial), np.zeros(ny + n), None)
        self.scales = Scales(self.model, plant, u, y[:, :ny], y[:, ny:], self.runs[0].time)
        if np.any(self.scales.y <= 0) or not np.all(np.isfinite(y)):
            raise Inadequate("an output does not move")
        self.start_std = rng.uniform(0.01, 0.04) * np.maximum(self.scales.x, 1e-9)
        self.gives_std = rng.random() < 0.7
        poles = np.abs(np.linalg.eigvals(linearised(self.model, plant.trim, self.runs[0].step)[0]))
        self.predictor = bool(np.any(poles >= 1 - 1 / len(self.runs[0].time)))
        if self.predictor:
            self.nominal, self.discrete = self.model, False
        self.sigma = self.scales.y * 10 ** (-rng.uniform(22 if self.predictor else 15, 40) / 20)  # a loop leaves less of an effect to see

    def traits(self) -> list[str]:
        """What is unusual about the files, for the summary of a draw."""
        steps = [run.step for run in self.runs]
        held = {
            "sampled model": self.discrete, "uneven stamps": any(np.ptp(np.diff(run.time)) > 0.1 * run.step for run in self.runs), "several rates": len(set(steps)) > 1,
            "missing samples": any(run.missing.any() for run in self.runs), "working point": any("operating" in c for c in self.model["inputs"]),
            "mean inputs": self.mean_inputs, "other unit": [c["unit"] for c in self.model["outputs"]] != [c["unit"] for c in self.machine_outputs],
            "rounded commands": self.resolution is not None, "closed loop": self.closed, "predictor": self.predictor,
        }
        return [name for name, holds in held.items() if holds]

    def _means(self, rng) -> bool:
        """Whether the inputs' operating points are "mean", the mean of the training logs, which open-loop commands have before they are sent."""
        channels = self.model["inputs"]
        if self.closed or any("operating" not in c for c in channels) or rng.random() < 0.5:
            return False
        mean = np.mean(np.concatenate([self.commands(run) for run in self.runs[:2]]), axis=0)
        for channel, value in zip(channels, mean):
            channel["operating"] = float(value)
        return True

    def commands(self, run: Run) -> np.ndarray:
        """What is sent in open loop."""
        return self._sent(self.trim + run.excitation)

    def _sent(self, command: np.ndarray) -> np.ndarray:
        return command if self.resolution is None else self.resolution * np.round(command / self.resolution)

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
        chance = {e["channel"]: e["parameters"] for e in effects if e["effect"] == "dropped_commands"}
        draws = self.runs[index].drops
        return np.column_stack([losses(chance.get(name, {}), draws[:, i]) for i, name in enumerate(self.names.inputs)]) if chance else None

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
            commands = self.commands(run)
            if outside is not None:
                commands = np.column_stack([commands, [outside.value(k, c) for k, c in enumerate(commands)]])
            clean = simulator.open_loop(commands)
            return commands[:, : len(self.trim)], self._measured(simulator, clean, commands, effects, model, run, x0, more, drops, noise_values), clean
        scale = self.scales.y if self.output_scale is None and hasattr(self, "scales") else self._first_scale(run)
        regulator = Regulator(self.model, self.plant.trim, run.step, self.plant.levels, run.excitation, scale, self.effort)

        def controller(k, measured):
            if k and self._is_lost(measured[-1], effects):
                raise Inadequate("the loop is lost")
            command = self._sent(regulator(k, measured))
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
