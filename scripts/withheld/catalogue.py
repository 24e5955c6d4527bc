"""Every effect on every channel of a model, with parameters of a wanted size."""

import math

import numpy as np

from .system import DYNAMICS, MOVING, STEPPING, Names

BOUNDS = {
    "delay": (0.0, math.inf), "later": (0.0, math.inf), "time": (0.0, math.inf), "period": (1e-6, math.inf), "width": (0.0, math.inf), "time_constant": (1e-6, math.inf), "damping": (0.003, 1.5), "level+": (0.0, math.inf),
    "rate+": (1e-12, math.inf), "step": (1e-12, math.inf), "frequency": (1e-6, math.inf), "ratio": (0.5, 2.0),
    "extra": (0.0, math.inf), "velocity": (1e-9, math.inf), "displacement": (1e-12, math.inf), "sharpness": (1.0, 10.0),
}


class Scales:
    """What a run of the nominal model looks like: sizes by which effects are measured."""

    def __init__(self, model, plant, u, y, x, time):
        self.names, self.model, self.plant = Names(model), model, plant
        self.middle_u, self.u = u.mean(axis=0), u.std(axis=0)
        self.peak_u = np.abs(u - self.middle_u).max(axis=0)
        self.middle_y, self.y = y.mean(axis=0), y.std(axis=0)
        self.peak_y = np.abs(y - self.middle_y).max(axis=0)
        self.x, self.x_size = x.std(axis=0), np.sqrt((x**2).mean(axis=0))
        steps = np.diff(time)
        self.rate = np.sqrt(((np.diff(x, axis=0) / steps[:, None]) ** 2).mean(axis=0))
        self.step, self.span, self.settling = float(np.median(steps)), time[-1], plant.settling
        self.raw_peak_y = np.abs(y).max(axis=0)
        self.absolute_u, self.raw_peak_u = np.abs(u).mean(axis=0), np.abs(u).max(axis=0)


def channels(model: dict, effect: str) -> list[str]:
    """All channels on which the effect can act."""
    names = Names(model)
    i, s, o = names.inputs, names.states, names.outputs
    if names.sample_time and (effect in DYNAMICS or effect == "parameter_jump"):
        return []
    if effect in ("output_delay", "sensor_lag", "sensor_gain"):
        return ["*"] + (o if len(o) > 1 else [])
    if effect.startswith("sensor_") or effect == "static_nonlinearity":
        return o
    if effect.startswith("clock"):
        return ["*"]
    if effect == "misalignment":
        return [f"{a}->{b}" for a in o for b in o if a != b]
    if effect == "unmodelled_mode":
        return [f"{u}->input:{u}" for u in i] + [f"{u}->state:{x}" for u in i for x in s] + [f"{u}->output:{y}" for u in i for y in o]
    if effect in ("parameter_error", "parameter_jump"):
        if not names.lti:
            return list(model["parameters"])
        return [f"{m}[{row},{col}]" for m, cols in (("A", s), ("B", i)) for r, row in enumerate(s) for c, col in enumerate(cols) if model[m][r][c]]
    if effect == "cross_coupling":
        if not names.lti:
            return [f"{a}->{b}" for a in s + i for b in s if a != b and a not in _words(model["derivatives"][b])]
        return [f"{col}->{row}" for m, cols in (("A", s), ("B", i)) for r, row in enumerate(s) for c, col in enumerate(cols) if not model[m][r][c] and row != col]
    if effect == "exchange":
        return _exchanges(model, names)
    if effect == "cubic_stiffness":
        return [f"{a}->{b}" for a in s for b in s if a != b]
    if effect in ("coulomb_friction", "stribeck_friction", "hysteresis", "quadratic_drag", "constant_disturbance", "periodic_disturbance"):
        return s
    return i


def _exchanges(model: dict, names: Names) -> list[str]:
    """Pairs of states of equal unit that do not depend on each other in the model."""
    units = [c.get("unit") for c in model["states"]] if names.lti else [model["states"][x].get("unit") for x in names.states]

    def depends(to: int, on: int) -> bool:
        if names.lti:
            return model["A"][to][on] != 0
        return names.states[on] in _words(model["derivatives"][names.states[to]])

    pairs = [(i, j) for j in range(len(units)) for i in range(j) if units[i] and units[i] == units[j] and not depends(i, j) and not depends(j, i)]
    return [f"{names.states[i]}<->{names.states[j]}" for i, j in sorted(pairs)]


def _words(text: str) -> set[str]:
    return set("".join(c if c.isalnum() or c == "_" else " " for c in text).split())


