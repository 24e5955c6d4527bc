"""A model with its effects as one set of ordinary differential equations, written as Python source and compiled.

State vector: the plant's states, then the actuator lags, the modes (q, q'), the sinusoids of periodic disturbances (sin, cos) and the sensor
lags. `f(t, X, seg, P, fr)` is dX/dt, `g(t, X, seg, P)` the outputs before delay and clock, `rest(t, X, seg, P)` what friction has to hold.
seg = (t0, values..., slopes...): the inputs before any lag; P: parameters; fr: per friction +1 or -1 (slips), 0 (sticks).
"""

import math
import random
import re
from functools import lru_cache

from .expressions import FUNCTIONS, to_source

INPUT = {
    "input_delay", "input_gain", "input_curve", "gain_fade", "input_offset", "deadband", "backlash", "saturation",
    "rate_limit", "actuator_lag", "dropped_commands",
}
MOVING = {"delay_jump", "delay_drift", "delay_jitter", "multi_rate"}  # delays of an input that move: a group of cases of their own
STEPPING = {"gain_jump", "parameter_jump"}  # what is another from a time on: a group of cases of their own
DYNAMICS = {
    "parameter_error", "cross_coupling", "exchange", "coulomb_friction", "stribeck_friction", "hysteresis", "quadratic_drag", "cubic_stiffness", "unmodelled_mode",
    "constant_disturbance", "periodic_disturbance",
}
OUTPUT = {
    "output_delay", "sensor_lag", "static_nonlinearity", "sensor_gain", "sensor_bias", "sensor_drift", "sensor_saturation",
    "sensor_quantisation", "misalignment",
}
DECLARED = {"candidate"}  # there only where a model file declares it: never drawn
CLOCK = {"clock_skew", "clock_offset"}


@lru_cache(maxsize=4096)
def compiled(source: str) -> dict:
    namespace = dict(FUNCTIONS, __builtins__={})
    exec(compile(source, "<model>", "exec"), namespace)  # noqa: S102 - the source is ours, its expressions checked
    return namespace


class Names:
    """States, inputs, outputs and starting values of a model@1 dict."""

    def __init__(self, model: dict):
        self.lti = model["kind"] == "lti"
        self.inputs = [c["name"] for c in model["inputs"]]
        self.outputs = [c["name"] for c in model["outputs"]]
        states = model["states"]
        self.states = [s["name"] for s in states] if self.lti else list(states)
        given = model.get("initial") if self.lti else [states[s].get("initial") for s in self.states]
        self.initial = [float(v or 0.0) for v in (given or [0.0] * len(self.states))]
        self.input_delay = [float(d) for d in model.get("input_delay_s") or [0.0] * len(self.inputs)]
        self.sample_time = float(model.get("sample_time_s") or 0.0)


def sort_effects(names: Names, effects: list[dict]) -> dict[str, dict[str, dict]]:
    """{effect: {channel: parameters}}; ValueError for an unknown effect or channel, or one named twice."""
    found: dict[str, dict[str, dict]] = {}
    for item in effects:
        effect, channel = item["effect"], item["channel"]
        if effect not in INPUT | MOVING | STEPPING | DYNAMICS | DECLARED | OUTPUT | CLOCK:
            raise ValueError(f"unknown effect {effect!r}")
        allowed = {**dict.fromkeys(INPUT | MOVING | {"gain_jump"}, names.inputs), **dict.fromkeys(CLOCK, ["*"])}.get(effect)
        if effect in OUTPUT - {"misalignment"}:
            allowed = names.outputs + (["*"] if effect in ("output_delay", "sensor_lag", "sensor_gain") else [])
        if allowed is not None and channel not in allowed:
            raise ValueError(f"{effect} cannot act on {channel!r}")
        if channel in found.setdefault(effect, {}):
            raise ValueError(f"{effect}:{channel} is listed twice")
        found[effect][channel] = {k: v for k, v in item["parameters"].items() if v is not None}
    return found


def output_values(sorted_effects: dict, effect: str, parameter: str, names: Names) -> list[list[float]]:
    """Per output the values of an effect that acts on it by name or by `*`."""
    channels = sorted_effects.get(effect, {})
    return [[channels[c][parameter] for c in (output, "*") if c in channels] for output in names.outputs]


