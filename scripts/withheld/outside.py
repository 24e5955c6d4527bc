"""Effects outside the catalogue: a truth model with one more input `outside` (and states where needed) that the log does not show."""

import copy
import re

import numpy as np
from scipy import signal

from .catalogue import Scales
from .system import Names

KINDS = ("hysteresis", "payload_drop", "slosh", "gusts", "intermittent_fault")


def as_equations(model: dict) -> dict:
    """A linear model written as equations."""
    names = Names(model)
    if not names.lti:
        return copy.deepcopy(model)
    signals = [f"({c['name']} - {c['operating']!r})" if c.get("operating") else c["name"] for c in model["inputs"]]

    def row(left, right, r):
        terms = [f"({v!r})*{x}" for v, x in zip(left[r], names.states) if v] + [f"({v!r})*{u}" for v, u in zip(right[r], signals) if v]
        return " + ".join(terms) or "0"

    return {
        "format": model["format"], "name": model["name"], "kind": "equations", "inputs": copy.deepcopy(model["inputs"]), "outputs": copy.deepcopy(model["outputs"]),
        "input_delay_s": list(names.input_delay), "states": {s: {"unit": c["unit"], "initial": v} for s, c, v in zip(names.states, model["states"], names.initial)},
        "parameters": {}, "derivatives": {s: row(model["A"], model["B"], r) for r, s in enumerate(names.states)},
        "output_equations": {c["name"]: f"{row(model['C'], model['D'], r)} + {c.get('operating') or 0.0!r}" for r, c in enumerate(model["outputs"])},
    }


class Outside:
    """One drawn effect. `model(size)` is the truth, `start(time)` prepares a log, `value(k, command)` the extra input of sample k."""

    def __init__(self, rng, kind: str, model: dict, scales: Scales, plant):
        self.rng, self.kind, self.base, self.scales = rng, kind, as_equations(model), scales
        names = scales.names
        self.state = str(rng.choice(plant.forces))
        self.force = 0.5 * float(scales.rate[names.states.index(self.state)])
        self.input = int(rng.integers(len(names.inputs)))
        self.output = names.outputs[int(rng.integers(len(names.outputs)))]
        self.at_sensor = rng.random() < 0.4
        self.frequency = float(rng.uniform(0.5, 1.2) / (2 * np.pi * scales.settling))
        self.span: tuple[float, float] | None = None
        self.size = 0.3

    def model(self) -> dict:
        model, size, name = copy.deepcopy(self.base), float(self.size), self.base["inputs"][self.input]["name"]
        delays = model.get("input_delay_s") or [0.0] * len(model["inputs"])
        model["input_delay_s"] = [*delays, 0.0]
        model["inputs"].append({"name": "outside", "unit": "1"})
        d, x = model["derivatives"], self.state

        def replace(text: str) -> None:
            for table in (d, model["output_equations"]):
                for key in table:
                    table[key] = re.sub(rf"\b{name}\b", text, table[key])

        if self.kind == "hysteresis":
            replace(f"({name} + {float(0.6 * size * self.scales.u[self.input])!r}*outside)")
        elif self.kind == "payload_drop":
            d[x] += f" + {1.5 * size * self.force!r}*outside*(1 + 0.5*{x}/{self._x(x)!r})"
        elif self.kind == "gusts":
            d[x] += f" + {size * self.force!r}*outside"
        elif self.kind == "slosh":
            omega, reference = 2 * np.pi * self.frequency, self._x(x)
            model["states"] |= {"slosh_1": {"unit": "1", "initial": 0.0}, "slosh_2": {"unit": "1", "initial": 0.0}}
            d["slosh_1"] = "slosh_2"
            d["slosh_2"] = f"{omega**2!r}*({x}/{reference!r} - slosh_1 - 1.5*slosh_1^3) - {0.06 * omega!r}*slosh_2"
            d[x] += f" + {2 * size * self.force!r}*slosh_1*abs(slosh_1)"
        elif self.at_sensor:
            model["output_equations"][self.output] += f" + {float(size * self.scales.y[self.scales.names.outputs.index(self.output)])!r}*outside"
        else:
            replace(f"({name} - {min(size, 1.0)!r}*outside*({name} - {float(self.scales.middle_u[self.input])!r}))")
        return model

    def _x(self, state: str) -> float:
        return max(float(self.scales.x[self.scales.names.states.index(state)]), 1e-12)

    def start(self, time: np.ndarray, seed: int) -> None:
        rng, n = np.random.default_rng(seed), len(time)
        self.series, self.relay, self.span = np.zeros(n), -1.0, None
        if self.kind == "payload_drop":
            first = int(n * rng.uniform(0.25, 0.65))
            self.series[first:] = rng.choice([-1, 1])
            self.span = (time[first], time[-1])
        elif self.kind == "intermittent_fault":
            edges = np.sort(rng.uniform(0.08, 0.95, 2 * rng.integers(2, 4)))
            for a, b in edges.reshape(-1, 2):
                self.series[int(a * n): int(b * n)] = 1.0
            self.span = (time[int(edges[0] * n)], time[int(edges[-1] * n) - 1])
        elif self.kind == "gusts":
            low = signal.butter(2, min(0.9, 2 * self.frequency * 2 * (time[1] - time[0])))
            series = signal.lfilter(*low, rng.standard_normal(n + 500))[500:]
            first, last = sorted((rng.uniform(0, 0.5), rng.uniform(0.6, 1.0)))
            series[: int(first * n)] = series[int(last * n):] = 0.0
            self.series = series / max(np.std(series), 1e-12)
            self.span = (time[int(first * n)], time[min(int(last * n), n - 1)])

    def value(self, k: int, command: np.ndarray) -> float:
        if self.kind != "hysteresis":
            return float(self.series[k])
        deviation = command[self.input] - self.scales.middle_u[self.input]
        threshold = 0.7 * self.scales.u[self.input]
        if abs(deviation) > threshold:
            self.relay = float(np.sign(deviation))
        return self.relay