def real_channels(model: dict, effect: str, plant) -> list[str]:
    """Those on which it acts in a real machine: forces only where a mass is, friction only on velocities."""
    found = channels(model, effect)
    if effect in ("coulomb_friction", "stribeck_friction", "hysteresis", "quadratic_drag"):
        return [c for c in found if c in plant.velocities]
    if effect in ("constant_disturbance", "periodic_disturbance"):
        return [c for c in found if c in plant.forces]
    if effect in ("cross_coupling", "cubic_stiffness", "unmodelled_mode"):
        state = [c for c in found if c.split("->")[1].removeprefix("state:") in plant.forces or ":" in c and "state:" not in c]
        if effect == "cubic_stiffness":
            state = [c for c in state if c.split("->")[0] not in plant.forces] or state
        return state
    if effect == "deadband" and plant.trim:
        return [c for c, trim, level in zip(found, plant.trim, plant.levels) if abs(trim) < level]
    if effect in ("parameter_error", "parameter_jump") and Names(model).lti:
        return [c for c in found if c[2:].split(",")[0] in plant.forces]
    return found


def nominal_value(model: dict, channel: str) -> float:
    names = Names(model)
    if not names.lti:
        return float(model["parameters"][channel]["value"])
    row, column = channel[2:-1].split(",")
    return float(model[channel[0]][names.states.index(row)][(names.states if channel[0] == "A" else names.inputs).index(column)])


def of_size(scales: Scales, effect: str, channel: str, size: float, sign: float, shape: tuple[float, float, float]) -> dict:
    """The effect with parameters of a relative size (0.01 hardly there, 1 large); sign +-1; shape: three numbers in 0..1."""
    s, n = scales, scales.names
    a, b, c = shape

    def made(**parameters):
        plain = {name: None if value is None else float(value) for name, value in parameters.items()}
        return {"effect": effect, "channel": channel, "parameters": plain}

    if channel in n.inputs:
        i = n.inputs.index(channel)
        u, middle, peak = s.u[i], s.middle_u[i], s.peak_u[i]
        reach = peak * (1.0 - 0.97 * size / (0.4 + size))
        simple = {
            "input_delay": {"delay": size * s.settling}, "input_gain": {"gain": 1 + 0.5 * sign * min(size, 1.8)},
            "input_curve": {"quadratic": 0.4 * sign * size * u / (s.absolute_u[i] * s.raw_peak_u[i])}, "gain_fade": {"rate": 0.6 * min(size, 1.5) / s.span},
            "input_offset": {"offset": 0.5 * sign * size * u}, "deadband": {"width": min(0.6 * size, 1.2) * u}, "backlash": {"width": 0.5 * size * u},
            "saturation": {"lower": middle - reach if b < 0.75 else None, "upper": middle + reach * (0.8 + 0.2 * a) if b > 0.25 else None},
            "rate_limit": {"rate": u / (size * s.settling)}, "actuator_lag": {"time_constant": size * s.settling},
            "dropped_commands": _losses(min(0.05 + 0.4 * size, 0.6), a, c),
        }
        if effect in MOVING:
            return made(**_moving(s, effect, size * s.settling, sign, shape))
        if effect in simple:
            return made(**simple[effect])
    if effect in STEPPING:
        nominal = 1.0 if effect == "gain_jump" else nominal_value(s.model, channel)
        return made(**_stepping(s, effect, nominal, size, sign, shape))
    frequency = min(10 ** (a * 1.3 - 0.6) / (2 * math.pi * s.settling), 0.3 / s.step)
    frequency = max(frequency, 4.0 / s.span)
    if effect == "parameter_error":
        return made(value=nominal_value(s.model, channel) * (1 + 0.5 * sign * min(size, 1.8)))
    if effect == "exchange":
        pair = [n.states.index(x) for x in channel.split("<->")]
        return made(gain=0.3 * sign * size * max(s.rate[j] for j in pair) / max(*(s.x_size[j] for j in pair), 1e-12))
    if effect in ("cross_coupling", "cubic_stiffness"):
        source, target = channel.split("->")
        j = n.states.index(target)
        origin = s.x_size[n.states.index(source)] if source in n.states else s.u[n.inputs.index(source)]
        if effect == "cross_coupling":
            return made(gain=0.3 * sign * size * s.rate[j] / max(origin, 1e-12))
        return made(coefficient=0.3 * sign * size * s.rate[j] / max(origin, 1e-12) ** 3)
    if effect == "unmodelled_mode":
        source, target = channel.split("->")
        kind, name = target.split(":")
        u = s.u[n.inputs.index(source)]
        gain = {"input": lambda: 0.4, "state": lambda: 0.3 * s.rate[n.states.index(name)] / u, "output": lambda: 0.3 * s.y[n.outputs.index(name)] / u}[kind]()
        return made(frequency=frequency, damping=0.02 + 0.2 * c**2, gain=sign * size * gain)
    if effect in ("coulomb_friction", "stribeck_friction", "hysteresis", "quadratic_drag", "constant_disturbance", "periodic_disturbance"):
        j = n.states.index(channel)
        force = 0.3 * size * s.rate[j]
        return made(**{
            "coulomb_friction": {"level": force}, "stribeck_friction": {"level": 0.5 * force, "extra": force, "velocity": (0.2 + 0.6 * a) * max(s.x_size[j], 1e-12)},
            "hysteresis": {"level": force, "displacement": (0.1 + 0.6 * a) * s.x_size[j] ** 2 / max(s.rate[j], 1e-12), "sharpness": 1.0 + 1.5 * c},
            "quadratic_drag": {"coefficient": force / max(s.x_size[j], 1e-12) ** 2},
            "constant_disturbance": {"level": 0.6 * sign * force}, "periodic_disturbance": {"frequency": frequency, "amplitude": force, "phase": 2 * math.pi * (b - 0.5)},
        }[effect])
    if effect.startswith("clock"):
        return made(ratio=1 + sign * 2 * size * s.settling / s.span) if effect == "clock_skew" else made(offset=sign * size * s.settling)
    if effect == "misalignment":
        source, target = (n.outputs.index(part) for part in channel.split("->"))
        return made(gain=0.3 * sign * size * s.y[target] / s.y[source])
    j = n.outputs.index(channel) if channel != "*" else 0
    y, reach = s.y[j], s.peak_y[j] * (1.0 - 0.97 * size / (0.4 + size))
    return made(**{
        "output_delay": {"delay": size * s.settling}, "sensor_lag": {"time_constant": size * s.settling}, "sensor_gain": {"gain": 1 + 0.5 * sign * min(size, 1.8)},
        "sensor_bias": {"offset": 0.3 * sign * size * y}, "sensor_drift": {"rate": 0.6 * sign * size * y / s.span},
        "sensor_saturation": {"lower": s.middle_y[j] - reach if b < 0.75 else None, "upper": s.middle_y[j] + reach * (0.8 + 0.2 * a) if b > 0.25 else None},
        "sensor_quantisation": {"step": min(0.6 * size, 1.2) * y},
        "static_nonlinearity": _bend(s.raw_peak_y[j], min(size, 1.8) * sign, a),
    }[effect])