class System:
    """The source, its compiled functions, the parameters and the start of a continuous model with effects."""

    def __init__(self, model: dict, names: Names, effects: dict):
        self.names, self.parameters, self.linear = names, [], True
        self.switches: list[float] = []  # times from which on a number is another
        self.x = [f"x{i}" for i in range(len(names.states))]
        self.extra: list[tuple[str, str]] = []  # (variable, source of its start)
        self.body: list[str] = [f"v{i} = a{i} + b{i}*(t - t0)" for i in range(len(names.inputs))]
        self.derivative: dict[str, str] = {}
        self.frictions: list[tuple[int, int]] = []  # (state, index of its level in P)
        self._inputs(effects)
        modes = self._modes(effects)
        self._plant(model, effects)
        self._dynamics(model, effects, modes)
        self._outputs(model, effects, modes)
        self._compile()

    def parameter(self, value: float) -> str:
        self.parameters.append(float(value))
        return f"P[{len(self.parameters) - 1}]"

    def _state(self, start: str, derivative: str) -> str:
        variable = f"z{len(self.extra)}"
        self.extra.append((variable, start))
        self.derivative[variable] = derivative
        return variable

    def _mode(self, drive: str, parameters: dict) -> str:
        """q of q'' + 2 zeta omega q' + omega^2 q = omega^2 drive, times the gain."""
        omega = self.parameter(2 * math.pi * parameters["frequency"])
        damping, gain = self.parameter(parameters["damping"]), self.parameter(parameters["gain"])
        position = self._state(drive, "")
        speed = self._state("0.0", "")
        self.derivative[position] = speed
        self.derivative[speed] = f"{omega}*({omega}*({drive} - {position}) - 2.0*{damping}*{speed})"
        return f"{gain}*{position}"

    def _inputs(self, effects: dict) -> None:
        modes = effects.get("unmodelled_mode", {})
        for i, name in enumerate(self.names.inputs):
            signal = f"v{i}"
            if name in effects.get("actuator_lag", {}):
                tau = self.parameter(effects["actuator_lag"][name]["time_constant"])
                signal = self._state(f"v{i}", "")
                self.derivative[signal] = f"(v{i} - {signal})/{tau}"
            channel = f"{name}->input:{name}"
            self.body.append(f"w{i} = {signal}")
            self.body.append(f"e{i} = w{i} + {self._mode(f'w{i}', modes[channel])}" if channel in modes else f"e{i} = w{i}")

    def _modes(self, effects: dict) -> dict[str, str]:
        """{"state:x" or "output:y": what is added there}."""
        added: dict[str, str] = {}
        for channel, parameters in effects.get("unmodelled_mode", {}).items():
            source, target = channel.split("->")
            kind, name = target.split(":")
            if kind == "input":
                if source != name or name not in self.names.inputs:
                    raise ValueError(f"unmodelled_mode cannot act on {channel!r}")
                continue
            if name not in (self.names.states if kind == "state" else self.names.outputs):
                raise ValueError(f"unmodelled_mode cannot act on {channel!r}")
            term = self._mode(f"e{self.names.inputs.index(source)}", parameters)
            added[target] = f"{added[target]} + {term}" if target in added else term
        return added

    def _plant(self, model: dict, effects: dict) -> None:
        errors = {channel: p["value"] for channel, p in effects.get("parameter_error", {}).items()}
        errors |= effects.get("parameter_jump", {})
        names = self.names
        if names.lti:
            self.rows = self._matrix_rows(model, "A", "B", names.states, errors)
            self.output_rows = self._matrix_rows(model, "C", "D", names.outputs, {})
            operating = [c.get("operating") or 0.0 for c in model["outputs"]]
            self.output_rows = [f"{row} + {o!r}" if o else row for row, o in zip(self.output_rows, operating)]
        else:
            known = dict(zip(names.states, self.x)) | {n: f"e{i}" for i, n in enumerate(names.inputs)} | {"time": "t"}
            for name, entry in model.get("parameters", {}).items():
                known[name] = self._number(errors.pop(name, entry["value"]))
            self.rows = [to_source(model["derivatives"][s], known) for s in names.states]
            self.output_rows = [to_source(model["output_equations"][o], known) for o in names.outputs]
        if errors:
            raise ValueError(f"no such parameter: {', '.join(errors)}")

    def _number(self, value) -> str:
        """A number of the model, or one that is another from a time on: by the start of the segment, on whose edges the times are."""
        if not isinstance(value, dict):
            return self.parameter(value)
        self.switches.append(value["time"])
        self.linear = False
        # A segment may begin a rounding before the time.
        return f"({self.parameter(value['value'])} if t0 < {self.parameter(value['time'] - 1e-9)} else {self.parameter(value['later'])})"

    def _matrix_rows(self, model: dict, left: str, right: str, rows: list[str], errors: dict) -> list[str]:
        operating = [c.get("operating") or 0.0 for c in model["inputs"]]
        deviation = [f"(e{i} - {o!r})" if o else f"e{i}" for i, o in enumerate(operating)]
        result = []
        for r, row in enumerate(rows):
            terms = []
            for matrix, columns, variables in ((left, self.names.states, self.x), (right, self.names.inputs, deviation)):
                for c, column in enumerate(columns):
                    entry = float(model[matrix][r][c])
                    channel = f"{matrix}[{row},{column}]"
                    if channel in errors:
                        terms.append(f"{self._number(errors.pop(channel))}*{variables[c]}")
                    elif entry != 0.0:
                        terms.append(f"{entry!r}*{variables[c]}")
            result.append(" + ".join(terms) or "0.0")
        return result

    def _add(self, state: str, term: str) -> None:
        self.rows[self.names.states.index(state)] += f" + {term}"

    def _variable(self, name: str) -> str:
        if name in self.names.states:
            return f"x{self.names.states.index(name)}"
        return f"e{self.names.inputs.index(name)}"

    def _deviation(self, model: dict, name: str) -> str:
        """What a matrix of the model would act on."""
        operating = dict(zip(self.names.inputs, (c.get("operating") or 0.0 for c in model["inputs"])))
        return f"({self._variable(name)} - {operating[name]!r})" if operating.get(name) else self._variable(name)

    def _dynamics(self, model: dict, effects: dict, modes: dict[str, str]) -> None:
        states = self.names.states
        for channel, p in effects.get("cross_coupling", {}).items():
            source, target = channel.split("->")
            self._add(target, f"{self.parameter(p['gain'])}*{self._deviation(model, source)}")
        for state, p in effects.get("quadratic_drag", {}).items():
            x = self._variable(state)
            self._add(state, f"-{self.parameter(p['coefficient'])}*{x}*abs({x})")
            self.linear = False
        for channel, p in effects.get("exchange", {}).items():
            a, b = channel.split("<->")
            flow = f"{self.parameter(p['gain'])}*({self._variable(a)} - {self._variable(b)})"
            self._add(b, flow)
            self._add(a, f"-({flow})")
        for channel, p in effects.get("candidate", {}).items():
            entry = next(c for c in model["candidates"] if c.get("name", f"{c['state']} += {c['adds']}") == channel)
            known = {name: self._deviation(model, name) for name in states + self.names.inputs} | {"time": "t"}
            known |= {name: self.parameter(value) for name, value in p.items()}
            self._add(entry["state"], to_source(entry["adds"], known))
            self.linear = False
        for channel, p in effects.get("cubic_stiffness", {}).items():
            source, target = channel.split("->")
            x = self._variable(source)
            self._add(target, f"-{self.parameter(p['coefficient'])}*{x}*{x}*{x}")
            self.linear = False
        for target, term in modes.items():
            kind, name = target.split(":")
            if kind == "state":
                self._add(name, term)
        for state, p in effects.get("constant_disturbance", {}).items():
            self._add(state, self.parameter(p["level"]))
        for state, p in effects.get("periodic_disturbance", {}).items():
            omega, phase = self.parameter(2 * math.pi * p["frequency"]), self.parameter(p["phase"])
            sine = self._state(f"sin({phase})", "")
            cosine = self._state(f"cos({phase})", f"-{omega}*{sine}")
            self.derivative[sine] = f"{omega}*{cosine}"
            self._add(state, f"{self.parameter(p['amplitude'])}*{sine}")
        held = {state: p["level"] for state, p in effects.get("coulomb_friction", {}).items()}
        for state, p in effects.get("stribeck_friction", {}).items():
            # Held at rest by level + extra; as it slides, speed takes a part of the extra away.
            x, extra, velocity = self._variable(state), self.parameter(p["extra"]), self.parameter(p["velocity"])
            self._add(state, f"{extra}*sign({x})*(1.0 - exp(-({x}/{velocity})**2))")
            held[state] = held.get(state, 0.0) + p["level"] + p["extra"]
        for state, p in effects.get("hysteresis", {}).items():
            # Written as Wen did: z' = rho*(v - |v|*|z|^(n-1)*z/2 - v*|z|^n/2).
            v, z, n = self._variable(state), self._state("0.0", ""), self.parameter(p["sharpness"])
            self.derivative[z] = f"({v} - 0.5*abs({v})*abs({z})**({n} - 1.0)*{z} - 0.5*{v}*abs({z})**{n})/{self.parameter(p['displacement'])}"
            self._add(state, f"-{self.parameter(p['level'])}*{z}")
            self.linear = False
        for state, level in held.items():
            self.parameter(level)
            self.frictions.append((states.index(state), len(self.parameters) - 1))
            self.linear = False

    def _outputs(self, model: dict, effects: dict, modes: dict[str, str]) -> None:
        names = self.names
        rows = [f"{row} + {modes[f'output:{o}']}" if f"output:{o}" in modes else row for o, row in zip(names.outputs, self.output_rows)]
        self.output_body = [f"y{j} = {row}" for j, row in enumerate(rows)]
        turned = [f"y{j}" for j in range(len(rows))]
        for channel, p in effects.get("misalignment", {}).items():
            source, target = (names.outputs.index(part) for part in channel.split("->"))
            turned[target] += f" + {self.parameter(p['gain'])}*y{source}"
        self.results = []
        self.lagged = False
        for j, values in enumerate(output_values(effects, "sensor_lag", "time_constant", names)):
            self.output_body.append(f"m{j} = {turned[j]}")
            if len(values) > 1:
                raise ValueError(f"two sensor lags on {names.outputs[j]}")
            if values:
                lag = self._state(f"m{j}", "")
                self.derivative[lag] = f"(m{j} - {lag})/{self.parameter(values[0])}"
                self.lagged = True
            self.results.append(lag if values else f"m{j}")

    def _compile(self) -> None:
        everything = self.x + [variable for variable, _ in self.extra]
        nu = len(self.names.inputs)
        segment = ", ".join(["t0", *(f"a{i}" for i in range(nu)), *(f"b{i}" for i in range(nu))])
        start = [f"{', '.join(everything)}, = X", f"{segment}, = seg"]
        rates = list(self.rows)
        for index, (state, level) in enumerate(self.frictions):
            rates[state] = f"({self.rows[state]} - fr[{index}]*P[{level}]) if fr[{index}] else 0.0"
        rates += [self.derivative[variable] for variable, _ in self.extra]

        def function(head: str, lines: list[str], values: list[str]) -> str:
            return "\n ".join([f"def {head}:", *lines, f"return ({', '.join(values)}{',' if values else ''})"])

        with_outputs = start + self.body + self.output_body
        source = "\n".join([
            function("f(t, X, seg, P, fr)", with_outputs if self.lagged else start + self.body, rates),
            function("rest(t, X, seg, P)", start + self.body, [self.rows[state] for state, _ in self.frictions]),
            function("g(t, X, seg, P)", with_outputs, self.results),
            function("start(t, X, seg, P)", self._ordered_start(segment), everything),
        ])
        if re.search(r"\bt\b", " ".join(self.rows + self.output_rows)):
            self.linear = False
        functions = compiled(source)
        self.f, self.g, self.rest, self._start = (functions[name] for name in ("f", "g", "rest", "start"))
        if not self.names.lti and self.linear and not self.switches:
            self.linear = self._is_affine(len(everything), nu)

    def _is_affine(self, n: int, nu: int) -> bool:
        """Whether equations are linear after all: values add up at points of either sign and any size."""
        def both(point):
            segment = (0.0, *point[n:], *[0.0] * nu)
            return [*self.f(0.0, point[:n], segment, self.parameters, ()), *self.g(0.0, point[:n], segment, self.parameters)]

        rng = random.Random(0)
        for size in (1e-3, 1e-1, 1.0, 1e1, 1e2, 1e3):
            left, right = ([size * rng.uniform(-1, 1) for _ in range(n + nu)] for _ in range(2))
            try:
                values = zip(both(left), both(right), both([a + b for a, b in zip(left, right)]), both([0.0] * (n + nu)))
                if any(abs(a + b - total - zero) > 1e-10 * (abs(a) + abs(b) + abs(total) + abs(zero)) for a, b, total, zero in values):
                    return False
            except (ArithmeticError, ValueError, TypeError):
                return False
        return True

    def _ordered_start(self, segment: str) -> list[str]:
        """The settled start: each extra state is set as soon as what drives it is known."""
        lines = [f"{', '.join(self.x)}, = X", f"{segment}, = seg"]
        waiting = list(self.extra)

        def known_now(text: str) -> bool:
            return not any(re.search(rf"\b{variable}\b", text) for variable, _ in waiting)

        def release(defined: set[str]) -> None:
            for item in list(waiting):
                needs = set(re.findall(r"\b[vwem]\d+\b", item[1]))
                if needs <= defined:
                    lines.append(f"{item[0]} = {item[1]}")
                    waiting.remove(item)

        defined: set[str] = set()
        release(defined)
        for line in self.body + self.output_body:
            assert known_now(line), line
            lines.append(line)
            defined.add(line.split(" = ")[0])
            release(defined)
        return lines

    def start(self, x0: list[float], segment: tuple) -> list[float]:
        return [float(v) for v in self._start(0.0, x0, segment, self.parameters)]