def _bend(peak: float, size: float, share: float) -> dict:
    """A characteristic that is bent by about 0.3*size of the largest value there: by its square, by its cube, or by both. Neither is 0: errors are told relative to them."""
    square, cube = (0.8, 0.2) if share < 0.4 else (0.2, 0.8) if share < 0.7 else (0.5, -0.5)
    return {"quadratic": 0.3 * size * square / peak, "cubic": 0.3 * size * cube / peak**2}


def _losses(probability: float, a: float, c: float) -> dict:
    """Commands that get lost each for itself, or in two cases of five in bursts that are longer than chance makes them."""
    return {"probability": probability} if c < 0.6 else {"probability": probability, "burst": (1.5 + 2.5 * a) / (1.0 - probability)}


def _moving(s: Scales, effect: str, late: float, sign: float, shape: tuple[float, float, float]) -> dict:
    """A delay of at most about `late` seconds that moves; a change comes within the first half of the first log, so that every log has it."""
    a, b, c = shape
    few, many = 0.5 * a * late, late
    if effect == "delay_jump":
        return {"delay": few if sign > 0 else many, "time": (0.2 + 0.25 * b) * s.span, "later": many if sign > 0 else few}
    if effect == "delay_drift":
        return {"delay": few if sign > 0 else many, "rate": sign * (many - few) / s.span}
    if effect == "multi_rate":
        period = max(2.0 * late, 2.0 * s.step)
        period = s.step * round(period / s.step) if c < 0.6 else period
        return {"period": period, "phase": b * period}
    return {"delay": late, "spread": (0.2 + 0.4 * a) * late, "ordered": float(c < 0.7)}


def _stepping(s: Scales, effect: str, nominal: float, size: float, sign: float, shape: tuple[float, float, float]) -> dict:
    """A number that is another from a time on; in two cases of three it is right until then. The time lies within the first half of the first log, so that every log has it."""
    change = 0.5 * sign * min(size, 1.8) * nominal
    before = {"gain_jump": "gain", "parameter_jump": "value"}[effect]
    return {before: nominal + (0.3 * change if shape[2] > 0.67 else 0.0), "time": (0.2 + 0.25 * shape[1]) * s.span, "later": nominal + change}


def bounds(effect: str, parameter: str) -> tuple[float, float]:
    if effect in STEPPING and parameter == "later":
        return -math.inf, math.inf
    if effect in ("rate_limit",) or (effect in ("coulomb_friction", "stribeck_friction", "hysteresis") and parameter == "level"):
        parameter += "+"
    return BOUNDS.get(parameter, (-math.inf, math.inf))
